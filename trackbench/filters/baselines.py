"""Baselines and the floor: no data, no model of motion, and the exact posterior."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, NamedTuple, cast

import numpy as np
from annotated_types import Ge
from numpy.random import Generator

from trackbench.core import elementary, quadrature
from trackbench.core.arrays import Array, with_trailing
from trackbench.core.distributions import Distribution, Gaussian, per_run_moments
from trackbench.core.posteriors import LinePosterior, Posterior
from trackbench.filters.base import Filter, WrongReturnError
from trackbench.models.base import GammaMotion, Model, Scene, log_likelihood
from trackbench.models.gaussian_steps import MODEL_NOISE, extended_prediction
from trackbench.models.motions.scalar import MerweMotion
from trackbench.models.sensors.square_then_line import SquareThenLine
from trackbench.registry import register

_LARGEST_SHAPE = 20
_MEANS_APART = 0.05  # standard deviations between the means by these and by more nodes
_VARIANCES_APART = 0.1
_PRIOR_REACH = 8.0  # standard deviations of a Gaussian prior beyond which its mass is below 1e-14


@register("filters", "prior-mean")
@dataclass(frozen=True, kw_only=True)
class PriorMean(Filter[Gaussian]):
    """No data at all: the mean and covariance that the motion alone predicts (linear motion)."""

    requires: ClassVar[tuple[str, ...]] = ("motion.jacobian",)
    contract_exemptions: ClassVar[dict[str, str]] = {"kalman": "looks at no measurement"}

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Gaussian:
        """The prior's moments."""
        return per_run_moments(prior)

    def step(self, model: Model, state: Gaussian, z: Array, k: int, rng: Generator) -> Gaussian:
        """Predict; the measurement is not looked at."""
        return extended_prediction(model, state, k, MODEL_NOISE)

    def estimate(self, state: Gaussian) -> Gaussian:
        """The prediction."""
        return state


@register("filters", "inversion")
@dataclass(frozen=True, kw_only=True)
class Inversion(Filter[Gaussian]):
    """No memory: the state that the measurement alone implies, h^-1(z)."""

    requires: ClassVar[tuple[str, ...]] = ("sensor.inverse", "sensor.jacobian", "motion.jacobian")

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Gaussian:
        """The prior's moments."""
        return per_run_moments(prior)

    def step(self, model: Model, state: Gaussian, z: Array, k: int, rng: Generator) -> Gaussian:
        """h^-1(z), with variance R / h'^2; the prediction where z is missing."""
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
        """The inverted measurement."""
        return state


class Resolved(NamedTuple):
    """The posterior, and the one by more nodes that it is checked against."""

    posterior: quadrature.Posterior
    check: quadrature.Posterior


