"""The smoother of the IMM against Kalman smoothers and all sequences of models."""

from functools import cache
from itertools import pairwise, product
from typing import Any

import numpy as np
import pytest

from tests.conftest import make_filter, per_run, track
from tests.filters.test_unequal_steps import INTERVALS, least_squares, smoothed_moments
from tests.papers import maneuver, seen_as
from trackbench.core.distributions import Gaussian
from trackbench.core.mixtures import combine
from trackbench.evaluation.simulated_runs import simulate
from trackbench.filters.imm import IMM, ModelBank
from trackbench.filters.imm_smoother import given_later
from trackbench.filters.kf import KF
from trackbench.filters.smoother_keys import FixedLag
from trackbench.models.base import Motion
from trackbench.models.motions.kinematic import ConstantAcceleration, WhiteAcceleration
from trackbench.models.motions.singer import Singer
from trackbench.models.sensors.position import PositionSensor
from trackbench.scenarios.starts.gaussian import GaussianStart
from trackbench.scenarios.targets.driven import Driven
from trackbench.scenarios.targets.initial_state import Launch
from trackbench.scenarios.targets.legs import Leg
from trackbench.scenarios.tracking import Tracking

T, RUNS, SIGMA, START = 5, 60, 20.0, (60.0, 4.0, 60.0, 4.0)
SLOW, QUICK = WhiteAcceleration(q=0.5), WhiteAcceleration(q=2000.0)
FADING = Singer(sigma=3.0, tau=20.0)
P = np.array([[0.8, 0.2], [0.3, 0.7]])
SCENARIO = Tracking(
    target=Driven(motion=WhiteAcceleration(q=300.0), launch=Launch(x=900.0, y=700.0, vx=-5.0)),
    sensor=PositionSensor(sigma=SIGMA, detection=0.8),
    start=GaussianStart(sigma=START),
    last=T,
)


def make_imm(
    motions: tuple[Motion, Motion],
    transition: Any,
    initial: tuple[float, float],
    smooth: Any = True,
) -> Any:
    rows = tuple(tuple(map(float, row)) for row in transition)
    return make_filter("imm", motions=motions, transition=rows, initial=initial, smooth=smooth)


def assert_same(imm: IMM, motion: Motion) -> None:
    """Compare an IMM that smooths with the Kalman smoother of one motion."""
    found = track(SCENARIO, imm, RUNS, covariances=RUNS)
    expected = track(seen_as(SCENARIO, motion), KF(smooth=True), RUNS, covariances=RUNS)
    assert found.cov is not None
    assert expected.cov is not None
    np.testing.assert_allclose(found.mean, expected.mean[:4], rtol=1e-9)
    np.testing.assert_allclose(found.cov, expected.cov[:4, :4], rtol=1e-7, atol=1e-7)


def test_one_model_of_two_is_a_kalman_smoother() -> None:
    assert_same(make_imm((SLOW, QUICK), np.eye(2), (1, 0)), SLOW)
    assert_same(make_imm((SLOW, QUICK), np.eye(2), (0, 1)), QUICK)


