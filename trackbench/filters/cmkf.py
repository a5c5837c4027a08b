"""Kalman filters in Cartesian coordinates, fed with converted measurements."""

from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple, cast

import numpy as np
from numpy.random import Generator

from trackbench.core import kalman, linalg
from trackbench.core.arrays import Array
from trackbench.core.conversions import Conversion, Polar, convert
from trackbench.core.distributions import Distribution, Gaussian, per_run_moments
from trackbench.core.kalman import Updated
from trackbench.filters.base import Filter
from trackbench.filters.gaussian_base import GaussianFilter
from trackbench.models.base import Model, Scene
from trackbench.models.gaussian_steps import MODEL_NOISE, extended_prediction
from trackbench.models.priors import Convertible, TwoPoint
from trackbench.models.sensors.range_azimuth import RangeAzimuth
from trackbench.registry import register


@register("filters", "cmkf")
@dataclass(frozen=True, kw_only=True)
class CMKF(GaussianFilter):
    """Converted measurement Kalman filter: a linear filter on the converted position.

    Banana paper, section III; the conversions and their sources are in `core.conversions`.
    """

    conversion: Conversion = "ucm"
    """how range and azimuth become a position: ccm, ucm, mucm or ducm"""
    start: Conversion | None = None
    """conversion of the two scans that the filter starts from; default: its own"""
    requires: ClassVar[tuple[str, ...]] = ("motion.jacobian", "sensor.reading")

    def idle_keys(self, scenario: Scene) -> dict[str, str]:
        """Only two scans are converted."""
        if issubclass(scenario.prior_type, Convertible):
            return {}
        return {"start": "as there are no two scans of range and azimuth to start from"}

    def started(self, model: Model, prior: Distribution) -> Gaussian:
        """Two-point differencing of converted measurements; the prior's moments if there are none."""
        if not isinstance(prior, Convertible):
            return per_run_moments(prior)  # as every run's measurements have
        return prior.gaussian(self.start or self.conversion)

    def updated(self, model: Model, state: Gaussian, z: Array, k: int) -> Updated:
        """Predict, convert the measurement, update linearly; half a measurement cannot be converted."""
        sensor = cast(RangeAzimuth, model.sensor)
        predicted = extended_prediction(model, state, k, MODEL_NOISE)
        expected = polar_moments(sensor, predicted, k) if self.conversion == "ducm" else None
        z = np.where(np.isnan(z).any(axis=0), np.nan, z)
        seen = convert(self.conversion, sensor.reading(z), expected)
        H = np.eye(len(predicted.mean))[0:4:2]
        nu = sensor.absolute_position(seen.mean, k) - linalg.matvec(H, predicted.mean)
        R = np.where(np.isnan(nu).any(axis=0), np.eye(2)[..., None], seen.cov)
        posterior, innovation = kalman.update(predicted, nu, H, R)
        # d(x, y) = b^2 r d(r, a) of a position at b r.
        x, y = seen.mean
        return posterior, innovation._replace(volume_ratio=(x * x + y * y) / sensor.reading(z).r)


def polar_moments(sensor: RangeAzimuth, state: Gaussian, k: int) -> Polar:
    """Range and azimuth of N(mean, cov) at step k with their variances to first order."""
    r, a = sensor.polar(state.mean, k)
    spread = linalg.sandwich(sensor.jacobian(state.mean, k), state.cov)
    return Polar(r, a, spread[0, 0], spread[1, 1])


class LastTwo(NamedTuple):
    """The last two scans, and the Gaussian that differencing makes of them."""

    scans: TwoPoint
    found: Gaussian


@register("filters", "conversion")
@dataclass(frozen=True, kw_only=True)
class Converted(Filter[LastTwo]):
    """No memory: the last measurement's converted position, and its difference from the one before.

    Its position shows a conversion's own bias and consistency (banana paper, Fig. 6).
    """

    conversion: Conversion = "ucm"
    """how range and azimuth become a position: ccm, ucm, mucm or ducm"""
    requires: ClassVar[tuple[str, ...]] = ("state.planar", "sensor.reading", "prior.gaussian")

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Two scans give positions and velocities, and nothing else that a motion may have."""
        others = ", ".join(scenario.model.motion.components[4:])
        if others:
            what = f"conversion estimates position and velocity only; its motion has {others}, too"
            return {"": f"{what}; give it `assume: {{motion: {{kind: cv, q: 0}}}}`"}
        return {}

    def init(self, model: Model, prior: Distribution, rng: Generator) -> LastTwo:
        """The first two scans."""
        assert isinstance(prior, TwoPoint)
        return LastTwo(prior, prior.gaussian(self.conversion))

    def step(self, model: Model, state: LastTwo, z: Array, k: int, rng: Generator) -> LastTwo:
        """Forget the older scan; one that is missing is where the two before it point to."""
        expected = model.motion.transition(state.found.mean, k).mean
        z = np.where(np.isnan(z).any(axis=0), cast(RangeAzimuth, model.sensor).polar(expected), z)
        scans = replace(state.scans, first=state.scans.second, second=z)
        return LastTwo(scans, scans.gaussian(self.conversion))

    def estimate(self, state: LastTwo) -> Gaussian:
        """The converted position, and the velocity between the last two."""
        return state.found
