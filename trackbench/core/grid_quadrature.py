"""Density of a scalar state at Gauss-Legendre nodes of a few panels, and its integrals.

If the noise is positive, the integrand of the Chapman-Kolmogorov equation (hdepf paper, eq. 3) stops at
an edge inside a panel. The interpolating polynomial is then integrated up to that edge, so the rule
converges as fast as for a smooth integrand.
"""

from functools import lru_cache
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre

from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.elementary import cos_sin
from trackbench.core.linalg import product
from trackbench.core.sums import dot, total

Interval = tuple[Array, Array]
"""Lower and upper ends; empty where the lower is not below the upper."""


class Panel(NamedTuple):
    """A density (n, M) at n Gauss-Legendre nodes x (n, M) between low and high (M,).

    ``evidence`` (M,) is the predictive density of the last measurement, over all panels.
    """

    low: Array
    high: Array
    x: Array
    density: Array
    evidence: Array | None = None

    @property
    def half(self) -> Array:
        """Half the panel's width (M,)."""
        return 0.5 * (self.high - self.low)

    @property
    def is_point(self) -> bool:
        """True if all mass is at one value: a panel of one node without width."""
        return len(self.x) == 1

    @property
    def mass(self) -> Array:
        """Probability at each node (n, M)."""
        if self.is_point:
            return self.density
        return np.asarray(self.half * gauss_legendre(len(self.x)).weights[:, None] * self.density)


Panels = tuple[Panel, ...]


def point_mass(x: Array) -> Panels:
    """Return the posterior with all mass at x (1, M): a panel of one node and no width."""
    return (Panel(x[0], x[0], x, np.ones_like(x)),)


def moments(posterior: Panels) -> Gaussian:
    """Compute the mean (1, M) and variance (1, 1, M)."""
    x, p = nodes_of(posterior)
    mean = total(p * x, axis=0)
    return Gaussian(mean[None], total(p * np.square(x - mean), axis=0)[None, None])


def nodes_of(posterior: Panels) -> tuple[Array, Array]:
    """Return the nodes (n, M) of all panels together, and the probability at each (n, M)."""
    x = np.concatenate([panel.x for panel in posterior])
    p = np.concatenate([panel.mass for panel in posterior])
    return x, p


def overlap(posterior: Panels) -> bool:
    """Test whether two panels cover the same values in any run."""
    for first, second in combinations(posterior, 2):
        if (np.minimum(first.high, second.high) > np.maximum(first.low, second.low)).any():
            return True
    return False


def hull(posterior: Panels) -> Interval:
    """Find the smallest interval (M,), (M,) that contains every nonempty panel.

    It is (inf, -inf) in a run whose panels are all empty.
    """
    nonempty = [(panel.half > 0.0) | panel.is_point for panel in posterior]
    low = [np.where(m, p.low, np.inf) for m, p in zip(nonempty, posterior, strict=True)]
    high = [np.where(m, p.high, -np.inf) for m, p in zip(nonempty, posterior, strict=True)]
    return np.min(low, axis=0), np.max(high, axis=0)


def refined(posterior: Panels, n: int) -> Panels:
    """Interpolate the density at n nodes of each panel that has fewer, by its polynomial.

    Parameters
    ----------
    posterior : tuple of Panel
        Panels of any number of nodes each, over M runs.
    n : int
        Least number of nodes of a panel in the result.

    Returns
    -------
    tuple of Panel
        Panels with the same ends. A panel whose mass is all at one point has no density to interpolate,
        and stays as it is.
    """
    panels = []
    for panel in posterior:
        if not panel.is_point and len(panel.x) < n:
            middle = 0.5 * (panel.low + panel.high)
            # The density (n', M) times weights (n', n): (n, M). A run is a row of the product, whose
            # rounding depends on the row's largest number. So the result of a run does not depend on the
            # other runs of its block.
            weights = _interpolation(len(panel.x), n)
            panel = panel._replace(
                x=middle + panel.half * gauss_legendre(n).nodes[:, None],
                density=product(panel.density.T, weights).T,
            )
        panels.append(panel)
    return tuple(panels)


@lru_cache
def _interpolation(n: int, n_new: int) -> Array:
    """Return weights (n, n_new) of the values at n nodes for those of the polynomial at n_new nodes."""
    P = legendre.legvander(gauss_legendre(n_new).nodes, n - 1)
    # Legendre coefficients are (2 m + 1) / 2 sum_i w_i P_m(x_i) g_i.
    return product(P[None] * (2.0 * np.arange(n) + 1.0), gauss_legendre(n).basis)[0].T


def mass_below(posterior: Panels, x: Array) -> Array:
    """Sum the probability below x, by each panel's interpolating polynomial.

    Parameters
    ----------
    posterior : tuple of Panel
        Panels over M runs.
    x : array (M,)
        Limit in each run, in the unit of the state.

    Returns
    -------
    array (M,)
        Probabilities. The error of the polynomial may carry them beyond [0, 1].
    """
    return np.asarray(sum(_up_to(panel, x, panel.density) for panel in posterior))


