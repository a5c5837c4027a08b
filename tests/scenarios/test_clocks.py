"""Recorded data on clocks of their own: irregular steps, dates, units, several sensors and runs."""

import math
import re
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from tests.commands import trackbench
from trackbench import api
from trackbench.config.load import load
from trackbench.errors import UserError
from trackbench.scenarios.recordings.naming_of_columns import Naming

pytestmark = pytest.mark.usefixtures("no_report")

T = np.array([0.0, 1.0, 1.7, 4.2, 4.3, 9.0, 9.5, 12.25, 13.0, 20.0, 20.1, 21.0])
RNG = np.random.default_rng(3)
X = np.stack([40.0 + 3.0 * T, -7.0 - 2.0 * T]) + RNG.normal(size=(2, len(T)))
Q, SIGMA = 0.3, 2.0


def table(names: str, *columns: Any) -> str:
    rows = zip(*columns, strict=True)
    return "\n".join([names, *(",".join(str(cell) for cell in row) for row in rows)]) + "\n"


def config(folder: Path, target: dict[str, Any], **changes: Any) -> Path:
    scenario = {
        "kind": "tracking",
        "target": {"kind": "measured", **target},
        "sensor": {"kind": "position", "sigma": SIGMA},
        "start": {"kind": "one-scan", "sigma_velocity": 10},
        "assume": {"motion": {"kind": "cwna", "q": Q}},
    }
    filters = changes.pop("filters", {"KF": {"kind": "kf"}})
    text = {"name": "x", "scenario": scenario | changes, "filters": filters}
    path = folder / "c.yaml"
    path.write_text(yaml.safe_dump(text))
    return path


def tracked(path: Path, **options: Any) -> dict[str, Any]:
    """The tracks of a run, and what it said."""
    out = path.parent / "out"
    report = api.run(path, out=out, workers=1, quiet=True, formats=(), save_tracks=True, **options)
    assert not report.failed
    with np.load(out / "tracks.npz") as tracks:
        return dict(tracks)


def by_hand(times: Any, z: Any) -> np.ndarray:
    """A Kalman filter of one axis of white acceleration, in scalars (Bar-Shalom 2001, 6.2.2)."""
    x, v, a, b, c, out = z[0], 0.0, SIGMA**2, 0.0, 100.0, [z[0]]
    for i in range(1, len(times)):
        t = times[i] - times[i - 1]
        x, v = x + t * v, v
        a, b, c = (
            a + 2 * t * b + t * t * c + Q * t**3 / 3,
            b + t * c + Q * t * t / 2,
            c + Q * t,
        )
        s = a + SIGMA**2
        if not math.isnan(z[i]):
            gain, other, nu = a / s, b / s, z[i] - x
            x, v = x + gain * nu, v + other * nu
            a, b, c = (1 - gain) * a, (1 - gain) * b, c - other * b
        out.append(x)
    return np.array(out)


