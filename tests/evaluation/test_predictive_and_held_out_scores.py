"""Predictions, whiteness and held-out measurements against plain loops over one run."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2, multivariate_normal

from tests.conftest import make_filter, track
from tests.linear_problem import LINEAR
from tests.planted import HandEKF, with_bug
from trackbench.core import compiled
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.evaluation.anis_and_autocorrelation import LAGS
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.predictive_and_held_out_scores import held_out
from trackbench.evaluation.run_blocks_side_by_side import run_block
from trackbench.evaluation.run_filter import run_filter
from trackbench.evaluation.simulated_runs import simulate
from trackbench.filters.base import Filter
from trackbench.filters.baselines import PriorMean
from trackbench.filters.ekf import EKF
from trackbench.filters.kf import KF
from trackbench.filters.robust import StudentT
from trackbench.models.motions.kinematic import WhiteAcceleration
from trackbench.models.sensors.position import PositionSensor
from trackbench.models.sensors.range_azimuth import RangeAzimuth
from trackbench.scenarios.starts.gaussian import GaussianStart

BOTH = ("score", "prediction")
MOTIONS = tuple(WhiteAcceleration(q=q) for q in (0.1, 2.0))
GAPPY = replace(
    LINEAR,
    last=40,
    sensor=(PositionSensor(sigma=2.0, detection=0.7), PositionSensor(sigma=1.0, period=3)),
)


def data(scenario: Any, runs: int) -> Array:
    return simulate(scenario, 1, 0, runs).measurements


def kalman_loop(scenario: Any, z: Array, run: int) -> tuple[Array, Array, Array]:
    """Innovations (T, n_z), NaN where missing, whitened ones, and their log-densities (T,)."""
    motion, sensor = scenario.model
    prior = simulate(scenario, 1, 0, run + 1).prior
    m, P = prior.mean[:, run], prior.cov
    nus, whites, told = [], [], []
    for k in range(z.shape[1]):
        m, P = motion.F @ m, motion.F @ P @ motion.F.T + motion.Q
        H, R = sensor.jacobian(m[:, None], k + 1), sensor.measurement(m[:, None], k + 1).cov
        nu = z[:, k, run] - (H @ m)
        there = ~np.isnan(nu)
        white = np.full(len(nu), np.nan)
        nus.append(nu)
        if there.any():
            H, R = H[there], R[np.ix_(there, there)]
            S = H @ P @ H.T + R
            white[there] = np.linalg.solve(np.linalg.cholesky(S), nu[there])
            told.append(multivariate_normal(cov=S).logpdf(nu[there]))
            K = P @ H.T @ np.linalg.inv(S)
            m, P = m + K @ nu[there], P - K @ S @ K.T
        else:
            told.append(np.nan)
        whites.append(white)
    return np.array(nus), np.array(whites), np.array(told)


def autocorrelation(white: Array, lag: int) -> float:
    """Of each component's measured values, one after the other."""
    columns = [c[~np.isnan(c)] for c in white.T]
    return float(
        sum((c[lag:] * c[:-lag]).sum() for c in columns) / sum((c * c).sum() for c in columns)
    )


@pytest.mark.parametrize("kind", ["kf", "rpf"])
def test_who_is_asked_goes_on_as_before(kind: str) -> None:
    tracker = make_filter(kind)
    alone, asked = track(GAPPY, tracker, 3), track(GAPPY, tracker, 3, predictive_metrics=BOTH)
    assert np.array_equal(alone.mean, asked.mean)
    assert np.array_equal(alone.nees, asked.nees)
    assert set(asked.diagnostics) > set(alone.diagnostics)


def test_predictions_are_the_kalman_filters_innovations() -> None:
    z, found = data(GAPPY, 3), track(GAPPY, KF(), 3, predictive_metrics=BOTH).diagnostics
    names = GAPPY.model.sensor.components
    for run in range(3):
        nus, whites, told = kalman_loop(GAPPY, z, run)
        errors = np.stack([found[f"error_predicted_{c}"][1:, run] for c in names], axis=1)
        np.testing.assert_allclose(errors, nus, rtol=1e-9, atol=1e-9)
        number = (~np.isnan(nus)).sum(axis=1)
        nis = np.nansum(np.square(whites), axis=1)
        there = number > 0
        np.testing.assert_array_equal(found["innovations"][1:, run][there], number[there])
        np.testing.assert_allclose(
            found["anis"][1:, run][there], nis[there] / number[there], rtol=1e-8
        )
        np.testing.assert_allclose(found["log_likelihood"][1:, run], told, rtol=1e-8)
        assert np.isnan(found["anis"][1:, run][~there]).all()


