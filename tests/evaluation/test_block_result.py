"""What a block makes of a state that is known, of runs that are lost, and of clouds that collapsed."""

import numpy as np
import pytest

from tests.conftest import make_filter
from tests.linear_problem import LINEAR
from tests.papers import maneuver, merwe
from trackbench.core.random_streams import RunStreams
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.error_series import series
from trackbench.evaluation.lost_runs import (
    LOST_BECAUSE,
    NO_TRUTH,
    NOT_FINITE,
    NOT_LOST,
    lost_runs,
    stayed_finite,
)
from trackbench.evaluation.per_run_metrics import per_run_metrics
from trackbench.evaluation.run_blocks_side_by_side import run_block
from trackbench.evaluation.series_sums import SeriesSums
from trackbench.evaluation.simulated_runs import simulate
from trackbench.models.assume import Assume
from trackbench.models.motions.kinematic import ConstantVelocity
from trackbench.models.motions.map_or_ode import MapMotion
from trackbench.models.sensors.function import FunctionSensor
from trackbench.models.sensors.position import PositionSensor
from trackbench.scenarios.starts.gaussian import GaussianStart
from trackbench.scenarios.starts.one_scan import OneScan
from trackbench.scenarios.targets.driven import Driven
from trackbench.scenarios.targets.random_legs import RandomLegs
from trackbench.scenarios.tracking import Tracking
from trackbench.statistics.sample_statistics import median


@pytest.mark.parametrize(
    ("kind", "keys"), [("grid", {}), ("ukf", {}), ("pf", {"N": 1000}), ("pf", {"N": 1024})]
)
def test_a_first_state_that_is_known_has_no_nees(kind: str, keys: dict[str, int]) -> None:
    """Its error and its covariance are zero: nothing to judge, whatever rounding makes of 0 / 0."""
    scenario = merwe(R=1.0, T=20)
    found = run_block(BlockTask(scenario, make_filter(kind, **keys), 0, 0, 40, 40))
    assert np.isfinite(found.per_run["nees"]).all()
    assert found.steps["nees"].number[0] == 0
    assert found.steps["outside_region"].number[0] == 0
    assert (found.steps["nees"].number[1:] == 40).all()
    assert found.steps["squared"].number[0] == 40  # the error is scored


def test_an_error_outside_the_region_is_one_in_a_million() -> None:
    """Chi-square of four degrees of freedom: P(X > x) = exp(-x / 2) (1 + x / 2)."""
    low, high = 33.37, 33.38
    assert np.exp(-low / 2) * (1 + low / 2) > 1e-6 > np.exp(-high / 2) * (1 + high / 2)
    truth, nees = np.zeros((4, 2, 2)), np.array([[low, np.nan], [high, 0.0]])
    found = series(LINEAR, truth, truth, nees, None)["outside_region"]
    np.testing.assert_array_equal(found, [[0.0, np.nan], [1.0, 0.0]])


def test_what_is_kept_for_medians_leaves_lost_runs_out() -> None:
    scenario = maneuver(duration=200.0, legs=(), score_from=100.0, lost_beyond=150.0)
    task = BlockTask(scenario, make_filter("kf"), 1, 0, 60, 60, keep_steps=("squared_position",))
    found = run_block(task)
    lost = found.per_run["lost"] != NOT_LOST
    assert 0 < lost.sum() < 60
    rows = found.run_series["squared_position"]
    assert np.isnan(rows[:, lost]).all()
    assert np.isfinite(rows[:, ~lost]).all()


@pytest.mark.parametrize(
    ("index", "used", "shown"), [(0, 40, 40), (1, 40, 10), (1, 5, 5), (2, 40, 0), (-1, 40, 0)]
)
def test_the_first_runs_of_all_are_shown(index: int, used: int, shown: int) -> None:
    """Fifty runs in blocks of forty; none of training."""
    task = BlockTask(merwe(), make_filter("ukf"), 1, index, 40, 40, runs_with_tracks=50)
    assert task.runs_with_tracks_among(used) == shown


def test_the_median_of_mostly_infinite_values_is_infinite() -> None:
    assert median(np.array([1.0, 2.0, np.inf, np.inf, np.inf])).value == np.inf
    assert median(np.array([1.0, 2.0, 3.0, 4.0, np.inf])).value == 3.0


