"""`kf` and `imm` against filterpy on the same measurements."""

from typing import Any

import numpy as np
import pytest

from tests.conftest import track
from tests.papers import maneuver, seen_as
from trackbench.core.random_streams import RunStreams
from trackbench.filters.alpha_beta import AlphaBeta
from trackbench.filters.imm import IMM
from trackbench.filters.kf import KF
from trackbench.models.motions.coordinated_turn import CoordinatedTurn
from trackbench.models.motions.kinematic import (
    ConstantAcceleration,
    ConstantVelocity,
    WhiteAcceleration,
)
from trackbench.scenarios.targets.legs import Leg

SCENARIO = maneuver(duration=120.0, legs=(Leg(start=40, end=80, ax=0.3, ay=-0.2),), score_from=0.0)
RUNS = 2
CV, CA = ConstantVelocity(q=0.02), ConstantAcceleration(q=1e-3, initial_std=0.3)
MOTIONS = [CV, CA, WhiteAcceleration(q=0.1), CoordinatedTurn(turn_rate_deg_s=1.0, q=0.01)]
RELATIVE = 1e-9


def data(seed: int = 1) -> Any:
    return SCENARIO.simulate(RunStreams(seed, range(RUNS)), RUNS)


def start(motion: Any, run: int) -> tuple[np.ndarray, np.ndarray]:
    """The prior as the other libraries take it."""
    prior = data().prior
    n = len(motion.sampled(1.0).F)
    mean, cov = np.zeros(n), np.zeros((n, n))
    mean[:4], cov[:4, :4] = prior.mean[:, run], prior.cov
    cov[4:, 4:] = 0.3**2 * np.eye(n - 4)
    return mean, cov


def close(ours: np.ndarray, theirs: np.ndarray) -> None:
    np.testing.assert_allclose(ours, theirs, rtol=RELATIVE, atol=RELATIVE * np.abs(theirs).max())


def filterpy_filter(motion: Any, run: int, size: int | None = None) -> Any:
    """filterpy's KalmanFilter of one motion; a smaller one may be padded with dead components."""
    from filterpy.kalman import KalmanFilter

    sampled = motion.sampled(1.0)
    n, m = len(sampled.F), size or len(sampled.F)
    mean, cov = start(motion, run)
    other = KalmanFilter(dim_x=m, dim_z=2)
    other.F, other.Q, other.P = np.zeros((m, m)), np.zeros((m, m)), np.zeros((m, m))
    other.x, other.H, other.R = np.zeros(m), np.zeros((2, m)), 1e4 * np.eye(2)
    other.F[:n, :n], other.Q[:n, :n], other.P[:n, :n] = sampled.F, sampled.Q, cov
    other.x[:n], other.H[0, 0], other.H[1, 2] = mean, 1.0, 1.0
    return other


@pytest.mark.parametrize("motion", MOTIONS, ids=lambda m: m.kind)
def test_kf_agrees_with_filterpy(motion: Any) -> None:
    ours, z = track(seen_as(SCENARIO, motion), KF(), RUNS), data().measurements
    for run in range(RUNS):
        other = filterpy_filter(motion, run)
        means, nis = [], []
        for k in range(z.shape[1]):
            other.predict()
            other.update(z[:, k, run])
            means.append(other.x[:4].copy())
            nis.append(float(other.y @ np.linalg.solve(other.S, other.y)))
        close(ours.mean[:, 1:, run], np.array(means).T)
        close(ours.diagnostics["nis"][1:, run], np.array(nis))


@pytest.mark.parametrize("motions", [(CV, CoordinatedTurn(turn_rate_deg_s=2.0, q=0.01)), (CV, CA)])
def test_imm_agrees_with_filterpy(motions: tuple[Any, ...]) -> None:
    """Unequal sizes: filterpy gets the smaller model padded with components that it sets to zero."""
    from filterpy.kalman import IMMEstimator

    transition = ((0.95, 0.05), (0.10, 0.90))
    tracker = IMM(motions=motions, transition=transition, initial=(0.7, 0.3), mixing="zero")
    ours, z = track(SCENARIO, tracker, RUNS), data().measurements
    size = max(len(m.sampled(1.0).F) for m in motions)
    for run in range(RUNS):
        filters = [filterpy_filter(m, run, size) for m in motions]
        other = IMMEstimator(filters, np.array([0.7, 0.3]), np.array(transition))
        means, modes = [], []
        for k in range(z.shape[1]):
            other.predict()
            other.update(z[:, k, run])
            means.append(other.x[:4].copy())
            modes.append(other.mu[1])
        close(ours.mean[:, 1:, run], np.array(means).T)
        close(ours.diagnostics["mode"][1:, run], np.array(modes))


def test_imm_of_equal_models_is_the_kalman_filter() -> None:
    tracker = IMM(motions=(CA, CA), transition=((0.9, 0.1), (0.4, 0.6)), initial=(1.0, 0.0))
    ours, alone = track(SCENARIO, tracker, RUNS), track(seen_as(SCENARIO, CA), KF(), RUNS)
    close(ours.mean, alone.mean)
    w = np.array([1.0, 0.0])
    for mode in ours.diagnostics["mode"][1:, 0]:
        w = w @ np.array([[0.9, 0.1], [0.4, 0.6]])
        assert mode == pytest.approx(w[1], rel=1e-9)


def test_alpha_beta_is_the_steady_state_of_the_kalman_filter() -> None:
    """Kalata's gains are the Riccati equation's, and so is the covariance that is reported."""
    long = maneuver(duration=400.0, legs=(), score_from=0.0)
    tracker = AlphaBeta(q=0.3)
    assumed = seen_as(long, ConstantVelocity(q=0.3))
    ab, kf = track(long, tracker, RUNS), track(assumed, KF(), RUNS)
    np.testing.assert_allclose(ab.mean[:, -1], kf.mean[:, -1], rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(ab.nees[-1], kf.nees[-1], rtol=1e-6)


def test_alpha_beta_starts_with_least_squares() -> None:
    """With no noise assumed to speak of, the start is the straight line through the first points."""
    tracker = AlphaBeta(q=1e-12)
    ours, z = track(SCENARIO, tracker, RUNS), data().measurements
    prior = data().prior.mean
    first = prior[[0, 2]] - prior[[1, 3]]  # z_0 = z_1 - T v
    points = np.stack([first, prior[[0, 2]], *(z[:, k] for k in range(8))], axis=1)
    t = np.arange(10.0)
    for axis, run in [(0, 0), (1, 1)]:
        slope, intercept = np.polyfit(t, points[axis, :, run], 1)
        assert ours.mean[2 * axis, 8, run] == pytest.approx(intercept + 9.0 * slope, rel=1e-9)
        assert ours.mean[2 * axis + 1, 8, run] == pytest.approx(slope, rel=1e-7)
