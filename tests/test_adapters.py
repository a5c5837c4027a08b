"""Filters of one run: theirs through the adapters are ours, and keys, order and noise are kept."""

from copy import copy
from dataclasses import replace
from itertools import islice
from typing import Any, ClassVar

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from tests.conftest import track
from tests.filters.test_nonlinear_oracles import RADAR
from tests.filters.test_nonlinear_oracles import SCENARIO as RADAR_SCENARIO
from tests.papers import maneuver, seen_as
from trackbench.adapters.filterpy import FilterPy
from trackbench.adapters.per_run import PerRun, RunFunctions, loop_over_runs
from trackbench.adapters.stonesoup import StoneSoup
from trackbench.contract.checks import CHECKS
from trackbench.contract.problems import PLANAR, ModelDraws
from trackbench.contract.run_contract import check_filter, run_check
from trackbench.core.arrays import Array
from trackbench.core.random_streams import block_stream
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.filter_output import FilterOutput
from trackbench.evaluation.lost_runs import NOT_FINITE
from trackbench.evaluation.run_blocks_side_by_side import run_block
from trackbench.evaluation.run_filter import run_filter
from trackbench.evaluation.simulated_runs import simulate
from trackbench.execution.block_size import block_width
from trackbench.filters.ekf import EKF
from trackbench.filters.imm import IMM
from trackbench.filters.kf import KF
from trackbench.filters.ukf import CKF, UKF
from trackbench.help.descriptions import help_texts
from trackbench.models.assume import Assume
from trackbench.models.base import Model
from trackbench.models.motions.coordinated_turn import CoordinatedTurn, UnknownTurn
from trackbench.models.motions.kinematic import ConstantVelocity, WhiteAcceleration
from trackbench.models.motions.map_or_ode import MapMotion
from trackbench.models.motions.unequal_intervals import Irregular
from trackbench.models.sensors.bearing import Bearing
from trackbench.models.sensors.function import FunctionSensor
from trackbench.models.sensors.position import PositionSensor
from trackbench.models.sensors.range_azimuth import RangeAzimuth
from trackbench.scenarios.score import Score
from trackbench.scenarios.starts.gaussian import GaussianStart
from trackbench.scenarios.targets.driven import Driven
from trackbench.scenarios.targets.initial_state import Launch
from trackbench.scenarios.targets.legs import Legs
from trackbench.scenarios.tracking import Tracking

RUNS = 3
MOTION = WhiteAcceleration(q=0.01)
MANEUVER = seen_as(maneuver(), MOTION)
SHORT = replace(MANEUVER, last=40, target=replace(MANEUVER.target, legs=()), score=Score())
SPREAD = {"alpha": 0.8, "beta": 1.5, "kappa": 1.0}


def run(one: type[PerRun], scenario: Any = SHORT, **keys: Any) -> FilterOutput:
    return track(scenario, loop_over_runs(one)(**keys), RUNS)


def equal(theirs: FilterOutput, ours: FilterOutput, within: float) -> None:
    assert_allclose(theirs.mean, ours.mean, rtol=within, atol=within * np.abs(ours.mean).max())
    assert_allclose(theirs.nees, ours.nees, rtol=max(100 * within, 1e-8))
    for name in theirs.diagnostics.keys() & {"nis", "mode"}:
        assert_allclose(
            theirs.diagnostics[name], ours.diagnostics[name], rtol=100 * within, atol=within
        )


def skip_without_package(one: type[PerRun]) -> None:
    """Skip the test of an adapter whose package is not installed."""
    for base, package in ((FilterPy, "filterpy"), (StoneSoup, "stonesoup")):
        if issubclass(one, base):
            pytest.importorskip(package)