def test_metrics_of_a_run_are_sums_over_its_measured_components() -> None:
    task = BlockTask(GAPPY, KF(), 1, index=0, width=3, runs_used=3, predictive_metrics=BOTH)
    with np.errstate(all="ignore"):
        per_run, z = run_block(task).per_run, data(GAPPY, 3)
    for run in range(3):
        nus, whites, told = kalman_loop(GAPPY, z, run)
        assert per_run["innovations"][run] == (~np.isnan(nus)).sum()
        assert per_run["anis"][run] == pytest.approx(np.nanmean(np.square(whites)), rel=1e-8)
        assert per_run["log_score"][run] == pytest.approx(np.nanmean(told), rel=1e-9)
        rms = np.sqrt(np.nanmean(np.square(nus[:, 0])))
        assert per_run["rmse_predicted_1.x"][run] == pytest.approx(rms, rel=1e-8)
        for lag in (1, 2, LAGS):
            expected = autocorrelation(whites, lag)
            assert per_run[f"autocorrelation_{lag}"][run] == pytest.approx(expected, abs=1e-8)


def test_without_a_pair_there_is_no_autocorrelation() -> None:
    two = replace(LINEAR, last=2)
    task = BlockTask(two, KF(), 1, index=0, width=3, runs_used=3, predictive_metrics=BOTH)
    with np.errstate(all="ignore"):
        per_run = run_block(task).per_run
    assert np.isfinite(per_run["autocorrelation_1"]).all()
    assert np.isnan(per_run["autocorrelation_2"]).all()


def test_every_so_manyth_measurement_of_a_run_is_held_out() -> None:
    z = np.ones((2, 7, 2))
    z[:, 1, 0], z[0, 3, 0] = np.nan, np.nan  # run 0 measures at 0, 2, 3 (half), 4, 5, 6
    held = held_out(z, 3)
    assert np.flatnonzero(held[:, 0]).tolist() == [3, 6]
    assert np.flatnonzero(held[:, 1]).tolist() == [2, 5]


@pytest.mark.parametrize("kind", ["kf", "pf"])
def test_what_is_held_out_is_not_seen(kind: str) -> None:
    task = BlockTask(GAPPY, make_filter(kind), 1, index=0, width=3, runs_used=3, hold_out=4)
    simulated = simulate(GAPPY, 1, 0, 3)
    held = held_out(simulated.measurements, 4)
    moved = simulated._replace(measurements=simulated.measurements + np.where(held, 50.0, 0.0))
    first, second = run_filter(task, simulated), run_filter(task, moved)
    assert np.array_equal(first.mean, second.mean)
    told = "held_log_likelihood"
    assert np.array_equal(np.isnan(first.diagnostics[told][1:]), ~held)
    assert (second.diagnostics[told][1:][held] < first.diagnostics[told][1:][held]).all()
    missing = np.where(held, np.nan, simulated.measurements)
    plain = replace(task, hold_out=None)
    assert np.array_equal(
        run_filter(plain, simulated._replace(measurements=missing)).mean, first.mean
    )


def test_held_out_measurements_are_predicted_as_the_kalman_filter_does() -> None:
    task = BlockTask(
        GAPPY, KF(), 1, index=0, width=3, runs_used=3, predictive_metrics=BOTH, hold_out=4
    )
    z = data(GAPPY, 3)
    found, held = run_filter(task, simulate(GAPPY, 1, 0, 3)).diagnostics, held_out(z, 4)
    motion, sensor = GAPPY.model
    for run in range(3):
        m, P = simulate(GAPPY, 1, 0, run + 1).prior.mean[:, run], simulate(GAPPY, 1, 0, 1).prior.cov
        for k in range(z.shape[1]):
            m, P = motion.F @ m, motion.F @ P @ motion.F.T + motion.Q
            there = ~np.isnan(z[:, k, run])
            H, R = sensor.jacobian(m[:, None], k), sensor.measurement(m[:, None], k).cov
            H, R = H[there], R[np.ix_(there, there)]
            nu, S = z[there, k, run] - H @ m, H @ P @ H.T + R
            row = [found[f"error_held_{c}"][k + 1, run] for c in sensor.components]
            if held[k, run]:
                np.testing.assert_allclose(np.array(row)[there], nu, rtol=1e-8, atol=1e-9)
                expected = multivariate_normal(cov=S).logpdf(nu)
                assert found["held_log_likelihood"][k + 1, run] == pytest.approx(expected, rel=1e-8)
                assert np.isnan(found["log_likelihood"][k + 1, run])
            else:
                assert np.isnan(row).all()
                if there.any():
                    K = P @ H.T @ np.linalg.inv(S)
                    m, P = m + K @ nu, P - K @ S @ K.T


