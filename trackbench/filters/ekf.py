"""Extended Kalman filters: plain, iterated, and with inflated noise for a curved measurement."""

from dataclasses import dataclass
from typing import ClassVar, cast

import numpy as np

from trackbench.core import kalman, linalg
from trackbench.core.arrays import Array
from trackbench.core.conversions import Polar
from trackbench.core.distributions import Gaussian
from trackbench.core.elementary import cos_sin
from trackbench.core.kalman import Updated
from trackbench.field_types import Count, NonNegative, Positive
from trackbench.filters.cmkf import polar_moments
from trackbench.filters.gaussian_base import NonlinearFilter
from trackbench.models.base import DifferentiableSensor, Model
from trackbench.models.gaussian_steps import extended_prediction, extended_step
from trackbench.models.sensors.range_azimuth import RangeAzimuth
from trackbench.registry import register

MERWE_DEMO: dict[str, object] = {"Q": 0.75, "R": 1e-5, "P0": 0.75, "noise_mean": False}
"""The noise that van der Merwe's public demo gives its Kalman filters."""


@register("filters", "ekf")
@dataclass(frozen=True, kw_only=True)
class EKF(NonlinearFilter):
    """Extended Kalman filter: first-order linearisation at the mean (Anderson & Moore 1979)."""

    requires: ClassVar[tuple[str, ...]] = ("motion.jacobian", "sensor.jacobian")
    presets: ClassVar[dict[str, dict[str, object]]] = {"merwe-demo": MERWE_DEMO}

    def updated(self, model: Model, state: Gaussian, z: Array, k: int) -> Updated:
        """Predict and update by the Jacobians."""
        return extended_step(model, state, z, k, self.assumed)


@register("filters", "iekf")
@dataclass(frozen=True, kw_only=True)
class IEKF(NonlinearFilter):
    """Iterated extended Kalman filter: Gauss-Newton steps to the posterior's mode.

    Bell & Cathey 1993; Bar-Shalom, Li & Kirubarajan 2001, section 10.5.2.
    """

    iterations: Count = 5
    """linearisations per update; 1 is the EKF"""
    requires: ClassVar[tuple[str, ...]] = ("motion.jacobian", "sensor.jacobian")

    def updated(self, model: Model, state: Gaussian, z: Array, k: int) -> Updated:
        """Predict; linearise the measurement again at each new estimate."""
        predicted = extended_prediction(model, state, k, self.assumed)
        posterior, first = predicted, None
        sensor = cast(DifferentiableSensor, model.sensor)
        for _ in range(self.iterations):
            H = sensor.jacobian(posterior.mean, k)
            seen = self.assumed.measurement(model, posterior.mean, k)
            nu = sensor.innovation(z, seen.mean)
            nu = nu - linalg.matvec(H, predicted.mean - posterior.mean)
            posterior, innovation = kalman.update(predicted, nu, H, seen.cov)
            first = first or innovation
        assert first is not None
        return posterior, first


@register("filters", "mcaekf")
@dataclass(frozen=True, kw_only=True)
class MCAEKF(NonlinearFilter):
    """Measurement covariance adaptive EKF for a range-azimuth sensor.

    The range's variance is raised by the square of the sagitta that the azimuth's uncertainty may
    hide (banana paper, section IV, eq. 11; Tian & Bar-Shalom 2009).
    """

    n_sigma: NonNegative = 2.0
    """how many standard deviations of the updated azimuth the sagitta is taken at"""
    kappa: Positive = 1.0
    """the sagitta is this many standard deviations of the added range noise"""
    requires: ClassVar[tuple[str, ...]] = ("motion.jacobian", "sensor.jacobian", "sensor.reading")

    def updated(self, model: Model, state: Gaussian, z: Array, k: int) -> Updated:
        """Predict, inflate the range's variance, update."""
        predicted = extended_prediction(model, state, k, self.assumed)
        sensor = cast(RangeAzimuth, model.sensor)
        seen = self.assumed.measurement(model, predicted.mean, k)
        nu = sensor.innovation(z, seen.mean)
        expected = polar_moments(sensor, predicted, k)
        D = self._sagitta(expected, nu[1], seen.cov[1, 1])
        R = np.broadcast_to(seen.cov[..., None], (2, 2, len(D))).copy()
        R[0, 0] += np.where(np.isnan(D), 0.0, np.square(D / self.kappa))
        H = sensor.jacobian(predicted.mean, k)
        return kalman.update(predicted, nu, H, R)

    def _sagitta(self, expected: Polar, nu: Array, variance: float) -> Array:
        """Eq. 11 at the largest likely turn between the prediction and the updated estimate."""
        gain = expected.azimuth_variance / (expected.azimuth_variance + variance)
        spread = np.sqrt(expected.azimuth_variance * (1.0 - gain))
        turn = np.abs(gain * nu) + self.n_sigma * spread
        return expected.r * (1.0 / cos_sin(np.minimum(turn, 1.5))[0] - 1.0)
