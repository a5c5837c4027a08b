"""The exact posterior of a scalar state by quadrature: a lower bound on the error of every filter.

The density is stored at Gauss-Legendre nodes of a few panels. At every step new panels cover the
intervals that the measurement allows, cut to the support of the prediction. If the noise is positive,
the integrand of the Chapman-Kolmogorov equation (hdepf paper, eq. 3) stops at an edge inside a panel.
The interpolating polynomial is then integrated up to that edge, so the rule converges as fast as for a
smooth integrand.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre

from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.elementary import cos_sin
from trackbench.core.sums import dot, product, total

_AT_ONCE = 32_768  # entries of a kernel of nodes by nodes: they stay in the cache

_MOST_WEIGHTS = 2**25

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
        return np.asarray(self.half * _rule(len(self.x)).weights[:, None] * self.density)


Posterior = tuple[Panel, ...]
Transition = Callable[[Array], Callable[[Array], Array]]
"""For states x, the transition density p(x' | x) as a function of x'."""


def point_mass(x: Array) -> Posterior:
    """Return the posterior with all mass at x (1, M): a panel of one node and no width."""
    return (Panel(x[0], x[0], x, np.ones_like(x)),)


def moments(posterior: Posterior) -> Gaussian:
    """Compute the mean (1, M) and variance (1, 1, M)."""
    x, p = nodes_of(posterior)
    mean = total(p * x, axis=0)
    return Gaussian(mean[None], total(p * np.square(x - mean), axis=0)[None, None])


def nodes_of(posterior: Posterior) -> tuple[Array, Array]:
    """Return the nodes (n, M) of all panels together, and the probability at each (n, M)."""
    x = np.concatenate([panel.x for panel in posterior])
    p = np.concatenate([panel.mass for panel in posterior])
    return x, p


def overlap(posterior: Posterior) -> bool:
    """Test whether two panels cover the same values in any run."""
    for first, second in combinations(posterior, 2):
        if (np.minimum(first.high, second.high) > np.maximum(first.low, second.low)).any():
            return True
    return False


def hull(posterior: Posterior) -> Interval:
    """Find the smallest interval (M,), (M,) that contains every nonempty panel."""
    nonempty = [(panel.half > 0.0) | panel.is_point for panel in posterior]
    low = [np.where(m, p.low, np.inf) for m, p in zip(nonempty, posterior, strict=True)]
    high = [np.where(m, p.high, -np.inf) for m, p in zip(nonempty, posterior, strict=True)]
    return np.min(low, axis=0), np.max(high, axis=0)


def nodes_between(intervals: Sequence[Interval], support: Interval, n: int) -> Posterior:
    """Lay a panel of n nodes over each interval, cut to the support, with the density one.

    ``intervals`` are those in which the measurement allows the state, with ends (M,) each. ``support``
    is the interval outside which the prediction has no density. A panel that is empty in some runs has
    width zero there; one that is empty in all is left out.
    """
    panels = []
    for low, high in intervals:
        # Cut the interval to the support.
        a = np.maximum(low, support[0])
        b = np.maximum(np.minimum(high, support[1]), a)
        if (b > a).any():
            # Map the nodes of [-1, 1] to [a, b].
            x = 0.5 * (a + b) + 0.5 * (b - a) * _rule(n).nodes[:, None]
            panels.append(Panel(a, b, x, np.ones_like(x)))
    if panels:
        return tuple(panels)
    # No interval meets the support: the measurements of all runs are impossible. Return one panel over
    # the support, of density zero.
    low, high = support
    return (Panel(low, high, np.stack([low, high]), np.zeros((2, *low.shape))),)


def refined(posterior: Posterior, n: int) -> Posterior:
    """Interpolate the density at n nodes of each panel that has fewer, by its polynomial.

    A panel whose mass is all at one point has no density to interpolate, and stays as it is.
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
                x=middle + panel.half * _rule(n).nodes[:, None],
                density=product(panel.density.T, weights).T,
            )
        panels.append(panel)
    return tuple(panels)


