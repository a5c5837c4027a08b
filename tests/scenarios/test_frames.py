"""Latitude and longitude beside another frame, and angles in degrees beside those in radians."""

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.scenarios import test_clocks
from tests.scenarios.test_clocks import table
from trackbench import api
from trackbench.config.load import load
from trackbench.errors import UserError
from trackbench.scenarios.recordings.guess_table import recognized

pytestmark = pytest.mark.usefixtures("no_report")

TIMES = np.arange(0.0, 40.0, 2.0)
NOISE = np.random.default_rng(2).normal(size=(2, len(TIMES)))
PLACE = np.stack([4000.0 - 20.0 * TIMES, 7000.0 + 10.0 * TIMES])
RADAR = {"kind": "range-azimuth", "sigma_range": 15, "sigma_azimuth_mrad": 3.5}
AT = (50.0, 5.0)
"""Place of the radar, deg"""


def config(folder: Path, target: dict[str, Any], sensor: Any, **changes: Any) -> Path:
    """Write a config with a filter for every sensor."""
    filters = {"EKF": {"kind": "ekf"}}
    return test_clocks.config(folder, target, sensor=sensor, filters=filters, **changes)


def geodetic(east: float, north: float) -> tuple[float, float]:
    """Return latitude and longitude, deg, that lie so many meters from `AT`, by Newton's method."""

    def cartesian(latitude: float, longitude: float) -> np.ndarray:
        a, e2 = 6378137.0, 6.69437999014e-3
        n = a / math.sqrt(1 - e2 * math.sin(latitude) ** 2)
        plane = n * math.cos(latitude)
        up = n * (1 - e2) * math.sin(latitude)
        return np.array([plane * math.cos(longitude), plane * math.sin(longitude), up])

    def from_radar(latitude: float, longitude: float) -> np.ndarray:
        p, q = map(math.radians, AT)
        d = cartesian(latitude, longitude) - cartesian(p, q)
        axes = [
            [-math.sin(q), math.cos(q), 0.0],
            [-math.sin(p) * math.cos(q), -math.sin(p) * math.sin(q), math.cos(p)],
        ]
        return np.array(axes) @ d

    point, step = np.radians(AT), 1e-6
    for _ in range(6):
        here = from_radar(*point)
        slopes = [(from_radar(*(point + step * e)) - here) / step for e in np.eye(2)]
        point = point + np.linalg.solve(np.stack(slopes, axis=1), (east, north) - here)
    return math.degrees(point[0]), math.degrees(point[1])


def write(folder: Path) -> None:
    x, y = PLACE
    azimuth = np.arctan2(y, x) + 3.5e-3 * NOISE[1]
    rows = TIMES, np.hypot(x, y) + 15.0 * NOISE[0]
    degrees = table("time,range,azimuth", *rows, np.degrees(azimuth))
    (folder / "plots.csv").write_text(table("time,range,azimuth", *rows, azimuth))
    (folder / "degrees.csv").write_text(degrees)
    (folder / "bearings.csv").write_text(degrees.replace("azimuth", "bearing"))
    (folder / "xy.csv").write_text(table("time,x,y", TIMES, x, y))
    earth = np.array([geodetic(*place) for place in PLACE.T.tolist()]).T
    (folder / "gps.csv").write_text(table("time,latitude,longitude", TIMES, *earth.tolist()))
    velocities = table("time,vx,vy", TIMES, 0.0 * x - 20.0, 0.0 * x + 10.0)
    (folder / "velocities.csv").write_text(velocities)


def rmse(folder: Path, target: dict[str, Any], sensor: Any = RADAR) -> float:
    path = config(folder, target, sensor)
    report = api.run(path, out=folder / "out", workers=1, quiet=True, formats=())
    return float(report.per_run.set_index("metric")["value"]["rmse_position"])


@pytest.mark.parametrize(
    "origin", [{"origin": [*AT]}, {"truth_naming": {"origin": [*AT]}}], ids=["target", "truth"]
)
def test_a_truth_in_degrees_is_that_in_meters(tmp_path: Path, origin: dict[str, Any]) -> None:
    write(tmp_path)
    plane = rmse(tmp_path, {"measurements": "plots.csv", "truth": "xy.csv"})
    earth = rmse(tmp_path, {"measurements": "plots.csv", "truth": "gps.csv", **origin})
    assert plane < 30.0
    assert earth == pytest.approx(plane, rel=1e-6)


POSITION = {"kind": "position", "sigma": 5}
RANGE = {"kind": "function", "h": {"range": "sqrt(px**2 + py**2)"}, "R": 225}
BOTH = ["gps.csv", "plots.csv"]