@register("filters", "grid")
@dataclass(frozen=True, kw_only=True)
class Grid(Filter[Resolved]):
    """Exact posterior of a scalar state by quadrature (hdepf paper, eqs. 3-5): the floor.

    Gauss-Legendre nodes around each root of the measurement equation. No filter can beat its RMSE.
    An experiment stops where the nodes do not resolve the posterior: where an eighth more of them move a
    mean by a twentieth of a standard deviation or a variance by a tenth, or where two neighbours are
    farther apart than the motion's noise reaches.
    """

    nodes: Annotated[int, Ge(8)] = 128
    """nodes per root of the measurement equation"""
    deviations: Annotated[float, Ge(4)] = 6.5
    """how many standard deviations of the measurement noise the nodes span on either side"""
    requires: ClassVar[tuple[str, ...]] = ("motion.support", "motion.origins", "sensor.preimage")

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Below its edge the density is continued by its formula, which a large shape makes too steep.

        From a shape of 30 on the estimate is wrong where R is large, without any sign of it.
        """
        motion = scenario.model.motion
        if isinstance(motion, GammaMotion) and motion.noise.shape > _LARGEST_SHAPE:
            return {"": f"grid is exact for gamma noise of a shape up to {_LARGEST_SHAPE} only"}
        nowhere = np.zeros((len(motion.components), 1))
        if not hasattr(motion.transition(nowhere, int(scenario.steps[0])), "prob"):
            return {"": "grid needs the transition's density as `prob`, and this motion's has none"}
        return {}

    def extra_memory(self, model: Model) -> int:
        """Numbers alive at once per run: kernels of nodes by nodes."""
        return 7 * self.nodes * self.nodes

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Resolved:
        """All mass on the first state, or nodes over what a Gaussian prior leaves open of it."""
        if not np.any(prior.cov):
            known = quadrature.point_mass(prior.mean)
            return Resolved(known, known)
        assert isinstance(prior, Gaussian)
        mean, reach = prior.mean[0], _PRIOR_REACH * np.sqrt(prior.cov[0, 0])
        around = mean - reach, mean + reach
        both = (quadrature.nodes_between([around], around, n)[0] for n in self._numbers)
        return Resolved(
            *((p._replace(density=elementary.exp(prior.log_prob(p.x[None]))),) for p in both)
        )

    @property
    def _numbers(self) -> tuple[int, int]:
        return self.nodes, self.nodes + self.nodes // 8

    def step(self, model: Model, state: Resolved, z: Array, k: int, rng: Generator) -> Resolved:
        """Lay nodes where z and the prediction allow mass, and condition on z.

        Raises WrongReturnError if there are too few nodes.
        """
        both = zip(state, self._numbers, strict=True)
        new = Resolved(*(self._conditioned(model, old, z, k, n) for old, n in both))
        own, check = map(quadrature.moments, new)
        variance, other = own.cov[0, 0], check.cov[0, 0]
        right = np.abs(check.mean - own.mean)[0] <= _MEANS_APART * np.sqrt(variance)
        right &= np.abs(other - variance) <= _VARIANCES_APART * variance
        right |= np.isnan(variance) & np.isnan(other)
        if not (right.all() and self._reaches_each_node(model, state.posterior, k)):
            what = f"grid does not resolve the posterior at step {k} with `nodes: {self.nodes}`"
            raise WrongReturnError("step", f"{what}; raise `nodes`, or narrow the start")
        return new

    def _reaches_each_node(self, model: Model, old: quadrature.Posterior, k: int) -> bool:
        """Whether what moves from one node overlaps what moves from the next."""
        for panel in old:
            moved = model.motion.transition(panel.x[None], k)
            gaps = np.abs(np.diff(moved.mean[0], axis=0))
            if (gaps > np.sqrt(moved.cov[0, 0])).any():
                return False
        return True

    def _conditioned(
        self, model: Model, old: quadrature.Posterior, z: Array, k: int, n: int
    ) -> quadrature.Posterior:
        motion, sensor = cast("tuple[MerweMotion, SquareThenLine]", model)
        support = motion.support(*quadrature.hull(old), k)
        reach = _anywhere_if_missing(z, sensor.preimage(z, self.deviations, k), support)

        def transition(x: Array, x_new: Array) -> Array:
            return motion.transition(x[None], k).prob(x_new[None])

        def likelihood(x_new: Array) -> Array:
            # (J, M) nodes as (1, M, J): the sensor sees them as it sees particles.
            return elementary.exp(log_likelihood(sensor, z, x_new.T[None], k).T)

        return quadrature.condition(
            old,
            quadrature.nodes_between(reach, support, n),
            transition,
            lambda x_new: motion.origins(x_new, k),
            likelihood,
        )

    def estimate(self, state: Resolved) -> Gaussian:
        """Posterior mean and variance."""
        return quadrature.moments(state.posterior)

    def posterior(self, state: Resolved) -> Posterior:
        """The density itself."""
        return LinePosterior(state.posterior)

    def log_likelihood(self, state: Resolved) -> Array:
        """log p(z_k | z_1..k-1) (M,), exact."""
        first = state.posterior[0]
        unknown = np.full(first.low.shape, np.nan)
        return unknown if first.evidence is None else elementary.log(first.evidence)


def _anywhere_if_missing(
    z: Array, reach: list[quadrature.Interval], support: quadrature.Interval
) -> list[quadrature.Interval]:
    """Without a measurement the first panel spans the prediction, and the others are empty."""
    missing = np.isnan(z).any(axis=0)
    if not missing.any():
        return reach
    low, high = support
    (first_low, first_high), *others = reach
    first = np.where(missing, low, first_low), np.where(missing, high, first_high)
    return [first, *((np.where(missing, low, a), np.where(missing, low, b)) for a, b in others)]
