"""`trackbench new experiment --from`: what it makes of tables, and that what it writes runs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.commands import trackbench
from tests.conftest import EXPERIMENTS
from trackbench.config.load import load
from trackbench.scenarios.recordings.guess_table import recognized
from trackbench.scenarios.recordings.naming_of_columns import Naming
from trackbench.scenarios.recordings.new_config_filters import left_out_filters
from trackbench.scenarios.recordings.new_config_lines import config_parts
from trackbench.scenarios.recordings.recognize_column_names import columns_of

T = np.arange(0.0, 60.0, 0.5)
NOISE = np.random.default_rng(5).normal(size=(2, len(T)))
X, Y = 100.0 + 20.0 * T + 3.0 * NOISE[0], 50.0 - 10.0 * T + 3.0 * NOISE[1]
STAMPS = [f"2026-05-04T10:{int(t // 60):02}:{t % 60:06.3f}Z" for t in T]


def table(path: Path, names: str, *columns: object) -> Path:
    rows = [",".join(map(str, row)) for row in zip(*columns, strict=True)]  # type: ignore[call-overload]
    path.write_text("\n".join([names, *rows]) + "\n")
    return path


TABLES = {
    "metres": ("t,east_m,north_m", T, X, Y),
    "steps": ("step,px,py", range(len(T)), X, Y),
    "dates": ("Track ID,Time (UTC),x (km),y (km)", [4] * len(T), STAMPS, X / 1e3, Y / 1e3),
    "a radar": (
        "timestamp_ms,range,bearing",
        (1.7e12 + 1000 * T).astype(int),
        np.hypot(X + 9e3, Y),
        np.rad2deg(np.arctan2(Y, X + 9e3)) % 360.0,
    ),
}


@pytest.mark.parametrize("what", TABLES)
def test_what_it_writes_runs(tmp_path: Path, what: str) -> None:
    table(tmp_path / "My data.csv", *TABLES[what])
    made = trackbench("new", "experiment", "--from", "My data.csv", cwd=tmp_path)
    units = ""
    if what == "a radar":
        units = (
            "read range in m (no unit is named; the usual speed is 22 m/s); another unit: --set "
        )
        units += "units.range=UNIT\n"
        units += "read bearing in deg (there are angles beyond 2 pi); another unit: --set "
        units += "units.azimuth=UNIT\n"
        units += (
            "read bearing clockwise from north (from 0 to 360 deg, as of radars); from x to y: "
        )
        units += "--set 'clockwise=[]'\n"
    run = "run it: trackbench run my_data.yaml\n"
    assert made.stdout == f"wrote my_data.yaml\n{units}{run}", made.stderr
    done = trackbench("run", "my_data.yaml", "--workers", "1", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "results" / "my-data" / "figures" / "track.png").exists()
    again = trackbench("new", "experiment", "--from", "My data.csv", cwd=tmp_path)
    assert again.returncode == 2
    assert "there is a file my_data.yaml" in again.stderr


def test_its_numbers_are_near(tmp_path: Path) -> None:
    guess = recognized(str(table(tmp_path / "m.csv", *TABLES["dates"])))
    assert guess.naming.columns == {
        "time": "Time (UTC)",
        "run": "Track ID",
        "x": "x (km)",
        "y": "y (km)",
    }
    assert guess.naming.units == {"x": "km", "y": "km"}
    assert 2.0 <= guess.sensors[0].sigmas[0] <= 4.0
    assert guess.speed == 22.0  # 22.4 to two digits
    guess = recognized(str(table(tmp_path / "m.csv", *TABLES["a radar"])))
    assert (guess.naming.units["time"], guess.naming.units["azimuth"]) == ("ms", "deg")
    names, *columns = TABLES["a radar"]
    named = recognized(str(table(tmp_path / "m.csv", f"{names}_deg", *columns)))
    # An error of 3 m across a range of 9.5 km is 0.3 mrad.
    for sigma_range, sigma_azimuth in (guess.sensors[0].sigmas, named.sensors[0].sigmas):
        assert 2.0 <= sigma_range <= 4.0
        assert 2e-4 <= sigma_azimuth <= 4e-4


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("time_unix_ms", "ms"),
        ("time_unix", "s"),
        ("unix_ms", "ms"),
        ("timestamp_unix_ms", "ms"),
        ("t_unix", "ms"),
        ("unix time [ms]", "ms"),
        ("ms_since_epoch", "ms"),
        ("seconds_since_1970", "s"),
        ("time_posix_ns", "ns"),
        ("epochMillis", "ms"),
        ("stamp_epoch_us", "us"),
        ("gps_time_s", "s"),
        ("t_utc", "s"),
        ("utc_ms", "ms"),
        ("ts_ms", "ms"),
    ],
)
def test_names_of_unix_times_are_times(tmp_path: Path, name: str, unit: str) -> None:
    """Words of a clock and its unit stand in any order; without a unit the numbers show it."""
    number = np.rint((1.7e9 + T) * {"s": 1e1, "ms": 1e3, "us": 1e6, "ns": 1e9}[unit]).astype(int)
    times = number / 10 if unit == "s" else number
    path = table(tmp_path / "m.csv", f"{name},east_m,north_m", times, X, Y)
    naming = recognized(str(path)).naming
    assert naming.columns["time"] == name
    assert naming.units.get("time", "s") == unit


@pytest.mark.parametrize("name", ["gps_sats", "utc_offset", "gps_status", "time_std", "est"])
def test_other_words_beside_a_clock_are_no_time(name: str) -> None:
    assert "time" not in columns_of([name])


def test_columns_that_are_not_used_are_named(tmp_path: Path) -> None:
    azimuth = np.degrees(np.arctan2(Y, X + 9e3))
    columns = (T, np.hypot(X + 9e3, Y), azimuth, *[np.round(azimuth, 2)] * 2)
    table(tmp_path / "m.csv", "time,range,azimuth_deg,elevation,Sea state", *columns)
    option = ("--set", "clockwise=[]")
    done = trackbench("new", "experiment", "--from", "m.csv", *option, cwd=tmp_path)
    way = "to use one as run, sensor or received"
    line = f"columns not used: elevation, \"Sea state\" ({way}: --set 'columns.run=ITS NAME')"
    assert done.stdout.splitlines()[1] == line
    assert '      # not used: elevation, "Sea state"\n' in (tmp_path / "m.yaml").read_text()
    # Neither a speed nor a course is read alone.
    table(tmp_path / "p.csv", "t,x,y,a,b", T, X, Y, T, T)
    done = trackbench("new", "experiment", "--from", "p.csv", cwd=tmp_path)
    both = "--set 'columns.speed=ITS NAME' --set 'columns.course=ITS NAME'"
    way = "to use one as speed and course, which need each other, run, sensor or received"
    assert f"columns not used: a, b ({way}: {both})" in done.stdout
    # Of several sensors no velocity is read, though both columns are there; nor is one that disagrees.
    sensor = np.where(np.arange(len(T)) % 2, 1, 2)
    table(tmp_path / "s.csv", "t,sensor,x,y,speed,course", T, sensor, X, Y, np.ones(len(T)), T)
    done = trackbench("new", "experiment", "--from", "s.csv", cwd=tmp_path)
    assert "columns not used: speed, course (to use one as run or received: " in done.stdout
    course = 360.0 * np.random.default_rng(2).random(len(T))
    table(tmp_path / "d.csv", "t,x,y,speed,course", T, X, Y, np.ones(len(T)), course)
    done = trackbench("new", "experiment", "--from", "d.csv", cwd=tmp_path)
    # The note on the velocity names both columns, with the options by which they are read.
    assert "columns not used" not in done.stdout
    assert "--set 'columns.speed=speed' --set 'columns.course=course'" in done.stdout
    table(tmp_path / "e.csv", "t,x,y,speed [m/s],course [°],a", T, X, Y, np.ones(len(T)), course, T)
    done = trackbench("new", "experiment", "--from", "e.csv", cwd=tmp_path)
    assert "columns not used: a (to use it as run, sensor or received: " in done.stdout
    # Twelve names are counted on the screen, and written into the file.
    table(tmp_path / "n.csv", "t,x,y," + ",".join("abcdefghijkl"), T, X, Y, *[T] * 12)
    done = trackbench("new", "experiment", "--from", "n.csv", cwd=tmp_path)
    assert "not used: a, b, c, d, e, f, g, h, i and 3 more" in done.stdout
    assert "# not used: a, b, c, d, e, f, g, h, i, j, k, l\n" in (tmp_path / "n.yaml").read_text()


@pytest.mark.parametrize(
    ("names", "x", "y", "digit"),
    [
        # A degree of latitude is 111 km: the sixth decimal 0.11 m, a unit of 1e-7 deg 0.011 m.
        ("t;lon;lat", "8.{:06}", "47.{:06}", 0.11),
        ("t;lon;lat", "8{:07}", "47{:07}", 0.011),
        ("t;x;y", "5,0{}", "-7,1{}", 0.01),
        ("t;x [km];y [km]", "5.0{}", "7.1{}", 10.0),
    ],
)
def test_errors_are_not_smaller_than_the_last_digit(
    tmp_path: Path, names: str, x: str, y: str, digit: float
) -> None:
    # Every second row repeats the one before: each is half a digit from the line of its neighbors.
    rows = [f"{i};{x.format(i // 2)};{y.format(i // 2)}" for i in range(20)]
    (tmp_path / "m.csv").write_text("\n".join([names, *rows]) + "\n")
    # Such slow things are asked about, unless a unit is named.
    given = None
    if names == "t;x;y":
        given = Naming(units={"x": "m", "y": "m"})
    elif digit == 0.011:
        given = Naming(units={"latitude": "degE7", "longitude": "degE7"})
    assert recognized(str(tmp_path / "m.csv"), given).sensors[0].sigmas[1] == digit


def test_the_ferries(tmp_path: Path) -> None:
    data = EXPERIMENTS / "data" / "solent-ais.csv"
    made = trackbench("new", "experiment", "ferry", "--from", str(data), cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    scenario = load(tmp_path / "ferry.yaml").points[0].scenario
    assert scenario.target.runs == (235013375,)
    assert [sensor.kind for sensor in scenario.sensor] == ["position", "velocity"]
    assert len(scenario.steps) == 1138


def test_columns_of_a_truth_that_are_not_used_are_named(tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text("time,x,y\n0,1,2\n1,2,3\n2,3,4\n3,4,5\n")
    (tmp_path / "t.csv").write_text(
        "time,x,y,HDOP,fix q\n" + "".join(f"{k},1,2,3,4\n" for k in range(4))
    )
    words = ("new", "experiment", "--from", "m.csv", "--truth", "t.csv")
    done = trackbench(*words, cwd=tmp_path)
    assert 'columns of the truth not used: HDOP, "fix q"\n' in done.stdout


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        ("a,b\n0,1", "m.csv:1:1: no column looks like a time or a step; there are a, b"),
        (
            "time,b\n0,1",
            "m.csv:1:1: no columns look like x and y, latitude and longitude, range and",
        ),
        (
            "time,x,y",
            "m.csv:1:1: has no rows below the names time, x, y: is it the right file, and",
        ),
        ("time,x,y\n0,1,2", "m.csv:2:1: time is 0 in 1 row: a recording needs rows of two times: "),
        ("time,x,y\n5,1,2\n5,2,3", "m.csv:2:1: time is 5 in 2 rows: a recording needs rows of two"),
        ("time,x,y\n0,1\n1,2", "m.csv:2:1: 2 cells under 3 columns\nm.csv:3:1: 2 cells under 3"),
        ("time,x,y\n0,1,2\n1,2", "m.csv:3:1: 2 cells under 3 columns\n"),
        ("a,b", "m.csv:1:1: has no rows below the names a, b: is it the right file, and complete?"),
    ],
)
def test_a_table_of_which_nothing_can_be_made(tmp_path: Path, names: str, expected: str) -> None:
    (tmp_path / "m.csv").write_text(names + "\n")
    done = trackbench("new", "experiment", "--from", "m.csv", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith(expected), done.stderr
    assert "Traceback" not in done.stderr
    assert not list(tmp_path.glob("*.yaml"))


def test_numbers_that_overflow_print_no_warnings_of_numpy(tmp_path: Path) -> None:
    rows = [f"{k},{'-' if k == 3 else ''}1e308,{k}" for k in range(4)]
    (tmp_path / "m.csv").write_text("time,x,y\n" + "\n".join(rows) + "\n")
    done = trackbench("new", "experiment", "--from", "m.csv", cwd=tmp_path)
    assert done.returncode == 0
    assert done.stderr == ""


def test_only_experiments_are_made_from_data(tmp_path: Path) -> None:
    done = trackbench("new", "sensor", "x", "--from", "m.csv", cwd=tmp_path)
    assert done.returncode == 2
    assert "a sensor is not made from data" in done.stderr
    done = trackbench("new", "filter", cwd=tmp_path)
    assert done.returncode == 2
    assert "is required without --from" in done.stderr


def test_a_very_long_recording_leaves_out_the_particle_filter(tmp_path: Path) -> None:
    k = np.arange(20_010)
    guess = recognized(str(table(tmp_path / "long.csv", "time,x,y", k, 3 * k, k % 7)))
    assert "  # RPF: {kind: rpf, N: 1000}  # left out: " in config_parts(guess)["@FILTERS@"]
    (line,) = left_out_filters(guess)
    assert "RPF is a comment in the config" in line
    assert "20010 steps" in line
    shorter = replace(guess, steps=20_000)
    assert "\n  RPF: {kind: rpf, N: 1000}" in config_parts(shorter)["@FILTERS@"]
    assert not left_out_filters(shorter)