@pytest.mark.parametrize(
    ("target", "sensor"),
    [
        ({"measurements": "plots.csv", "truth": "gps.csv"}, RADAR),
        ({"measurements": "gps.csv", "truth": "xy.csv"}, POSITION),
        ({"measurements": "gps.csv", "truth": "xy.csv", "truth_gap": 5}, POSITION),
        ({"measurements": ["plots.csv", "gps.csv"]}, [RADAR, POSITION]),
        ({"measurements": BOTH}, [POSITION, RADAR]),
        ({"measurements": BOTH}, [POSITION, RANGE]),
        ({"measurements": ["gps.csv", "xy.csv"]}, [POSITION, POSITION]),
    ],
)
def test_an_origin_is_required(tmp_path: Path, target: dict[str, Any], sensor: Any) -> None:
    write(tmp_path)
    with pytest.raises(UserError) as caught:
        load(config(tmp_path, target, sensor))
    (line,) = str(caught.value).splitlines()
    assert "gps.csv has latitude and longitude, and " in line
    assert "say where that is, `origin: [latitude, longitude]`" in line
    load(config(tmp_path, target | {"origin": [*AT]}, sensor))


@pytest.mark.parametrize(
    ("target", "sensor"),
    [
        ({"measurements": "gps.csv", "truth": "gps.csv"}, POSITION),
        (
            {"measurements": ["gps.csv", "velocities.csv"]},
            [POSITION, {"kind": "velocity", "sigma": 1}],
        ),
    ],
)
def test_no_origin_is_required(tmp_path: Path, target: dict[str, Any], sensor: Any) -> None:
    write(tmp_path)
    load(config(tmp_path, target, sensor))


@pytest.mark.parametrize(
    ("file", "sensor", "name"),
    [
        ("degrees.csv", RADAR, "azimuth"),
        ("degrees.csv", {"kind": "bearing", "sigma_mrad": 3.5}, "azimuth"),
        (
            "bearings.csv",
            {
                "kind": "function",
                "h": {"bearing": "atan2(py, px)"},
                "angles": ["bearing"],
                "R": 1e-5,
            },
            "bearing",
        ),
    ],
)
def test_degrees_without_a_unit_are_refused(
    tmp_path: Path, file: str, sensor: Any, name: str
) -> None:
    write(tmp_path)
    start = {"kind": "given", "mean": [4e3, -20, 7e3, 10], "sigma": [100, 10, 100, 10]}
    with pytest.raises(UserError) as caught:
        load(config(tmp_path, {"measurements": file}, sensor, start=start))
    (line,) = str(caught.value).splitlines()
    assert f"{file}:2:1: scenario: {name}: " in line
    assert "rad is beyond a whole turn, as are 19 more: say `units: {" in line
    target = {"measurements": file, "units": {name: "deg"}}
    load(config(tmp_path, target, sensor, start=start))


CLOCKWISE = table(
    "time,range,azimuth",
    TIMES,
    np.hypot(*PLACE) + 15.0 * NOISE[0],
    (90.0 - np.degrees(np.arctan2(PLACE[1], PLACE[0]) + 3.5e-3 * NOISE[1])) % 360.0,
)
"""Plots of the radar with azimuths clockwise from north."""


def test_angles_clockwise_from_north(tmp_path: Path) -> None:
    write(tmp_path)
    (tmp_path / "compass.csv").write_text(CLOCKWISE)
    target = {"truth": "xy.csv", "measurements": "compass.csv", "units": {"azimuth": "deg"}}
    plane = rmse(tmp_path, {"measurements": "plots.csv", "truth": "xy.csv"})
    assert plane < 30.0
    assert rmse(tmp_path, target | {"clockwise": ["azimuth"]}) == pytest.approx(plane, rel=1e-6)
    # Without the key truth and measurements are mirror images, and a note says so.
    (note,) = load(config(tmp_path, target, RADAR)).points[0].scenario.cautions
    assert note.startswith(
        "nearly every measurement of the sensor disagrees with the truth (median: "
    )
    assert note.endswith("if its azimuth counts from north clockwise: say `clockwise: [azimuth]`")
    for bad, what in (("range", "'range' is no angle that is measured here"), ("course", "always")):
        with pytest.raises(UserError, match=what):
            load(config(tmp_path, target | {"clockwise": [bad]}, RADAR))


FILE = np.degrees(np.arctan2(PLACE[1], PLACE[0]) + 3.5e-3 * NOISE[1])
"""Azimuths, deg, from x to y."""


