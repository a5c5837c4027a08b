"""Targets, starts and the bound of `tracking`, against integration, moments and a second recursion."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import trackbench
from tests.conftest import track
from trackbench.core.arrays import Array
from trackbench.core.random_streams import RunStreams
from trackbench.evaluation.simulated_runs import simulate
from trackbench.field_types import DataError, InvalidKeyError
from trackbench.filters.ekf import EKF
from trackbench.models.assume import Assume
from trackbench.models.motions.kinematic import ConstantAcceleration, WhiteAcceleration
from trackbench.models.sensors.base import Outliers
from trackbench.models.sensors.position import PositionSensor
from trackbench.models.sensors.range_azimuth import RangeAzimuth, RangeAzimuthDoppler
from trackbench.models.sensors.range_azimuth_elevation import RangeAzimuthElevation
from trackbench.scenarios.score import Score, Window
from trackbench.scenarios.starts.gaussian import GaussianStart
from trackbench.scenarios.starts.known import Known
from trackbench.scenarios.starts.one_scan import OneScan
from trackbench.scenarios.starts.two_scan import TwoScan
from trackbench.scenarios.targets.driven import Driven
from trackbench.scenarios.targets.initial_state import Launch
from trackbench.scenarios.targets.legs import Leg, Legs
from trackbench.scenarios.targets.recorded_path import RecordedPath
from trackbench.scenarios.targets.timeline import Schedule, Timeline
from trackbench.scenarios.targets.waypoints import Waypoints
from trackbench.scenarios.tracking import Tracking

LEGS = (
    Leg(start=10.0, end=40.0, ax=0.5, ay=-0.2, az=0.1),
    Leg(start=45.0, end=75.0, turn_rate_deg_s=4.0),
    Leg(start=75.0, end=90.0, turn_rate_deg_s=-6.0),
    Leg(start=95.0, end=110.0, ax=-1.0, ay=0.3),
)


def flown(t: float, x: Array) -> Array:
    """dx/dt of the legs."""
    leg = next((leg for leg in LEGS if leg.start <= t < leg.end), None)
    a, w = (np.array(leg.acceleration), np.deg2rad(leg.turn_rate_deg_s)) if leg else (0.0, 0.0)
    out = np.empty(6)
    out[0::2], out[1::2] = x[1::2], a + w * np.array([-x[3], x[1], 0.0])
    return out


def test_legs_against_integration() -> None:
    launch = Launch(x=100.0, y=-50.0, z=1000.0, vx=80.0, vy=20.0, vz=2.0)
    times = np.linspace(0.0, 120.0, 61)
    states = Legs(launch=launch, legs=LEGS).states(times)
    edges = sorted({0.0, 120.0, *(e for leg in LEGS for e in (leg.start, leg.end))})
    x, found = launch.state, []
    for a, b in pairwise(edges):
        inside = times[(times >= a) & (times < b)]
        path = solve_ivp(flown, (a, b - 1e-9), x, t_eval=[*inside, b - 1e-9], rtol=1e-11, atol=1e-8)
        found.append(path.y[:, : len(inside)])
        x = path.y[:, -1]
    exact = np.concatenate(found, axis=1)
    np.testing.assert_allclose(states[:, : exact.shape[1]], exact, rtol=1e-7, atol=1e-4)


def test_waypoints_are_met_and_velocities_are_derivatives() -> None:
    target = Waypoints(x=(0.0, 300.0, 500.0, 400.0), y=(0.0, 50.0, 300.0, 800.0), speed=20.0)
    reached = target._times
    np.testing.assert_allclose(np.diff(reached)[0], np.hypot(300.0, 50.0) / 20.0)
    np.testing.assert_allclose(target.states(reached)[[0, 2]], [target.x, target.y], atol=1e-9)
    t = np.linspace(-5.0, reached[-1] + 5.0, 97)  # straight on before and after
    slope = (target.states(t + 1e-5)[0::2] - target.states(t - 1e-5)[0::2]) / 2e-5
    np.testing.assert_allclose(target.states(t)[1::2], slope, atol=1e-4)


def test_a_recorded_path_is_flown(tmp_path: Path) -> None:
    true = Legs(launch=Launch(vx=30.0, vy=10.0), legs=(Leg(start=5.0, end=25.0, ax=1.0),))
    rows = np.arange(0.0, 31.0, 2.0)
    px, vx, py, vy = true.states(rows)
    path = tmp_path / "p.csv"

    def written(*columns: str) -> RecordedPath:
        values = {"time": rows, "x": px, "y": py, "vx": vx, "vy": vy}
        lines = [
            ",".join(map(repr, map(float, row)))
            for row in zip(*(values[c] for c in columns), strict=True)
        ]
        path.write_text("\n".join([",".join(columns), *lines]))
        return RecordedPath(file=str(path))

    t = np.arange(0.0, 30.5, 0.5)
    with_speed = written("time", "x", "y", "vx", "vy")
    np.testing.assert_allclose(with_speed.states(t)[0::2], true.states(t)[0::2], atol=0.2)
    positions = written("time", "y", "x")
    np.testing.assert_allclose(positions.states(rows)[0::2], [px, py], atol=1e-9)
    assert positions != with_speed  # the file of that name has other numbers now
    scenario = Tracking(
        target=positions,
        sensor=PositionSensor(sigma=1.0),
        start=TwoScan(),
        last=30,
        assume=Assume(motion=ConstantAcceleration(q=0.1)),
    )
    assert scenario.simulate(RunStreams(1, range(3)), 3).truth.shape == (4, 30, 3)
    with pytest.raises(DataError, match="covers 0 to 30 s of 0 to 31 s"):
        replace(scenario, last=31)


DRIVEN = Driven(motion=WhiteAcceleration(q=0.5), launch=Launch(x=3e3, y=4e3, vx=20.0, vy=-30.0))
SPACE = Driven(
    motion=WhiteAcceleration(q=0.5),
    launch=Launch(x=3e3, y=4e3, z=2e3, vx=20.0, vy=-30.0, vz=3.0),
)
RADAR: dict[str, Any] = {"sigma_range": 15.0, "sigma_azimuth_mrad": 4.0}
STARTS: list[tuple[Any, Any, Any]] = [
    (DRIVEN, PositionSensor(sigma=20.0), TwoScan()),
    (DRIVEN, RangeAzimuth(**RADAR), TwoScan()),
    (DRIVEN, RangeAzimuth(at=(500.0, -800.0), **RADAR), TwoScan()),
    (DRIVEN, RangeAzimuthDoppler(sigma_range_rate=1.0, **RADAR), TwoScan()),
    (SPACE, RangeAzimuthElevation(sigma_elevation_mrad=5.0, **RADAR), TwoScan()),
    (DRIVEN, PositionSensor(sigma=20.0), GaussianStart(sigma=(30.0, 4.0, 20.0, 3.0))),
    (
        Legs(launch=Launch(vx=9.0)),
        PositionSensor(sigma=20.0),
        GaussianStart(sigma=(30.0, 4.0, 20.0, 3.0)),
    ),
]


@pytest.mark.parametrize(("target", "sensor", "start"), STARTS)
def test_the_first_state_is_what_a_start_says(target: Any, sensor: Any, start: Any) -> None:
    """NEES of the prior over many runs: n, within 4.5 standard errors of a chi-square's mean."""
    runs = 4000
    scenario = Tracking(
        target=target,
        sensor=sensor,
        start=start,
        last=3,
        T=2.0,
        assume=Assume(motion=WhiteAcceleration(q=0.5)),
    )
    data = scenario.simulate(RunStreams(7, range(runs)), runs)
    e, cov = data.truth[:, 0] - data.prior.mean, data.prior.cov
    cov = np.broadcast_to(np.atleast_3d(cov), (*cov.shape[:2], runs))
    nees = np.einsum("im,mij,jm->m", e, np.linalg.inv(np.moveaxis(cov, -1, 0)), e)
    n = len(e)
    assert (
        abs(nees.mean() - n) < 4.5 * np.sqrt(2 * n / runs) + 0.02 * n
    )  # conversions are not exact