class Plain(PerRun):
    """The Kalman filter of a book, positions before velocities."""

    q: float = 0.01
    """acceleration's spectral density, m^2/s^3"""
    sigma: float = 100.0
    state: ClassVar[tuple[str, ...]] = ("px", "py", "vx", "vy")

    def start(self, mean: Array, cov: Array) -> None:
        self.x, self.P = mean, cov

    def predict(self, dt: float) -> tuple[Array, Array]:
        I = np.eye(2)  # noqa: E741
        F = np.block([[I, dt * I], [0 * I, I]])
        Q = self.q * np.block([[dt**3 / 3 * I, dt**2 / 2 * I], [dt**2 / 2 * I, dt * I]])
        self.x, self.P = F @ self.x, F @ self.P @ F.T + Q
        return self.x, self.P

    def update(self, z: Array) -> tuple[Array, Array]:
        K = self.P[:, :2] @ np.linalg.inv(self.P[:2, :2] + self.sigma**2 * np.eye(2))
        self.x, self.P = self.x + K @ (z - self.x[:2]), self.P - K @ self.P[:2]
        return self.x, self.P


def test_a_filter_of_a_book_equals_ours_and_predicts_over_a_missing_measurement() -> None:
    data = simulate(SHORT, 1, 0, RUNS)
    seen = data.measurements.copy()
    seen[:, 3:7, 0] = seen[:, 5, 1] = np.nan
    mine, ours = (
        run_filter(BlockTask(SHORT, f, 1, 0, RUNS, RUNS), data._replace(measurements=seen))
        for f in (loop_over_runs(Plain)(), KF())
    )
    equal(mine, ours, 1e-9)
    assert np.isnan(ours.diagnostics["nis"][4:8, 0]).all()


class FilterPyKF(FilterPy):
    def make(self, dt: float) -> Any:
        from filterpy.kalman import KalmanFilter

        kf = KalmanFilter(dim_x=4, dim_z=2)
        kf.F, kf.Q = self.model.motion.F, self.model.motion.Q
        kf.H, kf.R = self.model.sensor.H(), self.model.sensor.R
        return kf


class StoneSoupKF(StoneSoup):
    def make(self, transition: Any, measurement: Any) -> tuple[Any, Any]:
        from stonesoup.predictor.kalman import KalmanPredictor
        from stonesoup.updater.kalman import KalmanUpdater

        return KalmanPredictor(transition), KalmanUpdater(measurement)


def difference(a: Array, b: Array) -> Array:
    d = a - b
    d[1] = (d[1] + np.pi) % (2.0 * np.pi) - np.pi
    return d


def polar(x: Array) -> Array:
    return np.array([np.hypot(x[0], x[2]), np.arctan2(x[2], x[0])])


def polar_jacobian(x: Array) -> Array:
    r = np.hypot(x[0], x[2])
    return np.array([[x[0] / r, 0.0, x[2] / r, 0.0], [-x[2] / r**2, 0.0, x[0] / r**2, 0.0]])


class FilterPyUKF(FilterPy):
    measured: ClassVar[tuple[str, ...]] = ("range", "azimuth")

    def make(self, dt: float) -> Any:
        from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

        F = self.model.motion.F
        points = MerweScaledSigmaPoints(4, **SPREAD)
        ukf = UnscentedKalmanFilter(
            4, 2, dt, hx=polar, fx=lambda x, dt: F @ x, points=points, residual_z=difference
        )
        ukf.Q, ukf.R = self.model.motion.Q, RADAR.R
        return ukf


class FilterPyEKF(FilterPy):
    def make(self, dt: float) -> Any:
        from filterpy.kalman import ExtendedKalmanFilter

        ekf, sampled = ExtendedKalmanFilter(4, 2), WhiteAcceleration(q=2.0).sampled(dt)
        ekf.F, ekf.Q, ekf.R, ekf.x = sampled.F, sampled.Q, RADAR.R, np.zeros(4)
        return ekf, {"HJacobian": polar_jacobian, "Hx": polar, "residual": difference}


class FilterPyCKF(FilterPy):
    def make(self, dt: float) -> Any:
        from filterpy.kalman import CubatureKalmanFilter

        F = self.model.motion.F
        ckf = CubatureKalmanFilter(4, 2, dt, hx=lambda x: x[::2], fx=lambda x, dt: F @ x)
        ckf.Q, ckf.R = self.model.motion.Q, self.model.sensor.R
        return ckf