def test_a_right_filter_is_white_and_in_its_band_and_a_wrong_one_is_not() -> None:
    scenario = replace(LINEAR, last=60)
    right = BlockTask(scenario, KF(), 1, index=0, width=50, runs_used=50, predictive_metrics=BOTH)
    slow = replace(scenario.assume, motion=WhiteAcceleration(q=0.01))
    wrong = replace(right, assume=slow)
    number = 50 * 60 * 2
    low, high = chi2.ppf([1e-4, 1.0 - 1e-4], number) / number
    for task, good in ((right, True), (wrong, False)):
        per_run = run_block(task).per_run
        assert bool(low < per_run["anis"].mean() < high) is good
        white = abs(per_run["autocorrelation_1"].mean()) < 4.0 / np.sqrt(number)
        assert bool(white) is good
    better, worse = (run_block(t).per_run["log_score"] for t in (right, wrong))
    gain = better - worse
    assert gain.mean() > 4.0 * gain.std(ddof=1) / np.sqrt(len(gain))


class Silent(Filter[Any]):
    """A filter that does not tell its likelihood."""

    def __init__(self) -> None:
        self._kf = KF()

    def init(self, model: Any, prior: Any, rng: Any) -> Any:
        return self._kf.init(model, prior, rng)

    def step(self, model: Any, state: Any, z: Array, k: int, rng: Any) -> Any:
        return self._kf.step(model, state, z, k, rng)

    def estimate(self, state: Any) -> Gaussian:
        return self._kf.estimate(state)


def test_a_filter_that_tells_no_likelihood_has_none() -> None:
    silent: Any = Silent()
    found = track(GAPPY, silent, 2, predictive_metrics=BOTH, hold_out=5).diagnostics
    assert not {"log_likelihood", "held_log_likelihood"} & set(found)
    own = track(GAPPY, KF(), 2, predictive_metrics=BOTH, hold_out=5).diagnostics
    assert np.array_equal(found["anis"], own["anis"], equal_nan=True)


def test_a_filter_that_answers_a_mean_alone_has_prediction_errors() -> None:
    """z - H F x needs no covariance; what does is missing, of the one filter only."""

    class MeanOnly(Silent):
        def init(self, *words: Any) -> Any:
            return (super().init(*words),)

        def step(self, model: Any, state: Any, *words: Any) -> Any:
            return (super().step(model, *state, *words),)

        def estimate(self, state: Any) -> Gaussian:
            known = self._kf.estimate(*state)
            return Gaussian(known.mean, np.full(known.cov.shape, np.nan))

    alone: Any = MeanOnly()
    found = track(GAPPY, alone, 2, predictive_metrics=BOTH, hold_out=5).diagnostics
    own = track(GAPPY, KF(), 2, predictive_metrics=BOTH, hold_out=5).diagnostics
    errors = [name for name in own if name.startswith(("squared_", "error_"))]
    assert len(errors) == 16
    for name in errors:
        np.testing.assert_allclose(found[name], own[name], rtol=1e-9, atol=1e-12)
    for name in ("anis", "innovations", "autocovariance_1"):
        assert np.isnan(found[name]).all()


def test_a_filter_that_writes_to_its_state_is_asked_about_the_state_before() -> None:
    """Its prediction was that of a second step after the first."""

    class Writing(HandEKF):
        bug = "in place"

        def init(self, model: Any, prior: Any, rng: Any) -> Any:
            state = super().init(model, prior, rng)
            return state._replace(x=state.x.copy())

    writing = track(GAPPY, Writing(), 2, predictive_metrics=BOTH, hold_out=5)
    copying = track(GAPPY, with_bug(HandEKF, "")(), 2, predictive_metrics=BOTH, hold_out=5)
    assert {"anis", "squared_held_1.x"} <= set(copying.diagnostics)
    for name, series in copying.diagnostics.items():
        assert np.array_equal(writing.diagnostics[name], series, equal_nan=True), name


def test_a_likelihood_of_another_shape_is_the_filters_failure() -> None:
    class Wrong(Silent):
        def log_likelihood(self, state: Any) -> Array:
            return np.zeros((2, 2))

    wrong: Any = Wrong()
    with pytest.raises(ValueError, match="log_likelihood"):
        track(GAPPY, wrong, 2, predictive_metrics=BOTH)


@pytest.mark.parametrize(
    "kind",
    [
        {"kind": "kf", "gate": 0.9},
        {"kind": "kf", "robust": StudentT()},
        {"kind": "ekf", "fading": 1.1},
        {"kind": "iekf"},
        {"kind": "iplf"},
        {"kind": "ukf"},
        {"kind": "ckf", "gate": 0.9},
        {"kind": "imm", "motions": MOTIONS, "transition": ((0.9, 0.1), (0.2, 0.8))},
    ],
)
def test_stored_predictions_are_the_estimates_of_steps_without_a_measurement(kind: Any) -> None:
    tracker, simulated = make_filter(**kind), simulate(GAPPY, 1, 0, 3)
    z, rng = simulated.measurements, np.random.default_rng(0)
    state = tracker.init(GAPPY.model, simulated.prior, rng)
    for k in range(1, z.shape[1] + 1):
        nothing = np.full_like(z[:, k - 1], np.nan)
        aside = tracker.estimate(tracker.step(GAPPY.model, state, nothing, k, rng))
        state = tracker.step(GAPPY.model, state, z[:, k - 1], k, rng)
        np.testing.assert_array_equal(state.prediction.mean, aside.mean)
        np.testing.assert_array_equal(
            np.broadcast_to(state.prediction.cov, aside.cov.shape), aside.cov
        )