def test_one_scan_knows_a_velocitys_size_alone() -> None:
    scenario = Tracking(
        target=DRIVEN,
        sensor=PositionSensor(sigma=20.0),
        start=OneScan(sigma_velocity=40.0),
        last=5,
    )
    prior = scenario.simulate(RunStreams(1, range(5)), 5).prior
    np.testing.assert_array_equal(prior.mean[1::2], 0.0)
    np.testing.assert_array_equal(np.diagonal(prior.cov), [400.0, 1600.0, 400.0, 1600.0])
    assert scenario.steps[0] == 0


def test_the_bound_of_several_sensors_with_lost_measurements() -> None:
    """Tichavsky's recursion over paths drawn by numpy; an EKF of a nearly linear problem reaches it."""
    radar = RangeAzimuth(detection=0.7, **RADAR)
    position = PositionSensor(sigma=30.0, period=3, offset=1)
    start = GaussianStart(sigma=(60.0, 6.0, 60.0, 6.0))
    scenario = Tracking(target=DRIVEN, sensor=(radar, position), start=start, last=40)
    motion = scenario.model.motion
    paths, rng = 100_000, np.random.default_rng(3)
    P, root = np.diag(np.square(start.sigma)), np.linalg.cholesky(motion.Q)
    # The truth of a driven target is drawn about its state.
    x = DRIVEN.launch.state[:, None] + np.sqrt(P) @ rng.standard_normal((4, paths))
    squares = [P[0, 0] + P[2, 2]]
    for k in range(1, 41):
        x = motion.F @ x + root @ rng.standard_normal((4, paths))
        P = motion.F @ P @ motion.F.T + motion.Q
        H = radar.jacobian(x, k)
        information = np.einsum("aim,ab,bjm->ij", H, np.linalg.inv(radar.R), H) / paths
        J = np.linalg.inv(P) + 0.7 * information
        if k % 3 == 1:
            J[[0, 2], [0, 2]] += 1 / 900
        P = np.linalg.inv(J)
        squares.append(P[0, 0] + P[2, 2])
    bound = scenario.bounds()["position"]
    without = np.array([b["position"] for b in scenario.bounds_without_batch()])
    # The jackknife's error over ten batches of a thousand paths; mine has a tenth of its variance.
    stderr = np.sqrt(0.9 * np.square(without - without.mean(axis=0)).sum(axis=0))
    assert (stderr[1:] < 1e-3 * bound[1:]).all()
    assert (abs(bound - np.sqrt(squares)) <= 4.5 * np.sqrt(1.1) * stderr + 1e-9).all()
    runs = 1000
    error = track(scenario, EKF(), runs).mean - simulate(scenario, 1, 0, runs).truth
    rmse = np.sqrt(np.square(error[0::2]).sum(axis=0).mean(axis=1))
    above = rmse / scenario.bounds()["position"]
    assert above.min() > 1.0 - 4.5 * np.sqrt(0.5 / runs)  # of an rms over runs of two components
    assert above[-1] < 1.15  # losses at random cost more than their share


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"start": Known()}, "the first state is known"),
        ({"sensor": PositionSensor(sigma=1.0, outliers=Outliers(share=0.1))}, "normal errors"),
        ({"sensor": PositionSensor(sigma=1.0, bias=(1.0, 0.0))}, "without a bias"),
    ],
)
def test_no_bound(changes: dict[str, Any], why: str) -> None:
    keys: dict[str, Any] = {
        "target": DRIVEN,
        "sensor": PositionSensor(sigma=1.0),
        "start": TwoScan(),
        "last": 5,
    }
    assert Tracking(**keys).why_no_bound is None
    assert why in str(Tracking(**{**keys, **changes}).why_no_bound)


