"""The exact posterior of a scalar state by point masses: the floor no filter can beat.

Gauss-Legendre nodes are laid anew at every step over the only intervals where the posterior can
have mass: those that the measurement allows, cut to the support of the prediction. The Chapman-
Kolmogorov integral (hdepf paper, eq. 3) then is a sum over the previous nodes.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian

Interval = tuple[Array, Array]
"""Lower and upper ends (M,); empty where the lower is not below the upper."""


class PointMasses(NamedTuple):
    """Nodes x (K, M) with probabilities p (K, M) that sum to one over K."""

    x: Array
    p: Array

    def moments(self) -> Gaussian:
        """Mean (1, M) and variance (1, 1, M)."""
        mean = (self.p * self.x).sum(axis=0)
        variance = (self.p * (self.x - mean) ** 2).sum(axis=0)
        return Gaussian(mean[None], variance[None, None])


def gauss_legendre(intervals: list[Interval], support: Interval, nodes: int) -> PointMasses:
    """Nodes and quadrature weights (as p) over each interval cut to the support.

    An interval that is empty for every run is left out; one empty for some runs has weight zero there.
    """
    unit, weight = np.polynomial.legendre.leggauss(nodes)
    xs, ws = [], []
    for low, high in intervals:
        a, b = np.maximum(low, support[0]), np.minimum(high, support[1])
        half = np.where(b > a, 0.5 * (b - a), 0.0)
        if half.any():
            xs.append(0.5 * (a + b) + half * unit[:, None])
            ws.append(half * weight[:, None])
    if not xs:  # no run can explain its measurement: every weight is zero
        low, high = support
        return PointMasses(np.stack([low, high]), np.zeros((2, *low.shape)))
    return PointMasses(np.concatenate(xs), np.concatenate(ws))


def condition(
    prior: PointMasses,
    quadrature: PointMasses,
    transition: Callable[[Array, Array], Array],
    likelihood: Callable[[Array], Array],
) -> PointMasses:
    """Posterior on the quadrature's nodes: likelihood times the prior pushed through the transition.

    ``transition(x, x_new)`` is the density p(x_new | x) for x (K, 1, M) and x_new (1, J, M);
    ``likelihood(x_new)`` is p(z | x_new) up to a factor for x_new (J, M). A run without mass is NaN.
    """
    density = np.einsum("km,kjm->jm", prior.p, transition(prior.x[:, None], quadrature.x[None]))
    mass = likelihood(quadrature.x) * density * quadrature.p
    with np.errstate(invalid="ignore", divide="ignore"):
        return PointMasses(quadrature.x, mass / mass.sum(axis=0))
