"""Stone Soup: models, predictor, updater and resampler, one track per run."""

from datetime import datetime, timedelta
from typing import Any

import numpy as np
from stonesoup.base import Property
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.measurement.nonlinear import (
    CartesianToBearingRange,
    NonLinearGaussianMeasurement,
)
from stonesoup.models.transition import TransitionModel
from stonesoup.models.transition.linear import (
    CombinedLinearGaussianTransitionModel,
    ConstantVelocity,
)
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.predictor.particle import ParticlePredictor
from stonesoup.resampler.particle import SystematicResampler
from stonesoup.types.array import CovarianceMatrix, StateVector, StateVectors
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.state import GaussianState, ParticleState
from stonesoup.updater.kalman import KalmanUpdater
from stonesoup.updater.particle import ParticleUpdater

from trackbench.core.arrays import Array

START = datetime(2000, 1, 1)


def _second(k: float) -> datetime:
    return START + timedelta(seconds=float(k))


class MerweTransition(TransitionModel):
    scenario: Any = Property()

    @property
    def ndim_state(self) -> int:
        return 1

    def function(self, state: Any, noise: Any = False, **kwargs: Any) -> Any:
        s = self.scenario
        k = (state.timestamp + kwargs["time_interval"] - START).total_seconds()
        moved = 1.0 + np.sin(s.w * np.pi * k) + s.phi1 * state.state_vector
        if noise is True:
            noise = self.rvs(num_samples=state.state_vector.shape[1])
        return moved + noise

    def rvs(self, num_samples: int = 1, **kwargs: Any) -> Any:
        s = self.scenario
        return StateVectors(np.random.gamma(s.gamma_shape, 1.0 / s.gamma_rate, (1, num_samples)))

    def pdf(self, state1: Any, state2: Any, **kwargs: Any) -> Any:
        raise NotImplementedError


class MerweMeasurement(NonLinearGaussianMeasurement):
    scenario: Any = Property()

    @property
    def ndim_meas(self) -> int:
        return 1

    def function(self, state: Any, noise: Any = False, **kwargs: Any) -> Any:
        s, x = self.scenario, state.state_vector
        quadratic = (state.timestamp - START).total_seconds() <= s.switch
        return s.phi2 * x * x if quadratic else s.phi3 * x - 2.0


def _particle_filter(
    transition: Any, sensor: Any, clouds: list[Array], z: Array, times: Array
) -> Array:
    """Estimates (n_x, T, M); a cloud (n_x, N) per run; z (n_z, T, M); times (T + 1,)."""
    predictor = ParticlePredictor(transition)
    updater = ParticleUpdater(sensor, SystematicResampler())
    out = np.empty((len(clouds[0]), z.shape[1], len(clouds)))
    for m, cloud in enumerate(clouds):
        N = cloud.shape[1]
        state: Any = ParticleState(
            StateVectors(cloud), weight=np.full(N, 1.0 / N), timestamp=_second(times[0])
        )
        for t, now in enumerate(times[1:]):
            prediction = predictor.predict(state, timestamp=_second(now))
            seen = Detection(StateVector(z[:, t, m]), timestamp=_second(now))
            state = updater.update(SingleHypothesis(prediction, seen))
            out[:, t, m] = np.asarray(state.mean, dtype=float).ravel()
    return out


def merwe_pf(scenario: Any, z: Array, N: int) -> Array:
    """Bootstrap filter; z (1, T, M), estimates (1, T, M) from the resampled cloud."""
    sensor = MerweMeasurement(
        ndim_state=1,
        mapping=(0,),
        noise_covar=CovarianceMatrix([[scenario.R]]),
        scenario=scenario,
    )
    clouds = [np.full((1, N), scenario.x1)] * z.shape[2]
    return _particle_filter(MerweTransition(scenario=scenario), sensor, clouds, z, scenario.steps)


def banana_pf(q: float, R: Array, clouds: list[Array], z: Array, times: Array) -> Array:
    """Bootstrap filter of range and azimuth; z (2, T, M) as range, azimuth; estimates (4, T, M)."""
    motion = CombinedLinearGaussianTransitionModel([ConstantVelocity(q), ConstantVelocity(q)])
    sensor = CartesianToBearingRange(
        ndim_state=4, mapping=(0, 2), noise_covar=CovarianceMatrix(R[::-1, ::-1])
    )
    return _particle_filter(motion, sensor, clouds, z[::-1], times)


def kalman_cv(q: float, R: Array, mean: Array, cov: Array, z: Array, times: Array) -> Array:
    """Kalman filter of positions z (2, T, M) from N(mean, cov), mean (4, M); estimates (4, T, M)."""
    motion = CombinedLinearGaussianTransitionModel([ConstantVelocity(q), ConstantVelocity(q)])
    sensor = LinearGaussian(ndim_state=4, mapping=(0, 2), noise_covar=CovarianceMatrix(R))
    predictor, updater = KalmanPredictor(motion), KalmanUpdater(sensor)
    out = np.empty((4, *z.shape[1:]))
    for m in range(z.shape[2]):
        state: Any = GaussianState(mean[:, m], cov, timestamp=_second(times[0]))
        for t, now in enumerate(times[1:]):
            prediction = predictor.predict(state, timestamp=_second(now))
            seen = Detection(StateVector(z[:, t, m]), timestamp=_second(now))
            state = updater.update(SingleHypothesis(prediction, seen))
            out[:, t, m] = np.asarray(state.state_vector, dtype=float).ravel()
    return out