@pytest.mark.parametrize(
    ("azimuths", "clockwise", "words"),
    [
        (FILE, True, "counts from x to y: leave `clockwise: [azimuth]` out"),
        (-FILE, True, "counts from x clockwise: convert its angles"),
        (FILE - 90.0, True, "counts from north to west: convert its angles"),
        (270.0 - FILE, True, "counts from the opposite direction: convert its angles"),
        (FILE - 180.0, False, "counts from the opposite direction: convert its angles"),
        (-90.0 - FILE, False, "counts from south clockwise: convert its angles"),
    ],
)
def test_a_wrong_direction_of_azimuths_is_named_as_it_stands_in_the_file(
    tmp_path: Path, azimuths: Any, clockwise: bool, words: str
) -> None:
    """Also if the config says that angles are clockwise, which they are not."""
    write(tmp_path)
    ranges = np.hypot(*PLACE) + 15.0 * NOISE[0]
    (tmp_path / "m.csv").write_text(table("time,range,azimuth", TIMES, ranges, azimuths % 360.0))
    target = {"truth": "xy.csv", "measurements": "m.csv", "units": {"azimuth": "deg"}}
    if clockwise:
        target["clockwise"] = ["azimuth"]
    (note,) = load(config(tmp_path, target, RADAR)).points[0].scenario.cautions
    assert note.endswith(words)


def test_a_truth_that_is_mirrored_near_the_diagonal_is_noted(tmp_path: Path) -> None:
    """Most measurements then lie within ten standard deviations of it."""
    line = 9.0 * TIMES
    x, y = np.stack([line, 0.75 * line]) + 5.0 * NOISE
    (tmp_path / "m.csv").write_text(table("time,x,y", TIMES, x, y))
    (tmp_path / "t.csv").write_text(table("time,px,py", TIMES, 0.75 * line, line))
    target = {"measurements": "m.csv", "truth": "t.csv"}
    (note,) = load(config(tmp_path, target, POSITION)).points[0].scenario.cautions
    assert note.startswith("the truth and the measurements of the sensor disagree (median: ")
    assert "they agree if the truth is mirrored at the diagonal x = y" in note


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        ([3600.0, 900.0], "say its unit, `units: {azimuth: deg/10}` (or mrad, deg/100, acp)"),
        ([3600.0, 900.0], "write degrees if a turn has 6400, 16384 or 65536 counts"),
        ([36000.0, 900.0], "say its unit, `units: {azimuth: deg/100}`, or write degrees if a"),
        ([65000.0, 900.0], "cells: write degrees if a turn has 65536 counts, or correct the"),
    ],
)
@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_large_numbers_of_azimuths_have_several_units(
    tmp_path: Path, numbers: list[float], words: str, unit: str
) -> None:
    largest, least = numbers
    azimuths = np.linspace(least, largest, len(TIMES))
    (tmp_path / "m.csv").write_text(table("time,range,azimuth", TIMES, np.hypot(*PLACE), azimuths))
    target = {"measurements": "m.csv", "units": {"azimuth": unit}}
    with pytest.raises(UserError) as caught:
        load(config(tmp_path, target, RADAR))
    message = str(caught.value)
    assert f" {unit} is beyond a whole turn" in message
    assert words.removeprefix("cells: ") in message


@pytest.mark.parametrize(
    ("factor", "offset", "words"),
    [
        (1.0, 0.0, ""),
        (1.0 / 0.3048, 0.0, "if its z is multiplied by 0.3: are feet and m mixed up?"),
        (1.0, 48.0, "if its z is lower by 4"),
        (1.0, -48.0, "if its z is higher by 4"),
    ],
)
def test_heights_in_feet_or_above_the_sea_are_explained(
    tmp_path: Path, factor: float, offset: float, words: str
) -> None:
    heights = 500.0 + 3.0 * TIMES
    places = zip(*(geodetic(x, y) for x, y in (PLACE - PLACE[:, :1]).T), strict=True)
    latitude, longitude = (np.array(axis) for axis in places)
    measured = factor * (heights + offset + NOISE[0])
    names = "time,latitude,longitude,altitude"
    (tmp_path / "m.csv").write_text(table(names, TIMES, latitude, longitude, measured))
    (tmp_path / "t.csv").write_text(table(names, TIMES, latitude, longitude, heights))
    target = {"measurements": "m.csv", "truth": "t.csv", "axes": 3}
    sensor = {"kind": "position-3d", "sigma": 1}
    notes = load(config(tmp_path, target, sensor)).points[0].scenario.cautions
    assert len(notes) == bool(words)
    assert all(words in note for note in notes)
    lines = (tmp_path / "m.csv").read_text().replace("altitude", "alt_m")
    (tmp_path / "m.csv").write_text(lines)
    with pytest.raises(UserError, match="no column altitude; there are time, latitude, longitude"):
        load(config(tmp_path, target, sensor))


