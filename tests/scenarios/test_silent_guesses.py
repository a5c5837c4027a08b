"""A table that admits two readings is asked about, and each answer gives its reading.

The right values are those of the paths from which the tables are made.
"""

from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.commands import trackbench
from tests.scenarios.test_device_tables import (
    KNOT,
    Numbers,
    Path2,
    check_path,
    decimal,
    guessed,
    lonlat,
    table,
    whole,
    xy,
)
from trackbench.config.load import load
from trackbench.errors import UserError
from trackbench.new_experiment_from_tables import write_config_for
from trackbench.scenarios.recordings.recognize_column_names import unit_of

CAR = Path2(rows=60)
MINUTES = Path2(rows=50, usual_speed=2.0, every=60.0)
COUNTED_MINUTES = Path2(rows=25, usual_speed=30.0, every=60.0)
MONTHS = Path2(rows=60, usual_speed=0.01, every=86400.0)
DAILY = Path2(rows=20, usual_speed=0.01, every=86400.0)
DRIFTER = Path2(rows=60, usual_speed=0.05, every=3600.0)
HOURLY = Path2(rows=60, usual_speed=0.3, every=3600.0)
AIRCRAFT = Path2(rows=60, usual_speed=200.0, every=4.0)
NOON = datetime(2024, 5, 3, 12, 1, 0)
SUMMER_TIME = datetime(2024, 3, 31, 1, 59, 30)
NEAR, FAR = np.array([[800.0], [500.0]]), np.array([[-2000.0], [-3000.0]])


def whole_degrees(per_degree: float, path: Path2 = CAR) -> str:
    latitude, longitude = (whole(per_degree * part) for part in path.degrees[::-1])
    return table("time,lat,lon", whole(path.t), latitude, longitude)


def plane(path: Path2, meters: float = 1.0, digits: int = 2, names: str = "time,x,y") -> str:
    places = (decimal(part / meters, digits) for part in path.place)
    return table(names, whole(path.t), *places)


def clocked(path: Path2, cells: list[str], names: str = "time") -> str:
    return table(f"{names},x,y", cells, *xy(path))


def minutes_and_seconds(path: Path2, first: int) -> list[str]:
    numbers = np.rint(path.t).astype(int) + first
    return [f"{number // 60:02}{number % 60:02}" for number in numbers]


def turning(change: list[list[int]], names: str, *motion: list[str]) -> str:
    """Return a table of a changed path that turns by 1.7 deg/s, with the motion of the path itself."""
    place = np.array(change) @ turning_path()
    k = np.arange(place.shape[1])
    return table(f"time,x,y,{names}", whole(k), decimal(place[0], 2), decimal(place[1], 2), *motion)


COURSE = 0.2 + 0.03 * np.arange(60)
VELOCITY = 12.0 * np.stack([np.sin(COURSE), np.cos(COURSE)])
SPEED_AND_COURSE = (["12.0"] * 60, decimal(np.degrees(COURSE), 1))
VX_AND_VY = (decimal(VELOCITY[0], 2), decimal(VELOCITY[1], 2))


def turning_path() -> Numbers:
    noise = np.random.default_rng(1).normal(size=(2, 60))
    path: Numbers = np.cumsum(VELOCITY, axis=1) + noise
    return path


def two_objects(name: str, distance: float, pause: float) -> str:
    """Return a table in which the name of an object is given to a second one after a pause."""
    path = Path2(rows=40)
    x = np.concatenate([path.place[0], path.place[0][::-1] + distance])
    y = np.concatenate([path.place[1], path.place[1] + 0.3 * distance])
    time = np.concatenate([path.t, path.t + path.t[-1] + pause])
    columns = (whole(time), decimal(x, 1), decimal(y, 1))
    if not name:
        return table("time,x,y", *columns)
    return table(f"{name},time,x,y", [7] * len(time), *columns)


def local_times(zone: str = "") -> list[str]:
    """Return local times of a night in which clocks are set forward at two."""
    cells = []
    for seconds in CAR.t.tolist():
        moment = SUMMER_TIME + timedelta(seconds=seconds)
        if moment.hour >= 2:
            moment += timedelta(hours=1)
        cells.append(moment.strftime("%Y-%m-%d %H:%M:%S") + zone)
    return cells


def elapsed(seconds: Numbers) -> list[str]:
    """Return minutes and seconds, as 05:30, which may be hours and minutes."""
    return [
        f"{second // 60:02}:{second % 60:02}" for second in np.rint(seconds).astype(int).tolist()
    ]


def with_elapsed_times(text: str) -> str:
    """Return a table with a row every second, whose times are minutes and seconds."""
    names, *rows = text.splitlines()
    lines = [names.replace("time", "elapsed")]
    for time, row in zip(elapsed(np.arange(float(len(rows)))), rows, strict=True):
        lines.append(f"{time},{row.partition(',')[2]}")
    return "\n".join(lines) + "\n"


SLOW_AIRCRAFT = Path2(rows=100, usual_speed=200.0, every=10.0)
WINDING = 2.5 * np.sin(0.08 * np.arange(300))
"""headings of a slow robot, rad"""


