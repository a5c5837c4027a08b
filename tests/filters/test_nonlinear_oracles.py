"""Gaussian steps on a radar against filterpy and Stone Soup on the same measurements."""

import datetime
from typing import Any

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from tests.conftest import track
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.gauss_hermite_points import GaussHermite
from trackbench.core.random_streams import RunStreams
from trackbench.filters.ekf import EKF
from trackbench.filters.gauss_hermite_filter import GHKF
from trackbench.filters.imm import IMM
from trackbench.filters.ukf import CKF, UKF
from trackbench.models.assume import Assume
from trackbench.models.motions.coordinated_turn import CoordinatedTurn
from trackbench.models.motions.kinematic import ConstantVelocity, WhiteAcceleration
from trackbench.models.sensors.range_azimuth import RangeAzimuth
from trackbench.scenarios.starts.gaussian import GaussianStart
from trackbench.scenarios.targets.initial_state import Launch
from trackbench.scenarios.targets.legs import Leg, Legs
from trackbench.scenarios.tracking import Tracking

RUNS = 2
RELATIVE = 1e-8
MOTION = WhiteAcceleration(q=2.0)
RADAR = RangeAzimuth(sigma_range=40.0, sigma_azimuth_mrad=8.0)
SCENARIO = Tracking(
    T=2.0,
    last=60,
    target=Legs(
        launch=Launch(x=6000.0, y=-3000.0, vx=-90.0, vy=60.0),
        legs=(Leg(start=30.0, end=70.0, turn_rate_deg_s=2.0),),
    ),
    sensor=RADAR,
    start=GaussianStart(sigma=(80.0, 8.0, 80.0, 8.0)),
    assume=Assume(motion=MOTION),
)


def data() -> Any:
    return SCENARIO.simulate(RunStreams(1, range(RUNS)), RUNS)


def close(ours: Array, theirs: Array) -> None:
    np.testing.assert_allclose(ours, theirs, rtol=RELATIVE, atol=RELATIVE * np.abs(theirs).max())


def h(x: Array) -> Array:
    return np.array([np.hypot(x[0], x[2]), np.arctan2(x[2], x[0])])


def jacobian(x: Array) -> Array:
    r = np.hypot(x[0], x[2])
    return np.array([[x[0] / r, 0.0, x[2] / r, 0.0], [-x[2] / r**2, 0.0, x[0] / r**2, 0.0]])


def difference(a: Array, b: Array) -> Array:
    d = a - b
    d[1] = (d[1] + np.pi) % (2.0 * np.pi) - np.pi
    return d


def filterpy_ekf(motion: Any, run: int) -> Any:
    from filterpy.kalman import ExtendedKalmanFilter

    class Radar(ExtendedKalmanFilter):  # called as an IMM calls it
        def predict(self, u: Any = None) -> None:
            super().predict(0)

        def update(self, z: Array) -> None:
            super().update(z, jacobian, h, residual=difference)

    sampled, prior = motion.sampled(SCENARIO.T), data().prior
    other = Radar(dim_x=4, dim_z=2)
    other.x, other.P = prior.mean[:, run].copy(), prior.cov.copy()
    other.F, other.Q, other.R = sampled.F.copy(), sampled.Q.copy(), RADAR.R.copy()
    return other


def test_ekf_agrees_with_filterpy() -> None:
    ours = track(SCENARIO, EKF(), RUNS, predictive_metrics=("score",))
    z = data().measurements
    for run in range(RUNS):
        other, means, scores = filterpy_ekf(MOTION, run), [], []
        for k in range(z.shape[1]):
            other.predict()
            other.update(z[:, k, run])
            means.append(other.x.copy())
            scores.append(multivariate_normal(cov=other.S).logpdf(other.y))
        close(ours.mean[:, 1:, run], np.array(means).T)
        close(ours.diagnostics["log_likelihood"][1:, run], np.array(scores))


def test_imm_of_ekfs_agrees_with_filterpy() -> None:
    from filterpy.kalman import IMMEstimator

    motions = (ConstantVelocity(q=0.01), CoordinatedTurn(turn_rate_deg_s=2.0, q=0.1))
    transition = ((0.95, 0.05), (0.1, 0.9))
    tracker = IMM(motions=motions, transition=transition, initial=(0.7, 0.3))
    ours = track(SCENARIO, tracker, RUNS, predictive_metrics=("score",))
    z = data().measurements
    for run in range(RUNS):
        bank = [filterpy_ekf(motion, run) for motion in motions]
        other = IMMEstimator(bank, (0.7, 0.3), np.array(transition))
        means, modes, scores = [], [], []
        for k in range(z.shape[1]):
            other.predict()
            weights = other.cbar.copy()
            other.update(z[:, k, run])
            means.append(other.x.copy())
            modes.append(other.mu[1])
            densities = [multivariate_normal(cov=f.S).pdf(f.y) for f in bank]
            scores.append(np.log(weights @ densities))
        close(ours.mean[:, 1:, run], np.array(means).T)
        close(ours.diagnostics["mode"][1:, run], np.array(modes))
        close(ours.diagnostics["log_likelihood"][1:, run], np.array(scores))