def test_filterpys_cubature_filter_is_itself() -> None:
    """It keeps its points for the update, which ours does not: held to its own loop, bit for bit."""
    pytest.importorskip("filterpy")
    theirs, found = run(FilterPyCKF), simulate(SHORT, 1, 0, RUNS)
    maker = FilterPyCKF()
    maker.model = SHORT.model
    for m in range(RUNS):
        ckf = maker.make(SHORT.T)
        ckf.x, ckf.P = found.prior.mean[:, [m]].copy(), found.prior.cov.copy()
        for i in range(20):
            ckf.predict()
            ckf.update(found.measurements[:, i, m][:, None])
            assert_array_equal(theirs.mean[:, i + 1, m], ckf.x[:, 0])


MOTIONS = (ConstantVelocity(q=0.01), CoordinatedTurn(turn_rate_deg_s=2.0, q=0.1))
TRANSITION = ((0.95, 0.05), (0.1, 0.9))


class FilterPyIMM(FilterPy):
    def make(self, dt: float) -> Any:
        from filterpy.kalman import IMMEstimator, KalmanFilter

        bank = []
        for motion in MOTIONS:
            kf, sampled = KalmanFilter(4, 2), motion.sampled(dt)
            kf.F, kf.Q, kf.x = sampled.F, sampled.Q, np.zeros(4)
            kf.H, kf.R = np.eye(4)[::2], self.functions.R()
            bank.append(kf)
        return IMMEstimator(bank, (0.5, 0.5), np.array(TRANSITION))


class StoneSoupUKF(StoneSoup):
    def make(self, transition: Any, measurement: Any) -> tuple[Any, Any]:
        from stonesoup.predictor.kalman import UnscentedKalmanPredictor
        from stonesoup.updater.kalman import UnscentedKalmanUpdater

        predictor = UnscentedKalmanPredictor(transition, **SPREAD)
        return predictor, UnscentedKalmanUpdater(measurement, **SPREAD)


class StoneSoupEKF(StoneSoup):
    def make(self, transition: Any, measurement: Any) -> tuple[Any, Any]:
        from stonesoup.predictor.kalman import ExtendedKalmanPredictor
        from stonesoup.updater.kalman import ExtendedKalmanUpdater

        return ExtendedKalmanPredictor(transition), ExtendedKalmanUpdater(measurement)


class StoneSoupCKF(StoneSoup):
    def make(self, transition: Any, measurement: Any) -> tuple[Any, Any]:
        from stonesoup.predictor.kalman import CubatureKalmanPredictor
        from stonesoup.updater.kalman import CubatureKalmanUpdater

        return CubatureKalmanPredictor(transition), CubatureKalmanUpdater(measurement)


def test_stone_soup_takes_a_motion_that_is_not_linear() -> None:
    """It calls the transition of our motion."""
    pytest.importorskip("stonesoup")
    turning = replace(
        RADAR_SCENARIO,
        assume=Assume(motion=UnknownTurn(q=0.1, turn_walk_deg_s=0.7)),
    )
    equal(run(StoneSoupEKF, turning), track(turning, EKF(), RUNS), 1e-8)


def test_stone_soup_takes_a_linear_sensor_that_scales() -> None:
    """Its own linear model only picks components of the state."""
    pytest.importorskip("stonesoup")
    scaled = FunctionSensor(h={"a": "2*px", "b": "3*py + 1"}, R=100.0, angles=())
    plain = FunctionSensor(h={"a": "2*px", "b": "3*py"}, R=100.0, angles=())
    for sensor in (scaled, plain):
        start = GaussianStart(sigma=(100.0, 10.0, 100.0, 10.0))
        scenario = replace(SHORT, sensor=sensor.for_state(SHORT.components), start=start)
        equal(run(StoneSoupEKF, scenario), track(scenario, EKF(), RUNS), 1e-8)


def test_an_angle_may_cross_the_cut() -> None:
    """Westward, where the azimuth jumps from pi to -pi."""
    pytest.importorskip("stonesoup")
    west = replace(
        RADAR_SCENARIO, target=Legs(launch=Launch(x=-9000.0, y=-1500.0, vx=0.0, vy=30.0))
    )
    azimuth = simulate(west, 1, 0, RUNS).measurements[1]
    assert azimuth.min() < -3.0
    assert azimuth.max() > 3.0
    ours = track(west, UKF(noise="additive", **SPREAD), RUNS)
    equal(run(StoneSoupUKF, west), ours, 1e-8)