@lru_cache
def _interpolation(n: int, n_new: int) -> Array:
    """Return weights (n, n_new) of the values at n nodes for those of the polynomial at n_new nodes."""
    P = legendre.legvander(_rule(n_new).nodes, n - 1)
    # Legendre coefficients are (2 m + 1) / 2 sum_i w_i P_m(x_i) g_i.
    return product(P[None] * (2.0 * np.arange(n) + 1.0), _rule(n).basis)[0].T


def condition(
    prior: Posterior,
    panels: Posterior,
    transition: Transition,
    origins: Callable[[Array], Interval],
    likelihood: Callable[[Array], Array],
) -> Posterior:
    """Condition on new panels, ``p(z | x') int p(x' | x) p(x) dx / p(z)``.

    Parameters
    ----------
    prior : Posterior
        Posterior of the step before.
    panels : Posterior
        New panels, from `nodes_between`.
    transition : callable
        p(x' | x) as a function of x' (J, M), for x (n, 1, M). It must be smooth in x over the whole
        panel, also outside ``origins(x')``, where its values are interpolated and do not count.
    origins : callable
        Interval of x from which x' (J, M) can be reached: the integral is over it alone.
    likelihood : callable
        p(z | x') for x' (J, M).

    Returns
    -------
    Posterior
        Panels with normalized densities, NaN in a run without mass, and p(z) as evidence.
    """
    # Step 1: predict at the new nodes and multiply by the likelihood.
    joint = []
    for panel in panels:
        reachable = origins(panel.x)
        predicted = sum(_push_forward(old, panel.x, transition, reachable) for old in prior)
        # The new panel's own density is 1, or 0 if the measurement is impossible in all runs.
        joint.append(panel._replace(density=likelihood(panel.x) * predicted * panel.density))
    # Step 2: divide by the mass of all panels.
    with np.errstate(invalid="ignore", divide="ignore"):
        mass = np.asarray(sum(total(panel.mass, axis=0) for panel in joint))
        return tuple(p._replace(density=p.density / mass, evidence=mass) for p in joint)