@pytest.mark.parametrize("kind", ["kf", "alpha-beta"])
def test_a_track_is_less_certain_after_a_gap(kind: str) -> None:
    """Fifty samples missing: error and reported deviation grow together.

    Half a sample is one of the other axis to a Kalman filter, and none to fixed gains.
    """
    scenario = maneuver(duration=300.0, legs=())
    data = scenario.simulate(RunStreams(1, range(500)), 500)
    z = data.measurements.copy()
    z[:, 100:150] = np.nan
    tracker = make_filter(kind, **({"q": 0.01} if kind == "alpha-beta" else {}))
    rng = np.random.default_rng(0)
    state = tracker.init(scenario.model, data.prior, rng)
    for i in range(150):
        state = tracker.step(scenario.model, state, z[:, i], i + 2, rng)
    found = tracker.estimate(state)
    rms = np.sqrt(np.square(found.mean[0] - data.truth[0, 150]).mean())
    variance = found.cov[0, 0] if found.cov.ndim == 2 else found.cov[0, 0, 0]
    assert np.sqrt(variance) > 0.9 * rms
    z[:, 100] = data.measurements[:, 100]
    z[1, 100] = np.nan
    again = tracker.init(scenario.model, data.prior, rng)
    for i in range(101):
        again = tracker.step(scenario.model, again, z[:, i], i + 2, rng)
        if i == 99:
            before = tracker.estimate(again)
    x, vx, y, vy = before.mean
    after = tracker.estimate(again).mean
    np.testing.assert_allclose(after[2], y + vy, rtol=1e-12)
    assert np.allclose(after[0], x + vx, rtol=1e-12) == (kind == "alpha-beta")


def test_a_run_is_finite_in_all_that_any_run_estimates() -> None:
    """Of three components and four runs nobody estimates the second component."""
    mean = np.zeros((3, 5, 4))
    mean[1] = np.nan
    mean[0, 2, 1] = np.nan
    mean[2, 4, 3] = np.inf
    assert stayed_finite(mean).tolist() == [True, False, True, False]
    assert stayed_finite(mean[:, :2]).tolist() == [True] * 4
    assert stayed_finite(np.full((3, 5, 4), np.nan)).tolist() == [False] * 4


def test_a_run_with_an_infinite_error_is_lost() -> None:
    """Its estimate is finite, and the square of its error is not."""
    squared = np.array([[1.0, 4.0, 1.0], [2.0, np.inf, np.nan]])
    lost = lost_runs(LINEAR, {"squared_position": squared}, np.ones(3, dtype=np.bool_))
    assert lost.tolist() == [NOT_LOST, NOT_FINITE, NOT_LOST]


def _unstable(power: str, last: int) -> Tracking:
    """Return a scenario of a motion with this part."""
    motion = MapMotion(components=("x",), next={"x": f"0.9*x + {power}"}, Q=0.01)
    sensor = FunctionSensor(h={"z": "x"}, R=0.1)
    start = GaussianStart(sigma=(0.1,))
    return Tracking(target=Driven(motion=motion), sensor=sensor, start=start, last=last)


def test_an_alternating_input_is_a_number_at_every_step() -> None:
    found = run_block(BlockTask(_unstable("0.5*(-1)**k", 40), make_filter("ukf"), 1, 0, 20, 20))
    assert (found.per_run["lost"] == NOT_LOST).all()
    assert found.per_run["rmse"].max() < 0.5


@pytest.mark.parametrize("power", ["0*log(16.5 - k)", "exp(exp(k))"])
def test_a_truth_that_is_not_finite_is_the_scenarios_fault(power: str) -> None:
    task = BlockTask(_unstable(power, 17), make_filter("pf", N=20), 1, 0, 20, 20)
    assert (run_block(task).per_run["lost"] == NO_TRUTH).all()
    assert "true state" in LOST_BECAUSE[NO_TRUTH]


def test_an_infinite_error_is_a_lost_run() -> None:
    """Of any error, and of squares whose sum is infinite."""
    for name, square in (("squared_velocity", np.inf), ("squared_position", 1e308)):
        squares = {n: np.ones((7, 3)) for n in ("squared_position", "squared_velocity")}
        squares["outside_region"] = np.zeros((7, 3))
        squares[name][4:6, 1] = square
        sums = SeriesSums.from_series(squares, LINEAR.windows, ())
        got = per_run_metrics(LINEAR, squares, sums, np.ones(3, dtype=bool))
        np.testing.assert_array_equal(got["lost"], [NOT_LOST, NOT_FINITE, NOT_LOST])
        assert np.isfinite(got["rmse_position"][[0, 2]]).all()


def test_a_target_that_is_gone_loses_no_run() -> None:
    """After the last leg of `random-legs` there is no truth, and that is no fault of the scenario."""
    target = RandomLegs(
        area=600.0, speed=(30.0, 90.0), legs=(2, 3), leg_steps=(3, 4), sigma_along=2.0, across=15.0
    )
    scenario = Tracking(
        target=target,
        sensor=PositionSensor(sigma=10.0),
        start=OneScan(sigma_velocity=50.0),
        assume=Assume(motion=ConstantVelocity(q=40.0)),
        last=20,
    )
    task = BlockTask(scenario, make_filter("kf"), 1, 0, 30, 30)
    found = run_block(task)
    assert np.isnan(simulate(scenario, 1, 0, 30).truth).any()
    assert (found.per_run["lost"] == NOT_LOST).all()
