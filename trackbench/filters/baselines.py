"""Baselines without data or without memory, and the exact posterior of a scalar state."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, NamedTuple, cast

import numpy as np
from annotated_types import Ge
from numpy.random import Generator

from trackbench.core import elementary, quadrature
from trackbench.core.arrays import Array, with_trailing
from trackbench.core.distributions import Distribution, Gaussian, per_run_moments
from trackbench.core.posterior_scores import LinePosterior, Posterior
from trackbench.filters.base import Filter, WrongReturnError
from trackbench.models.base import GammaMotion, Model, Scene, log_likelihood
from trackbench.models.gaussian_steps import MODEL_NOISE, extended_prediction
from trackbench.models.motions.scalar import MerweMotion
from trackbench.models.sensors.square_then_line import SquareThenLine
from trackbench.registry import register

_MAX_GAMMA_SHAPE = 20
_MEAN_TOLERANCE = 0.05  # difference of the means by these and by more nodes, in standard deviations
_VARIANCE_TOLERANCE = 0.1  # relative difference of the variances
_PRIOR_REACH = 8.0  # standard deviations of a Gaussian prior beyond which its mass is below 1e-14


@register("filters", "prior-mean")
@dataclass(frozen=True, kw_only=True)
class PriorMean(Filter[Gaussian]):
    """Baseline without data: mean and covariance predicted by the motion alone (linear motion)."""

    requires: ClassVar[tuple[str, ...]] = ("motion.jacobian",)
    contract_exemptions: ClassVar[dict[str, str]] = {"kalman": "uses no measurement"}

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Gaussian:
        """Return the prior's moments."""
        return per_run_moments(prior)

    def step(self, model: Model, state: Gaussian, z: Array, k: int, rng: Generator) -> Gaussian:
        """Predict, without the measurement."""
        return extended_prediction(model, state, k, MODEL_NOISE)

    def estimate(self, state: Gaussian) -> Gaussian:
        """Return the prediction."""
        return state


@register("filters", "inversion")
@dataclass(frozen=True, kw_only=True)
class Inversion(Filter[Gaussian]):
    """Baseline without memory: the state that the measurement alone implies, h^-1(z)."""

    requires: ClassVar[tuple[str, ...]] = ("sensor.inverse", "sensor.jacobian", "motion.jacobian")

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Gaussian:
        """Return the prior's moments."""
        return per_run_moments(prior)

    def step(self, model: Model, state: Gaussian, z: Array, k: int, rng: Generator) -> Gaussian:
        """Return h^-1(z) with variance R / h'^2; the prediction where z is missing."""
        sensor = cast(SquareThenLine, model.sensor)
        x = sensor.inverse(z, k)
        R = sensor.measurement(x, k).cov
        with np.errstate(divide="ignore"):
            cov = with_trailing(R, 1, leading=2) / np.square(sensor.jacobian(x, k))
        missing = np.isnan(z).any(axis=0)
        if not missing.any():
            return Gaussian(x, cov)
        predicted = extended_prediction(model, state, k, MODEL_NOISE)
        return Gaussian(np.where(missing, predicted.mean, x), np.where(missing, predicted.cov, cov))

    def estimate(self, state: Gaussian) -> Gaussian:
        """Return the inverted measurement."""
        return state


class Resolved(NamedTuple):
    """Posterior, and the posterior by more nodes that it is checked against."""

    posterior: quadrature.Posterior
    check: quadrature.Posterior