def _push_forward(panel: Panel, x_new: Array, transition: Transition, origins: Interval) -> Array:
    """Integrate the transition density over one panel of the prior, at x_new (J, M).

    ``transition(x)`` returns p(x' | x) as a function of x'. ``origins`` are the lower and upper ends
    (J, M) of the x from which each x_new can be reached.
    """
    if panel.is_point:
        return np.asarray(transition(panel.x)(x_new) * panel.density)
    n = len(panel.x)
    middle = len(x_new) // 2
    if middle and n * x_new.size > _MOST_WEIGHTS:
        # The weights (J, M, n) would be too many: take one half of the new nodes after the other.
        low, high = origins
        first = (low[:middle], high[:middle])
        second = (low[middle:], high[middle:])
        return np.concatenate(
            [
                _push_forward(panel, x_new[:middle], transition, first),
                _push_forward(panel, x_new[middle:], transition, second),
            ]
        )
    # Step 1: weights of the panel's nodes for the integral over the origins only.
    low, high = origins
    start = _place_in(panel, low)
    end = _place_in(panel, high)
    weights = weights_up_to(end, n)
    if (start > -1.0).any():
        weights = weights - weights_up_to(start, n)
    # Step 2: sum weight times density times transition, for as many new nodes as fit the cache.
    integral = np.empty_like(x_new)
    size = max(1, _AT_ONCE // panel.x.size)
    density_of = transition(panel.x[:, None])  # nodes first: a sum of whole rows
    for i in range(0, len(x_new), size):
        piece = slice(i, i + size)
        kernel = density_of(x_new[piece])
        kernel *= panel.density[:, None]
        kernel *= np.moveaxis(weights[piece], -1, 0)
        integral[piece] = total(kernel, axis=0)
    # A panel may be empty in some runs: its places are NaN there.
    return np.where(panel.half > 0.0, panel.half * integral, 0.0)


def mass_below(posterior: Posterior, x: Array) -> Array:
    """Sum the probability (M,) below x (M,), by each panel's interpolating polynomial."""
    return np.asarray(sum(_up_to(panel, x, panel.density) for panel in posterior))


def distance_from(posterior: Posterior, x: Array) -> Array:
    """Compute ``E|X - x|`` (M,) for x (M,): E[X - x] less twice its part below x."""
    terms = []
    for panel in posterior:
        e = panel.x - x
        below = _up_to(panel, x, panel.density * e)
        terms.append(total(panel.mass * e, axis=0) - 2.0 * below)
    return np.asarray(sum(terms))


def half_distance_within(posterior: Posterior) -> Array:
    """Compute ``E|X - X'| / 2`` (M,) for two independent draws, by panels that do not overlap."""
    # Of two draws from different panels, which do not overlap, E|X - X'| is the distance of the panels'
    # means: sums over masses.
    masses = [total(panel.mass, axis=0) for panel in posterior]
    sums = [total(panel.mass * panel.x, axis=0) for panel in posterior]
    across = []
    for i in range(len(masses)):
        for j in range(i):
            across.append(abs(masses[i] * sums[j] - masses[j] * sums[i]))
    return np.asarray(sum(_half_distance_in(panel) for panel in posterior) + sum(across))


def _half_distance_in(panel: Panel) -> Array:
    """Return the part of ``E|X - X'| / 2`` (M,) of two draws that are both from this panel.

    It is the integral of ``F (m - F)`` over the panel of mass m, F being the panel's mass below x.
    """
    if panel.is_point:
        return np.zeros_like(panel.low)
    n = len(panel.x)
    # `product` takes an array (r, ..., n): one row (1, M, n) with the densities of all runs.
    densities = np.ascontiguousarray(panel.density.T)[None]
    # F at each node: the integral of the density from the left end to there.
    F = panel.half * product(densities, weights_up_to(_rule(n).nodes, n).T)[0].T
    integrand = F * (total(panel.mass, axis=0) - F)
    return np.asarray(panel.half * total(_rule(n).weights[:, None] * integrand, axis=0))


def _up_to(panel: Panel, x: Array, values: Array) -> Array:
    """Return the integral (M,) up to x (M,) of a function with ``values`` (n, M) at a panel's nodes."""
    if panel.is_point:
        return np.where(panel.low < x, values[0], 0.0)
    weights = weights_up_to(_place_in(panel, x), len(panel.x))
    return np.where(panel.half > 0.0, panel.half * dot(weights, values.T), 0.0)


def _place_in(panel: Panel, x: Array) -> Array:
    """Return where in a panel x is, from -1 to 1: its nearer end if x is outside, NaN without width."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.clip((x - 0.5 * (panel.low + panel.high)) / panel.half, -1.0, 1.0)


def weights_up_to(t: Array, n: int) -> Array:
    """Return weights (*t.shape, n) of the n-point rule's nodes for the integral from -1 to t.

    The interpolating polynomial has Legendre coefficients ``(2 m + 1) / 2 sum_i w_i P_m(x_i) g_i``
    and ``(2 m + 1) int_-1^t P_m = P_{m+1}(t) - P_{m-1}(t)``; at t = 1 these are Gauss's weights. So the
    weights are the sum over m of these integrals times ``w_i P_m(x_i) / 2`` (`_Rule.basis`).

    A row of t is ``t[j]``. t is 1 where the integral is over the whole panel.
    """
    whole = (t == 1.0).all(axis=tuple(range(1, t.ndim)))
    if whole.all():
        return np.broadcast_to(_rule(n).weights, (*t.shape, n))
    # Most rows of t are ones alone: compute the weights of one such row for all of them.
    rows = np.concatenate([t[~whole], np.ones((1, *t.shape[1:]))])
    P = legendre.legvander(rows, n)
    integrals = np.concatenate([rows[..., None] + 1.0, P[..., 2:] - P[..., :-2]], axis=-1)
    weights = product(integrals, _rule(n).basis)
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
def _rule(n: int) -> _Rule:
    """Return the Gauss-Legendre rule of n nodes."""
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