@pytest.mark.parametrize("one", [Plain, StoneSoupKF])
def test_steps_that_differ_come_with_their_intervals(one: type[PerRun]) -> None:
    skip_without_package(one)
    intervals = np.random.default_rng(1).uniform(0.2, 3.0, len(SHORT.steps))
    model = Model(Irregular(MOTION, 2, int(SHORT.steps[0]), intervals), SHORT.model.sensor)
    data = simulate(SHORT, 1, 0, RUNS)
    states = []
    for tracker in (loop_over_runs(one)(), EKF()):
        rng = block_stream(1, 0)
        state = tracker.init(model, data.prior, rng)
        for i, k in enumerate(SHORT.steps[1:40]):
            state = tracker.step(model, state, data.measurements[:, i], int(k), rng)
        states.append(tracker.estimate(state))
    mine, ours = states
    assert_allclose(mine.mean, ours.mean, rtol=1e-9, atol=1e-6)
    assert_allclose(
        mine.cov, np.broadcast_to(ours.cov.reshape(4, 4, -1), mine.cov.shape), rtol=1e-8
    )


EQUAL = [
    (FilterPyKF, KF(), SHORT),
    (FilterPyIMM, IMM(motions=MOTIONS, transition=TRANSITION), SHORT),
    (FilterPyEKF, EKF(), RADAR_SCENARIO),
    (FilterPyUKF, UKF(noise="additive", **SPREAD), RADAR_SCENARIO),
    (StoneSoupKF, KF(), SHORT),
    (StoneSoupUKF, UKF(noise="additive", **SPREAD), RADAR_SCENARIO),
    (StoneSoupEKF, EKF(), RADAR_SCENARIO),
    (StoneSoupCKF, CKF(), RADAR_SCENARIO),
]


@pytest.mark.parametrize(("one", "other", "scenario"), EQUAL)
def test_estimates_and_log_scores_are_ours(one: type[PerRun], other: Any, scenario: Any) -> None:
    """Of whole measurements (run 2), of halves and of missing ones."""
    skip_without_package(one)
    data = simulate(scenario, 1, 0, RUNS)
    seen = data.measurements.copy()
    seen[0, 3:9, 0] = seen[1, 5:12, 1] = np.nan
    if not isinstance(other, IMM):  # filterpy's leaves its mode probabilities as they are
        seen[:, 14:16, 0] = np.nan
    data = data._replace(measurements=seen)
    mine, ours = (
        run_filter(BlockTask(scenario, f, 1, 0, RUNS, RUNS, predictive_metrics=("score",)), data)
        for f in (loop_over_runs(one)(), other)
    )
    missing = np.isnan(seen).all(axis=0).sum()  # and the first state's
    assert np.isnan(mine.diagnostics["log_likelihood"]).sum() == RUNS + missing
    assert_allclose(
        mine.diagnostics["log_likelihood"], ours.diagnostics["log_likelihood"], rtol=1e-6
    )
    equal(mine, ours, 1e-9 if type(other) is KF else 1e-8)


class OfUnscented(FilterPyUKF):
    """A bank of filters without H, whose likelihoods are taken of whole measurements."""

    def make(self, dt: float) -> Any:
        from filterpy.kalman import IMMEstimator

        bank = [FilterPyUKF.make(self, dt) for _ in range(2)]
        return IMMEstimator(bank, (0.5, 0.5), np.array(TRANSITION))


def test_where_a_half_would_be_wrong_it_is_refused() -> None:
    pytest.importorskip("filterpy")
    data = simulate(RADAR_SCENARIO, 1, 0, RUNS)
    seen = data.measurements.copy()
    seen[0, 3, 1] = np.nan
    task = BlockTask(RADAR_SCENARIO, loop_over_runs(OfUnscented)(), 1, 0, RUNS, RUNS)
    with pytest.raises(ValueError, match="a part of a measurement is missing"):
        run_filter(task, data._replace(measurements=seen))