@register("filters", "grid")
@dataclass(frozen=True, kw_only=True)
class Grid(Filter[Resolved]):
    """Exact posterior of a scalar state by quadrature (hdepf paper, eqs. 3-5): no RMSE is smaller.

    Gauss-Legendre nodes lie around each root of the measurement equation. The filter fails if the
    nodes do not resolve the posterior: an eighth more nodes change a mean by a twentieth of a
    standard deviation or a variance by a tenth, or two neighbors are farther apart than the
    motion's noise reaches.
    """

    nodes: Annotated[int, Ge(8)] = 128
    """nodes per root of the measurement equation"""
    deviations: Annotated[float, Ge(4)] = 6.5
    """half the span of the nodes, in standard deviations of the measurement noise"""
    requires: ClassVar[tuple[str, ...]] = ("motion.support", "motion.origins", "sensor.preimage")

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Return a gamma noise of too large a shape, and a motion without a density.

        The density is continued by its formula below its edge, where a large shape is too steep:
        from 30 on the estimate is wrong if R is large, and no check shows it.
        """
        motion = scenario.model.motion
        if isinstance(motion, GammaMotion) and motion.noise.shape > _MAX_GAMMA_SHAPE:
            return {"": f"grid is exact for gamma noise of a shape up to {_MAX_GAMMA_SHAPE} only"}
        origin = np.zeros((len(motion.components), 1))
        if not hasattr(motion.transition(origin, int(scenario.steps[0])), "prob"):
            return {"": "grid needs the transition's density as `prob`, and this motion's has none"}
        return {}

    def extra_memory(self, model: Model) -> int:
        """Return the numbers of the kernels of nodes by nodes."""
        return 7 * self.nodes * self.nodes

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Resolved:
        """Put all mass on a known first state, or nodes over a Gaussian prior."""
        if not np.any(prior.cov):
            point = quadrature.point_mass(prior.mean)
            return Resolved(point, point)
        assert isinstance(prior, Gaussian)
        mean, reach = prior.mean[0], _PRIOR_REACH * np.sqrt(prior.cov[0, 0])
        span = mean - reach, mean + reach
        both = (quadrature.nodes_between([span], span, n)[0] for n in self._node_counts)
        return Resolved(
            *((p._replace(density=elementary.exp(prior.log_prob(p.x[None]))),) for p in both)
        )

    @property
    def _node_counts(self) -> tuple[int, int]:
        return self.nodes, self.nodes + self.nodes // 8

    def step(self, model: Model, state: Resolved, z: Array, k: int, rng: Generator) -> Resolved:
        """Place nodes where z and the prediction allow mass, and condition on z.

        Raises WrongReturnError if there are too few nodes.
        """
        both = zip(state, self._node_counts, strict=True)
        new = Resolved(*(self._condition(model, old, z, k, n) for old, n in both))
        ours, check = map(quadrature.moments, new)
        variance, other = ours.cov[0, 0], check.cov[0, 0]
        resolved = np.abs(check.mean - ours.mean)[0] <= _MEAN_TOLERANCE * np.sqrt(variance)
        resolved &= np.abs(other - variance) <= _VARIANCE_TOLERANCE * variance
        resolved |= np.isnan(variance) & np.isnan(other)
        if not (resolved.all() and self._has_dense_nodes(model, state.posterior, k)):
            what = f"grid does not resolve the posterior at step {k} with `nodes: {self.nodes}`"
            raise WrongReturnError("step", f"{what}; raise `nodes`, or narrow the start")
        return new

    def _has_dense_nodes(self, model: Model, old: quadrature.Posterior, k: int) -> bool:
        """Return whether the transitions from neighboring nodes overlap."""
        for panel in old:
            transition = model.motion.transition(panel.x[None], k)
            gaps = np.abs(np.diff(transition.mean[0], axis=0))
            if (gaps > np.sqrt(transition.cov[0, 0])).any():
                return False
        return True

    def _condition(
        self, model: Model, old: quadrature.Posterior, z: Array, k: int, n: int
    ) -> quadrature.Posterior:
        motion, sensor = cast("tuple[MerweMotion, SquareThenLine]", model)
        # Intervals of x that z allows, within the support of the prediction.
        support = motion.support(*quadrature.hull(old), k)
        reach = _support_if_missing(z, sensor.preimage(z, self.deviations, k), support)

        def transition(x: Array, x_new: Array) -> Array:
            return motion.transition(x[None], k).prob(x_new[None])

        def likelihood(x_new: Array) -> Array:
            # (J, M) nodes as (1, M, J): the sensor takes them for particles.
            return elementary.exp(log_likelihood(sensor, z, x_new.T[None], k).T)

        return quadrature.condition(
            old,
            quadrature.nodes_between(reach, support, n),
            transition,
            lambda x_new: motion.origins(x_new, k),
            likelihood,
        )

    def estimate(self, state: Resolved) -> Gaussian:
        """Return the posterior mean and variance."""
        return quadrature.moments(state.posterior)

    def posterior(self, state: Resolved) -> Posterior:
        """Return the density itself."""
        return LinePosterior(state.posterior)

    def log_likelihood(self, state: Resolved) -> Array:
        """Return log p(z_k | z_1..k-1) (M,), exact."""
        first = state.posterior[0]
        unknown = np.full(first.low.shape, np.nan)
        return unknown if first.evidence is None else elementary.log(first.evidence)


def _support_if_missing(
    z: Array, reach: list[quadrature.Interval], support: quadrature.Interval
) -> list[quadrature.Interval]:
    """Return the intervals; without a measurement the first is the support, the others are empty."""
    missing = np.isnan(z).any(axis=0)
    if not missing.any():
        return reach
    low, high = support
    (first_low, first_high), *others = reach
    first = np.where(missing, low, first_low), np.where(missing, high, first_high)
    return [first, *((np.where(missing, low, a), np.where(missing, low, b)) for a, b in others)]