def test_motions_are_given_the_true_interval_of_each_step(tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text(table("time,x,y", T, *X))
    found = tracked(config(tmp_path, {"measurements": "m.csv"}))
    np.testing.assert_allclose(found["times"], T, rtol=1e-12)
    for axis in range(2):
        np.testing.assert_allclose(
            found["mean/KF"][2 * axis, :, 0], by_hand(T, X[axis]), rtol=1e-10
        )


@pytest.mark.parametrize("stray", [0.01, 0.001, 1e-5])
def test_a_clock_that_strays_by_a_small_share_has_steps_of_its_own(
    tmp_path: Path, stray: float
) -> None:
    """Each step has its own interval, not the mean one, which a filter would show in its digits."""
    times = 2.0 * np.arange(10) + stray * np.array([0, 0, 0, 1, 0, 0, -1, 0, 0, 0])
    (tmp_path / "m.csv").write_text(table("time,x,y", times, *X[:, :10]))
    found = tracked(config(tmp_path, {"measurements": "m.csv"}))
    np.testing.assert_allclose(found["mean/KF"][0, :, 0], by_hand(times, X[0, :10]), rtol=1e-10)


def test_rounding_of_a_clock_is_no_step_of_its_own(tmp_path: Path) -> None:
    times = 0.1 * np.arange(12)
    times[5] += 1e-9
    (tmp_path / "m.csv").write_text(table("time,x,y", times, *X))
    scenario = load(config(tmp_path, {"measurements": "m.csv"})).points[0].scenario
    assert scenario.model.motion.T == 0.1


FILTERS = {
    "KF": {"kind": "kf"},
    "UKF": {"kind": "ukf"},
    "CT": {
        "kind": "ekf",
        "assume": {"motion": {"kind": "ct-unknown", "q": 0.1, "turn_walk_deg_s": 1}},
    },
    "Singer": {"kind": "ckf", "assume": {"motion": {"kind": "singer", "sigma": 1, "tau": 5}}},
    "IMM": {
        "kind": "imm",
        "motions": [{"kind": "cwna", "q": 0.1}, {"kind": "ca", "q": 0.01}],
        "transition": [[0.9, 0.1], [0.1, 0.9]],
    },
    "RPF": {"kind": "rpf", "N": 50},
    "PF": {"kind": "pf", "N": 50},
}


def test_equal_intervals_give_the_same_bytes_whether_or_not_a_later_one_differs(
    tmp_path: Path,
) -> None:
    times = 2.0 * np.arange(10)
    path = config(tmp_path, {"measurements": "m.csv"}, filters=FILTERS)
    (tmp_path / "m.csv").write_text(table("time,x,y", times, *X[:, :10]))
    equal = tracked(path)
    times[-1] += 0.5
    (tmp_path / "m.csv").write_text(table("time,x,y", times, *X[:, :10]))
    irregular = tracked(path)
    for label in FILTERS:
        before, now = equal[f"mean/{label}"][:, :-1], irregular[f"mean/{label}"][:, :-1]
        np.testing.assert_array_equal(before, now)
        assert not np.array_equal(equal[f"mean/{label}"], irregular[f"mean/{label}"])


ADAPTIVE = {
    "kind": "adaptive-kf",
    "preset": "paper-eta20",
    "nmf": {"q": 0.01},
    "mf": {"q": 0.01},
}


def test_a_filter_of_equal_steps_is_refused_or_resampled_for(tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text(table("time,x,y", T, *X))
    filters = {"A": ADAPTIVE, "KF": {"kind": "kf"}}
    with pytest.raises(UserError, match=r"only with steps of equal length.*`resample:"):
        load(config(tmp_path, {"measurements": "m.csv"}, filters=filters))
    path = config(tmp_path, {"measurements": "m.csv", "resample": 1.0}, filters=filters)
    (told,) = load(path).points[0].scenario.cautions
    # 4.2 and 4.3 are at 4, 9.0 and 9.5 at 9 and 10, 20.0 and 20.1 at 20
    assert told.startswith(
        "resampled: measurements are taken to be up to 0.5 s from when they were, 2"
    )
    found = tracked(path)
    np.testing.assert_array_equal(found["times"], np.arange(22.0))
    z = np.full(22, np.nan)
    for t, value in zip(T[::-1], X[0, ::-1], strict=True):
        z[int(np.floor(t + 0.5))] = value  # of two the earlier, which is the nearer here
    np.testing.assert_allclose(found["mean/KF"][0, :, 0], by_hand(np.arange(22.0), z), rtol=1e-10)


def test_dates_units_and_names_change_nothing(tmp_path: Path) -> None:
    path = config(tmp_path, {"measurements": "m.csv"})
    (tmp_path / "m.csv").write_text(table("time,x,y", T, *X))
    plain = tracked(path)["mean/KF"]
    dates = np.datetime64("2026-03-01T23:59:50", "us") + np.rint(T * 1e6).astype("m8[us]")
    columns = {"time": "Zeit", "x": "east", "y": "north (ft)"}
    units = {"x": "km", "y": "ft"}
    target = {"measurements": "m.csv", "columns": columns, "units": units}
    feet = X[1] / 0.3048
    (tmp_path / "m.csv").write_text(table("east,Zeit,north (ft)", X[0] / 1000, dates, feet))
    named = tracked(config(tmp_path, target))
    np.testing.assert_allclose(named["times"], T, atol=1e-9)
    np.testing.assert_allclose(named["mean/KF"], plain, rtol=1e-9)


def test_rows_out_of_order_and_twice_are_told_of(tmp_path: Path) -> None:
    order = [0, 2, 1, 3, 4, 5, 5, 6, 7, 8, 9, 11, 10]
    path = config(tmp_path, {"measurements": "m.csv"})
    (tmp_path / "m.csv").write_text(table("time,x,y", T, *X))
    plain = tracked(path)["mean/KF"]
    (tmp_path / "m.csv").write_text(table("time,x,y", T[order], *X[:, order]))
    np.testing.assert_array_equal(tracked(path)["mean/KF"], plain)
    late, twice = load(path).points[0].scenario.cautions
    assert late.startswith("2 rows that came after later ones were put in order; the largest fall")
    assert twice == "1 row repeats the one before and was left out"


def test_each_run_starts_from_its_own_first_measurements(tmp_path: Path) -> None:
    """The second run is later, elsewhere, and its first cell is empty."""
    later = T + 1000.5
    names = ["7"] * len(T) + ["other"] * (1 + len(T))
    times = np.concatenate([T, [later[0] - 3.0], later])
    x = [*X[0], "", *(X[0] + 5e5)]
    y = np.concatenate([X[1], [1.0], X[1] - 5e5])
    (tmp_path / "m.csv").write_text(table("run,time,x,y", names, times, x, y))
    found = tracked(config(tmp_path, {"measurements": "m.csv"}))
    np.testing.assert_allclose(found["times"], T, atol=1e-9)
    first, second = found["mean/KF"][0].T
    np.testing.assert_allclose(first, by_hand(T, X[0]), rtol=1e-10)
    np.testing.assert_allclose(second, by_hand(T, X[0] + 5e5), rtol=1e-9)


def test_two_scans_are_as_far_apart_as_they_were_in_each_run(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(table("time,x,y", T, *X))
    (tmp_path / "b.csv").write_text(table("time,x,y", T[1:], *X[:, 1:]))
    found = tracked(config(tmp_path, {"measurements": "?.csv"}, start="two-scan"))
    velocity = found["mean/KF"][1, 0]
    np.testing.assert_allclose(velocity[0], (X[0, 1] - X[0, 0]) / 1.0, rtol=1e-12)
    np.testing.assert_allclose(velocity[1], (X[0, 2] - X[0, 1]) / 0.7, rtol=1e-9)


def test_sensors_come_in_one_file_or_in_one_each(tmp_path: Path) -> None:
    sensors = [
        {"kind": "position", "sigma": SIGMA},
        {"kind": "range-azimuth", "sigma_range": 5, "sigma_azimuth_mrad": 9},
    ]
    late = T[:-1] + 0.05
    r, a = np.hypot(40 + 3 * late, -7 - 2 * late), np.arctan2(-7 - 2 * late, 40 + 3 * late)
    (tmp_path / "p.csv").write_text(table("time,x,y", T, *X))
    (tmp_path / "r.csv").write_text(table("time,range,azimuth", late, r / 1000, np.rad2deg(a)))
    units = {"range": "km", "azimuth": "deg"}
    filters = {"EKF": {"kind": "ekf"}, "UKF": {"kind": "ukf"}}
    each = {"measurements": ["p.csv", "r.csv"], "units": units}
    apart = tracked(config(tmp_path, each, sensor=sensors, filters=filters))
    n, empty = len(T), [""] * len(T)
    (tmp_path / "m.csv").write_text(
        table(
            "sensor,time,x,y,range,azimuth",
            [1] * n + [2] * (n - 1),
            np.concatenate([T, late]),
            *([*row, *empty[1:]] for row in X),
            [*empty, *(r / 1000)],
            [*empty, *np.rad2deg(a)],
        )
    )
    one = {"measurements": "m.csv", "units": units}
    together = tracked(config(tmp_path, one, sensor=sensors, filters=filters))
    for label in filters:
        np.testing.assert_array_equal(apart[f"mean/{label}"], together[f"mean/{label}"])
    assert np.isfinite(apart["measurements"][2:, ::2]).sum() == 2 * (n - 1)


BEGIN = 1715679062.0  # 2024-05-14T09:31:02Z, s since 1970


def dates(times: Any, zone: str = "Z", ahead: float = 0.0) -> list[str]:
    """ISO 8601 dates of times after `BEGIN`, by clocks that are ``ahead`` of UTC, s."""
    form = "%Y-%m-%dT%H:%M:%S.%f"
    moments = (datetime.fromtimestamp(BEGIN + ahead + t, UTC) for t in times)
    return [moment.strftime(form) + zone for moment in moments]


def two_clocks(folder: Path, unix: list[str], gps: list[str], names: Sequence[str]) -> None:
    """Write positions with dates and distances with UNIX times; ``names`` are those of the times."""
    late = T[:-1] + 0.05
    r = np.hypot(40 + 3 * late, -7 - 2 * late)
    a = np.arctan2(-7 - 2 * late, 40 + 3 * late)
    (folder / "p.csv").write_text(table(f"{names[0]},x,y", gps, *X))
    (folder / "r.csv").write_text(table(f"{names[1]},d,a", unix, r / 1000, np.rad2deg(a)))


TWO_SENSORS = [
    {"kind": "position", "sigma": SIGMA},
    {"kind": "range-azimuth", "sigma_range": 5, "sigma_azimuth_mrad": 9},
]
RADAR_NAMING = {
    "columns": {"range": "d", "azimuth": "a"},
    "units": {"range": "km", "azimuth": "deg"},
}


def with_two_clocks(folder: Path, own: dict[str, Any], **target: Any) -> dict[str, Any]:
    """The tracks of the two sensors; ``own`` are keys of the radar's time."""
    naming = {**RADAR_NAMING, "columns": RADAR_NAMING["columns"] | own.get("columns", {})}
    naming["units"] = RADAR_NAMING["units"] | own.get("units", {})
    keys = {"measurements": ["p.csv", "r.csv"], "measurement_naming": [{}, naming], **target}
    filters = {"EKF": {"kind": "ekf"}}
    return tracked(config(folder, keys, sensor=TWO_SENSORS, filters=filters))


@pytest.mark.parametrize(("unit", "digits"), [("s", 10), ("ms", 13), ("us", 16), ("ns", 19)])
def test_unix_times_stand_beside_dates(tmp_path: Path, unit: str, digits: int) -> None:
    """Each file has names and units of its own, and the tracks are those of equal clocks."""
    late = T[:-1] + 0.05
    two_clocks(tmp_path, dates(late), dates(T), ("date", "date"))
    alike = with_two_clocks(tmp_path, {}, columns={"time": "date"})
    whole = [round((BEGIN + t) * 1000) * 10 ** (digits - 10) // 1000 for t in late]
    unix = [str(number) for number in whole]
    if unit == "s":
        unix = [f"{BEGIN + t:.2f}" for t in late]
    two_clocks(tmp_path, unix, dates(T), ("date", "stamp"))
    own = {"columns": {"time": "stamp"}, "units": {"time": unit}}
    mixed = with_two_clocks(tmp_path, own, columns={"time": "date"})
    np.testing.assert_allclose(mixed["times"], alike["times"], rtol=0, atol=1e-6)
    np.testing.assert_allclose(mixed["mean/EKF"], alike["mean/EKF"], rtol=1e-4, atol=1e-3)
    # A unit that files share is that of the numbers alone.
    own = {"columns": {"time": "stamp"}}
    shared = with_two_clocks(tmp_path, own, columns={"time": "date"}, units={"time": unit})
    np.testing.assert_array_equal(mixed["mean/EKF"], shared["mean/EKF"])


def test_a_truth_with_dates_stands_beside_unix_times(tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text(table("time,x,y", np.rint(1000 * (BEGIN + T)).astype(int), *X))
    (tmp_path / "t.csv").write_text(table("time,x,y", dates(T), 40 + 3 * T, -7 - 2 * T))
    target = {"measurements": "m.csv", "truth": "t.csv", "units": {"time": "ms"}}
    truth = tracked(config(tmp_path, target))["truth"][0, :, 0]
    np.testing.assert_allclose(truth, 40 + 3 * T, rtol=1e-12)
    # The other way round: a unit that the target has for all files is that of the truth alone.
    (tmp_path / "m.csv").write_text(table("time,x,y", dates(T), *X))
    unix = np.rint(1000 * (BEGIN + T)).astype(int)
    (tmp_path / "t.csv").write_text(table("time,x,y", unix, 40 + 3 * T, -7 - 2 * T))
    truth = tracked(config(tmp_path, target))["truth"][0, :, 0]
    np.testing.assert_allclose(truth, 40 + 3 * T, rtol=1e-12)


def test_inputs_with_unix_times_stand_beside_dates(tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text(table("time,x,y", dates(T), *X))
    speeds = np.arange(len(T)) / 10.0
    unix = np.rint(1000 * (BEGIN + T)).astype(int)
    motion = {
        "kind": "map",
        "components": ["px", "py"],
        "input": ["v"],
        "next": {"px": "px + v*T", "py": "py"},
        "Q": [["T", 0], [0, "T"]],
    }
    keys: dict[str, Any] = {
        "sensor": {"kind": "function", "h": {"x": "px", "y": "py"}, "R": 4},
        "start": {"kind": "given", "mean": [40, -7], "sigma": [9, 9]},
        "assume": {"motion": motion},
    }
    target: dict[str, Any] = {
        "measurements": "m.csv",
        "input": {"v": "v"},
        "input_file": "i.csv",
        "input_gap": 100,
        "state": ["px", "py"],
    }
    found = []
    for times, units in ((dates(T), {}), (unix, {"time": "ms"})):
        (tmp_path / "i.csv").write_text(table("time,v", times, speeds))
        found.append(tracked(config(tmp_path, target | {"units": units}, **keys))["mean/KF"])
    np.testing.assert_allclose(found[0], found[1], rtol=1e-9)


def test_dates_without_a_zone_beside_unix_times_are_a_question(tmp_path: Path) -> None:
    late = T[:-1] + 0.05
    own = {"columns": {"time": "stamp"}}
    two_clocks(tmp_path, [f"{BEGIN + t:.2f}" for t in late], dates(T), ("date", "stamp"))
    alike = with_two_clocks(tmp_path, own, columns={"time": "date"})
    local = dates(T, "", ahead=7200.0)
    two_clocks(tmp_path, [f"{BEGIN + t:.2f}" for t in late], local, ("date", "stamp"))
    what = (
        r"r.csv:1:1: .*UNIX times in s.*: which zone have the dates in date of .*p.csv\? Say `zone"
    )
    with pytest.raises(UserError, match=what):
        with_two_clocks(tmp_path, own, columns={"time": "date"})
    zoned = with_two_clocks(tmp_path, own, columns={"time": "date"}, zone="+02:00")
    np.testing.assert_array_equal(zoned["mean/EKF"], alike["mean/EKF"])
    # Two hours in the wrong zone are within a day, and those of another year are not.
    wrong = [f"{BEGIN - 315964800 + t:.2f}" for t in late]
    two_clocks(tmp_path, wrong, dates(T), ("date", "stamp"))
    what = "stamp has UNIX times in s from 2014-05-10 .*dates with a zone from 2024-05-14"
    with pytest.raises(UserError, match=what):
        with_two_clocks(tmp_path, own, columns={"time": "date"})


def test_times_of_gps_beside_dates_are_a_question(tmp_path: Path) -> None:
    late = T[:-1] + 0.05
    unix = [f"{BEGIN + t:.2f}" for t in late]
    two_clocks(tmp_path, unix, dates(T), ("date", "gps_time"))
    own: dict[str, Any] = {"columns": {"time": "gps_time"}}
    with pytest.raises(UserError, match="GPS is ahead of UTC by leap seconds, 18 s since 2017"):
        with_two_clocks(tmp_path, own, columns={"time": "date"})
    answered = with_two_clocks(tmp_path, own, columns={"time": "date"}, zone="UTC")
    two_clocks(tmp_path, unix, dates(T), ("date", "stamp"))
    own = {"columns": {"time": "stamp"}}
    alike = with_two_clocks(tmp_path, own, columns={"time": "date"})
    np.testing.assert_array_equal(answered["mean/EKF"], alike["mean/EKF"])


def test_weeks_of_gps_beside_unix_times_have_no_zone_to_say(tmp_path: Path) -> None:
    """Weeks never count from 1970, so that a `zone` would only be the next mistake."""
    late = T[:-1] + 0.05
    seconds = [f"{207060 + t:.2f}" for t in late]
    unix = [f"{BEGIN + t:.2f}" for t in T]
    two_clocks(tmp_path, seconds, unix, ("stamp", "tow"))
    rows = (tmp_path / "r.csv").read_text().splitlines()
    weeks = ["week,tow,d,a", *(f"2314,{row}" for row in rows[1:])]
    (tmp_path / "r.csv").write_text("\n".join(weeks) + "\n")
    own: dict[str, Any] = {"columns": {"time": "tow", "week": "week"}}
    what = r"GPS is ahead of UTC by leap seconds, 18 s since 2017: write UNIX times into .*r\.csv$"
    with pytest.raises(UserError, match=what) as caught:
        with_two_clocks(tmp_path, own, columns={"time": "stamp"})
    assert "zone" not in str(caught.value)


def test_the_truth_is_interpolated_within_its_gap_only(tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text(table("time,x,y", T, *X))
    at = np.array([-1.0, 2.0, 4.0, 9.0, 15.0, 20.1])
    (tmp_path / "t.csv").write_text(table("time,x,y", at, 40 + 3 * at, -7 - 2 * at))
    target = {"measurements": "m.csv", "truth": "t.csv", "truth_gap": 3}
    found = tracked(config(tmp_path, target))
    truth = found["truth"][0, :, 0]
    there = [True] * 3 + [False] * 2 + [True] + [False] * 4 + [True, False]
    np.testing.assert_array_equal(np.isfinite(truth), there)
    np.testing.assert_allclose(truth[there], (40 + 3 * T)[there], rtol=1e-12)
    target.pop("truth_gap")
    alone = tracked(config(tmp_path, target))["truth"][0, :, 0]
    np.testing.assert_array_equal(np.isfinite(alone), np.isin(T, at))
    (tmp_path / "t.csv").write_text(table("time,x,y", at + 0.001, at, at))
    with pytest.raises(
        UserError, match=r"t.csv:1:1: scenario: has no truth at any step: name a `truth_"
    ):
        load(config(tmp_path, target))


def test_metrics_are_over_the_steps_that_have_a_truth(tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text(table("time,x,y", T, *X))
    (tmp_path / "t.csv").write_text(table("time,x,y", T[5:], 40 + 3 * T[5:], -7 - 2 * T[5:]))
    path = config(tmp_path, {"measurements": "m.csv", "truth": "t.csv"})
    found = tracked(path)
    report = api.run(path, out=tmp_path / "out", workers=1, quiet=True, formats=())
    values = report.per_run.set_index("metric")["value"]
    error = found["mean/KF"][0::2, 5:, 0] - found["truth"][0::2, 5:, 0]
    square = (error**2).sum(axis=0)
    assert values["rmse_position"] == pytest.approx(np.sqrt(square.mean()), rel=1e-6)
    assert values["peak_position"] == pytest.approx(np.sqrt(square.max()), rel=1e-6)


def test_latitude_speed_and_course_stand_for_positions_and_velocities(tmp_path: Path) -> None:
    names = "time,latitude,longitude,speed,course"
    rows = table(
        names, [0, 10, 20], [50.0, 50.001, 50.0], [0.0, 0.0, ""], [10, 20, 30], [90, 180, 270]
    )
    (tmp_path / "m.csv").write_text(rows)
    target = {"measurements": "m.csv", "units": {"speed": "kn"}}
    sensor = [{"kind": "position", "sigma": 5}, {"kind": "velocity", "sigma": 1}]
    x, y, vx, vy = tracked(config(tmp_path, target, sensor=sensor))["measurements"][:, :, 0]
    knot = 1852 / 3600
    np.testing.assert_allclose(y, [111.229, np.nan], rtol=1e-5)  # 111 229 m a degree at 50 north
    np.testing.assert_allclose(x, [0.0, np.nan], atol=1e-6)
    np.testing.assert_allclose(vx, [0.0, -30 * knot], atol=1e-9)
    np.testing.assert_allclose(vy, [-20 * knot, 0.0], atol=1e-9)


def test_parquet_is_read_where_there_is_pyarrow(tmp_path: Path) -> None:
    (tmp_path / "m.parquet").write_bytes(b"PAR1")
    path = config(tmp_path, {"measurements": "m.parquet"})
    try:
        import pandas as pd
        import pyarrow  # noqa: F401
    except ImportError:
        with pytest.raises(
            UserError, match=r"m.parquet:1:1: scenario: reading Parquet takes pyarrow"
        ):
            load(path)
        return
    with pytest.raises(UserError, match=r"m.parquet:1:1: scenario: not a Parquet file"):
        load(path)
    pd.DataFrame({"time": T, "x": X[0], "y": X[1]}).to_parquet(tmp_path / "m.parquet")
    found = tracked(path)
    np.testing.assert_allclose(found["mean/KF"][0, :, 0], by_hand(T, X[0]), rtol=1e-10)
    # A column of pandas' nullable numbers has the value NA where a cell is missing.
    frame = pd.DataFrame({"time": T, "x": X[0], "y": X[1]}).convert_dtypes()
    frame.loc[3, ["x", "y"]] = pd.NA
    frame.to_parquet(tmp_path / "m.parquet")
    with_gap = tracked(path)
    frame.astype(float).to_csv(tmp_path / "m.csv", index=False)
    as_csv = tracked(config(tmp_path, {"measurements": "m.csv"}))
    np.testing.assert_array_equal(with_gap["measurements"], as_csv["measurements"])
    assert np.isnan(with_gap["measurements"]).any()


@pytest.mark.parametrize(
    ("zone", "offset"),
    [("utc", 0.0), ("Z", 0.0), ("+00:00", 0.0), ("UTC+2", 7200.0), ("-0330", -12600.0)],
)
def test_a_zone_is_utc_in_any_case_or_an_offset(zone: str, offset: float) -> None:
    assert Naming(zone=zone).offset == offset


@pytest.mark.parametrize(
    ("zone", "words"),
    [
        ("europe/berlin", "Europe/Berlin is +01:00 in January and +02:00 in July"),
        ("Asia/Tokio", "write +09:00, the offset of Asia/Tokyo"),
        ("+15:00", "'+15:00' is neither UTC nor an offset from it"),
    ],
)
def test_a_zone_of_a_place_has_its_offsets_in_the_message(zone: str, words: str) -> None:
    with pytest.raises(ValueError, match=re.escape(words)):
        Naming(zone=zone)


def test_mistakes_of_clocks_name_files_as_the_config_does(tmp_path: Path) -> None:
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs" / "m.csv").write_text(table("time,x,y", dates(T, zone=""), *X))
    (tmp_path / "t.csv").write_text(table("time,x,y", BEGIN + T, *X))
    config(tmp_path, {"measurements": "logs/m.csv", "truth": "t.csv"})
    done = trackbench("check", "c.yaml", cwd=tmp_path)
    assert done.stderr.startswith("t.csv:1:1: scenario: its column time has UNIX times")
    assert (
        "that of logs/m.csv dates: which zone have the dates in time of logs/m.csv?" in done.stderr
    )
    config(tmp_path, {"measurements": "logs/m*.csv", "truth": "t.csv"})
    done = trackbench("check", f"{tmp_path.name}/c.yaml", cwd=tmp_path.parent)
    assert done.stderr.startswith(f"{tmp_path.name}/t.csv:1:1: scenario: ")
    assert f"that of {tmp_path.name}/logs/m.csv dates" in done.stderr


@pytest.mark.parametrize("zone", [{}, {"zone": "UTC"}])
def test_times_of_day_beside_dates_are_told_so(tmp_path: Path, zone: dict[str, str]) -> None:
    clock = [f"08{int(t) // 60:02}{t % 60:05.2f}" for t in T]
    dates = [f"2024-05-03T08:{int(t) // 60:02}:{t % 60:05.2f}Z" for t in T]
    (tmp_path / "m.csv").write_text(table("UTC,x,y", clock, *X))
    (tmp_path / "t.csv").write_text(table("time,px,py", dates, *X))
    target = {
        "measurements": "m.csv",
        "columns": {"time": "UTC"},
        "time_format": "%H%M%S.%f",
        "truth": "t.csv",
        "truth_naming": {},
        **zone,
    }
    with pytest.raises(UserError) as error:
        load(config(tmp_path, target))
    message = str(error.value).replace(f"{tmp_path}/", "")
    assert "that of m.csv times of day without a date: write the date before the times" in message
    assert "in column UTC of m.csv, or name its column, `columns: {date: NAME}`" in message
    # So written, the file is read.
    day = [f"2024-05-03 {cell}" for cell in clock]
    (tmp_path / "m.csv").write_text(table("UTC,x,y", day, *X))
    target |= {"time_format": "%Y-%m-%d %H%M%S.%f", "zone": "UTC"}
    truth = load(config(tmp_path, target)).points[0].scenario.target._recording.truth
    np.testing.assert_allclose(truth[0::2, :, 0], X, atol=1e-9)
