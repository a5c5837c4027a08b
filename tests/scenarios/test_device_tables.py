"""Tables of devices with a known path: `new experiment --from` reads them right, or asks.

The target moves in the plane with a slowly changing course, from 47 N 8.5 E on unless a table says
otherwise. Its path, in meters and seconds, is compared with what the written config reads.
"""

import re
import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from tests.commands import trackbench
from tests.scenarios.test_clocks import config
from trackbench.config.load import load
from trackbench.errors import UserError
from trackbench.new_experiment_from_tables import write_config_for
from trackbench.scenarios.recordings.recognize_column_names import columns_of

Numbers = NDArray[np.float64]
EQUATOR, SQUARED_ECCENTRICITY = 6378137.0, 0.00669437999014
KNOT = 1852.0 / 3600.0
START = datetime(2024, 5, 3, 10, 0, 0)
MIDNIGHT = datetime(2024, 3, 8, 23, 59, 30)


@dataclass
class Path2:
    """A target's path: times, s, positions with noise, m and deg, speeds, m/s, and courses, deg."""

    rows: int = 60
    every: float = 1.0
    usual_speed: float = 12.0
    latitude: float = 47.0
    longitude: float = 8.5
    t: Numbers = field(init=False)
    place: Numbers = field(init=False)
    velocity: Numbers = field(init=False)

    def __post_init__(self) -> None:
        rng = np.random.default_rng(3)
        k = np.arange(self.rows)
        self.t = k * self.every
        course = 0.6 + 0.004 * k
        size = self.usual_speed * (1.0 + 0.1 * np.sin(k / 9.0))
        self.velocity = size * np.stack([np.sin(course), np.cos(course)])
        steps = 0.5 * (self.velocity[:, 1:] + self.velocity[:, :-1]) * self.every
        path = np.concatenate([np.zeros((2, 1)), np.cumsum(steps, axis=1)], axis=1)
        noise = min(2.0, 0.1 * self.usual_speed * self.every)
        self.place = path + noise * rng.normal(size=path.shape)

    @property
    def speed(self) -> Numbers:
        return np.hypot(*self.velocity)

    @property
    def course(self) -> Numbers:
        return np.degrees(np.arctan2(self.velocity[0], self.velocity[1])) % 360.0

    @property
    def degrees(self) -> Numbers:
        """Longitude and latitude, by the radii of curvature at the first position."""
        phi = np.radians(self.latitude)
        w = 1.0 - SQUARED_ECCENTRICITY * np.sin(phi) ** 2
        meridian = EQUATOR * (1.0 - SQUARED_ECCENTRICITY) / w**1.5
        normal = EQUATOR / np.sqrt(w)
        longitude = self.longitude + np.degrees(self.place[0] / (normal * np.cos(phi)))
        return np.stack([longitude, self.latitude + np.degrees(self.place[1] / meridian)])

    def dates(self, form: str, start: datetime = START, cut: int | None = None) -> list[str]:
        moments = (start + timedelta(seconds=float(t)) for t in self.t)
        return [moment.strftime(form)[:cut] for moment in moments]


def whole(values: Numbers) -> list[str]:
    return [str(round(value)) for value in values.tolist()]


def decimal(values: Numbers, digits: int) -> list[str]:
    return [f"{value:.{digits}f}" for value in values.tolist()]


def table(names: str, *columns: Sequence[object], separator: str = ",") -> str:
    rows = (separator.join(map(str, row)) for row in zip(*columns, strict=True))
    return "\n".join([names, *rows]) + "\n"


def lonlat(path: Path2, digits: int = 7) -> tuple[list[str], list[str]]:
    longitude, latitude = path.degrees
    return decimal(longitude, digits), decimal(latitude, digits)


def xy(path: Path2, digits: int = 2) -> tuple[list[str], list[str]]:
    return decimal(path.place[0], digits), decimal(path.place[1], digits)


def fit(p: Path2) -> str:
    lon, lat = (whole(part * 2.0**31 / 180.0) for part in p.degrees)
    names = "timestamp,position_lat,position_long,enhanced_speed"
    return table(names, p.dates("%Y-%m-%d %H:%M:%S"), lat, lon, decimal(p.speed, 3))


def microdegrees(p: Path2) -> str:
    lon, lat = (whole(part * 1e6) for part in p.degrees)
    return table("time,lat,lon,speed_kmh", whole(1.7e9 + p.t), lat, lon, decimal(3.6 * p.speed, 1))


def radians(p: Path2) -> str:
    lon, lat = (decimal(np.radians(part), 10) for part in p.degrees)
    motion = decimal(p.speed, 2), decimal(p.course, 1)
    return table("t,lat,lon,vel,heading", decimal(p.t, 1), lat, lon, *motion)