def test_a_flown_target_needs_a_motion_to_assume() -> None:
    scenario = Tracking(
        target=Legs(launch=Launch()), sensor=PositionSensor(sigma=1.0), start=TwoScan(), last=5
    )
    with pytest.raises(InvalidKeyError, match="name the motion that filters assume"):
        _ = scenario.model
    assumed = scenario.with_assumptions(Assume(motion=ConstantAcceleration(q=1.0)))
    assert assumed.model.motion.components[-1] == "ay"


def test_windows_of_the_score_are_within_what_is_scored() -> None:
    score = Score(steps=(3, 8), windows=(Window(name="late", first=6),))
    scenario = Tracking(
        target=DRIVEN, sensor=PositionSensor(sigma=1.0), start=TwoScan(), last=9, score=score
    )
    assert scenario.steps[scenario.windows[""]].tolist() == [3, 4, 5, 6, 7, 8]
    assert scenario.steps[scenario.windows["late"]].tolist() == [6, 7, 8]


def test_every_filter_may_assume_a_motion_and_the_scenario_none(tmp_path: Path) -> None:
    """A flown path has no motion; what is asked of the scenario alone is asked of its sensor."""
    (tmp_path / "c.yaml").write_text("""name: c
runs: 4
scenario:
  kind: tracking
  last: 10
  target: {kind: legs, launch: {x: 3000, y: 100, vx: -20, vy: 5}}
  sensor: {kind: position, sigma: 10}
  start: two-scan
filters: {A: {kind: kf, assume: {motion: {kind: cv, q: 1}}}}
figures: {track: {kind: track}}
""")
    report = trackbench.run(
        tmp_path / "c.yaml", out=tmp_path / "out", quiet=True, engine="serial", formats=("svg",)
    )
    assert np.isfinite(report.summary["value"]).any()
    assert (tmp_path / "out" / "figures" / "track.svg").exists()


@pytest.mark.parametrize("last", [None, 1])
def test_a_timeline_that_the_start_uses_up_is_a_mistake(last: int | None) -> None:
    """A target of a plugin may have fewer steps than a file, which is checked as it is read."""
    schedule = Schedule(first=0, last=last, begin=None, skipped=1)
    two_steps = Timeline(steps=np.arange(2), times=np.arange(2.0), T=1.0)
    with pytest.raises(InvalidKeyError, match="no step after those that the start uses up"):
        schedule.check(two_steps)