def stone_soup_means(predictor: Any, updater: Any, run: int) -> Array:
    from stonesoup.types.array import CovarianceMatrix, StateVector
    from stonesoup.types.detection import Detection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.state import GaussianState

    begin, found = datetime.datetime(2026, 1, 1), data()
    mean, cov = found.prior.mean[:, run], found.prior.cov
    state: Any = GaussianState(StateVector(mean), CovarianceMatrix(cov), timestamp=begin)
    means = []
    for k in range(found.measurements.shape[1]):
        now = begin + datetime.timedelta(seconds=SCENARIO.T * (k + 1))
        r, a = found.measurements[:, k, run]
        seen = Detection(
            StateVector([a, r]), timestamp=now, measurement_model=updater.measurement_model
        )
        state = updater.update(SingleHypothesis(predictor.predict(state, timestamp=now), seen))
        means.append(np.asarray(state.state_vector, dtype=float).ravel())
    return np.array(means).T


def stone_soup_models() -> tuple[Any, Any]:
    """Motion and radar; its own radar would average bearings on the circle, which is another filter."""
    from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement
    from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel
    from stonesoup.types.array import CovarianceMatrix, StateVectors

    class Radar(NonLinearGaussianMeasurement):
        ndim_meas = 2

        def function(self, state: Any, noise: Any = False, **keys: Any) -> Any:
            x = np.asarray(state.state_vector, dtype=float)
            return StateVectors(np.array([np.arctan2(x[2], x[0]), np.hypot(x[0], x[2])]))

        def rvs(self, *args: Any, **keys: Any) -> Any:
            raise NotImplementedError

        def pdf(self, *args: Any, **keys: Any) -> Any:
            raise NotImplementedError

    sampled = MOTION.sampled(SCENARIO.T)
    motion = LinearGaussianTimeInvariantTransitionModel(
        transition_matrix=sampled.F, covariance_matrix=sampled.Q
    )
    noise = CovarianceMatrix(RADAR.R[::-1, ::-1].copy())
    return motion, Radar(ndim_state=4, mapping=(0, 2), noise_covar=noise)


def test_ukf_agrees_with_stone_soup() -> None:
    from stonesoup.predictor.kalman import UnscentedKalmanPredictor
    from stonesoup.updater.kalman import UnscentedKalmanUpdater

    motion, radar = stone_soup_models()
    keys = {"alpha": 0.8, "beta": 1.5, "kappa": 1.0}
    ours = track(SCENARIO, UKF(noise="additive", **keys), RUNS)
    for run in range(RUNS):
        theirs = stone_soup_means(
            UnscentedKalmanPredictor(motion, **keys), UnscentedKalmanUpdater(radar, **keys), run
        )
        close(ours.mean[:, 1:, run], theirs)


def test_ckf_is_a_ukf_without_spread() -> None:
    ours = track(SCENARIO, CKF(), RUNS)
    other = track(SCENARIO, UKF(noise="additive", kappa=0.0), RUNS)
    np.testing.assert_array_equal(ours.mean, other.mean)


def test_gauss_hermite_of_a_higher_order_changes_little() -> None:
    third, fifth = (track(SCENARIO, GHKF(order=order), RUNS).mean for order in (3, 5))
    ekf = track(SCENARIO, EKF(), RUNS).mean
    assert np.abs(third - fifth).max() < 0.05 * np.abs(third - ekf).max()


@pytest.mark.parametrize("order", range(2, 10))
def test_gauss_hermite_nodes(order: int) -> None:
    nodes, weights = np.polynomial.hermite_e.hermegauss(order)
    ours = np.array(GaussHermite(order).nodes)
    np.testing.assert_allclose(ours[:, 0], nodes, atol=1e-14)
    np.testing.assert_allclose(ours[:, 1], weights / weights.sum(), rtol=1e-13)


@pytest.mark.parametrize(("order", "f"), [(3, lambda x: x**5 - x**4), (5, lambda x: x**8)])
def test_gauss_hermite_against_quadrature(order: int, f: Any) -> None:
    from scipy.integrate import quad

    mean, variance = 0.7, 1.3
    points = GaussHermite(order).points(Gaussian(np.array([[mean]]), np.array([[[variance]]])))
    ours = points.mean(f(points.x))[0, 0]

    def integrand(x: float) -> float:
        return f(x) * np.exp(-0.5 * (x - mean) ** 2 / variance) / np.sqrt(2 * np.pi * variance)

    exact, _ = quad(integrand, mean - 14, mean + 14, epsabs=1e-12)
    assert ours == pytest.approx(exact, rel=1e-9)