def distance_from(posterior: Panels, x: Array) -> Array:
    """Compute ``E|X - x|``: E[X - x] less twice its part below x.

    Parameters
    ----------
    posterior : tuple of Panel
        Panels over M runs, the density of X.
    x : array (M,)
        Value in each run, in the unit of the state.

    Returns
    -------
    array (M,)
        Mean distances, in the unit of the state.
    """
    terms = []
    for panel in posterior:
        e = panel.x - x
        below = _up_to(panel, x, panel.density * e)
        terms.append(total(panel.mass * e, axis=0) - 2.0 * below)
    return np.asarray(sum(terms))


def _up_to(panel: Panel, x: Array, values: Array) -> Array:
    """Return the integral (M,) up to x (M,) of a function with ``values`` (n, M) at a panel's nodes."""
    if panel.is_point:
        return np.where(panel.low < x, values[0], 0.0)
    weights = weights_up_to(place_in(panel, x), len(panel.x))
    return np.where(panel.half > 0.0, panel.half * dot(weights, values.T), 0.0)


def place_in(panel: Panel, x: Array) -> Array:
    """Return the relative place of x in a panel.

    Parameters
    ----------
    panel : Panel
        Panel between its ends low and high (M,).
    x : array (..., M)
        Values in the unit of the state.

    Returns
    -------
    array (..., M)
        Places from -1, the lower end, to 1, the upper end. It is the nearer end if x is outside. In a
        panel without width it is NaN for x at the panel's value, and else -1 below it or 1 above it.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.clip((x - 0.5 * (panel.low + panel.high)) / panel.half, -1.0, 1.0)


def weights_up_to(t: Array, n: int) -> Array:
    """Return weights of the n-point rule's nodes for the integral from -1 to t.

    The interpolating polynomial has Legendre coefficients ``(2 m + 1) / 2 sum_i w_i P_m(x_i) g_i``
    and ``(2 m + 1) int_-1^t P_m = P_{m+1}(t) - P_{m-1}(t)``; at t = 1 these are Gauss's weights. So the
    weights are the sum over m of these integrals times ``w_i P_m(x_i) / 2`` (`_Rule.basis`).

    Parameters
    ----------
    t : array (J, ...)
        Upper ends of the integrals, from -1 to 1. It is 1 where the integral is over the whole panel.
        A row of t is ``t[j]``.
    n : int
        Number of nodes of the rule.

    Returns
    -------
    array (J, ..., n)
        Weights of the values at the nodes, NaN where t is. They are read-only if t is 1 everywhere.
    """
    whole = (t == 1.0).all(axis=tuple(range(1, t.ndim)))
    if whole.all():
        return np.broadcast_to(gauss_legendre(n).weights, (*t.shape, n))
    # Most rows of t are ones alone: compute the weights of one such row for all of them.
    rows = np.concatenate([t[~whole], np.ones((1, *t.shape[1:]))])
    P = legendre.legvander(rows, n)
    integrals = np.concatenate([rows[..., None] + 1.0, P[..., 2:] - P[..., :-2]], axis=-1)
    weights = product(integrals, gauss_legendre(n).basis)
    out = np.empty((*t.shape, n))
    out[~whole] = weights[:-1]
    out[whole] = weights[-1]
    return out


class _Rule(NamedTuple):
    """Gauss-Legendre rule on [-1, 1]."""

    nodes: Array
    weights: Array
    basis: Array
    """``w_i P_m(x_i) / 2``, shape (m, i): times values it gives Legendre coefficients over 2 m + 1"""


@lru_cache
def gauss_legendre(n: int) -> _Rule:
    """Return the Gauss-Legendre rule of n nodes on [-1, 1].

    Parameters
    ----------
    n : int
        Number of nodes, at least 1.

    Returns
    -------
    _Rule
        ``nodes`` (n,) in ascending order, ``weights`` (n,), whose sum is 2, and ``basis`` (n, n), which
        turns values at the nodes into Legendre coefficients divided by 2 m + 1.
    """
    # Step 1: roots of P_n by Newton's method from Tricomi's first guess.
    nodes = -cos_sin(np.pi * (np.arange(n) + 0.75) / (n + 0.5))[0]
    for _ in range(8):
        # Columns are P_0 ... P_n; P_n'(x) = n (P_{n-1}(x) - x P_n(x)) / (1 - x^2).
        P = legendre.legvander(nodes, n)
        slope = n * (P[:, -2] - nodes * P[:, -1]) / (1.0 - nodes * nodes)
        nodes = nodes - P[:, -1] / slope
    # Step 2: make the nodes symmetric; w_i = 2 / ((1 - x_i^2) P_n'(x_i)^2).
    nodes = 0.5 * (nodes - nodes[::-1])
    weights = 2.0 / ((1.0 - nodes * nodes) * np.square(slope))
    # w_i P_m(x_i) / 2, shape (m, i). The sum over i with the values of a function at the nodes is its
    # m-th Legendre coefficient, but for the factor 2 m + 1, which the integral of P_m contains.
    basis = 0.5 * weights * legendre.legvander(nodes, n - 1).T
    return _Rule(nodes=nodes, weights=weights, basis=basis)
