"""Extended Kalman filters for a strongly curved measurement: iterated, and with inflated noise."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.random import Generator

from trackbench.core import kalman, linalg
from trackbench.core.arrays import Array
from trackbench.core.elementary import cos_sin
from trackbench.filters.converted import polar_moments
from trackbench.filters.kalman import GaussianFilter, Tracked
from trackbench.keys import Count, NonNegative, Positive
from trackbench.models.gaussian import extended_prediction
from trackbench.registry import register


@register("filters", "iekf")
@dataclass(frozen=True, kw_only=True)
class IEKF(GaussianFilter):
    """Iterated extended Kalman filter: Gauss-Newton steps to the posterior's mode.

    Bell & Cathey 1993; Bar-Shalom, Li & Kirubarajan 2001, section 10.5.2.
    """

    iterations: Count = 5
    """linearisations per update; 1 is the EKF"""
    needs: ClassVar[tuple[str, ...]] = ("motion.jacobian", "sensor.jacobian")

    def step(self, model: Any, state: Tracked, z: Array, k: int, rng: Generator) -> Tracked:
        """Predict; linearise the measurement again at each new estimate."""
        predicted = extended_prediction(model, state.posterior, k, self._assumed)
        posterior, first = predicted, None
        for _ in range(self.iterations):
            H = model.sensor.jacobian(posterior.mean, k)
            seen = self._assumed.measurement(model, posterior.mean, k)
            nu = model.sensor.innovation(z, seen.mean)
            nu = nu - linalg.matvec(H, predicted.mean - posterior.mean)
            posterior, innovation = kalman.update(predicted, nu, H, seen.cov)
            first = first or innovation
        assert first is not None
        return Tracked(posterior, first.nis)


@register("filters", "mcaekf")
@dataclass(frozen=True, kw_only=True)
class MCAEKF(GaussianFilter):
    """Measurement covariance adaptive EKF for a range-azimuth sensor.

    The range's variance is raised by the square of the sagitta that the azimuth's uncertainty may
    hide (banana paper, section IV, eq. 11; Tian & Bar-Shalom 2009).
    """

    n_sigma: NonNegative = 2.0
    """how many standard deviations of the updated azimuth the sagitta is taken at"""
    kappa: Positive = 1.0
    """the sagitta is this many standard deviations of the added range noise"""
    needs: ClassVar[tuple[str, ...]] = ("motion.jacobian", "sensor.jacobian", "sensor.reading")

    def step(self, model: Any, state: Tracked, z: Array, k: int, rng: Generator) -> Tracked:
        """Predict, inflate the range's variance, update."""
        predicted = extended_prediction(model, state.posterior, k, self._assumed)
        seen = self._assumed.measurement(model, predicted.mean, k)
        nu = model.sensor.innovation(z, seen.mean)
        expected = polar_moments(model.sensor, predicted)
        D = self._sagitta(expected, nu[1], seen.cov[1, 1])
        R = np.broadcast_to(seen.cov[..., None], (2, 2, len(D))).copy()
        R[0, 0] += np.where(np.isnan(D), 0.0, np.square(D / self.kappa))
        H = model.sensor.jacobian(predicted.mean, k)
        posterior, innovation = kalman.update(predicted, nu, H, R)
        return Tracked(posterior, innovation.nis)

    def _sagitta(self, expected: Any, nu: Array, variance: float) -> Array:
        """Eq. 11 at the largest likely turn between the prediction and the updated estimate."""
        gain = expected.azimuth_variance / (expected.azimuth_variance + variance)
        spread = np.sqrt(expected.azimuth_variance * (1.0 - gain))
        turn = np.abs(gain * nu) + self.n_sigma * spread
        return expected.r * (1.0 / cos_sin(np.minimum(turn, 1.5))[0] - 1.0)