PATH = np.stack([9.0 * TIMES, 200.0 * np.sin(TIMES / 9.0)])
SPEEDS = np.stack([np.full(len(TIMES), 9.0), 200.0 / 9.0 * np.cos(TIMES / 9.0)])


@pytest.mark.parametrize(
    ("speeds", "words"),
    [
        (SPEEDS, ""),
        (3.6 * SPEEDS, "are 3.6 times as fast as the positions move: are they in km/h?"),
        (SPEEDS * 3600.0 / 1852.0, "are 1.9 times as fast as the positions move: are they in kn?"),
        (7.0 * SPEEDS, " times as fast as the positions move: check their unit"),
        (SPEEDS[::-1], "have other directions than the positions move in; they agree if vx and vy"),
        (-SPEEDS, "they agree in the opposite direction"),
        (0.0 * SPEEDS, "are 0 in 100 % of the rows where positions move: empty these cells"),
    ],
)
def test_velocities_that_contradict_the_positions_are_noted(
    tmp_path: Path, speeds: Any, words: str
) -> None:
    """Those of a truth, and measured ones."""
    x, y = PATH + 1.0 * NOISE
    (tmp_path / "m.csv").write_text(table("time,x,y,vx,vy", TIMES, x, y, *speeds))
    (tmp_path / "t.csv").write_text(table("time,px,py,vx,vy", TIMES, *PATH, *speeds))
    (tmp_path / "p.csv").write_text(table("time,x,y", TIMES, x, y))
    position = {"kind": "position", "sigma": 1}
    sensors = [position, {"kind": "velocity", "sigma": 1}]
    measured = load(config(tmp_path, {"measurements": "m.csv"}, sensors)).points[0].scenario
    target = {"measurements": "p.csv", "truth": "t.csv"}
    true = load(config(tmp_path, target, position)).points[0].scenario
    for scenario, whose in ((measured, "measured velocities "), (true, "velocities of the truth ")):
        notes = [note for note in scenario.cautions if note.startswith(whose)]
        assert len(notes) == bool(words)
        assert all(words in note for note in notes)


@pytest.mark.parametrize(
    ("change", "late", "words"),
    [
        (lambda x, y: (x, y), 0.0, ""),
        (lambda x, y: (x + 10.0, y), 0.0, ""),
        (lambda x, y: (y, x), 0.0, "they agree if x and y of one of them are exchanged"),
        (lambda x, y: (x, -y), 0.0, "they agree if y of one of them has the other sign"),
        (lambda x, y: (x, y), 15.0, "they agree if the second is some 15 s behind the first"),
        (lambda x, y: (x - 500.0, y + 90.0), 0.0, "they agree if the second is moved by ["),
        (lambda x, y: (7.0 * x, y * y), 0.0, "check their units, clocks and origins"),
    ],
)
def test_sensors_whose_positions_contradict_each_other_are_noted(
    tmp_path: Path, change: Any, late: float, words: str
) -> None:
    t = np.arange(0.0, 200.0, 2.0)
    noise = np.random.default_rng(4).normal(size=(4, len(t)))
    x, y = np.stack([9.0 * t, 300.0 * np.sin(t / 40.0)])
    (tmp_path / "a.csv").write_text(table("time,x,y", t, x + noise[0], y + noise[1]))
    other_x, other_y = change(x, y)
    columns = (t + 1.0 + late, other_x + 9.0 + noise[2], other_y + noise[3])
    (tmp_path / "b.csv").write_text(table("time,x,y", *columns))
    sensors = [{"kind": "position", "sigma": 2}, {"kind": "position", "sigma": 2}]
    written = config(tmp_path, {"measurements": ["a.csv", "b.csv"]}, sensors)
    notes = [note for note in load(written).points[0].scenario.cautions if " apart (" in note]
    assert len(notes) == bool(words)
    assert all(words in note for note in notes)
    assert all(note.startswith("positions of sensor 1 and sensor 2 lie ") for note in notes)