@pytest.mark.parametrize("lag", [None, 2])
def test_models_that_take_turns_at_unequal_steps_against_least_squares(lag: int | None) -> None:
    """Of the first step on QUICK, SLOW, QUICK, ...: one sequence of models has all the weight."""
    smooth = True if lag is None else FixedLag(lag=lag)
    found = smoothed_moments(make_imm((SLOW, QUICK), ((0, 1), (1, 0)), (1, 0), smooth))
    noise = [(QUICK.q, SLOW.q)[i % 2] for i in range(len(INTERVALS))]
    for a, b in zip(found[:2], least_squares(noise, lag), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize(("number", "other"), [(1, SLOW), (0, FADING)])
def test_a_switch_to_another_state_is_a_kalman_smoother(number: int, other: Motion) -> None:
    """The first step is certainly in one model and the others in one of more or fewer components."""
    motions, row = (SLOW, FADING), [float(number == 0), float(number == 1)]
    initial = (row[1], row[0])
    assert_same(make_imm(motions, [row, row], initial), motions[number])


def all_sequences(z: np.ndarray, mean: np.ndarray, steps: int) -> tuple[np.ndarray, ...]:
    """Return means (T + 1, 4), variances and model probabilities (T + 1, 2), by all 2^(T + 1) sequences.

    Given a sequence, all states and the measurements of the first steps are jointly Gaussian.
    """
    models = [m.sampled(1.0) for m in (SLOW, QUICK)]
    seen = [k for k in range(1, steps + 1) if np.isfinite(z[0, k - 1])]
    H = np.zeros((2 * len(seen), 4 * (T + 1)))
    for i, k in enumerate(seen):
        H[2 * i, 4 * k] = H[2 * i + 1, 4 * k + 2] = 1.0
    values = np.concatenate([z[:, k - 1] for k in seen])
    logs, means, variances, sequences = [], [], [], list(product(range(2), repeat=T + 1))
    for sequence in sequences:
        m, C = np.zeros(4 * (T + 1)), np.zeros((4 * (T + 1),) * 2)
        m[:4], C[:4, :4] = mean, np.diag(np.square(START))
        log_w = np.log(0.5)
        for k in range(1, T + 1):
            log_w += np.log(P[sequence[k - 1], sequence[k]])
            F, Q = models[sequence[k]].F, models[sequence[k]].Q
            a, b = slice(4 * k - 4, 4 * k), slice(4 * k, 4 * k + 4)
            m[b], C[b] = F @ m[a], F @ C[a]
            C[:, b] = C[b].T
            C[b, b] = F @ C[a, a] @ F.T + Q
        S, nu = H @ C @ H.T + SIGMA**2 * np.eye(len(H)), values - H @ m
        K = C @ H.T @ np.linalg.inv(S)
        logs.append(log_w - 0.5 * (nu @ np.linalg.solve(S, nu) + np.linalg.slogdet(S)[1]))
        means.append((m + K @ nu).reshape(T + 1, 4))
        variances.append(np.diag(C - K @ H @ C).reshape(T + 1, 4))
    w = np.exp(np.array(logs) - max(logs))
    w /= w.sum()
    weighted = np.einsum("s,ski->ki", w, np.array(means))
    spread = np.array(variances) + np.square(np.array(means) - weighted)
    number = np.array(sequences).T[..., None] == np.arange(2)
    return weighted, np.einsum("s,ski->ki", w, spread), np.einsum("s,ksj->kj", w, number)


@cache
def exact_by_run() -> list[dict[int, tuple[np.ndarray, ...]]]:
    """Return `all_sequences` of each run by the number of its measurements, if there is one."""
    data, by_run = simulate(SCENARIO, 1, 0, RUNS), []
    for run in range(RUNS):
        z, mean = data.measurements[..., run], data.prior.mean[:, run]
        ends = [end for end in range(1, T + 1) if np.isfinite(z[0, :end]).any()]
        by_run.append({end: all_sequences(z, mean, end) for end in ends})
    return by_run


def banks(tracker: IMM, data: Any) -> tuple[list[ModelBank], list[ModelBank]]:
    """Return the banks of the filter and of the smoother at every step."""
    rng = np.random.default_rng(1)
    states = [tracker.init(SCENARIO.model, data.prior, rng)]
    for k in range(1, T + 1):
        z = data.measurements[:, k - 1]
        states.append(tracker.step(SCENARIO.model, states[-1], z, k, rng))
    return states, tracker.smoothed(SCENARIO.model, states, 0, rng)


@pytest.mark.parametrize("lag", [None, 2])
def test_two_models_are_near_all_sequences_of_models(lag: int | None) -> None:
    """An IMM merges states that differ by earlier models; its smoother adds little to that error.

    Errors are in exact deviations of each component: the filter's of what it estimates, x_k given the
    measurements up to k, then the filter's and the smoother's given the later ones as well.
    """
    data = simulate(SCENARIO, 1, 0, RUNS)
    smooth = True if lag is None else FixedLag(lag=lag)
    tracker = make_imm((SLOW, QUICK), P, (0.5, 0.5), smooth)
    filtered, smoothed = banks(tracker, data)
    rows = []
    for run, exact in enumerate(exact_by_run()):
        for k in range(1, T):
            ends = k, min(k + (lag or T), T)
            if not set(ends) <= exact.keys():
                continue
            cases = (filtered, ends[0]), (filtered, ends[1]), (smoothed, ends[1])
            rows.append([compared(tracker, of[k], run, exact[end], k) for of, end in cases])
    assert len(rows) > 150
    mean, variance, weight = np.array(rows).transpose(2, 1, 0, 3).reshape(3, 3, -1)
    by_merging, filters, smoothers = np.sqrt(np.mean(np.square(mean), axis=1))
    assert smoothers < 1.5 * by_merging < 0.35
    assert filters > 3.0 * smoothers
    assert abs(variance[2].mean()) < 0.1
    assert variance[1].mean() > 0.5
    of_filter, of_smoother = np.sqrt(np.mean(np.square(weight[1:]), axis=1))
    assert of_smoother < 0.8 * of_filter


def compared(
    tracker: IMM, bank: ModelBank, run: int, exact: tuple[np.ndarray, ...], k: int
) -> np.ndarray:
    """Return errors (3, 4) of mean, log-variance and first model's probability."""
    mean, variance, weights = (rows[k] for rows in exact)
    found = tracker.estimate(bank)
    return np.array(
        [
            (found.mean[:, run] - mean) / np.sqrt(variance),
            np.log(np.diag(found.cov[..., run]) / variance),
            np.full(4, bank.weights[0, run] - weights[0]),
        ]
    )


def test_predictions_given_a_later_likelihood() -> None:
    """By integrals on a line: two predictions, and a likelihood N(y; x, R) of what comes later."""
    x = np.linspace(-60.0, 60.0, 60001)

    def density(m: float, v: float) -> np.ndarray:
        return np.exp(-0.5 * (x - m) ** 2 / v) / np.sqrt(2 * np.pi * v)

    parts, mixing, y, R = [(0.0, 1.0), (3.0, 4.0)], np.array([[0.7], [0.3]]), 5.0, 2.0
    predicted = [Gaussian(np.full((1, 1), m), np.full((1, 1, 1), v)) for m, v in parts]
    mixed = combine(predicted, mixing)
    m, v = mixed.mean.item(), mixed.cov.item()
    K = v / (v + R)
    later = Gaussian(np.full((1, 1), m + K * (y - m)), np.full((1, 1, 1), v - K * v))
    given, log_c = given_later(predicted, mixing, later)
    masses = []
    for g, (a, b) in zip(given, parts, strict=True):
        p = density(a, b) * density(y, R)
        masses.append(p.sum())
        at = (x @ p) / p.sum()
        np.testing.assert_allclose([g.mean.item(), g.cov.item()], [at, (x - at) ** 2 @ p / p.sum()])
    np.testing.assert_allclose(log_c[1] - log_c[0], np.log(masses[1] / masses[0]))


def test_a_later_state_of_more_spread_than_predicted_is_left_out() -> None:
    """The second run's quotient is no density, so that its predictions stay as they are."""
    predicted = [Gaussian(np.zeros((1, 2)), np.full((1, 1, 2), v)) for v in (1.0, 9.0)]
    later = Gaussian(np.ones((1, 2)), np.array([[[0.5, 90.0]]]))
    given, log_c = given_later(predicted, np.full((2, 2), 0.5), later)
    for g, p in zip(given, predicted, strict=True):
        assert (g.mean[0, 1], g.cov[0, 0, 1]) == (0.0, p.cov[0, 0, 1])
        assert g.cov[0, 0, 0] < p.cov[0, 0, 0]
    assert (log_c[:, 1] == 0.0).all()
    assert (log_c[:, 0] != 0.0).all()


def test_a_component_without_noise_stays_known() -> None:
    """As the acceleration of a model of constant velocity: the other component is smoothed alike."""
    alone = [
        Gaussian(np.full((1, 1), m), np.full((1, 1, 1), v)) for m, v in ((0.0, 1.0), (3.0, 4.0))
    ]
    later, mixing = (
        Gaussian(np.full((1, 1), 1.5), np.full((1, 1, 1), 0.4)),
        np.array([[0.7], [0.3]]),
    )
    expected, log_c = given_later(alone, mixing, later)

    def beside(state: Gaussian) -> Gaussian:
        cov = np.zeros((2, 2, 1))
        cov[0, 0] = state.cov[0, 0]
        return Gaussian(np.concatenate([state.mean, [[0.0]]]), cov)

    given, log_both = given_later([beside(x) for x in alone], mixing, beside(later))
    for a, b in zip(given, map(beside, expected), strict=True):
        np.testing.assert_allclose(a.mean, b.mean, atol=1e-12)
        np.testing.assert_allclose(a.cov, b.cov, atol=1e-12)
    np.testing.assert_allclose(log_both, log_c)


@pytest.mark.parametrize("quick", [WhiteAcceleration(q=100.0), ConstantAcceleration(q=4.0)])
def test_a_long_track_with_maneuvers(quick: Motion) -> None:
    """All measurements serve better than four later ones, and these better than none."""
    legs = Leg(start=60, end=90, ax=8.0, ay=-5.0), Leg(start=130, end=140, ax=-20.0, ay=10.0)
    scenario = maneuver(duration=150.0, legs=legs, score_from=0.0)
    motions, rows = (WhiteAcceleration(q=0.01), quick), ((0.95, 0.05), (0.05, 0.95))
    rmse = []
    for smooth in (False, FixedLag(lag=4), True):
        found = per_run(scenario, make_imm(motions, rows, (0.5, 0.5), smooth), 50, "rmse_position")
        rmse.append(found)
    assert rmse[2].mean() < 0.6 * rmse[0].mean()
    for worse, better in pairwise(rmse):
        gain = worse - better
        assert gain.mean() > 4.0 * gain.std() / np.sqrt(50)
