"""Predictive log-likelihoods against joint densities and each other."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from tests.conftest import track
from tests.filters.test_nonlinear_oracles import SCENARIO
from tests.linear_problem import LINEAR
from tests.papers import maneuver
from trackbench.core.arrays import Array
from trackbench.core.random_streams import RunStreams
from trackbench.evaluation.simulated_runs import simulate
from trackbench.filters.adaptive_kf.adaptive_kf_and_vdf import VDF, AdaptiveKF
from trackbench.filters.adaptive_kf.decision_keys_and_thresholds import Detector
from trackbench.filters.alpha_beta import AlphaBeta
from trackbench.filters.cmkf import CMKF
from trackbench.filters.ekf import EKF, IEKF
from trackbench.filters.gauss_hermite_filter import GHKF
from trackbench.filters.imm import IMM
from trackbench.filters.input_estimation import InputEstimation
from trackbench.filters.iplf import IPLF
from trackbench.filters.kf import KF
from trackbench.filters.ukf import CKF, UKF
from trackbench.models.motions.kinematic import ConstantAcceleration, ConstantVelocity
from trackbench.models.sensors.position import PositionSensor
from trackbench.models.sensors.range_azimuth import RangeAzimuth
from trackbench.scenarios.base import Scenario
from trackbench.scenarios.targets.legs import Leg

CV, CA = ConstantVelocity(q=0.1), ConstantAcceleration(q=1e-3)
TURN = Leg(start=120, end=220, ax=1.0, ay=-0.8)
QUIET: dict[str, Any] = {"nmf": CV, "mf": CA, "detector": Detector(eta=1e9, window_s=20.0)}


def told(scenario: Scenario, tracker: Any, runs: int, seed: int = 1) -> Array:
    """log p(z_k | z_1..k-1) (T, M)."""
    found = track(scenario, tracker, runs, seed, predictive_metrics=("score",))
    return found.diagnostics["log_likelihood"][1:]


def joint_density(scenario: Any, z: Array, run: int) -> float:
    """Log-density of all measurements of a run of a linear model at once, by one big covariance."""
    motion, sensor = scenario.model
    F, Q, T, x = motion.F, motion.Q, z.shape[1], np.zeros((len(motion.F), 1))
    H, R = sensor.jacobian(x, 1), sensor.measurement(x, 1).cov
    H = H[..., 0] if H.ndim == 3 else H
    prior = scenario.simulate(RunStreams(1, range(run + 1)), run + 1).prior
    n = len(F)
    # x_k = F^k x_0 + sum_j F^(k-j) w_j: all states as one linear function of x_0, w_1, ..., w_T.
    powers = [np.linalg.matrix_power(F, i) for i in range(T + 1)]
    G = np.zeros((T * n, (T + 1) * n))
    for k in range(1, T + 1):
        for j in range(k + 1):
            G[(k - 1) * n : k * n, j * n : (j + 1) * n] = powers[k - j]
    sources = np.kron(np.eye(T + 1), Q)
    sources[:n, :n] = prior.cov
    big = np.kron(np.eye(T), H)
    mean = big @ G[:, :n] @ prior.mean[:, run]
    cov = big @ G @ sources @ G.T @ big.T + np.kron(np.eye(T), R)
    seen = z[..., run].T.ravel()
    there = ~np.isnan(seen)
    return float(multivariate_normal(mean[there], cov[np.ix_(there, there)]).logpdf(seen[there]))


@pytest.mark.parametrize(
    "tracker",
    [KF(), EKF(), IEKF(), UKF(), UKF(noise="additive"), CKF(), GHKF(), IPLF()],
    ids=lambda f: f"{f.kind}",
)
def test_gaussian_filters_give_the_joint_density_of_all_measurements(tracker: Any) -> None:
    one = PositionSensor(sigma=2.0, detection=0.7)
    other = PositionSensor(sigma=1.0, period=2)
    for sensor in (PositionSensor(sigma=2.0), one, (one, other)):
        scenario = replace(LINEAR, sensor=sensor)
        found, z = told(scenario, tracker, 4), simulate(scenario, 1, 0, 4).measurements
        assert np.array_equal(np.isnan(found), np.isnan(z).all(axis=0))
        for run in range(4):
            expected = joint_density(scenario, z, run)
            assert np.nansum(found[:, run]) == pytest.approx(expected, rel=1e-9)


def test_half_a_measurement_counts_as_half() -> None:
    z = simulate(LINEAR, 1, 0, 1).measurements.copy()
    z[1, 2], z[0, 4] = np.nan, np.nan
    model, state = LINEAR.model, None
    prior, rng, found = simulate(LINEAR, 1, 0, 1).prior, np.random.default_rng(1), 0.0
    state = KF().init(model, prior, rng)
    for i in range(z.shape[1]):
        state = KF().step(model, state, z[:, i], i + 1, rng)
        found += float(KF().log_likelihood(state)[0])
    assert found == pytest.approx(joint_density(LINEAR, z, 0), rel=1e-9)


@pytest.mark.parametrize("conversion", ["ccm", "ucm", "mucm", "ducm"])
def test_converted_measurements_are_scored_as_range_and_azimuth(conversion: Any) -> None:
    """Of a sharp radar a conversion is linear, and the density of (x, y) is r times too small."""
    sharp = RangeAzimuth(sigma_range=1.0, sigma_azimuth_mrad=0.05)
    scenario = replace(SCENARIO, sensor=sharp)
    expected, found = told(scenario, EKF(), 50), told(scenario, CMKF(conversion=conversion), 50)
    assert np.abs(found - expected).mean() < 0.02  # log r is 9
    models = IMM(motions=(CV, CV), transition=((0.5, 0.5), (0.5, 0.5)), filter=CMKF())
    assumed = replace(scenario, assume=replace(scenario.assume, motion=CV))
    alone = told(assumed, CMKF(), 50)
    np.testing.assert_allclose(told(assumed, models, 50), alone, rtol=1e-9)


@pytest.mark.parametrize(
    "tracker",
    [
        AdaptiveKF(**QUIET),
        VDF(nmf=CV, mf=CA, eta=1e9),
        InputEstimation(motion=CV, eta=1e9, window_s=20.0, min_window_s=5.0),
    ],
    ids=lambda f: f"{f.kind}",
)
def test_without_an_alarm_a_switching_filter_scores_as_its_quiet_one(tracker: Any) -> None:
    scenario = maneuver(duration=120.0, score_from=0.0, legs=())
    scenario = replace(scenario, assume=replace(scenario.assume, motion=CV))
    np.testing.assert_allclose(told(scenario, tracker, 3), told(scenario, KF(), 3), rtol=1e-9)


def test_a_switching_filter_scores_by_the_filter_that_was_on() -> None:
    """The maneuvering filter's S is larger, and its innovations in a turn are smaller."""
    scenario = maneuver(duration=300.0, score_from=0.0, legs=(TURN,))
    detector = Detector(eta=20.0, window_s=20.0)
    alert = track(
        scenario, AdaptiveKF(**{**QUIET, "detector": detector}), 20, predictive_metrics=("score",)
    ).diagnostics
    log_det = -2.0 * alert["log_likelihood"] - alert["nis"] - 2.0 * np.log(2.0 * np.pi)
    was = np.vstack([alert["mode"][:1], alert["mode"][:-1]])[60:] == 1.0
    assert was.any()
    assert not was.all()
    assert np.nanmin(log_det[60:][was]) > np.nanmax(
        log_det[60:][~was & ~after_a_switch(alert["mode"])[60:]]
    )


def after_a_switch(mode: Array) -> Array:
    """Steps within 30 of a change of the mode."""
    changed = np.abs(np.diff(mode, axis=0, prepend=mode[:1])) > 0
    return np.array([changed[max(0, k - 30) : k + 1].any(axis=0) for k in range(len(mode))])


def test_alpha_beta_settles_at_the_kalman_filters_score() -> None:
    scenario = maneuver(duration=400.0, score_from=0.0, legs=())
    motion = ConstantVelocity(q=0.05)
    scenario = replace(scenario, assume=replace(scenario.assume, motion=motion))
    found, exact = told(scenario, AlphaBeta(q=0.05), 5), told(scenario, KF(), 5)
    np.testing.assert_allclose(found[-50:], exact[-50:], atol=1e-3)