def test_who_tells_no_likelihood_has_no_score() -> None:
    task = BlockTask(
        SHORT, loop_over_runs(Plain)(), 1, 0, RUNS, RUNS, predictive_metrics=("score",)
    )
    found = run_filter(task, simulate(SHORT, 1, 0, RUNS))
    assert "log_likelihood" not in found.diagnostics


class Sees(PerRun):
    """Keeps what it is given."""

    measured: ClassVar[tuple[str, ...]] = ("y", "x")
    state: ClassVar[tuple[str, ...]] = ("bias", "vy", "py", "vx", "px")
    extra_std: ClassVar[dict[str, float]] = {"bias": 3.0}
    given: ClassVar[list[Any]] = []

    def start(self, mean: Array, cov: Array) -> None:
        self.given.append((mean.copy(), cov.copy()))
        self.mean, self.cov = mean, cov
        mean[0] = 7.0  # its own

    def step(self, z: Array | None, dt: float) -> Any:
        assert z is not None
        self.given.append((self.k, dt, z.copy()))
        z += 1.0  # its own
        return self.mean[:, None], self.cov.tolist()  # a column and rows are taken, too


def test_components_are_in_the_filters_own_order() -> None:
    Sees.given.clear()
    data = simulate(SHORT, 1, 0, RUNS)
    found = run(Sees)
    mean, cov = Sees.given[0]
    assert_array_equal(mean, [0.0, *data.prior.mean[[3, 2, 1, 0], 0]])
    assert_array_equal(cov[1:, 1:], data.prior.cov[::-1, ::-1])
    assert_array_equal(cov[0], [9.0, 0.0, 0.0, 0.0, 0.0])
    k, dt, z = Sees.given[RUNS]
    assert (k, dt) == (SHORT.steps[1], SHORT.T)
    assert_array_equal(z, data.measurements[::-1, 0, 0])
    assert_array_equal(found.mean[:, 5], data.prior.mean)


class Draws(PerRun):
    """Random numbers of its own, in the second run many more."""

    def start(self, mean: Array, cov: Array) -> None:
        self.x, self.P = mean, cov

    def step(self, z: Array | None, dt: float) -> Any:
        self.rng.standard_normal(1 if z is None or z[0] < 0 else 9)
        return self.x + self.rng.standard_normal(4), self.P


def test_noise_is_each_runs_own_and_the_same_again() -> None:
    first, again = run(Draws), run(Draws)
    assert_array_equal(first.mean, again.mean)
    assert np.unique(first.mean[0, 5]).size == RUNS
    tracker, data, rng = loop_over_runs(Draws)(), simulate(SHORT, 1, 0, RUNS), block_stream(1, 0)
    z = data.measurements[:, 0].copy()
    z[0] = [-1.0, -1.0, -1.0]
    state = tracker.init(SHORT.model, data.prior, rng)
    few = tracker.step(SHORT.model, state, z, 1, rng).mean
    z[0, 1] = 1.0
    rng = block_stream(1, 0)
    state = tracker.init(SHORT.model, data.prior, rng)
    more = tracker.step(SHORT.model, state, z, 1, rng).mean
    assert_array_equal(few[:, [0, 2]], more[:, [0, 2]])
    assert (few[:, 1] != more[:, 1]).all()


def test_another_interval_gives_the_filter_another_motion() -> None:
    pytest.importorskip("filterpy")
    one = FilterPyIMM()
    one.model, one.dt, one.k = SHORT.model, 1.0, 1
    one.functions = RunFunctions(one)
    one.start(np.array([1.0, 2.0, 3.0, 4.0]), np.eye(4))
    for dt, expected in ((1.0, 3.0), (2.5, 8.0), (0.5, 9.0)):
        mean, _ = one.predict(dt)
        straight = one._object.filters[0]
        assert straight.F[0, 1] == dt
        assert straight.x[0] == pytest.approx(expected, abs=0.2)
        assert np.isfinite(mean).all()


def test_runs_that_are_looped_over_come_in_narrow_blocks() -> None:
    assert block_width(loop_over_runs(Plain)(), SHORT) == 10
    assert block_width(KF(), SHORT) > 100