def test_bearings_of_a_station_elsewhere(tmp_path: Path) -> None:
    write(tmp_path)
    at = (-900.0, 400.0)
    bearing = np.arctan2(PLACE[1] - at[1], PLACE[0] - at[0]) + 3.5e-3 * NOISE[1]
    (tmp_path / "m.csv").write_text(table("time,azimuth", TIMES, 0.5 * np.pi - bearing))
    sensor = {"kind": "bearing", "at": [*at], "sigma_mrad": 3.5}
    start = {"kind": "given", "mean": [4e3, -20, 7e3, 10], "sigma": [100, 10, 100, 10]}
    target = {"measurements": "m.csv", "truth": "xy.csv"}
    (note,) = load(config(tmp_path, target, sensor, start=start)).points[0].scenario.cautions
    assert note.endswith("if its azimuth counts from north clockwise: say `clockwise: [azimuth]`")
    target["clockwise"] = ["azimuth"]
    scenario = load(config(tmp_path, target, sensor, start=start)).points[0].scenario
    assert scenario.cautions == ()
    np.testing.assert_allclose(scenario.target._recording.measurements[0, :, 0], bearing, rtol=1e-9)


def test_a_truth_that_contradicts_the_measurements_is_noted(tmp_path: Path) -> None:
    x, y = PLACE + 5.0 * NOISE
    (tmp_path / "m.csv").write_text(table("time,x,y", TIMES, x, y))
    notes = []
    for truth in ((PLACE[0], PLACE[1]), (PLACE[1], PLACE[0]), (-PLACE[1], PLACE[0]), PLACE - 900.0):
        (tmp_path / "t.csv").write_text(table("time,px,py", TIMES, *truth))
        target = {"measurements": "m.csv", "truth": "t.csv"}
        notes.append(load(config(tmp_path, target, POSITION)).points[0].scenario.cautions)
    assert notes[0] == ()
    assert (
        "they agree if the truth is mirrored at the diagonal x = y: are x and y exchanged"
        in notes[1][0]
    )
    assert "they agree if the truth is turned by 270 deg: are x and y exchanged" in notes[2][0]
    assert re.search(
        r"they agree if the truth is moved by \[(89|90)\d, (89|90)\d\] m: do both count from one origin",
        notes[3][0],
    )
    # No simple change explains axes that are turned by 20 deg.
    turned = np.array([[0.94, -0.34], [0.34, 0.94]]) @ PLACE
    (tmp_path / "t.csv").write_text(table("time,px,py", TIMES, *turned))
    (note,) = load(config(tmp_path, target, POSITION)).points[0].scenario.cautions
    assert note.endswith("): check the origin, the units, the clock and the sensor's sigma")


def test_the_zone_in_the_name_of_a_column(tmp_path: Path) -> None:
    stamps = [f"2026-05-04 10:00:{t:02.0f}" for t in TIMES]
    x, y = PLACE
    (tmp_path / "m.csv").write_text(table("Time (UTC),x,y", stamps, x, y))
    zoned = [f"{stamp.replace(' ', 'T')}Z" for stamp in stamps]
    (tmp_path / "t.csv").write_text(table("time,px,py", zoned, x, y))
    target = {"measurements": "m.csv", "truth": "t.csv", "columns": {"time": "Time (UTC)"}}
    assert rmse(tmp_path, target | {"truth_naming": {}}, POSITION) < 60.0
    (tmp_path / "m.csv").write_text(table("local time,x,y", stamps, x, y))
    target["columns"] = {"time": "local time"}
    with pytest.raises(UserError, match="has dates with a zone, and that of"):
        load(config(tmp_path, target | {"truth_naming": {}}, POSITION))


def test_azimuths_from_0_to_360_are_guessed_to_be_clockwise(tmp_path: Path) -> None:
    azimuth = np.linspace(170.0, 300.0, len(TIMES))
    (tmp_path / "compass.csv").write_text(table("time,range,azimuth_deg", TIMES, TIMES, azimuth))
    assert recognized(str(tmp_path / "compass.csv")).naming.clockwise == ("azimuth",)
    # Azimuths within half a turn are open, unless the name says more.
    (tmp_path / "open.csv").write_text(CLOCKWISE.replace("azimuth", "azimuth_deg"))
    guess = recognized(str(tmp_path / "open.csv"))
    assert not guess.naming.clockwise
    assert len(guess.questions) == 2
    write(tmp_path)
    for name in ("plots.csv", "xy.csv"):
        assert recognized(str(tmp_path / name)).naming.clockwise is None
    mixed = np.linspace(-100.0, 100.0, len(TIMES))
    (tmp_path / "half.csv").write_text(table("time,range,azimuth_deg", TIMES, TIMES, mixed))
    assert recognized(str(tmp_path / "half.csv")).naming.clockwise is None
    (tmp_path / "half.csv").write_text(table("time,range,bearing_true", TIMES, TIMES, mixed))
    assert recognized(str(tmp_path / "half.csv")).naming.clockwise == ("azimuth",)
