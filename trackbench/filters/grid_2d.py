"""Exact posterior of a state of two components, on a grid that moves with it."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from annotated_types import Ge
from numpy.random import Generator

from trackbench.core import grid_2d_quadrature, linalg
from trackbench.core.arrays import Array
from trackbench.core.distributions import Distribution, Gaussian, per_run_moments
from trackbench.core.grid_2d_quadrature import Map, Plane, UnresolvedError
from trackbench.core.posterior_scores import PlanePosterior, Posterior
from trackbench.core.sums import mean, total
from trackbench.filters.base import WHOLE_FILTER, Filter, WrongReturnError
from trackbench.models.base import Model, SampledMotion, Scene, angle_rows
from trackbench.models.likelihood import log_likelihood
from trackbench.models.numerical_derivatives import central_differences
from trackbench.registry import register

_TOLERANCE = 1e-6  # of means in standard deviations, and of covariances likewise, by half the nodes
_NEGLIGIBLE = 1e-6  # probability of an angle beyond half a turn from its mean
State = Plane | Array


class Planes(NamedTuple):
    """Posterior of each run, and the posterior by half as many nodes that it is checked against."""

    posteriors: tuple[State, ...]
    checks: tuple[State, ...]


@register("filters", "grid-2d")
@dataclass(frozen=True, kw_only=True)
class PlaneGrid(Filter[Planes]):
    """Exact posterior of a state of two components with additive Gaussian noise: no RMSE is smaller.

    A grid of `nodes` by `nodes` moves with the posterior. The density moves along the inverse of the
    motion's map and is convolved with the noise, however narrow. If the map has no inverse, the
    prediction is a sum over all nodes, which takes some ten times as long and needs noise that reaches
    from node to node (`core/grid_2d_quadrature.py`). The filter fails where half as many nodes change a
    mean or a covariance by a millionth. Likelihoods of any law are used as they are.
    """

    loops_over_runs: ClassVar[bool] = True
    density_only: ClassVar[bool] = True

    nodes: Annotated[int, Ge(32)] = 128
    """nodes along each axis; a step of a run takes about 0.03 s of CPU time at 128, and 0.12 s at 256"""

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Reject other than two components, and a prior or noise that is not Gaussian."""
        motion = scenario.model.motion
        n = len(motion.components)
        if n != 2:
            return {WHOLE_FILTER: f"grid-2d needs a state of two components; this one has {n}"}
        if not issubclass(scenario.prior_type, Gaussian):
            return {WHOLE_FILTER: "grid-2d needs a Gaussian start"}
        # The scenario's first step has the start; the first transition leads to the next step.
        step_after_start = int(scenario.steps[0]) + 1
        transition = motion.transition(np.zeros((2, 1)), step_after_start)
        if not isinstance(transition, Gaussian) or transition.cov.ndim > 2:
            return {WHOLE_FILTER: "grid-2d needs additive Gaussian noise of constant covariance"}
        return {}

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Planes:
        """Return the prior of each run on nodes, or the state itself if it is known.

        Each posterior is computed a second time with half as many nodes along each axis, as a check that
        the nodes resolve it. Raises WrongReturnError if the prior has no density and is no known state
        either.
        """
        runs = range(prior.mean.shape[1])
        if not np.any(prior.cov):
            # A known state has no density to check.
            known = tuple(prior.mean[:, run] for run in runs)
            return Planes(posteriors=known, checks=known)
        moments = per_run_moments(prior)
        priors = [Gaussian(moments.mean[:, run], moments.cov[..., run]) for run in runs]
        if any(linalg.is_singular(of_run.cov) for of_run in priors):
            raise WrongReturnError("init", "a part of the prior has no density: raise its `sigma`")
        nodes, check_nodes = self._node_counts
        return Planes(
            posteriors=tuple(grid_2d_quadrature.over_prior(of_run, nodes) for of_run in priors),
            checks=tuple(grid_2d_quadrature.over_prior(of_run, check_nodes) for of_run in priors),
        )

    @property
    def _node_counts(self) -> tuple[int, int]:
        """Number of nodes along an axis of the posterior, and number along an axis of its check."""
        return self.nodes, self.nodes // 2

    def step(self, model: Model, state: Planes, z: Array, k: int, rng: Generator) -> Planes:
        """Condition each run on the measurement z (n_z, M) of step k.

        Raises WrongReturnError if half as many nodes give other moments.
        """
        motion = _map(model.motion, self.estimate(state), k)  # f, its Jacobian and Q
        nodes, check_nodes = self._node_counts
        posteriors = []
        checks = []
        for run, (old, old_check) in enumerate(zip(state.posteriors, state.checks, strict=True)):

            def log_density_of_z(x: Array, z: Array = z[:, run : run + 1]) -> Array:
                """Return log p(z | x) (N,) of states x (2, N), for the measurement z of this run."""
                return log_likelihood(model.sensor, z, x[:, None], k)[0]

            try:
                posteriors.append(
                    grid_2d_quadrature.condition(old, motion, log_density_of_z, nodes)
                )
                checks.append(
                    grid_2d_quadrature.condition(old_check, motion, log_density_of_z, check_nodes)
                )
            except UnresolvedError as error:
                raise self._unresolved(k, f": {error}") from None
        planes = Planes(posteriors=tuple(posteriors), checks=tuple(checks))
        if not _largest_difference(planes) <= _TOLERANCE:  # or NaN
            raise self._unresolved(k, "")
        for i in angle_rows(model.motion):
            if _most_beyond_half_a_turn(planes.posteriors, i) > _NEGLIGIBLE:
                name = model.motion.components[i]
                message = f"at step {k} the angle {name!r} may differ by more than half a turn"
                raise WrongReturnError(
                    "step", f"{message}, and grid-2d averages it as a number; narrow the start"
                )
        return planes

    def _unresolved(self, k: int, why: str) -> WrongReturnError:
        """Return the error of step k; ``why`` is a reason after a colon, or empty."""
        message = (
            f"grid-2d does not resolve the posterior at step {k} with `nodes: {self.nodes}`{why}"
        )
        return WrongReturnError("step", f"{message}; raise `nodes`, or narrow the start")

    def estimate(self, state: Planes) -> Gaussian:
        """Return the posterior mean (2, M) and covariance (2, 2, M)."""
        return _moments(state.posteriors)

    def posterior(self, state: Planes) -> Posterior | None:
        """Return the density on the grid; None for a known state, which has none."""
        planes = tuple(plane for plane in state.posteriors if isinstance(plane, Plane))
        if len(planes) < len(state.posteriors):
            return None
        return PlanePosterior(planes)

    def log_likelihood(self, state: Planes) -> Array:
        """Evaluate log p(z_k | z_1..k-1) (M,), exact; NaN before the first measurement.

        A known state, which is no `Plane`, is one before the first measurement.
        """
        return np.array(
            [plane.evidence if isinstance(plane, Plane) else np.nan for plane in state.posteriors]
        )