def test_the_keys_are_the_attributes() -> None:
    made = loop_over_runs(Plain)
    assert made(q=0.5) == made(q=0.5) != made()
    assert hash(made(q=0.5)) == hash(made(q=0.5))
    assert made.__doc__ == Plain.__doc__
    assert help_texts(made)["q"].startswith("acceleration's spectral density")
    assert not np.array_equal(run(Plain).mean, run(Plain, q=0.5).mean)


class Shared(Plain):
    """Keeps its state in one place for all runs."""

    places: ClassVar[dict[str, Any]] = {}

    def start(self, mean: Array, cov: Array) -> None:
        self.places["x"] = mean
        super().start(mean, cov)

    def update(self, z: Array) -> tuple[Array, Array]:
        self.places["x"] = self.places["x"] + 0.1 * (np.array([*z, 0.0, 0.0]) - self.places["x"])
        return self.places["x"], self.P


class Unsettled(Plain):
    """Draws from a stream that nobody started."""

    def update(self, z: Array) -> tuple[Array, Array]:
        mean, cov = super().update(z)
        return mean + np.random.default_rng().normal(), cov


class SharedCopies(Plain):
    """Its copies keep the state in the same array."""

    contract_exemptions: ClassVar[dict[str, str]] = {"repeats": "takes as long as it may"}

    def start(self, mean: Array, cov: Array) -> None:
        super().start(mean, cov)
        self.place = mean.copy()

    def __deepcopy__(self, memo: dict[int, Any]) -> "SharedCopies":
        return copy(self)

    def update(self, z: Array) -> tuple[Array, Array]:
        mean, cov = super().update(z)
        self.place += mean
        return mean + self.place, cov


class UnsettledCopies(Unsettled):
    """It draws from a stream that nobody started, so its copies cannot be tested."""

    contract_exemptions: ClassVar[dict[str, str]] = {"repeats": "draws from its own stream"}


def test_copies_are_checked_where_equal_runs_are_not() -> None:
    title, _ = CHECKS["copies"]
    expected = {Plain: None, SharedCopies: "bad", UnsettledCopies: "left out"}
    for one, verdict in expected.items():
        findings = check_filter(loop_over_runs(one))
        verdicts = {finding.check: finding.verdict for finding in islice(findings, 5)}
        assert verdicts.get(title) == verdict


@pytest.mark.parametrize(
    ("one", "bad"),
    [
        (Plain, {}),
        (FilterPyEKF, {}),
        # Its function h is that of a radar at the origin.
        (FilterPyCKF, {"uses the place of the sensor"}),
        (FilterPyIMM, {}),
        (StoneSoupUKF, {}),
        (Draws, {"follows the target"}),
        (Shared, {"runs are independent"}),
        (Unsettled, {"equal runs give equal estimates", "runs are independent"}),
    ],
)
def test_the_contract_holds_them_to_what_can_be_asked(one: Any, bad: Any) -> None:
    skip_without_package(one)
    found, names = [], set()
    for finding in check_filter(loop_over_runs(one)):
        found.append(str(finding))
        if finding.verdict == "bad":
            names.add(finding.check)
        if bad and names >= bad:
            return
    assert not bad, found
    assert not names, found


class MeanAlone(Plain):
    """The filter of the book, without its covariance."""

    def update(self, z: Array) -> Any:
        mean, _ = super().update(z)
        return mean

    def predict(self, dt: float) -> Any:
        mean, _ = super().predict(dt)
        return mean


class NoneBeside(Plain):
    """The filter of the book, with None in place of its covariance."""

    def step(self, z: Array | None, dt: float) -> Any:
        mean, _ = super().step(z, dt)
        return mean, None


class NanBeside(Plain):
    """The filter of the book, with NaN in place of its covariance."""

    def step(self, z: Array | None, dt: float) -> tuple[Array, Array]:
        mean, cov = super().step(z, dt)
        return mean, np.full_like(cov, np.nan)