def raw_ais(p: Path2) -> str:
    lon, lat = (whole(part * 600000.0) for part in p.degrees)
    speed, course = whole(10.0 * p.speed / KNOT), whole(10.0 * p.course)
    speed[7], course[7] = "1023", "3600"
    return table(
        "timestamp,mmsi,lon,lat,sog,cog",
        *(whole(1714730400 + p.t), [211000001] * p.rows, lon, lat, speed, course),
    )


def decoded_ais(p: Path2) -> str:
    speed, course = decimal(p.speed / KNOT, 1), decimal(p.course, 1)
    return table(
        "time,mmsi,x,y,sog,cog", whole(1.7e9 + p.t), [1] * p.rows, *lonlat(p, 6), speed, course
    )


def ubx(p: Path2) -> str:
    lon, lat = (whole(part * 1e7) for part in p.degrees)
    motion = whole(1e3 * p.speed), whole(1e5 * p.course)
    return table("iTOW,lon,lat,gSpeed,headMot", whole(381600000 + 1e3 * p.t), lon, lat, *motion)


def mavlink(p: Path2) -> str:
    lon, lat = (whole(part * 1e7) for part in p.degrees)
    motion = whole(100.0 * p.speed), whole(100.0 * p.course)
    return table("time_usec,lat,lon,vel,cog", whole(5.2e7 + 1e6 * p.t), lat, lon, *motion)


def speed_over_ground(unit: float) -> Callable[[Path2], str]:
    def written(p: Path2) -> str:
        lon, lat = lonlat(p)
        motion = decimal(p.speed / unit, 3), decimal(p.course, 1)
        return table("time,latitude,longitude,sog,cog", whole(p.t), lat, lon, *motion)

    return written


def millimeters(p: Path2) -> str:
    x, y = (whole(1e3 * part) for part in p.place)
    return table(
        "t,x,y,speed,heading_deg", decimal(p.t, 2), x, y, decimal(p.speed, 3), decimal(p.course, 1)
    )


def clocked(name: str, cells: Callable[[Path2], Sequence[object]]) -> Callable[[Path2], str]:
    """Return a table of x and y whose times are written so."""
    return lambda p: table(f"{name},x,y", cells(p), *xy(p))


def minutes(p: Path2) -> list[str]:
    return [f"{int(t // 60):02}:{int(t % 60):02}" for t in p.t]


def go_time(p: Path2) -> list[str]:
    dates = p.dates("%Y-%m-%d %H:%M:%S")
    return [f"{date}.12345678{k % 10} +0000 UTC" for k, date in enumerate(dates)]


def day_of_year(form: str, names: str = "time") -> Callable[[Path2], str]:
    """Return a table whose times pass midnight."""
    return lambda p: table(f"{names},x,y", p.dates(form, MIDNIGHT), *xy(p))


def nmea(form: str) -> Callable[[Path2], str]:
    def written(p: Path2) -> str:
        lon, lat = lonlat(p)
        clock = p.dates(form, MIDNIGHT), p.dates("%H%M%S", MIDNIGHT)
        return table("date,time,latitude,longitude", *clock, lat, lon)

    return written