ASKED: dict[str, tuple[str, str, tuple[str, ...], Path2 | None]] = {
    "milliseconds of arc": (
        whole_degrees(3.6e6),
        r"lat, lon in degE7.*lat, lon in mas, with a usual speed of 12 m/s: say",
        ("units.latitude=mas", "units.longitude=mas"),
        CAR,
    ),
    "1e-7 deg without a speed": (
        whole_degrees(1e7),
        r"lat, lon in degE7.*lat, lon in semicircle",
        ("units.latitude=degE7", "units.longitude=degE7"),
        CAR,
    ),
    "a count of minutes": (
        table("time,lat,lon", whole(COUNTED_MINUTES.t / 60.0), *lonlat(COUNTED_MINUTES)[::-1]),
        r"time in s, with a usual speed of 1\.9e\+03 m/s.*time in min, with a usual speed of 32 m/s",
        ("units.time=min",),
        None,
    ),
    "hours as fractions of days": (
        table("time,lat,lon", decimal(HOURLY.t / 86400.0, 6), *lonlat(HOURLY)[::-1]),
        r"time in d, with a usual speed of 0\.3 m/s.*time in h, with a usual speed of 7\.2 m/s",
        ("units.time=d",),
        None,
    ),
    "radians of six digits": (
        table("time,lat,lon", whole(CAR.t),
              *(decimal(np.radians(part), 6) for part in CAR.degrees[::-1])),
        r"lat, lon in deg,.*lat, lon in rad,",
        ("units.latitude=rad", "units.longitude=rad"),
        None,
    ),
    "kilometers of an aircraft": (
        plane(AIRCRAFT, 1e3, 3),
        r"x, y: no unit is named, and in m the usual speed would be 0\.2 m/s, in km 2e\+02 m/s",
        ("units.x=km", "units.y=km"),
        AIRCRAFT,
    ),
    "kilometers beside a speed": (
        table("time,x,y,speed_mps", whole(AIRCRAFT.t),
              *(decimal(part / 1e3, 3) for part in AIRCRAFT.place), decimal(AIRCRAFT.speed, 1)),
        r"time in s and x, y in km.*time in ms and x, y in m",
        ("units.x=km", "units.y=km", "units.time=s"),
        AIRCRAFT,
    ),
    "kilometers of an aircraft every ten seconds, in minutes and seconds": (
        table("elapsed,x,y", elapsed(SLOW_AIRCRAFT.t),
              *(decimal(part / 1e3, 3) for part in SLOW_AIRCRAFT.place)),
        r"x, y: no unit is named, and in m the usual speed would be 0\.2 m/s, in km 2e\+02 m/s",
        ("units.x=km", "units.y=km"),
        SLOW_AIRCRAFT,
    ),
    "x and y exchanged beside vx and vy, in minutes and seconds": (
        with_elapsed_times(turning([[0, 1], [1, 0]], "vx,vy", *VX_AND_VY)),
        r"x and y agree with vx and vy only if they are exchanged",
        ("columns.x=y", "columns.y=x"),
        None,
    ),
    "x and y exchanged beside a course": (
        turning([[0, 1], [1, 0]], "speed,course", *SPEED_AND_COURSE),
        r"x and y agree with speed and course only if they are exchanged.*'columns\.x=y'",
        ("columns.x=y", "columns.y=x"),
        None,
    ),
    "x and y exchanged beside a course alone": (
        turning([[0, 1], [1, 0]], "cog", SPEED_AND_COURSE[1]),
        r"x and y agree with cog only if they are exchanged: if x points north and y east, say",
        ("columns.x=y", "columns.y=x"),
        None,
    ),
    "x and y exchanged beside vx and vy": (
        turning([[0, 1], [1, 0]], "vx,vy", *VX_AND_VY),
        r"x and y agree with vx and vy only if they are exchanged",
        ("columns.x=y", "columns.y=x"),
        None,
    ),
    "a path near the diagonal": (
        table("time,x,y,speed,course", whole(CAR.t), *xy(CAR)[::-1],
              decimal(CAR.speed, 2), decimal(CAR.course, 1)),
        r"x and y agree with speed and course only if they are exchanged",
        ("columns.x=y", "columns.y=x"),
        CAR,
    ),
    "x to the west": (
        turning([[-1, 0], [0, 1]], "speed,course", *SPEED_AND_COURSE),
        r"x agrees with speed and course only with the opposite sign: .* positive to the east",
        ('columns.speed=""', 'columns.course=""'),
        None,
    ),
    "y to the south": (
        turning([[1, 0], [0, -1]], "vx,vy", *VX_AND_VY),
        r"y agrees with vx and vy only with the opposite sign: .* positive to the north",
        ('columns.vx=""', 'columns.vy=""'),
        None,
    ),
    "directions from which something comes": (
        table("time,x,y,speed,course", whole(CAR.t), *xy(CAR),
              decimal(CAR.speed, 2), decimal((CAR.course + 180.0) % 360.0, 1)),
        r"speed and course agree with x and y only in the opposite direction",
        ('columns.speed=""', 'columns.course=""'),
        CAR,
    ),
    "a quarter turn": (
        turning([[0, 1], [-1, 0]], "cog", SPEED_AND_COURSE[1]),
        r"cog agrees with x and y only after a quarter turn",
        ('columns.course=""',),
        None,
    ),
    "latitude and longitude exchanged beside a heading": (
        table("time,lat,lon,heading", whole(CAR.t), *lonlat(CAR), decimal(CAR.course, 1)),
        r"lat and lon agree with heading only if they are exchanged: say",
        ("columns.latitude=lon", "columns.longitude=lat"),
        CAR,
    ),
    "minutes within an hour": (
        clocked(MINUTES, MINUTES.dates("%H%M", NOON)),
        r"time in s, .* --set 'units\.time=s'.*time in %H%M, with a usual speed of 2 m/s",
        ('time_format="%H%M"',),
        MINUTES,
    ),
    "seconds between 1201 and 1258": (
        clocked(Path2(rows=58), whole(1201.0 + Path2(rows=58).t)),
        r"time in s, with a usual speed of 12 m/s.*time in %H%M, ",
        ("units.time=s",),
        Path2(rows=58),
    ),
    "whole minutes with seconds within an hour": (
        clocked(MINUTES, MINUTES.dates("%H%M%S", NOON)),
        r"time in %H%M%S, with a usual speed of 2 m/s",
        ('time_format="%H%M%S"',),
        MINUTES,
    ),
    "minutes and seconds in one number": (
        clocked(Path2(rows=200), minutes_and_seconds(Path2(rows=200), 40)),
        r"time in %M%S, with a usual speed of 12 m/s.*time in %H%M",
        ('time_format="%M%S"',),
        Path2(rows=200),
    ),
    "seconds behind a point": (
        clocked(CAR, [f"{cell[:-2]}.{cell[-2:]}" for cell in minutes_and_seconds(CAR, 40)]),
        r"time in %M\.%S, with a usual speed of 12 m/s.*time in %H\.%M",
        ('time_format="%M.%S"',),
        CAR,
    ),
    "minutes with decimals": (
        clocked(Path2(usual_speed=1.4), decimal(Path2(usual_speed=1.4).t / 60.0, 5)),
        r"time in s, with a usual speed of 84 m/s.*time in min, with a usual speed of 1\.4 m/s",
        ("units.time=min",),
        Path2(usual_speed=1.4),
    ),
    "a name that is given again": (
        two_objects("id", 150e3, 3600.0),
        r"m\.csv:42:1: 1\.56e\+05 m in 3\.6e\+03 s are 3\.3 times as fast.*does id 7 name another",
        ("columns.run=id",),
        None,
    ),
    "the number of a track that is given again": (
        two_objects("track_id", 8e3, 60.0),
        r"m\.csv:42:1: .* does track_id 7 name another target from here on",
        ("columns.run=track_id",),
        None,
    ),
    "two recordings in one table": (
        two_objects("", 8e3, 1.0),
        r"m\.csv:42:1: .* is this another target, or another recording, from here on",
        ('columns.run=""',),
        None,
    ),
    "days of a month in one number": (
        clocked(DAILY, DAILY.dates("%Y%m%d")),
        r"m\.csv:2:1: is 20240503 the date 2024-05-03\? Then say --set 'time_format=\"%Y%m%d\"'",
        ('time_format="%Y%m%d"',),
        DAILY,
    ),
    "days of a year in one number": (
        clocked(DAILY, DAILY.dates("%Y%j")),
        r"m\.csv:2:1: is 2024124 the date 2024-05-03\? .*; if these are seconds, say",
        ('time_format="%Y%j"',),
        DAILY,
    ),
    "a latitude in x": (
        table("time,x,y", whole(DRIFTER.t), *lonlat(DRIFTER)[::-1]),
        r"or in degrees, .*, or if x is the latitude, --set 'columns\.latitude=x'",
        ("columns.latitude=x", "columns.longitude=y"),
        DRIFTER,
    ),
    "a latitude in x beside a longitude beyond 91": (
        table("time,x,y", whole(CAR.t), lonlat(CAR)[1], decimal(CAR.degrees[0] + 120.0, 7)),
        r"or in degrees, --set 'columns\.latitude=x' --set 'columns\.longitude=y'",
        ("columns.latitude=x", "columns.longitude=y"),
        CAR,
    ),
    "summer time": (
        clocked(CAR, local_times()),
        r"m\.csv:32:1: after 01:59:59 comes 03:00:00, on a Sunday of March: are these local times",
        ("columns.time=time",),
        None,
    ),
}  # fmt: skip
RIGHT: dict[str, tuple[str, Path2 | None]] = {
    "days of months in one number": (clocked(MONTHS, MONTHS.dates("%Y%m%d")), MONTHS),
    "days in one number below the name of a date": (
        clocked(DAILY, DAILY.dates("%d%m%Y"), "date"),
        DAILY,
    ),
    "seconds with as many digits as a date": (
        clocked(CAR, whole(20240503.0 + 13.0 * np.arange(60))),
        Path2(every=13.0, usual_speed=12.0 / 13.0),
    ),
    "milliseconds of arc in the name": (
        whole_degrees(3.6e6).replace("lat,lon", "lat_mas,lon_mas"),
        CAR,
    ),
    "a course beside x and y": (
        table("time,x,y,cog", whole(CAR.t), *xy(CAR), decimal(CAR.course, 1)),
        CAR,
    ),
    "north and east": (
        table("time,north,east,speed,course", whole(CAR.t), *xy(CAR)[::-1],
              decimal(CAR.speed, 2), decimal(CAR.course, 1)),
        CAR,
    ),
    "minutes over an hour": (
        clocked(MINUTES, MINUTES.dates("%H%M", datetime(2024, 5, 3, 12, 30))),
        MINUTES,
    ),
    "minutes with a zero before them": (
        clocked(MINUTES, MINUTES.dates("%H%M", datetime(2024, 5, 3, 9, 1))),
        MINUTES,
    ),
    "minutes behind a point": (
        clocked(MINUTES, MINUTES.dates("%H.%M", datetime(2024, 5, 3, 9, 30))),
        MINUTES,
    ),
    "minutes beside a date": (
        clocked(MINUTES, [f"2024-05-03,{cell}" for cell in MINUTES.dates("%H%M", NOON)],
                "date,time"),
        MINUTES,
    ),
    "minutes in a column of this name": (
        clocked(MINUTES, MINUTES.dates("%H%M", NOON), "hhmm"),
        MINUTES,
    ),
    "minutes beside a speed": (
        table("time,x,y,speed", MINUTES.dates("%H%M", NOON), *xy(MINUTES), decimal(MINUTES.speed, 2)),
        MINUTES,
    ),
    "seconds in a column of this unit": (
        clocked(Path2(rows=58), whole(1201.0 + Path2(rows=58).t), "time_s"),
        Path2(rows=58),
    ),
    "seconds from zero on": (clocked(Path2(rows=59), whole(Path2(rows=59).t)), Path2(rows=59)),
    "seconds over 1260": (clocked(CAR, whole(1201.0 + CAR.t)), CAR),
    "tenths of a second over a minute": (
        clocked(
            Path2(every=0.1),
            [c[:-5] for c in Path2(every=0.1).dates("%H%M%S.%f", datetime(2024, 5, 3, 12, 30, 57))],
        ),
        Path2(every=0.1),
    ),
    "minutes and seconds beyond 24": (
        clocked(Path2(rows=200), minutes_and_seconds(Path2(rows=200), 1840)),
        Path2(rows=200),
    ),
    "a pause that motion explains": (two_objects("id", 20e3, 3600.0), None),
    "summer time in UTC": (clocked(CAR, local_times("Z")), None),
    "a robot that turns": (
        table("time,x,y", decimal(np.arange(300) / 10.0, 1),
              decimal(np.sin(0.02 * np.arange(300)), 4),
              decimal(1.0 - np.cos(0.02 * np.arange(300)), 4)),
        None,
    ),
    "a robot that turns, in minutes and seconds": (
        table("elapsed,x,y", elapsed(np.arange(300.0)),
              decimal(np.cumsum(0.3 * np.cos(WINDING)), 4),
              decimal(np.cumsum(0.3 * np.sin(WINDING)), 4)),
        None,
    ),
    "a slow robot in ROS": (
        table("time,pose.position.x,pose.position.y", decimal(np.arange(99) / 10.0, 1),
              decimal(0.03 * np.arange(99), 4), decimal(0.01 * np.arange(99), 4)),
        None,
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", ASKED)
def test_two_readings_are_a_question(tmp_path: Path, case: str) -> None:
    text, expected, answers, path = ASKED[case]
    with pytest.raises(UserError, match=rf"(?s){expected}"):
        guessed(tmp_path, text)
    assert not (tmp_path / "g.yaml").exists()
    scenario, _ = guessed(tmp_path, text, *answers)
    if path is not None:
        check_path(scenario, path)


@pytest.mark.parametrize("case", RIGHT)
def test_one_reading_is_no_question(tmp_path: Path, case: str) -> None:
    text, path = RIGHT[case]
    scenario, _ = guessed(tmp_path, text)
    if path is not None:
        check_path(scenario, path)


def radar_table(
    radar: Numbers, count: Callable[[Numbers, Numbers], Numbers], name: str = "az_deg"
) -> str:
    """Return ranges and azimuths of the car from a radar; ``count`` returns these by x and y, rad."""
    x, y = CAR.place - radar
    azimuths = decimal(np.degrees(count(x, y)), 4)
    if name.endswith("rad"):
        azimuths = decimal(count(x, y), 6)
    return table(f"time,range_m,{name}", whole(CAR.t), decimal(np.hypot(x, y), 2), azimuths)


def from_x(x: Numbers, y: Numbers) -> Numbers:
    return np.arctan2(y, x)


def from_north(x: Numbers, y: Numbers) -> Numbers:
    return np.arctan2(x, y)


def check_radar(scenario: Any, radar: Numbers) -> None:
    """Compare the positions that the config reads with those of the car."""
    recording = scenario.target._recording
    ranges, azimuths = recording.measurements[:2, :, 0]
    read = ranges * np.stack([np.cos(azimuths), np.sin(azimuths)])
    np.testing.assert_allclose(read, (CAR.place - radar)[:, -read.shape[1] :], atol=0.1)


@pytest.mark.parametrize("name", ["az_deg", "bearing (deg)", "azimuth_rad"])
@pytest.mark.parametrize("radar", [NEAR, FAR])
def test_azimuths_within_half_a_turn_are_a_question(
    tmp_path: Path, name: str, radar: Numbers
) -> None:
    for count, answer in ((from_x, "clockwise=[]"), (from_north, "clockwise=[azimuth]")):
        text = radar_table(radar, count, name)
        with pytest.raises(UserError) as error:
            guessed(tmp_path, text)
        first, second = str(error.value).splitlines()
        assert "do these angles count clockwise from north" in first
        assert first.endswith("Say --set 'clockwise=[azimuth]'")
        assert second.endswith("Say --set 'clockwise=[]'")
        scenario, _ = guessed(tmp_path, text, answer)
        check_radar(scenario, radar)
        (tmp_path / "g.yaml").unlink()


def test_bearings_alone_are_a_question_too(tmp_path: Path) -> None:
    lines = radar_table(NEAR, from_x).splitlines()
    text = "\n".join(f"{line.split(',')[0]},{line.split(',')[2]}" for line in lines) + "\n"
    with pytest.raises(UserError, match="do these angles count clockwise from north"):
        guessed(tmp_path, text)


@pytest.mark.parametrize("count", [from_x, from_north])
@pytest.mark.parametrize("geodetic", [False, True])
def test_a_truth_shows_from_where_azimuths_count(
    tmp_path: Path, count: Callable[[Numbers, Numbers], Numbers], geodetic: bool
) -> None:
    (tmp_path / "m.csv").write_text(radar_table(FAR, count))
    truth = plane(CAR)
    if geodetic:
        truth = table("time,lat,lon", whole(CAR.t), *lonlat(CAR)[::-1])
    (tmp_path / "truth.csv").write_text(truth)
    (path,) = write_config_for(tmp_path / "m.csv", "g", tmp_path, (), tmp_path / "truth.csv").paths
    text = path.read_text()
    if count is from_north:
        assert "clockwise: [azimuth]  # as the truth shows" in text
    else:
        assert "# azimuths count from x to y, as the truth shows" in text
    path.write_text(text.replace("LATITUDE, LONGITUDE", "47.0269, 8.5263"))
    check_radar(load(path).points[0].scenario, FAR)


def test_a_truth_corrects_azimuths_beyond_half_a_turn(tmp_path: Path) -> None:
    text = radar_table(NEAR, lambda x, y: from_x(x, y) % (2.0 * np.pi))
    (tmp_path / "m.csv").write_text(text)
    alone = write_config_for(tmp_path / "m.csv", "alone", tmp_path)
    assert any("read az_deg clockwise from north" in line for line in alone.units)
    (tmp_path / "truth.csv").write_text(plane(CAR))
    with_truth = write_config_for(tmp_path / "m.csv", "g", tmp_path, (), tmp_path / "truth.csv")
    assert not with_truth.units
    check_radar(load(with_truth.paths[0]).points[0].scenario, NEAR)


def test_velocities_of_an_autopilot_begin_with_north(tmp_path: Path) -> None:
    north_and_east = (decimal(CAR.velocity[1], 2), decimal(CAR.velocity[0], 2))
    text = table("time,lat,lon,vx,vy", whole(CAR.t), *lonlat(CAR)[::-1], *north_and_east)
    scenario, written = guessed(tmp_path, text)
    assert written["target"]["columns"]["vx"] == "vy"
    check_path(scenario, CAR)
    measured = scenario.target._recording.measurements[2:, :, 0]
    np.testing.assert_allclose(measured, CAR.velocity[:, 1:], atol=0.1)


def test_zeros_near_the_start_of_a_path_are_a_question(tmp_path: Path) -> None:
    x, y = xy(CAR)
    for row in (5, 20, 21):
        x[row] = y[row] = "0"
    with pytest.raises(UserError, match=r"2 rows with x and y = 0 lie far from the rows before"):
        guessed(tmp_path, table("time,x,y", whole(CAR.t), x, y))


def test_velocities_that_are_left_out_are_named(tmp_path: Path) -> None:
    course = decimal((CAR.course + 50.0) % 360.0, 1)
    columns = (whole(CAR.t), *xy(CAR), decimal(CAR.speed / KNOT, 2), course)
    (tmp_path / "m.csv").write_text(table("time,x,y,speed,course", *columns))
    made = trackbench("new", "experiment", "--from", "m.csv", cwd=tmp_path)
    assert made.returncode == 0
    reason = "they have other directions than the positions move in, usually by 50 deg"
    assert f"velocities are left out: {reason}" in made.stdout
    options = "--set 'columns.speed=speed' --set 'columns.course=course'"
    assert f"to use them all the same: {options}\n" in made.stdout


@pytest.mark.parametrize("names", ["min,sec", "minutes,seconds", "hour,min,sec", "sec,hundredths"])
def test_a_time_in_several_columns_is_a_question(tmp_path: Path, names: str) -> None:
    """The minutes were taken for the names of runs, and the seconds for the time."""
    times = CAR.t * (0.1 if "hundredths" in names else 2.0)
    parts = {
        "hour": times // 3600 + 10,
        **dict.fromkeys(("min", "minutes"), times // 60 % 60),
        **dict.fromkeys(("sec", "seconds"), times // 1 % 60),
        "hundredths": 100.0 * times % 100,
    }
    columns = [whole(parts[name]) for name in names.split(",")]
    text = table(f"{names},x,y", *columns, *xy(CAR))
    with pytest.raises(UserError, match="the time seems to be split over the columns"):
        guessed(tmp_path, text)
    seconds = "seconds" if "seconds" in names else "sec"
    with pytest.raises(UserError, match=f"--set 'columns.time={seconds}'"):
        guessed(tmp_path, text)


def test_parts_of_a_time_that_stay_the_same_are_no_question(tmp_path: Path) -> None:
    same = ["10"] * CAR.rows
    scenario, _ = guessed(tmp_path, table("hour,min,sec,x,y", same, same, whole(CAR.t), *xy(CAR)))
    check_path(scenario, CAR)


def test_a_satellite_in_km_and_km_per_second(tmp_path: Path) -> None:
    path = Path2(rows=60, usual_speed=7500.0)
    places = (decimal(part / 1000.0, 3) for part in path.place)
    speeds = (decimal(part / 1000.0, 4) for part in path.velocity)
    text = table("time,x_km,y_km,vx_km_s,vy_km_s", whole(path.t), *places, *speeds)
    scenario, written = guessed(tmp_path, text)
    assert written["target"]["units"]["vx"] == "km/s"
    check_path(scenario, path)
    measured = scenario.target._recording.measurements[2:, :, 0]
    np.testing.assert_allclose(measured, path.velocity[:, 1:], atol=0.1)


@pytest.mark.parametrize(
    "names",
    [
        "X,odom_x,odom_y,Y",
        "x_est,y_est,x_obs,y_obs",
        "filtered_x,filtered_y,raw_x,raw_y",
        "x,y,x_meas,y_meas",
    ],
)
def test_both_coordinates_are_of_the_measurement(tmp_path: Path, names: str) -> None:
    """The y of another source, an estimate and the truth were taken."""
    other = (decimal(5.0 * CAR.place[0], 2), decimal(5.0 * CAR.place[1], 2))
    columns = [*other, *xy(CAR)]
    if names.startswith("X"):
        names = "gps_x,odom_x,odom_y,gps_y"
        columns = [xy(CAR)[0], *other, xy(CAR)[1]]
    scenario, written = guessed(tmp_path, table(f"time,{names}", whole(CAR.t), *columns))
    measured = {"gps_x", "gps_y", "x_obs", "y_obs", "raw_x", "raw_y", "x_meas", "y_meas"}
    columns_of_place = written["target"]["columns"]
    assert {columns_of_place["x"], columns_of_place["y"]} <= measured
    check_path(scenario, CAR)


@pytest.mark.parametrize(
    ("names", "answer", "x", "y"),
    [
        ("gps_lat,gps_lng,fix_lat,fix_lon", (), "gps_lng", "gps_lat"),
        ("gps_lat,gps_long,map_lat,map_lng", (), "gps_long", "gps_lat"),
        ("gps_lat,gps_lng,fix_lat,fix_lon", ("columns.latitude=fix_lat",), "fix_lon", "fix_lat"),
    ],
)
def test_latitude_and_longitude_are_of_one_source(
    tmp_path: Path, names: str, answer: tuple[str, ...], x: str, y: str
) -> None:
    longitude, latitude = lonlat(CAR)
    text = table(f"time,{names}", whole(CAR.t), latitude, longitude, latitude, longitude)
    _, written = guessed(tmp_path, text, *answer)
    columns = written["target"]["columns"]
    assert (columns["longitude"], columns["latitude"]) == (x, y)


def beside_latitudes(names: str, *cells: str) -> str:
    """Return a table whose degrees are positive, with columns of equal cells beside them."""
    longitude, latitude = (decimal(np.abs(degrees), 7) for degrees in CAR.degrees)
    words = ([cell] * CAR.rows for cell in cells)
    return table(f"time,{names}", whole(CAR.t), latitude, longitude, *words)


@pytest.mark.parametrize(
    ("names", "cells", "answer"),
    [
        ("lat,lon,hemisphere", ["NW"], ["columns.north_south=", "columns.east_west="]),
        ("lat,lon,lat_dir,lon_dir", ["1", "-1"], ["columns.north_south=", "columns.east_west="]),
        ("latitud,longitud,ns,eo", ["N", "O"], ["columns.east_west="]),
        ("Latitude S,Longitude E", [], ["columns.latitude=Latitude S"]),
        ("Lat [°S],Lon [°E]", [], ["columns.latitude=Lat [°S]"]),
        ("lat,lonW", [], ["columns.longitude=lonW"]),
        ("lat_N,lon_W", [], ["columns.longitude=lon_W"]),
        ("Latitude (deg N),Longitude (deg W)", [], ["columns.longitude=Longitude (deg W)"]),
        ("latitude_degrees_south,longitude", [], ["columns.latitude=latitude_degrees_south"]),
    ],
)
def test_a_hemisphere_in_doubt_is_a_question(
    tmp_path: Path, names: str, cells: list[str], answer: list[str]
) -> None:
    """The degrees were read as north and east."""
    text = beside_latitudes(names, *cells)
    asked = "does it name the hemisphere|as its name says"
    with pytest.raises(UserError, match=asked) as error:
        guessed(tmp_path, text)
    way = [change + '""' * change.endswith("=") for change in answer]
    if "°" not in names:
        assert all(f"--set '{change}'" in str(error.value) for change in way)
    guessed(tmp_path, text, *way)


@pytest.mark.parametrize(
    "words", [("Northern", "Western"), ("N", "Ovest"), ("Süd", "West"), ("Sul", "Oeste")]
)
def test_hemispheres_have_words_of_several_languages(
    tmp_path: Path, words: tuple[str, str]
) -> None:
    _, written = guessed(tmp_path, beside_latitudes("lat,lon,ns,ew", *words))
    columns = written["target"]["columns"]
    assert (columns["north_south"], columns["east_west"]) == ("ns", "ew")


@pytest.mark.parametrize("names", ["lat_N,lon_E,ns", "lat_degrees_north,lon_degrees_east,ns"])
def test_names_of_north_and_east_and_satellites_are_no_question(tmp_path: Path, names: str) -> None:
    _, written = guessed(tmp_path, beside_latitudes(names, "9"))
    assert "latitude" in written["target"]["columns"]


@pytest.mark.parametrize(
    ("names", "unit"),
    [
        ("speed (m/min),course", "m/min"),
        ("speed_m_min,course", "m/min"),
        ("speed [km/min],course", "km/min"),
        ("speed (ft per min),course", "ft/min"),
        ("speed [dm/s],course", "dm/s"),
        ("speed_dm_s,course", "dm/s"),
        ("speed [m/h],course", "m/h"),
    ],
)
def test_an_unknown_unit_of_a_speed_is_an_error(tmp_path: Path, names: str, unit: str) -> None:
    """The unit was dropped, and another one was chosen with which times and positions agree."""
    text = turning([[1, 0], [0, 1]], names, *SPEED_AND_COURSE)
    with pytest.raises(UserError, match=f"the unit {unit} is unknown here"):
        guessed(tmp_path, text)
    with pytest.raises(UserError, match=r"--set units\.speed=m/s"):
        guessed(tmp_path, text)
    _, written = guessed(tmp_path, text, "units.speed=m/s")
    assert written["target"]["units"]["speed"] == "m/s"


@pytest.mark.parametrize(
    ("name", "unit"),
    [("m/sec", "m/s"), ("km/hr", "km/h"), ("mi/h", "mph"), ("nmi/h", "kn"), ("km/s", "km/s")],
)
def test_units_of_speeds_have_several_spellings(name: str, unit: str) -> None:
    assert unit_of(f"speed [{name}]", "speed") == unit


def test_times_with_marks_between_thousands_are_numbers(tmp_path: Path) -> None:
    times = [f'"{1714730400000 + 1000 * k:,}"' for k in range(CAR.rows)]
    scenario, written = guessed(tmp_path, table("time,x,y", times, *xy(CAR)))
    assert written["target"]["units"]["time"] == "ms"
    check_path(scenario, CAR)


def refused(tmp_path: Path, text: str, truth: str = "") -> str:
    """Return the message on a table, perhaps beside a truth."""
    (tmp_path / "m.csv").write_text(text)
    options = []
    if truth:
        (tmp_path / "truth.csv").write_text(truth)
        options = ["--truth", "truth.csv"]
    made = trackbench("new", "experiment", "g", "--from", "m.csv", *options, cwd=tmp_path)
    assert made.returncode == 2
    assert not (tmp_path / "g.yaml").exists()
    return made.stderr


def test_a_date_and_an_hour_are_a_split_time(tmp_path: Path) -> None:
    days = ["2024-05-03"] * 40 + ["2024-05-04"] * 20
    hours = decimal(CAR.t / 3.0 % 24.0, 4)
    message = refused(tmp_path, table("date,hour,x,y", days, hours, *xy(CAR)))
    assert "the time seems to be split over the columns hour, date" in message


def test_angles_in_text_are_named(tmp_path: Path) -> None:
    angles = [f"299:{k // 60:02}:{k % 60:02}" for k in range(CAR.rows)]
    text = table("time,range_m,azimuth", whole(CAR.t), xy(CAR)[0], angles)
    message = refused(tmp_path, text)
    assert "m.csv:2:1: azimuth: '299:00:00' is not a number" in message
    option = 'columns.azimuth=""'
    made = trackbench("new", "experiment", "g", "--from", "m.csv", "--set", option, cwd=tmp_path)
    assert made.returncode == 0


def test_positions_without_numbers_are_named(tmp_path: Path) -> None:
    empty = "".join(f"{k},,\n" for k in range(10_100))
    assert "x, y: there is no number in any row" in refused(tmp_path, f"time,x,y\n{empty}")


def test_two_rows_are_too_few(tmp_path: Path) -> None:
    message = refused(tmp_path, "time,x,y\n0,0.691,1.667\n1,7.705,2.319\n")
    assert "m.csv: has 2 rows in its longest run, which are too few" in message


def test_a_truth_on_a_grid_cannot_stand_beside_latitudes(tmp_path: Path) -> None:
    east, north = decimal(633e3 + CAR.place[0], 2), decimal(5627e3 + CAR.place[1], 2)
    measured = table("time,lat,lon", whole(CAR.t), *lonlat(CAR)[::-1])
    message = refused(tmp_path, measured, table("time,easting,northing", whole(CAR.t), east, north))
    assert "truth.csv:1:1: easting and northing count from a point 5662 km away" in message


def test_a_truth_of_several_sources_is_told_so(tmp_path: Path) -> None:
    measured = table("time,lat,lon", whole(CAR.t), *lonlat(CAR)[::-1])
    sources = ["rtk", "ins"] * (CAR.rows // 2)
    truth = table("time,source,lat,lon", whole(CAR.t), sources, *lonlat(CAR)[::-1])
    message = refused(tmp_path, measured, truth)
    assert "column source names rtk, ins, and a truth is of one source" in message


def test_velocities_without_numbers_are_named(tmp_path: Path) -> None:
    empty = [""] * CAR.rows
    (tmp_path / "m.csv").write_text(
        table("time,x,y,speed,course", whole(CAR.t), *xy(CAR), empty, empty)
    )
    made = trackbench("new", "experiment", "--from", "m.csv", cwd=tmp_path)
    assert "velocities are left out: they have no numbers\n" in made.stdout


def test_a_question_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text(radar_table(NEAR, from_x))
    made = trackbench("new", "experiment", "--from", "m.csv", cwd=tmp_path)
    assert made.returncode == 2
    assert made.stderr.startswith("m.csv:1:1: az_deg: do these angles count")
    assert not (tmp_path / "m.yaml").exists()


SLOW = Path2(rows=60, usual_speed=0.03, every=60.0)


@pytest.mark.parametrize(
    ("first", "per_second", "unit"),
    [(0, 1, "s"), (1714730400, 1000, "ms"), (1714730400, 10**6, "us")],
)
def test_minutes_of_something_slow_are_no_thousandths(
    tmp_path: Path, first: int, per_second: int, unit: str
) -> None:
    """A buoy of 3 cm/s, whose times would be those of something that goes 30 m/s."""
    times = [str((first + 60 * k) * per_second) for k in range(SLOW.rows)]
    text = table("time,lat,lon", times, *lonlat(SLOW)[::-1])
    with pytest.raises(UserError, match=rf"units\.time={unit}'"):
        guessed(tmp_path, text)
    check_path(guessed(tmp_path, text, f"units.time={unit}")[0], SLOW)


def test_seconds_since_2006_may_be_milliseconds(tmp_path: Path) -> None:
    """A cow of .4 m/s in seconds of BeiDou, or something of 400 m/s after a week of milliseconds."""
    cow = Path2(rows=60, usual_speed=0.4, every=60.0)
    times = [str(578923200 + 60 * k) for k in range(cow.rows)]
    text = table("time,lat,lon", times, *lonlat(cow)[::-1])
    with pytest.raises(UserError, match=r"units\.time=s'"):
        guessed(tmp_path, text)
    check_path(guessed(tmp_path, text, "units.time=s")[0], cow)


def minutes_in_one_number(rows: int) -> list[str]:
    """Times one minute apart, from 09:10 on, as 250403091000."""
    began = datetime(2025, 4, 3, 9, 10)
    return [f"{began + timedelta(minutes=k):%y%m%d%H%M%S}" for k in range(rows)]


def test_dates_at_whole_minutes_are_no_numbers(tmp_path: Path) -> None:
    """250403091000, 250403091100, ... were read as numbers, as their last two digits are alike."""
    columns = [decimal(300.0 * np.arange(70), 1), decimal(40.0 * np.arange(70), 1)]
    text = table("time,x,y", minutes_in_one_number(70), *columns)
    scenario, written = guessed(tmp_path, text)
    assert written["target"]["time_format"] == "%y%m%d%H%M%S"
    np.testing.assert_allclose(np.diff(scenario.times), 60.0)
    (tmp_path / "g.yaml").unlink()
    # Within an hour the numbers are as regular as the dates.
    text = table("time,x,y", minutes_in_one_number(40), *(cells[:40] for cells in columns))
    asked = r"is 250403091000 the date 2025-04-03 09:10:00\?.*units\.time=us"
    with pytest.raises(UserError, match=asked):
        guessed(tmp_path, text)
    scenario, _ = guessed(tmp_path, text, "time_format=%y%m%d%H%M%S")
    np.testing.assert_allclose(np.diff(scenario.times), 60.0)


def test_a_count_of_microseconds_is_no_date(tmp_path: Path) -> None:
    counts = [str(250403000000 + 1000000 * k) for k in range(40)]  # the 32nd of April is none
    text = table("time,x,y", counts, *(decimal(12.0 * np.arange(40), 2) for _ in "xy"))
    _, written = guessed(tmp_path, text)
    assert written["target"]["units"]["time"] == "us"


def test_mm_and_ms_agree_with_speeds_as_m_and_s(tmp_path: Path) -> None:
    """A robot's x and y in mm and times in ms were read as m and s beside vx and vy in m/s."""
    angle = 0.02 * np.arange(200)
    x, y = 1000.0 * np.sin(angle), 1000.0 - 1000.0 * np.cos(angle)
    vx, vy = (decimal(v, 4) for v in (np.cos(angle), np.sin(angle)))
    times = whole(20.0 * np.arange(200))
    text = table("time,x,y,vx,vy", times, decimal(x, 1), decimal(y, 1), vx, vy)
    asked = r"(?s)time in s and x, y in m.*time in ms and x, y in mm.*units.time=ms.*units.x=mm"
    with pytest.raises(UserError, match=asked):
        guessed(tmp_path, text)
    scenario, _ = guessed(tmp_path, text, "units.time=ms", "units.x=mm", "units.y=mm")
    np.testing.assert_allclose(np.diff(scenario.times), 0.02)
    (tmp_path / "g.yaml").unlink()
    guessed(tmp_path, text, "units.time=s")
    # Positions in mm hardly have digits of micrometers.
    (tmp_path / "g.yaml").unlink()
    guessed(tmp_path, table("time,x,y,vx,vy", times, decimal(x, 3), decimal(y, 3), vx, vy))


def test_x_and_y_in_degrees_are_told_in_the_config(tmp_path: Path) -> None:
    speed, course = (
        decimal(np.hypot(*CAR.velocity), 2),
        decimal(np.rad2deg(np.arctan2(*CAR.velocity)) % 360.0, 1),
    )
    text = table("time,x,y,speed,course", whole(CAR.t), *lonlat(CAR), speed, course)
    guessed(tmp_path, text)
    assert "latitude: y  # guess: x and y are a longitude and" in (tmp_path / "g.yaml").read_text()
