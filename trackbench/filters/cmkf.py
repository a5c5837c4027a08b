"""Converted measurement Kalman filter: range and azimuth become a position."""

from dataclasses import dataclass
from typing import ClassVar, cast

import numpy as np

from trackbench.core import kalman, linalg
from trackbench.core.arrays import Array
from trackbench.core.distributions import Distribution, Gaussian, per_run_moments
from trackbench.core.kalman import Updated
from trackbench.core.polar_conversions import Conversion, Polar, convert
from trackbench.filters.assumed_noise import MODEL_NOISE
from trackbench.filters.ekf_linearization import extended_prediction
from trackbench.filters.gaussian_base import GaussianFilter
from trackbench.models.base import Model, Scene
from trackbench.models.sensors.range_azimuth import RangeAzimuth
from trackbench.models.two_scan_prior import Convertible
from trackbench.registry import register


@register("filters", "cmkf")
@dataclass(frozen=True, kw_only=True)
class CMKF(GaussianFilter):
    """Converted measurement Kalman filter: a linear filter on the converted position.

    Banana paper, section III; the conversions and their sources are in `core.polar_conversions`.
    """

    conversion: Conversion = "ucm"
    """conversion of range and azimuth to a position: ccm, ucm, mucm or ducm"""
    start: Conversion | None = None
    """conversion of the two scans that initialize the filter; default: `conversion`"""
    requires: ClassVar[tuple[str, ...]] = ("motion.jacobian", "sensor.reading")

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Reject the key ``robust``: its weights belong to R of range and azimuth."""
        conflicts = super().conflicts(scenario)
        if self.robust is not None:
            conflicts["robust"] = (
                "weighs a sensor's R, and the converted position has another one: take ekf or mcaekf"
            )
        return conflicts

    def idle_keys(self, scenario: Scene) -> dict[str, str]:
        """Report also ``start`` as idle if there are no two scans to convert."""
        idle = super().idle_keys(scenario)
        if not issubclass(scenario.prior_type, Convertible):
            idle["start"] = "as this scenario does not start from two scans of a radar"
        return idle

    def initialize(self, model: Model, prior: Distribution) -> Gaussian:
        """Start from two-point differencing of converted scans, or without scans from the prior."""
        if not isinstance(prior, Convertible):
            return per_run_moments(prior)
        return prior.gaussian(self.start or self.conversion)

    def update(self, model: Model, state: Gaussian, z: Array, k: int) -> Updated:
        """Predict, convert the measurement to a position, and update linearly.

        A measurement that lacks range or azimuth counts as missing.
        """
        sensor = cast(RangeAzimuth, model.sensor)
        predicted = extended_prediction(model, state, k, MODEL_NOISE)
        # Step 1: convert (r, a) to mean and covariance of the position relative to the sensor; ducm uses
        # the predicted range and azimuth.
        expected = None
        if self.conversion == "ducm":
            expected = polar_moments(sensor, predicted, k)
        z = np.where(np.isnan(z).any(axis=0), np.nan, z)
        converted = convert(self.conversion, sensor.reading(z), expected)
        # Step 2: update with the position, which is the components 0 and 2 of the state. Where it is
        # missing (NaN), the unit matrix stands in for R, which has no effect then.
        H = np.eye(len(predicted.mean))[0:4:2]
        nu = sensor.absolute_position(converted.mean, k) - linalg.matvec(H, predicted.mean)
        R = np.where(np.isnan(nu).any(axis=0), np.eye(2)[..., None], converted.cov)
        posterior, innovation = kalman.update(predicted, nu, H, R)
        # The likelihood is that of (r, a). A conversion that scales the range by b has the volume ratio
        # d(x, y) / d(r, a) = b^2 r = (x^2 + y^2) / r.
        x, y = converted.mean
        return posterior, innovation._replace(volume_ratio=(x * x + y * y) / sensor.reading(z).r)


def polar_moments(sensor: RangeAzimuth, state: Gaussian, k: int) -> Polar:
    """Transform N(mean, cov) at step k to range and azimuth, with variances to first order."""
    r, a = sensor.polar(state.mean, k)
    spread = linalg.sandwich(sensor.jacobian(state.mean, k), state.cov)  # (2, 2, M)
    return Polar(r, a, range_variance=spread[0, 0], azimuth_variance=spread[1, 1])