def two_parts(names: str, unit: float) -> Callable[[Path2], str]:
    """Return a table whose stamp is in two columns, whole seconds and the rest in a unit."""

    def written(p: Path2) -> str:
        # Exact multiples of a millisecond: 0.237 s, 0.337 s, ...
        milliseconds = np.rint(1e3 * p.t) + 237.0
        seconds = whole(1714730400 + milliseconds // 1000.0)
        rest = whole((milliseconds % 1000.0) * 1e-3 / unit)
        return table(f"{names},x,y", seconds, rest, *xy(p, 4))

    return written


def week(p: Path2) -> str:
    seconds = 604770.0 + p.t
    lon, lat = lonlat(p, 9)
    clock = whole(2310 + seconds // 604800.0), decimal(seconds % 604800.0, 3)
    return table("week,tow,lat,lon", *clock, lat, lon)


def rtklib(p: Path2) -> str:
    names = "%  GPST          latitude(deg) longitude(deg)  height(m)   Q"
    seconds = 604770.0 + p.t
    lon, lat = lonlat(p, 9)
    clock = whole(2310 + seconds // 604800.0), decimal(seconds % 604800.0, 3)
    rest = ["50.0"] * p.rows, [1] * p.rows
    return "% program : RTKPOST\n" + table(names, *clock, lat, lon, *rest, separator="  ")


def thousands(p: Path2) -> str:
    columns = []
    for offset, part in zip((3512000.0, 5401000.0), p.place, strict=True):
        cells = (f"{offset + value:,.2f}" for value in part.tolist())
        columns.append([cell.translate(str.maketrans(",.", ".,")) for cell in cells])
    return table("Zeit;Rechtswert;Hochwert", whole(p.t), *columns, separator=";")


def no_fix(p: Path2) -> str:
    lon, lat = lonlat(p)
    zeros = ["0.0000000"] * 6
    speed, course = decimal(p.speed, 2), decimal(p.course, 1)
    return table(
        "time,latitude,longitude,speed,course",
        *(whole(np.arange(p.rows + 6.0)), zeros + lat, zeros + lon),
        *(["0.00"] * 6 + speed, ["0.0"] * 6 + course),
    )


def trackmate(p: Path2) -> str:
    names = "LABEL,TRACK_ID,POSITION_X,POSITION_Y,POSITION_T"
    words = "Label,Track ID,X,Y,T\n" * 2 + ",,(micron),(micron),(sec)\n"
    labels = [f"ID{k}" for k in range(p.rows)]
    x, y = (decimal(1e6 * part, 2) for part in p.place)
    first, rest = table(names, labels, [0] * p.rows, x, y, decimal(p.t, 1)).split("\n", 1)
    return f"{first}\n{words}{rest}"


def kinds(p: Path2) -> str:
    rows = []
    for k, (x, y) in enumerate(p.place.T.tolist()):
        rows.append(
            f"R\t{x:.3f}\t{y:.3f}\t1.0\t{k}\t0" if k % 2 else f"L\t{x:.3f}\t{y:.3f}\t{k}\t0"
        )
    return "\n".join(rows) + "\n"


def days(p: Path2) -> str:
    lon, lat = lonlat(p)
    return table("time,lat,lon", decimal(45415.4166666667 + p.t / 86400.0, 9), lat, lon)


def nmea_degrees(p: Path2) -> str:
    lon, lat = (
        [f"{int(value)}{60.0 * (value % 1.0):07.4f}" for value in part.tolist()]
        for part in p.degrees
    )
    return table("time,lat,lon", whole(p.t), lat, lon)


DRIFTER, ROBOT = Path2(usual_speed=0.15, every=600.0), Path2(usual_speed=1.2, every=0.1)
SHIP = Path2(usual_speed=6.0, every=10.0, latitude=37.8, longitude=-122.4)
WALK = Path2(usual_speed=4.0, every=3.0)
SLOW_WALK = Path2(usual_speed=4.0, every=30.0, rows=200)
FAST = Path2(usual_speed=115.0)
CAR, ODOMETRY = Path2(), Path2(usual_speed=6.0, every=0.1)
MINUTES = Path2(usual_speed=2.0, every=60.0)

RIGHT: dict[str, tuple[Path2, Callable[[Path2], str]]] = {
    "semicircles": (Path2(usual_speed=3.6), fit),
    "microdegrees": (Path2(usual_speed=9.0, latitude=51.2, longitude=-0.2), microdegrees),
    "radians": (Path2(usual_speed=25.0), radians),
    "raw AIS": (SHIP, raw_ais),
    "decoded AIS": (SHIP, decoded_ais),
    "u-blox": (FAST, ubx),
    "MAVLink": (CAR, mavlink),
    "speed over ground in m/s": (CAR, speed_over_ground(1.0)),
    "speed over ground in knots": (CAR, speed_over_ground(KNOT)),
    "speed over ground in km/h": (CAR, speed_over_ground(1.0 / 3.6)),
    "millimeters": (ROBOT, millimeters),
    "days of a spreadsheet": (DRIFTER, days),
    "fast milliseconds": (FAST, clocked("time", lambda p: whole(1e3 * p.t))),
    "microseconds": (ODOMETRY, clocked("timestamp", lambda p: whole(5234100 + 1e6 * p.t))),
    "milliseconds since 1970": (CAR, clocked("t", lambda p: whole(1.7e12 + 1e3 * p.t))),
    "Windows file times": (
        CAR,
        clocked("FileTime", lambda p: [133591824 * 10**9 + round(1e7 * t) for t in p.t]),
    ),
    "hours": (CAR, clocked("hours", lambda p: decimal(10.5 + p.t / 3600.0, 6))),
    "seconds of a drifter": (DRIFTER, clocked("time", lambda p: whole(p.t))),
    "minutes and seconds": (WALK, clocked("elapsed", minutes)),
    "more than 59 minutes": (SLOW_WALK, clocked("elapsed", minutes)),
    "hours and minutes": (MINUTES, clocked("time", lambda p: p.dates("%H:%M"))),
    "14 digits": (CAR, clocked("time", lambda p: p.dates("%Y%m%d%H%M%S"))),
    "17 digits": (ODOMETRY, clocked("time", lambda p: p.dates("%Y%m%d%H%M%S%f", cut=17))),
    "12 digits": (MINUTES, clocked("time", lambda p: p.dates("%Y%m%d%H%M"))),
    "12 digits with seconds": (WALK, clocked("time", lambda p: p.dates("%y%m%d%H%M%S"))),
    "Go": (SHIP, clocked("time_utc", go_time)),
    "Go, summer time": (
        WALK,
        clocked("t", lambda p: [f"{d} +0200 CEST" for d in p.dates("%Y-%m-%d %H:%M:%S")]),
    ),
    "words of days": (CAR, clocked("time", lambda p: p.dates("%a %b %d %H:%M:%S %Y"))),
    "NMEA's date over midnight": (CAR, nmea("%d%m%y")),
    "days of the year in ISO 8601": (CAR, day_of_year("%Y-%jT%H:%M:%S.25Z")),
    "days of the year in ISO 8601 without separators": (CAR, day_of_year("%Y%jT%H%M%S")),
    "days of the year before a space": (CAR, day_of_year("%Y%j %H%M%S")),
    "days of the year in one number": (CAR, day_of_year("%Y%j%H%M%S")),
    "days of the year, of two digits, in one number": (CAR, day_of_year("%y%j%H%M%S")),
    "days of the year of a spacecraft": (CAR, day_of_year("%Y:%j:%H:%M:%S.000")),
    "days of the year without a year": (CAR, day_of_year("%j/%H:%M:%S")),
    "days of the year in a column of dates": (CAR, day_of_year("%Y%j,%H:%M:%S", "date,time")),
    "days of the year beside digits": (CAR, day_of_year("%Y-%j,%H%M%S", "date,time")),
    "a year of two digits first": (CAR, nmea("%y%m%d")),
    "ROS 2": (ODOMETRY, two_parts("header.stamp.sec,header.stamp.nanosec", 1e-9)),
    "ROS 1": (ODOMETRY, two_parts("field.header.stamp.secs,field.header.stamp.nsecs", 1e-9)),
    "timeval": (ODOMETRY, two_parts("tv_sec,tv_usec", 1e-6)),
    "weeks of GPS": (Path2(usual_speed=3.0), week),
    "RTKLIB": (Path2(usual_speed=3.0), rtklib),
    "points of thousands": (CAR, thousands),
    "no fix": (CAR, no_fix),
    "TrackMate": (WALK, trackmate),
}
WITH_VELOCITY = {
    *("radians", "raw AIS", "decoded AIS", "u-blox", "MAVLink", "millimeters", "no fix"),
    *("speed over ground in m/s", "speed over ground in knots", "speed over ground in km/h"),
}
ASKED: dict[str, tuple[Path2, Callable[[Path2], str], list[str]]] = {
    "microdegrees alone": (
        Path2(usual_speed=9.0, latitude=51.2, longitude=-0.2),
        lambda p: "".join(line.rpartition(",")[0] + "\n" for line in microdegrees(p).splitlines()),
        ["--set units.latitude=degE6 --set units.longitude=degE6", "units.latitude=degE7"],
    ),
    "3000 in s or ms": (
        Path2(usual_speed=90.0, every=3.0),
        lambda p: table("t,lat,lon", whole(1e3 * p.t), *lonlat(p)[::-1]),
        ["--set 'units.time=ms'", "--set 'units.time=s'"],
    ),
    "minutes or hours": (
        WALK,
        clocked("time", minutes),
        ["""--set 'time_format="%M:%S"'""", """--set 'time_format="%H:%M"'"""],
    ),
    "degrees and minutes in one number": (CAR, nmea_degrees, ["46 deg 59.9", "as NMEA writes it"]),
    "rows of two kinds": (
        CAR,
        kinds,
        ["has rows of 2 kinds: L (5 cells), R (6 cells)", "grep '^L"],
    ),
}


def guessed(folder: Path, text: str, *changes: str) -> Any:
    """Return the scenario of the config that is written for a table, and its YAML."""
    (folder / "m.csv").write_text(text)
    config = write_config_for(folder / "m.csv", "g", folder, changes).paths[0]
    return load(config).points[0].scenario, yaml.safe_load(config.read_text())["scenario"]


def check_path(scenario: Any, path: Path2) -> None:
    recording = scenario.target._recording
    z = np.concatenate([recording.scans, recording.measurements], axis=1)[:2, :, 0]
    times = scenario.times[-z.shape[1] :]
    np.testing.assert_allclose(times - times[0], path.t, atol=2e-3 * path.every)
    # The radii of curvature serve for a few kilometers; digits are those of the table.
    way = np.hypot(*(path.place[:, -1] - path.place[:, 0]))
    expected = path.place - path.place[:, :1]
    np.testing.assert_allclose(z - z[:, :1], expected, atol=0.2 + 3e-3 * way if way > 100 else 0.05)


@pytest.mark.parametrize("what", RIGHT)
def test_a_table_is_read_right(tmp_path: Path, what: str) -> None:
    path, write = RIGHT[what]
    scenario, config = guessed(tmp_path, write(path))
    check_path(scenario, path)
    sensors = [sensor["kind"] for sensor in config["sensor"]]
    assert sensors == (["position", "velocity"] if what in WITH_VELOCITY else ["position"])
    if what in WITH_VELOCITY:
        measured = scenario.target._recording.measurements[2:, :, 0]
        there = np.isfinite(measured).all(axis=0)
        away = np.hypot(*(measured - path.velocity[:, 1:]))[there]
        assert away.max() <= 0.02 * path.usual_speed + 0.1
        assert there.sum() >= path.rows - 2


@pytest.mark.parametrize("what", ASKED)
def test_a_table_that_may_be_read_in_two_ways_is_asked_about(tmp_path: Path, what: str) -> None:
    path, write, expected = ASKED[what]
    with pytest.raises(UserError) as error:
        guessed(tmp_path, write(path))
    lines = str(error.value).splitlines()
    # Whole numbers of degrees may be in five units.
    assert len(lines) <= (5 if what == "microdegrees alone" else 2)
    assert all(words in str(error.value) for words in expected), str(error.value)
    assert not (tmp_path / "g.yaml").exists()
    # Each line names options that can be pasted, and then the table is read.
    option = 'time_format="%M:%S"' if what == "minutes or hours" else ""
    option = "units.time=ms" if "ms" in what else option
    if option:
        scenario, _ = guessed(tmp_path, write(path), option)
        check_path(scenario, path)


def kalman(path: Path2, sigma: float, sigma_velocity: float, q: float) -> tuple[float, float]:
    """Return ANIS and mean log score of a Kalman filter of white acceleration, axis by axis."""
    squared, log_scores = [], []
    states = [np.array([z, 0.0]) for z in path.place[:, 0]]
    covariance = np.diag([sigma**2, sigma_velocity**2])
    for k in range(1, path.rows):
        T = path.t[k] - path.t[k - 1]
        transition = np.array([[1.0, T], [0.0, 1.0]])
        noise = q * np.array([[T**3 / 3.0, T**2 / 2.0], [T**2 / 2.0, T]])
        covariance = transition @ covariance @ transition.T + noise
        variance = covariance[0, 0] + sigma**2
        gain = covariance[:, 0] / variance
        distance = 0.0
        for axis in range(2):
            predicted = transition @ states[axis]
            innovation = path.place[axis, k] - predicted[0]
            distance += innovation**2 / variance
            states[axis] = predicted + gain * innovation
        covariance = covariance - np.outer(gain, covariance[0])
        squared.append(0.5 * distance)
        log_scores.append(-0.5 * distance - np.log(2.0 * np.pi * variance))
    return float(np.mean(squared)), float(np.mean(log_scores))


@pytest.mark.parametrize("what", ["semicircles", "ROS 2", "RTKLIB", "Go", "14 digits"])
def test_filters_score_as_another_program_says(tmp_path: Path, what: str) -> None:
    path, write = RIGHT[what]
    sigma = min(2.0, 0.1 * path.usual_speed * path.every)
    _, scenario = guessed(tmp_path, write(path))
    scenario["sensor"] = {"kind": "position", "sigma": sigma}
    scenario["start"] = {"kind": "one-scan", "sigma_velocity": 20}
    scenario["assume"] = {"motion": {"kind": "cwna", "q": 0.2}}
    columns = {"ANIS": "mean(anis)", "Log": "mean(log_score)"}
    tables = {"t": {"kind": "metrics", "columns": columns}}
    whole_config = {
        "name": "own",
        "seed": 1,
        "scenario": scenario,
        "filters": {"KF": {"kind": "kf"}},
    }
    (tmp_path / "own.yaml").write_text(yaml.safe_dump(whole_config | {"tables": tables}))
    done = trackbench("run", "own.yaml", "--workers", "1", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    _, row = (tmp_path / "results" / "own" / "tables" / "t.csv").read_text().splitlines()[:2]
    cells = row.split(",")
    anis, log_score = kalman(path, sigma, 20.0, 0.2)
    # Latitudes and longitudes have seven digits, 0.01 m; the plane bends by less.
    assert float(cells[1]) == pytest.approx(anis, rel=0.02)
    assert float(cells[3]) == pytest.approx(log_score, abs=0.02)


def test_rows_without_a_fix_are_left_out_of_any_config(tmp_path: Path) -> None:
    path = Path2()
    (tmp_path / "m.csv").write_text(no_fix(path))
    scenario: Any = load(config(tmp_path, {"measurements": "m.csv"})).points[0].scenario
    check_path(scenario, path)
    (note,) = scenario.cautions
    assert "6 rows with latitude = longitude = 0 have no fix and were left out" in note
    # A path through the point is none of these.
    near = Path2(latitude=0.0, longitude=0.0)
    (tmp_path / "m.csv").write_text(
        table("time,latitude,longitude", whole(near.t), *lonlat(near)[::-1])
    )
    lines = (tmp_path / "m.csv").read_text().splitlines()
    lines[1] = "0,0,0"
    (tmp_path / "m.csv").write_text("\n".join(lines) + "\n")
    scenario = load(config(tmp_path, {"measurements": "m.csv"})).points[0].scenario
    assert len(scenario.steps) == near.rows


def test_courses_that_are_missing_at_standstill(tmp_path: Path) -> None:
    path = Path2(rows=80, usual_speed=8.0)
    lon, lat = lonlat(path)
    course: list[str] = decimal(path.course, 1)
    course[30:50] = [""] * 20
    names = "time,latitude,longitude,speed,course"
    text = table(names, whole(path.t), lat, lon, decimal(path.speed, 2), course)
    scenario, written = guessed(tmp_path, text)
    assert written["sensor"][1] == {"kind": "velocity", "sigma": 0.42}
    assert written["start"]["sigma_velocity"] == 16.6
    measured = scenario.target._recording.measurements[2:, :, 0]
    assert np.isnan(measured).all(axis=0).sum() == 20


def test_a_recording_is_longer_than_a_scenario_may_be(tmp_path: Path) -> None:
    rows = (f"{k / 100:.2f},{k / 100:.3f},{k / 200:.3f}" for k in range(100_002))
    text = "\n".join(["time,x,y", *rows]) + "\n"
    scenario, written = guessed(tmp_path, text)
    assert written["last"] == 20_000
    assert len(scenario.steps) == 20_001
    path = config(tmp_path, {"measurements": "m.csv"})
    with pytest.raises(UserError, match="gives 100002 steps, more than 100000: say `last: 99999`"):
        load(path)
    path.write_text(path.read_text().replace("kind: tracking", "kind: tracking\n  last: 50000"))
    assert len(load(path).points[0].scenario.steps) == 50_001


NEXT_LINES = ("\x85", "\u2028", "\u2029")


@pytest.mark.parametrize("line", NEXT_LINES)
def test_names_of_a_table_write_no_key(tmp_path: Path, line: str) -> None:
    path = Path2(rows=20)
    evil = f"{line}plugins: [evil.py] #"
    runs = [f"A{k % 2}{evil}" for k in range(path.rows)]
    name = f"m{evil}.csv"
    names = f"run,time,x,y,@FILTERS@,@SENSOR@{evil}"
    text = table(names, runs, whole(path.t), *xy(path), whole(path.t), whole(path.t))
    (tmp_path / name).write_text(text, newline="")
    (written,) = write_config_for(tmp_path / name, "g", tmp_path).paths
    content = yaml.safe_load(written.read_text())
    assert "plugins" not in content
    assert content["scenario"]["target"]["runs"] == [f"A0{evil}"]
    assert not set(written.read_text()) & set(NEXT_LINES)
    assert '# not used: "@FILTERS@", "@SENSOR@' in written.read_text()
    assert load(written).plugins == ()


def test_a_config_that_would_not_run_is_not_written(tmp_path: Path) -> None:
    path = Path2(rows=20)
    runs = [f"A{k % 2}\x1b[31m" for k in range(path.rows)]
    (tmp_path / "m.csv").write_text(table("run,time,x,y", runs, whole(path.t), *xy(path)))
    with pytest.raises(UserError, match=r"a config for it would not run: .*holds the char"):
        write_config_for(tmp_path / "m.csv", "g", tmp_path)
    assert not (tmp_path / "g.yaml").exists()


@pytest.mark.parametrize(
    ("text", "columns", "expected"),
    [
        (
            two_parts("sec,nanosec", 1e-9)(ODOMETRY),
            {"time": "sec"},
            r"nanosec may hold the rest of the time: say `columns: \{subsecond: nanosec\}`; or say",
        ),
        (
            week(Path2(usual_speed=3.0)),
            {"time": "tow", "latitude": "lat", "longitude": "lon"},
            r"time falls by 604799 s.*week may hold the rest.*`columns: \{week: week\}`",
        ),
        (
            RIGHT["14 digits"][1](CAR),
            {},
            r'no time, nor are 59 more; it looks like a date, say `time_format: "%Y%m%d%H%M%S"`$',
        ),
        (
            table("time,x,y", ["0", "1"], ["1", "2"], ["2", "3"]),
            {"subsecond": "y"},
            r"y: 2e-09|column y is both",
        ),
    ],
)
def test_configs_by_hand_hear_of_the_other_half(
    tmp_path: Path, text: str, columns: dict[str, str], expected: str
) -> None:
    (tmp_path / "m.csv").write_text(text)
    with pytest.raises(UserError, match=expected):
        load(config(tmp_path, {"measurements": "m.csv", "columns": columns}))


def test_a_spread_time_beside_its_nanoseconds_is_noted(tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text(two_parts("sec,nanosec", 1e-9)(ODOMETRY))
    target = {"measurements": "m.csv", "columns": {"time": "sec"}, "same_time": "spread"}
    cautions = load(config(tmp_path, target)).points[0].scenario.cautions
    assert any("the column nanosec may hold the rest of the time" in note for note in cautions)


def test_numbers_that_other_columns_measure_are_no_missing_cells(tmp_path: Path) -> None:
    path = Path2(rows=40)
    x, y = (decimal(1e5 + part, 2) for part in path.place)
    x[7] = y[7] = "0"
    speeds = ["0" if k < 9 else "12" for k in range(path.rows)]
    what = r"m\.csv:9:1: 1 row with x and y = 0 lies far from .*: empty these cells if nothing was"
    with pytest.raises(UserError, match=what):
        guessed(tmp_path, table("time,x,y,speed", whole(path.t), x, y, speeds))
    columns = {"x": "x", "y": "y", "vx": "speed", "vy": "x2"}
    text = table("time,x,y,speed,x2", whole(path.t), x, y, speeds, speeds)
    (tmp_path / "m.csv").write_text(text)
    sensors = [{"kind": "position", "sigma": 2}, {"kind": "velocity", "sigma": 1}]
    target = {"measurements": "m.csv", "columns": columns}
    cautions = load(config(tmp_path, target, sensor=sensors)).points[0].scenario.cautions
    assert any("(`missing: [0]` would also empty cells of speed)" in note for note in cautions)


@pytest.mark.parametrize("unit", ["um", "µm", "μm", "micron", "microns", "micrometers"])
def test_micrometers_have_many_names(unit: str) -> None:
    named = columns_of(["t (s)", f"x ({unit})", f"y_{unit}", f"vx [{unit}/s]"])
    assert [named[name].unit for name in ("x", "y", "vx")] == ["um", "um", "um/s"]


def test_zeros_of_one_quantity_are_missing_and_those_of_another_are_not(tmp_path: Path) -> None:
    """A latitude of 0 stands for no fix, beside a speed that is 0 at a stop."""
    rows = no_fix(CAR).splitlines()
    # The longitude is kept, so that no row is one of latitude = longitude = 0.
    longitude = rows[7].split(",")[2]
    rows[1:7] = [
        row.replace(",0.0000000,0.0000000,", f",0.0000000,{longitude},") for row in rows[1:7]
    ]
    stop = rows[20].split(",")
    rows[20] = ",".join([*stop[:3], "0.00", stop[4]])
    text = "\n".join(rows) + "\n"
    option = re.escape("--set 'missing.latitude=[0]'")
    with pytest.raises(UserError, match=f"if 0 stands for no fix, say {option}"):
        guessed(tmp_path, text)
    scenario, keys = guessed(tmp_path, text, "missing.latitude=[0]")
    assert keys["target"]["missing"] == {"latitude": [0]}
    (note,) = [note for note in scenario.cautions if "not available" in note]
    assert note.startswith("6 cells")
    assert note.endswith("latitude 0 (6)")


@pytest.mark.parametrize("first", [datetime(2024, 5, 3, 10), datetime(2024, 5, 9, 23, 59, 30)])
@pytest.mark.parametrize("form", ["%d%m%y", "%m%d%y", "%d%m%Y"])
@pytest.mark.parametrize("clock", ["%H%M%S", "%H:%M:%S"])
def test_days_in_one_number_may_lack_a_zero(
    tmp_path: Path, first: datetime, form: str, clock: str
) -> None:
    """A spreadsheet writes 30524 for 030524, of which strptime would make the 30th of May."""
    path = Path2(rows=60)
    days = [day.lstrip("0") for day in path.dates(form, first)]
    clocks = [cell if ":" in clock else str(int(cell)) for cell in path.dates(clock, first)]
    scenario, written = guessed(tmp_path, table("date,time,x,y", days, clocks, *xy(path)))
    check_path(scenario, path)
    assert written["target"]["columns"]["date"] == "date"


def test_a_day_that_lacks_a_zero_is_read_by_a_format_by_hand(tmp_path: Path) -> None:
    path = Path2(rows=60)
    days = [day.lstrip("0") for day in path.dates("%d%m%y", datetime(2024, 5, 3, 23, 59, 30))]
    clocks = path.dates("%H:%M:%S", datetime(2024, 5, 3, 23, 59, 30))
    (tmp_path / "m.csv").write_text(table("date,time,x,y", days, clocks, *xy(path)))
    target = {"measurements": "m.csv", "time_format": "%d%m%y %H:%M:%S"}
    check_path(load(config(tmp_path, target)).points[0].scenario, path)


@pytest.mark.parametrize("word", ["---", "****", "–", "<NA>", "-nan(ind)", "1.#QNAN", "?"])
def test_words_of_programs_are_missing_cells(tmp_path: Path, word: str) -> None:
    path = Path2(rows=60)
    x, y = xy(path)
    x[20] = y[20] = x[40] = word
    scenario, _ = guessed(tmp_path, table("time,x,y", whole(path.t), x, y))
    z = scenario.target._recording.measurements[:, :, 0]
    assert np.isnan(z).any(axis=0).sum() == 2


@pytest.mark.parametrize(
    ("cell", "way"),
    [
        (
            "NO FIX",
            "'NO FIX' is not a number: correct it, or empty the cell if nothing was measured",
        ),
        ("overflow", "or empty the cell if nothing was measured"),
        ("1,234,567", 'say `format: {thousands: ","}` if this mark separates thousands'),
    ],
)
def test_text_in_place_of_a_number_has_a_way_on(tmp_path: Path, cell: str, way: str) -> None:
    path = Path2(rows=60)
    x, y = xy(path)
    x[20] = f'"{cell}"'
    (tmp_path / "m.csv").write_text(table("time,x,y", whole(path.t), x, y))
    written = config(tmp_path, {"measurements": "m.csv"})
    with pytest.raises(UserError) as error:
        load(written)
    assert f"m.csv:22:1: scenario: x: {cell!r} is not a number" in str(error.value)
    assert way in str(error.value)


def test_speeds_and_courses_without_numbers_raise_no_question(tmp_path: Path) -> None:
    path = Path2(rows=60)
    names = "time,latitude,longitude,speed,course"
    text = table(names, whole(path.t), *lonlat(path)[::-1], [""] * 60, [""] * 60)
    scenario, written = guessed(tmp_path, text)
    check_path(scenario, path)
    assert [sensor["kind"] for sensor in written["sensor"]] == ["position"]


@pytest.mark.parametrize("usual_speed", [1.4, 12.0, 200.0])
def test_a_year_with_decimals_is_a_question(tmp_path: Path, usual_speed: float) -> None:
    path = Path2(rows=60, usual_speed=usual_speed)
    years = [f"{2024.337 + t / 86400.0 / 366.0:.10f}" for t in path.t]
    with pytest.raises(
        UserError, match=r"is 2024.3370000000 a year with decimals\? Then write dates"
    ):
        guessed(tmp_path, table("time,x,y", years, *xy(path)))
    # The year 2024 is a time in seconds, too.
    check_path(
        guessed(tmp_path, table("time,x,y", decimal(2000.0 + path.t, 6), *xy(path)))[0], path
    )


@pytest.mark.parametrize("name", ["time_cs", "t_ticks", "time [hundredths]"])
def test_an_unknown_unit_of_times_is_an_error(tmp_path: Path, name: str) -> None:
    path = Path2(rows=60)
    with pytest.raises(UserError, match=r"the unit \w+ is unknown here: .* --set units.time=s"):
        guessed(
            tmp_path, table(f"{name},x,y", whole(100.0 * path.t), *xy(path)), f"columns.time={name}"
        )


@pytest.mark.parametrize("names", ["lat1,lon1,lat2,lon2", "gps1_lat,gps1_lon,gps2_lat,gps2_lon"])
def test_the_advice_on_latitudes_names_them_so(tmp_path: Path, names: str) -> None:
    path = Path2(rows=60)
    latitude, longitude, *_ = names.split(",")
    places = lonlat(path)[::-1]
    with pytest.raises(UserError) as error:
        guessed(tmp_path, table(f"time,{names}", whole(path.t), *places, *places))
    options = f"columns.latitude={latitude}", f"columns.longitude={longitude}"
    assert all(f"--set '{option}'" in str(error.value) for option in options)
    scenario, _ = guessed(
        tmp_path, table(f"time,{names}", whole(path.t), *places, *places), *options
    )
    check_path(scenario, path)


def test_the_gps_week_of_a_receiver_has_several_names(tmp_path: Path) -> None:
    path = Path2(rows=60)
    seconds = 604770.0 + path.t
    weeks = 2312 + seconds // 604800.0
    for name in ("WNc", "gps_week_num", "WN"):
        text = table(f"TOW,{name},x,y", whole(seconds % 604800.0), whole(weeks), *xy(path))
        check_path(guessed(tmp_path, text)[0], path)
        (tmp_path / "g.yaml").unlink()


@pytest.mark.parametrize(
    "name",
    ["Länge", "Широта", "α/β", "it's", 'x "raw"', "a\\b", "[x]", "{y}", "1.5", "c #d", "a: b"],
)
def test_advice_with_a_name_of_a_column_can_be_pasted(tmp_path: Path, name: str) -> None:
    """Names have letters of any language, quotation marks, and what YAML and the shell would change."""
    path = Path2(rows=60)
    names = [f'"{part}"' for part in (f"{name}1".replace('"', '""'), f"{name}2".replace('"', '""'))]
    text = table(f"time,{','.join(names)}", whole(path.t), *xy(path))
    with pytest.raises(UserError) as error:
        guessed(tmp_path, text)
    advice = re.search(r"`(--set 'columns.x=.*?)`", str(error.value))
    assert advice is not None, str(error.value)
    options = [word for word in shlex.split(advice[1]) if word != "--set"]
    scenario, written = guessed(tmp_path, text, *options)
    check_path(scenario, path)
    assert written["target"]["columns"]["x"] == f"{name}1"


def test_names_without_latin_letters_may_be_those_of_latitudes(tmp_path: Path) -> None:
    path = Path2(rows=60)
    text = table("time,Широта,Долгота", whole(path.t), *lonlat(path)[::-1])
    options = ("columns.latitude=Широта", "columns.longitude=Долгота")
    check_path(guessed(tmp_path, text, *options)[0], path)