@pytest.mark.parametrize("one", [MeanAlone, NoneBeside, NanBeside])
def test_a_filter_may_estimate_the_mean_alone(one: type[PerRun]) -> None:
    """It has errors and no NEES, also none of the prior, whose covariance trackbench knows."""
    tracker = loop_over_runs(one)()
    output = track(SHORT, tracker, RUNS, predictive_metrics=("calibration", "crps"))
    assert_array_equal(output.mean, run(Plain).mean)
    assert np.isnan(output.nees).all()
    for name in ("coverage_90", "crps_px", "pit_px"):
        assert np.isnan(output.diagnostics[name]).all()
    left_out = {}
    for finding in check_filter(loop_over_runs(one)):
        assert finding.verdict != "bad", str(finding)
        left_out[finding.check] = finding.why
    why = "the filter gives no covariance"
    assert left_out["covariance is symmetric and positive definite"] == why
    assert left_out["errors and covariance fit reference filters"] == why


class LosesCovariance(Plain):
    """The filter of the book, whose covariance is NaN at some steps of the runs that go far."""

    def step(self, z: Array | None, dt: float) -> tuple[Array, Array]:
        mean, cov = super().step(z, dt)
        if self.k == 20 and self.rng.random() < 0.5:
            cov = cov.copy()
            cov[2, 2] = np.nan
        return mean, cov


def test_a_covariance_that_left_the_numbers_loses_its_run() -> None:
    """The NEES of its other steps would look like that of the run."""
    runs = 8
    task = BlockTask(SHORT, loop_over_runs(LosesCovariance)(), 1, 0, runs, runs)
    per_run = run_block(task).per_run
    lost = per_run["lost"] == NOT_FINITE
    assert 0 < lost.sum() < runs
    plain = replace(task, filter=loop_over_runs(Plain)())
    expected = run_block(plain).per_run
    assert not expected["lost"].any()
    assert_array_equal(per_run["nees"][~lost], expected["nees"][~lost])


class Writes(PerRun):
    """A filter that writes to what the model's functions return, as one that wraps a heading."""

    def start(self, mean: Array, cov: Array) -> None:
        self.x, self.P = mean, cov

    def step(self, z: Array | None, dt: float) -> tuple[Array, Array]:
        model = self.functions
        self.x = model.f(self.x)
        self.x[0] = 1.0
        h = model.h(self.x)
        for vector in (h, model.innovation(h, h)):
            vector[0] = 1.0
        for matrix in (model.F(self.x), model.Q(self.x), model.H(self.x), model.R(self.x)):
            matrix[0, 0] = 1.0
        return self.x, self.P


EQUATIONS = Tracking(
    target=Driven(
        motion=MapMotion(
            components=("heading", "rate"),
            next={"heading": "heading + rate*T + 0*sin(rate)", "rate": "rate"},
            Q=(0.01, 0.01),
        )
    ),
    sensor=FunctionSensor(h={"s": "sin(heading)", "c": "cos(heading)"}, R=0.04),
    start=GaussianStart(sigma=(0.3, 0.1)),
    last=5,
)


@pytest.mark.parametrize("scenario", [SHORT, RADAR_SCENARIO, EQUATIONS])
def test_what_the_models_functions_return_may_be_written_to(scenario: Any) -> None:
    run(Writes, scenario)


class NoiseAtTheStart(Plain):
    """It takes R before the first step, without a state."""

    def start(self, mean: Array, cov: Array) -> None:
        super().start(mean, cov)
        self.first_R = self.functions.R()

    def update(self, z: Array) -> tuple[Array, Array]:
        assert_array_equal(self.first_R, self.functions.R(self.x))
        assert_array_equal(self.first_R, self.functions.R())
        return self.x, self.P


_ONE_RANGE = {"range": "sqrt(px**2 + py**2)"}


@pytest.mark.parametrize(
    "sensor",
    [
        PositionSensor(sigma=3.0),
        RangeAzimuth(sigma_range=5.0, sigma_azimuth_mrad=2.0),
        (Bearing(sigma_mrad=2.0), Bearing(sigma_mrad=3.0, at=(50.0, 20.0))),
        FunctionSensor(
            h={**_ONE_RANGE, "azimuth": "atan2(py, px)"}, R={"range": 9.0, "azimuth": 1e-6}
        ),
    ],
)
def test_the_noise_of_any_sensor_is_known_before_the_first_step(sensor: Any) -> None:
    run(NoiseAtTheStart, replace(RADAR_SCENARIO, sensor=sensor))