@pytest.mark.parametrize("hold_out", [None, 4])
@pytest.mark.parametrize("tracker", [KF(), EKF()])
def test_all_steps_at_once_are_the_single_steps(
    tracker: KF | EKF, hold_out: int | None, monkeypatch: Any
) -> None:
    task = BlockTask(LINEAR, tracker, 1, index=0, width=3, runs_used=3, predictive_metrics=BOTH)
    task, z = replace(task, hold_out=hold_out), task.data.measurements.copy()
    z[:, 2], z[1, 4] = np.nan, np.nan
    start = tracker.init(LINEAR.model, task.data.prior, np.random.default_rng(0))
    steps_of, gappy = type(tracker).all_steps, task.data._replace(measurements=z)
    assert (steps_of(tracker, LINEAR.model, start, z, 1) is None) == (compiled.kernels is None)
    together = run_filter(task, gappy)
    monkeypatch.setattr(type(tracker), "all_steps", Filter.all_steps)
    single = run_filter(task, gappy)
    np.testing.assert_array_equal(together.mean, single.mean)
    np.testing.assert_array_equal(together.nees, single.nees)
    assert single.diagnostics.keys() == together.diagnostics.keys()
    for name, rows in single.diagnostics.items():
        np.testing.assert_array_equal(together.diagnostics[name], rows)


@pytest.mark.parametrize("hold_out", [None, 4])
def test_steps_at_once_after_single_steps_keep_their_place(
    hold_out: int | None, monkeypatch: Any
) -> None:
    """A filter may filter only some pieces of a run in one call: the scores are equal."""
    scenario = replace(LINEAR, last=12)
    task = BlockTask(scenario, EKF(), 1, index=0, width=3, runs_used=3, predictive_metrics=BOTH)
    task, at_once = replace(task, hold_out=hold_out), EKF.all_steps
    monkeypatch.setattr(EKF, "all_steps", Filter.all_steps)
    single = run_filter(task, task.data)

    def not_at_first(self: EKF, model: Any, state: Any, z: Array, k: int) -> Any:
        return None if k == 1 else at_once(self, model, state, z, k)

    monkeypatch.setattr(EKF, "all_steps", not_at_first)
    monkeypatch.setattr("trackbench.evaluation.run_filter._AT_ONCE", 4 * task.runs)
    mixed = run_filter(task, task.data)
    assert single.diagnostics.keys() == mixed.diagnostics.keys()
    for name, rows in single.diagnostics.items():
        np.testing.assert_array_equal(mixed.diagnostics[name], rows)


@pytest.mark.parametrize("hold_out", [None, 2])
def test_prediction_errors_of_a_filter_that_never_updates_are_those_of_its_path(
    hold_out: int | None,
) -> None:
    # A spread of 60 m at a range of some 14 m: the mean range over it is some 50 m too long.
    scenario = replace(
        LINEAR,
        sensor=RangeAzimuth(sigma_range=1.0, sigma_azimuth_mrad=10.0),
        start=GaussianStart(sigma=(60.0, 1.0, 60.0, 1.0)),
    )
    told = track(scenario, PriorMean(), 3, predictive_metrics=BOTH, hold_out=hold_out)
    names = [f"error_predicted_{c}" for c in ("range", "azimuth")]
    simulated = simulate(scenario, 1, 0, 3)
    seen = ~held_out(simulated.measurements, hold_out) if hold_out else np.ones((6, 3), dtype=bool)
    path = simulated.prior.mean
    for k in range(6):
        px, vx, py, vy = path
        path = np.stack([px + vx, vx, py + vy, vy])
        px, _, py, _ = path
        z = simulated.measurements[:, k]
        errors = [z[0] - np.hypot(px, py), z[1] - np.arctan2(py, px)]
        errors[1] = (errors[1] + np.pi) % (2.0 * np.pi) - np.pi
        for name, error in zip(names, errors, strict=True):
            for chosen, head in ((seen[k], "predicted"), (~seen[k], "held")):
                if chosen.any():
                    series = told.diagnostics[name.replace("predicted", head)]
                    np.testing.assert_allclose(series[k + 1][chosen], error[chosen], atol=1e-9)
    # The consistency is that of the whole Gaussian.
    assert np.isfinite(told.diagnostics["anis"][1:][seen]).all()
