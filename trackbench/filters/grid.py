"""Exact posterior of a scalar state by quadrature: the point-mass filter, a lower bound on every RMSE.

At every step new panels of nodes cover the intervals that the measurement allows, cut to the support of
the prediction (`grid_support`).
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, ClassVar, NamedTuple, Protocol, cast, runtime_checkable

import numpy as np
from annotated_types import Ge
from numpy.random import Generator

from trackbench.core import elementary, grid_quadrature
from trackbench.core.angles import mean_direction, near
from trackbench.core.arrays import Array
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.gamma_noise import Shifted
from trackbench.core.grid_quadrature import Interval, Panel, Panels, place_in, weights_up_to
from trackbench.core.particles import Particles
from trackbench.core.posterior_scores import LinePosterior, ParticlePosterior, Posterior
from trackbench.core.sums import dot, total
from trackbench.filters.base import WHOLE_FILTER, Filter, WrongReturnError
from trackbench.filters.grid_support import (
    BoundedMotion,
    SensorWithPreimage,
    likely_intervals,
    nodes_between,
    number_of_parts,
    support_if_missing,
    support_of_prediction,
)
from trackbench.models.base import GammaMotion, Model, Scene, angle_rows
from trackbench.models.likelihood import log_likelihood
from trackbench.registry import register

_AT_ONCE = 32_768  # entries of a kernel of nodes by nodes: they stay in the cache
_MOST_WEIGHTS = 2**25
Transition = Callable[[Array], Callable[[Array], Array]]
"""For states x, the transition density p(x' | x) as a function of x'."""


_MAX_GAMMA_SHAPE = 20  # of a process noise; see `Grid.conflicts`
_REFINE_ABOVE = 1e-6  # difference of means in standard deviations, and of variances relatively
_TOLERANCE = 1e-5  # the two densities drift apart from step to step
_DOUBLINGS = 2  # of the nodes in one step, at most
_PRIOR_REACH = 8.0  # standard deviations of a Gaussian prior beyond which its mass is below 1e-14
_LEAST_NODES = 8
_FEW_ROOTS = 4  # of a measurement equation: so many have all of the nodes each


@runtime_checkable
class BoundedPrior(Protocol):
    """A prior of a scalar that has its mass in known intervals."""

    def intervals(self, deviations: float) -> list[grid_quadrature.Interval]:
        """Return the intervals that the prior's mass is in.

        Parameters
        ----------
        deviations : float
            Number of standard deviations about the mean at which a normal part ends.

        Returns
        -------
        list of Interval
            Lower and upper ends (M,) of disjoint intervals, in ascending order.
        """


class Resolved(NamedTuple):
    """Posterior, and the posterior by more nodes that it is checked against."""

    posterior: grid_quadrature.Panels
    check: grid_quadrature.Panels


@register("filters", "grid")
@dataclass(frozen=True, kw_only=True)
class Grid(Filter[Resolved]):
    """Exact posterior of a scalar state by quadrature (hdepf paper, eqs. 3-5): no RMSE is smaller.

    Gauss-Legendre nodes lie where the measurement has a likelihood, around each root of the measurement
    equation. Where an eighth more nodes change a mean by a millionth of its standard deviation, or a
    variance by a millionth, or where the motion's noise does not reach from node to node, the nodes are
    doubled, up to four times as many. The filter fails where a difference above 1e-5 is left.
    """

    mixes_runs: ClassVar[bool] = True

    nodes: Annotated[int, Ge(_LEAST_NODES)] = 128
    """nodes per root of the measurement equation, fewer beyond four, more in steps that need them"""
    deviations: Annotated[float, Ge(4)] = 6.5
    """half the span of the nodes, in standard deviations of the measurement noise"""
    reach: Annotated[float, Ge(4)] | None = None
    """half the span of the states that are moved on, in standard deviations about their mean; default:
    all. A measurement that excludes no large states lets the nodes spread without it"""

    density_only: ClassVar[bool] = True

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Reject several components, gamma noise of a large shape, and motions without a density.

        The quadrature continues a gamma density by its formula below the density's edge, where a large
        shape is too steep: with the shape 30 the estimate is wrong if R is large, and no check shows it.
        So shapes up to `_MAX_GAMMA_SHAPE` are allowed.
        """
        motion = scenario.model.motion
        if len(motion.components) > 1:
            message = f"grid needs a state of one component; this one has {len(motion.components)}"
            if len(motion.components) == 2:
                message += "; use grid-2d"
            return {WHOLE_FILTER: message}
        if isinstance(motion, GammaMotion) and motion.noise.shape > _MAX_GAMMA_SHAPE:
            return {
                WHOLE_FILTER: f"grid is exact for gamma noise of a shape up to {_MAX_GAMMA_SHAPE} only"
            }
        # Try the transition from the start, at the scenario's first step, to the next step: it shows
        # which density the motion has.
        step_after_start = int(scenario.steps[0]) + 1
        transition = motion.transition(np.zeros((1, 1)), step_after_start)
        if isinstance(transition, Gaussian):
            if np.all(transition.cov > 0.0):
                return {}
            return {WHOLE_FILTER: "grid needs process noise, and this motion has none"}
        if not (hasattr(transition, "prob") and isinstance(motion, BoundedMotion)):
            members = "the transition's `prob` and the motion's `support` and `origins`"
            return {WHOLE_FILTER: f"grid needs {members}, or a Gaussian transition"}
        return {}

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Resolved:
        """Put all mass on a known first state, or place nodes over the prior.

        The nodes lie in the intervals of a bounded prior, or within `_PRIOR_REACH` standard deviations
        of the mean. The posterior is computed twice in every step, the second time with more nodes: the
        difference shows whether the nodes resolve it.
        """
        if not np.any(prior.cov):
            point = grid_quadrature.point_mass(prior.mean)
            return Resolved(posterior=point, check=point)
        if isinstance(prior, BoundedPrior):
            spans = prior.intervals(_PRIOR_REACH)
        else:
            mean = prior.mean[0]
            reach = _PRIOR_REACH * np.sqrt(prior.cov[0, 0])
            spans = [(mean - reach, mean + reach)]
        # Cut each interval into as many panels as the motion needs.
        shares = np.linspace(0.0, 1.0, number_of_parts(model.motion) + 1)
        intervals = []
        for low, high in spans:
            for a, b in pairwise(shares):
                intervals.append(((1.0 - a) * low + a * high, (1.0 - b) * low + b * high))
        support = (intervals[0][0], intervals[-1][1])
        densities = []
        for n in _node_counts(self.nodes):  # of the posterior, and of its check
            panels = nodes_between(intervals, support, n)
            densities.append(tuple(_with_density(panel, prior) for panel in panels))
        posterior, check = densities
        return Resolved(posterior=posterior, check=check)

    def step(self, model: Model, state: Resolved, z: Array, k: int, rng: Generator) -> Resolved:
        """Place nodes where z and the prediction allow mass, and condition on z.

        Nodes that do not resolve the posterior are doubled for this step, up to four times as many.

        Raises WrongReturnError if these are too few as well.
        """
        nodes = self.nodes
        old = state
        for doubled in range(_DOUBLINGS + 1):
            # Step 1: condition twice, with n nodes and with n + n / 8 as a check.
            n, n_check = _node_counts(nodes)
            new = Resolved(
                posterior=self._condition(model, old.posterior, z, k, n),
                check=self._condition(model, old.check, z, k, n_check),
            )
            # Transitions that do not overlap from node to node miss a part of the mass in both.
            difference = np.inf
            if self._has_dense_nodes(model, old.posterior, k):
                difference = _largest_difference(new)
            # With the most nodes a larger difference is allowed than the one that doubles them.
            tolerance = _REFINE_ABOVE if doubled < _DOUBLINGS else _TOLERANCE
            if difference <= tolerance:
                angles = angle_rows(model.motion)
                return Resolved(
                    posterior=_on_one_turn(new.posterior, angles),
                    check=_on_one_turn(new.check, angles),
                )
            # Step 2: double the nodes, those of the last posterior by its interpolating polynomial.
            nodes *= 2
            n, n_check = _node_counts(nodes)
            old = Resolved(
                posterior=grid_quadrature.refined(state.posterior, n),
                check=grid_quadrature.refined(state.check, n_check),
            )
        # Step 3: reject a posterior that the nodes do not resolve.
        message = f"grid does not resolve the posterior at step {k} with `nodes: {self.nodes}`"
        # `reach` leaves out states of the last posterior that are so many standard deviations or more
        # from its mean: the nodes then lie closer to each other.
        way_on = "" if self.reach else ", set `reach: 8`"
        raise WrongReturnError("step", f"{message}; raise `nodes`{way_on}, or narrow the start")

    def _has_dense_nodes(self, model: Model, old: grid_quadrature.Panels, k: int) -> bool:
        """Test whether the transitions from neighboring nodes overlap.

        The distance of their means must not exceed the standard deviation of the process noise. ``old``
        is the posterior of step k - 1, whose panels have nodes x (n, M).
        """
        for panel in old:
            transition = model.motion.transition(panel.x[None], k)
            gaps = np.abs(np.diff(transition.mean[0], axis=0))  # (n - 1, M)
            # The noise may depend on the state: take the smaller one of both nodes.
            deviations = np.broadcast_to(np.sqrt(transition.cov[0, 0]), panel.x.shape)  # (n, M)
            if (gaps > np.minimum(deviations[1:], deviations[:-1])).any():
                return False
        return True

    def _condition(
        self, model: Model, old: grid_quadrature.Panels, z: Array, k: int, n: int
    ) -> grid_quadrature.Panels:
        """Predict the posterior of step k - 1 and condition it on z (1, M), with n nodes per root.

        A root is an interval of states near which h(x) = z, such as one of two for a square.
        """
        motion, sensor = model
        # Intervals of x that z allows, within the support of the prediction.
        support = support_of_prediction(motion, old, k, self.reach)
        if isinstance(sensor, SensorWithPreimage):
            intervals = sensor.preimage(z, self.deviations, k)
        else:
            intervals = likely_intervals(sensor, z, self.deviations, k, support)
        number_of_roots = len(intervals)
        # Runs without a measurement get the whole support in place of roots, cut into parts.
        intervals = support_if_missing(z, intervals, support, number_of_parts(motion))
        # Many roots are narrow, for example those of an angle that may have turned several times: they
        # share the nodes of a few.
        if number_of_roots > _FEW_ROOTS:
            n = max(_FEW_ROOTS * n // number_of_roots, _LEAST_NODES)

        def transition(x: Array) -> Callable[[Array], Array]:
            """Return the density of the next state, given the states x."""
            distribution = motion.transition(x[None], k)
            if isinstance(distribution, Gaussian):
                return lambda x_new: elementary.exp(distribution.log_prob(x_new[None]))
            return lambda x_new: cast(Shifted, distribution).prob(x_new[None])

        def origins(x_new: Array) -> grid_quadrature.Interval:
            """Return the interval of states from which the motion may lead to ``x_new``."""
            if isinstance(motion, BoundedMotion):
                return motion.origins(x_new, k)
            return np.full_like(x_new, -np.inf), np.full_like(x_new, np.inf)

        def likelihood(x_new: Array) -> Array:
            # (J, M) nodes as (1, M, J): the sensor takes them for particles.
            return elementary.exp(log_likelihood(sensor, z, x_new.T[None], k).T)

        return condition(
            old,
            nodes_between(intervals, support, n),
            transition,
            origins,
            likelihood,
        )

    def estimate(self, state: Resolved) -> Gaussian:
        """Return the posterior mean and variance."""
        return grid_quadrature.moments(state.posterior)

    def posterior(self, state: Resolved) -> Posterior:
        """Return the density itself, or its nodes as particles if panels of an angle overlap."""
        if not grid_quadrature.overlap(state.posterior):
            return LinePosterior(state.posterior)
        x, w = grid_quadrature.nodes_of(state.posterior)
        return ParticlePosterior(Particles(x.T[None], w.T))

    def log_likelihood(self, state: Resolved) -> Array:
        """Evaluate log p(z_k | z_1..k-1) (M,), exact."""
        first = state.posterior[0]  # each panel has p(z_k | z_1..k-1), over all panels
        if first.evidence is None:
            return np.full(first.low.shape, np.nan)
        return elementary.log(first.evidence)


def _on_one_turn(
    posterior: grid_quadrature.Panels, angles: tuple[int, ...]
) -> grid_quadrature.Panels:
    """Shift the panels of a posterior of an angle by whole turns to near its mean direction.

    ``angles`` is empty if the state is no angle: then the posterior is returned as it is.
    """
    if not angles:
        return posterior
    nodes, weights = grid_quadrature.nodes_of(posterior)
    x = nodes.T
    w = weights.T
    center = mean_direction(x[None], w, dot(x, w)[None], angles)
    shifted = []
    for panel in posterior:
        middle = 0.5 * (panel.low + panel.high)[None]
        turns = (near(middle, center, angles) - middle)[0]
        # An empty panel stays where it is.
        turns = np.where((panel.half > 0.0) | panel.is_point, turns, 0.0)
        shifted.append(
            panel._replace(low=panel.low + turns, high=panel.high + turns, x=panel.x + turns)
        )
    return tuple(shifted)


def _node_counts(nodes: int) -> tuple[int, int]:
    """Return the numbers of nodes of the posterior and of its check."""
    return nodes, nodes + nodes // 8


def _largest_difference(both: Resolved) -> float:
    """Return the largest difference of a run's mean or variance from those of the check.

    The check is the posterior computed with more nodes. Differences of means are relative to the
    standard deviation, those of variances to the variance. The result is infinite if one of both is NaN
    in a run, and zero if both are.
    """
    moments = grid_quadrature.moments(both.posterior)
    check = grid_quadrature.moments(both.check)
    variance = moments.cov[0, 0]
    check_variance = check.cov[0, 0]
    with np.errstate(invalid="ignore", divide="ignore"):
        of_means = np.abs(check.mean - moments.mean)[0] / np.sqrt(variance)
        of_variances = np.abs(check_variance - variance) / variance
        largest = np.maximum(of_means, of_variances)
    # Both are NaN in a run without mass.
    largest[np.isnan(variance) & np.isnan(check_variance)] = 0.0
    return float(np.where(np.isnan(largest), np.inf, largest).max())


def _with_density(panel: grid_quadrature.Panel, prior: Distribution) -> grid_quadrature.Panel:
    """Fill the panel with the prior's density at its nodes (n, M)."""
    density = elementary.exp(prior.log_prob(panel.x[None]))
    if not np.isfinite(density).all():
        raise WrongReturnError("init", "a part of the prior has no density: raise its `sigma`")
    return panel._replace(density=density)


def condition(
    prior: Panels,
    panels: Panels,
    transition: Transition,
    origins: Callable[[Array], Interval],
    likelihood: Callable[[Array], Array],
) -> Panels:
    """Condition on new panels, ``p(z | x') int p(x' | x) p(x) dx / p(z)``.

    Parameters
    ----------
    prior : Panels
        Panels of the step before.
    panels : Panels
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
    Panels
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
    start = place_in(panel, low)
    end = place_in(panel, high)
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