def _most_beyond_half_a_turn(states: Iterable[State], row: int) -> float:
    """Return the largest probability, over the runs, of angles beyond half a turn from their mean."""
    most = 0.0
    for state in states:
        if isinstance(state, Plane):  # a known state, an array, has no spread
            distance = np.abs(state.box.nodes[row] - state.moments.mean[row])
            most = max(most, float(total(np.where(distance > np.pi, state.mass, 0.0))))
    return most


def _moments(states: Iterable[State]) -> Gaussian:
    """Return the means (2, M) and covariances (2, 2, M) of the states of M runs."""
    means = []
    covs = []
    for state in states:
        if isinstance(state, Plane):
            means.append(state.moments.mean)
            covs.append(state.moments.cov)
        else:  # a known state
            means.append(state)
            covs.append(np.zeros((2, 2)))
    return Gaussian(np.stack(means, axis=-1), np.stack(covs, axis=-1))


def _map(motion: SampledMotion, state: Gaussian, k: int) -> Map:
    """Express the motion to step k as a map with additive noise.

    Its Jacobian is that of central differences, with steps relative to the spread of state and noise.
    One spread (2,) serves all runs: the mean of their variances, plus those of the noise. ``state`` has
    the mean (2, M) and the covariance (2, 2, M).
    """

    def f(x: Array) -> Array:
        """Move states x (2, N) without noise."""
        return motion.transition(x[:, None], k).mean[:, 0]

    # `conflicts` has rejected a Q that depends on the state.
    Q = motion.transition(np.zeros((2, 1)), k).cov.reshape(2, 2)
    spread = np.sqrt(mean(linalg.diagonal(state.cov)) + np.diagonal(Q))
    return Map(f, lambda x: central_differences(f, x, spread=spread), Q)


def _largest_difference(both: Planes) -> float:
    """Return the largest difference of the posterior from its check, in standard deviations.

    The check is the posterior by half as many nodes.
    """
    moments = _moments(both.posteriors)
    check = _moments(both.checks)
    sd = np.sqrt(linalg.diagonal(moments.cov))
    of_means = np.abs(check.mean - moments.mean) / sd
    of_covariances = np.abs(check.cov - moments.cov) / (sd[:, None] * sd)
    return float(max(of_means.max(), of_covariances.max()))