def test_noise_that_depends_on_the_state_needs_a_state() -> None:
    sensor = FunctionSensor(h=_ONE_RANGE, R={"range": "1 + px**2 / 1e6"})
    with pytest.raises(ValueError, match=r"R\(\) needs a state, .*: R\(x\)"):
        run(NoiseAtTheStart, replace(RADAR_SCENARIO, sensor=sensor))


class AttributeR(Plain):
    """It takes R of a radar by an attribute that sensors of equations do not have as a matrix."""

    def update(self, z: Array) -> tuple[Array, Array]:
        sensor: Any = self.model.sensor
        self.noise = sensor.R[0, 0]
        return super().update(z)


def test_the_contract_tries_a_sensor_of_equations() -> None:
    title, check = CHECKS["equations"]
    finding = run_check(title, check, loop_over_runs(AttributeR)(), PLANAR)
    assert finding.verdict == "bad"
    assert "runs with a sensor of x, y, and fails if its kind is `function`: " in finding.why
    assert "`self.functions.R(x)`" in finding.why
    assert run_check(title, check, loop_over_runs(Plain)(), PLANAR).verdict == "good"
    # On the problem of a config the filter may be one of its sensor alone.
    findings = check_filter(loop_over_runs(AttributeR), on=ModelDraws(base=PLANAR))
    verdicts = {one.check: one.verdict for one in findings}
    assert verdicts[title] == "left out"


class Crashes(Plain):
    """It fails at once."""

    def predict(self, dt: float) -> tuple[Array, Array]:
        raise RuntimeError("boom")


def test_a_filter_that_runs_nowhere_follows_no_target() -> None:
    findings = {f.check: f for f in check_filter(loop_over_runs(Crashes))}
    assert findings["follows the target"].verdict == "left out"


def test_what_is_asked_aside_leaves_the_objects_alone() -> None:
    """A prediction is a step without a measurement, of a copy; it is the Kalman filter's."""
    task = BlockTask(SHORT, loop_over_runs(Plain)(), 1, 0, RUNS, RUNS)
    data = simulate(SHORT, 1, 0, RUNS)
    asked = replace(task, predictive_metrics=("prediction",))
    plain, told = run_filter(task, data), run_filter(asked, data)
    assert_array_equal(told.mean, plain.mean)
    exact = run_filter(replace(asked, filter=KF(), hold_out=5), data)
    held = run_filter(replace(asked, hold_out=5), data)
    for name in ("anis", "squared_predicted_x", "squared_held_x", "autocovariance_3"):
        assert_allclose(held.diagnostics[name], exact.diagnostics[name], rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("method", ["__post_init__", "start", "step"])
@pytest.mark.parametrize("name", ["model", "functions", "rng", "dt", "k", "inputs"])
def test_attributes_that_trackbench_sets_cannot_be_assigned(method: str, name: str) -> None:
    class Assigns(Plain):
        def assign(self) -> None:
            setattr(self, name, 1)

        def __post_init__(self) -> None:
            if method == "__post_init__":
                self.assign()

        def start(self, mean: Array, cov: Array) -> None:
            if method == "start":
                self.assign()
            super().start(mean, cov)

        def step(self, z: Array | None, dt: float) -> tuple[Array, Array]:
            self.assign()
            return super().step(z, dt)

    with pytest.raises(AttributeError, match=rf"self\.{name} cannot be assigned"):
        run(Assigns, replace(SHORT, last=3))
    alone = Plain()  # without trackbench, as in a test of the class
    setattr(alone, name, 7)
    assert getattr(alone, name) == 7


def test_an_attribute_of_the_class_cannot_have_a_name_that_trackbench_sets() -> None:
    with pytest.raises(TypeError, match=r"cannot be called 'k': trackbench sets self\.k"):

        class Counts(PerRun):
            k = 0
