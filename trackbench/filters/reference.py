"""Baselines and the floor: no data, no model of motion, and the exact posterior."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, cast

import numpy as np
from annotated_types import Ge
from numpy.random import Generator

from trackbench.core import elementary, grid
from trackbench.core.arrays import Array, with_trailing
from trackbench.core.distributions import Distribution, Gaussian, of_each_run
from trackbench.core.posteriors import LinePosterior, Posterior
from trackbench.filters.base import Filter
from trackbench.models.base import GammaMotion, Model, Scene, log_likelihood
from trackbench.models.gaussian import AS_IT_IS, extended_prediction
from trackbench.models.motions.scalar import MerweMotion
from trackbench.models.sensors.square_then_line import SquareThenLine
from trackbench.registry import register

_LARGEST_SHAPE = 20
_PRIOR_REACH = 8.0  # standard deviations of a Gaussian prior beyond which its mass is below 1e-14


@register("filters", "prior-mean")
@dataclass(frozen=True, kw_only=True)
class PriorMean(Filter[Gaussian]):
    """No data at all: the mean and covariance that the motion alone predicts (linear motion)."""

    needs: ClassVar[tuple[str, ...]] = ("motion.jacobian",)
    excused: ClassVar[dict[str, str]] = {"kalman": "looks at no measurement"}

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Gaussian:
        """The prior's moments."""
        return of_each_run(prior)

    def step(self, model: Model, state: Gaussian, z: Array, k: int, rng: Generator) -> Gaussian:
        """Predict; the measurement is not looked at."""
        return extended_prediction(model, state, k, AS_IT_IS)

    def estimate(self, state: Gaussian) -> Gaussian:
        """The prediction."""
        return state


@register("filters", "inversion")
@dataclass(frozen=True, kw_only=True)
class Inversion(Filter[Gaussian]):
    """No memory: the state that the measurement alone implies, h^-1(z)."""

    needs: ClassVar[tuple[str, ...]] = ("sensor.inverse", "sensor.jacobian", "motion.jacobian")

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Gaussian:
        """The prior's moments."""
        return of_each_run(prior)

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
        predicted = extended_prediction(model, state, k, AS_IT_IS)
        return Gaussian(np.where(missing, predicted.mean, x), np.where(missing, predicted.cov, cov))

    def estimate(self, state: Gaussian) -> Gaussian:
        """The inverted measurement."""
        return state


@register("filters", "grid")
@dataclass(frozen=True, kw_only=True)
class Grid(Filter[grid.Posterior]):
    """Exact posterior of a scalar state by quadrature (hdepf paper, eqs. 3-5): the floor.

    Gauss-Legendre nodes around each root of the measurement equation. No filter can beat its RMSE.
    """

    nodes: Annotated[int, Ge(8)] = 128
    """nodes per root of the measurement equation"""
    deviations: Annotated[float, Ge(4)] = 6.5
    """how many standard deviations of the measurement noise the nodes span on either side"""
    needs: ClassVar[tuple[str, ...]] = ("motion.support", "motion.origins", "sensor.preimage")

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Below its edge the density is continued by its formula, which a large shape makes too steep.

        From a shape of 30 on the estimate is wrong where R is large, without any sign of it.
        """
        motion = scenario.model.motion
        if isinstance(motion, GammaMotion) and motion.noise.shape > _LARGEST_SHAPE:
            return {"": f"grid is exact for gamma noise of a shape up to {_LARGEST_SHAPE} only"}
        return {}

    def held(self, model: Model) -> int:
        """Numbers alive at once per run: kernels of nodes by nodes."""
        return 7 * self.nodes * self.nodes

    def init(self, model: Model, prior: Distribution, rng: Generator) -> grid.Posterior:
        """All mass on the first state, or nodes over what a Gaussian prior leaves open of it."""
        if not np.any(prior.cov):
            return grid.known(prior.mean)
        assert isinstance(prior, Gaussian)
        mean, reach = prior.mean[0], _PRIOR_REACH * np.sqrt(prior.cov[0, 0])
        around = mean - reach, mean + reach
        (panel,) = grid.nodes_between([around], around, self.nodes)
        return (panel._replace(density=elementary.exp(prior.log_prob(panel.x[None]))),)

    def step(
        self, model: Model, state: grid.Posterior, z: Array, k: int, rng: Generator
    ) -> grid.Posterior:
        """Lay nodes where z and the prediction allow mass, and condition on z."""
        motion, sensor = cast("tuple[MerweMotion, SquareThenLine]", model)
        support = motion.support(*grid.hull(state), k)
        reach = _anywhere_if_missing(z, sensor.preimage(z, self.deviations, k), support)

        def transition(x: Array, x_new: Array) -> Array:
            return motion.transition(x[None], k).prob(x_new[None])

        def likelihood(x_new: Array) -> Array:
            # (J, M) nodes as (1, M, J): the sensor sees them as it sees particles.
            return elementary.exp(log_likelihood(sensor, z, x_new.T[None], k).T)

        return grid.condition(
            state,
            grid.nodes_between(reach, support, self.nodes),
            transition,
            lambda x_new: motion.origins(x_new, k),
            likelihood,
        )

    def estimate(self, state: grid.Posterior) -> Gaussian:
        """Posterior mean and variance."""
        return grid.moments(state)

    def posterior(self, state: grid.Posterior) -> Posterior:
        """The density itself."""
        return LinePosterior(state)

    def log_likelihood(self, state: grid.Posterior) -> Array:
        """log p(z_k | z_1..k-1) (M,), exact."""
        density = state[0].evidence
        unknown = np.full(state[0].low.shape, np.nan)
        return unknown if density is None else elementary.log(density)


def _anywhere_if_missing(
    z: Array, reach: list[grid.Interval], support: grid.Interval
) -> list[grid.Interval]:
    """Without a measurement the first panel spans the prediction, and the others are empty."""
    missing = np.isnan(z).any(axis=0)
    if not missing.any():
        return reach
    low, high = support
    (first_low, first_high), *others = reach
    first = np.where(missing, low, first_low), np.where(missing, high, first_high)
    return [first, *((np.where(missing, low, a), np.where(missing, low, b)) for a, b in others)]
