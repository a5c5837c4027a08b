"""Measurement covariance adaptive EKF: the range's variance is inflated for a curved measurement."""

from dataclasses import dataclass
from typing import ClassVar, cast

import numpy as np

from trackbench.core import kalman
from trackbench.core.arrays import Array, with_trailing
from trackbench.core.distributions import Gaussian
from trackbench.core.elementary import cos_sin
from trackbench.core.kalman import Updated
from trackbench.core.polar_conversions import Polar
from trackbench.field_types import NonNegative, Positive
from trackbench.filters.cmkf import polar_moments
from trackbench.filters.ekf_linearization import extended_prediction
from trackbench.filters.gaussian_base import NonlinearFilter
from trackbench.models.base import Model
from trackbench.models.numerical_derivatives import jacobian_at
from trackbench.models.sensors.range_azimuth import RangeAzimuth
from trackbench.registry import register

_MOST_TURN = 1.5  # change of the azimuth, rad, beyond which the sagitta does not grow


@register("filters", "mcaekf")
@dataclass(frozen=True, kw_only=True)
class MCAEKF(NonlinearFilter):
    """Measurement covariance adaptive EKF: inflates the range variance for a curved measurement.

    The added variance is the square of the sagitta within the azimuth's uncertainty (banana paper,
    section IV, eq. 11; Tian & Bar-Shalom 2009).
    """

    n_sigma: NonNegative = 2.0
    """standard deviations of the updated azimuth at which the sagitta is taken"""
    kappa: Positive = 1.0
    """the sagitta divided by the standard deviation of the added range noise"""
    requires: ClassVar[tuple[str, ...]] = ("motion.jacobian", "sensor.jacobian", "sensor.reading")

    def update(self, model: Model, state: Gaussian, z: Array, k: int) -> Updated:
        """Predict, inflate the range's variance, update."""
        predicted = extended_prediction(model, state, k, self.assumed)
        sensor = cast(RangeAzimuth, model.sensor)
        expected = self.assumed.measurement(model, predicted.mean, k)
        nu = sensor.innovation(z, expected.mean)
        # R11 <- R11 + (D / kappa)^2 with the sagitta D (M,), which is NaN where the azimuth is missing.
        # The key kappa is the ratio of D to the standard deviation of the added noise.
        D = self._sagitta(polar_moments(sensor, predicted, k), nu[1], expected.cov[1, 1])
        # The sensor's R, (2, 2) for all runs or (2, 2, M), becomes one for each run.
        R = np.broadcast_to(with_trailing(expected.cov, 1, leading=2), (2, 2, len(D))).copy()
        R[0, 0] += np.where(np.isnan(D), 0.0, np.square(D / self.kappa))
        H = jacobian_at(sensor, predicted, k)
        return kalman.update(predicted, nu, H, R)

    def _sagitta(self, predicted: Polar, nu: Array, variance: float) -> Array:
        """Return the sagitta D = r (1 / cos d - 1) for the largest likely change d of azimuth, m.

        Tian & Bar-Shalom 2009; banana paper, eq. 11. The change is that of the update plus `n_sigma`
        standard deviations of the updated azimuth. ``predicted`` are range and azimuth of the prediction
        with their variances, ``nu`` (M,) is the innovation of the azimuth, and ``variance`` that of the
        azimuth's noise.
        """
        gain = predicted.azimuth_variance / (predicted.azimuth_variance + variance)
        spread = np.sqrt(predicted.azimuth_variance * (1.0 - gain))
        turn = np.abs(gain * nu) + self.n_sigma * spread
        # At a right angle 1 / cos d would be infinite.
        d = np.minimum(turn, _MOST_TURN)
        return predicted.r * (1.0 / cos_sin(d)[0] - 1.0)
