"""Gauss-Hermite rule: nodes and weights for moments of a function of a Gaussian."""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise, product
from math import factorial, prod, sqrt

import numpy as np

from trackbench.core import linalg
from trackbench.core.arrays import with_axes_of
from trackbench.core.distributions import Gaussian, root_of
from trackbench.core.sigma_points import SigmaPoints


@dataclass(frozen=True)
class GaussHermite:
    """Product rule with ``order`` points along each axis, exact to degree 2 order - 1 in each.

    Ito & Xiong 2000; Abramowitz & Stegun, 25.4.46, for the weight exp(-x^2 / 2).
    """

    order: int

    @cached_property
    def nodes(self) -> list[tuple[float, float]]:
        """Pairs (node, weight) for N(0, 1): roots of He_n, and weights whose sum is one."""
        n = self.order
        norm = factorial(n) / (n * n)
        return [(x, norm / _hermite(n - 1, x) ** 2) for x in _hermite_roots(n)]

    def points(self, gaussian: Gaussian) -> "SigmaPoints":
        """Place order^n points of N(m, P).

        Parameters
        ----------
        gaussian : Gaussian
            Mean m (n, *batch), covariance P (n, n[, *batch]), which may be singular.

        Returns
        -------
        SigmaPoints
            Points (n, order^n, *batch) with the same weights (order^n,) for mean and covariance. The
            first point is the mean, which callers take as the center (`PointRule`). An even order has
            no node at the mean, which is then one more point of weight zero.
        """
        mean = gaussian.mean
        root = root_of(gaussian)
        # Step 1: every combination of the axes' (node, weight). The center, of zeros alone, sorts first.
        grid = list(product(self.nodes, repeat=len(mean)))
        grid.sort(key=lambda point: any(x for x, _ in point))
        if self.order % 2 == 0:  # no node of an axis is zero: add the center with the weight zero
            grid.insert(0, ((0.0, 0.0),) * len(mean))
        nodes, factors = np.moveaxis(np.array(grid), -1, 0)  # (points, n) each
        # Step 2: x_i = m + L e_i, and a weight is the product of the axes' weights. The copy has the
        # numbers of a node next to each other in memory.
        points = [mean + linalg.matvec(root, with_axes_of(mean, e)) for e in nodes.copy()]
        weights = np.array([prod(row) for row in factors.tolist()])
        return SigmaPoints(np.stack(points, axis=1), weights=weights, cov_weights=weights)


@lru_cache
def gauss_hermite(order: int) -> GaussHermite:
    """Return the rule of this order, always the same object."""
    return GaussHermite(order)


def _hermite(n: int, x: float) -> float:
    """Evaluate He_n(x), by ``He_{k+1} = x He_k - k He_{k-1}``."""
    previous = 0.0
    current = 1.0
    for k in range(n):
        following = x * current - k * previous
        previous = current
        current = following
    return current


def _hermite_roots(n: int) -> list[float]:
    """Find the roots of He_n, by bisection between the roots of He_{n-1}."""
    if n == 0:
        return []
    edge = 2.0 * sqrt(n)
    roots = []
    # The roots of He_{n-1} separate those of He_n, all of them below 2 sqrt(n).
    for low, high in pairwise([-edge, *_hermite_roots(n - 1), edge]):
        rising = _hermite(n, high) > 0.0
        middle = 0.5 * (low + high)
        # Halve the bracket until no float lies between its ends.
        while low < middle < high:
            value = _hermite(n, middle)
            if value == 0.0:
                break
            if (value > 0.0) == rising:
                high = middle
            else:
                low = middle
            middle = 0.5 * (low + high)
        roots.append(middle)
    return roots
