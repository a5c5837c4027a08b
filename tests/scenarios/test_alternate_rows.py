"""Tables in which rows of positions and rows of velocities take turns, as messages of two types."""

from pathlib import Path

import numpy as np
import pytest

from tests.commands import trackbench
from tests.scenarios.test_clocks import config
from tests.scenarios.test_device_tables import KNOT, Path2, decimal, guessed, lonlat, table
from trackbench.config.load import load
from trackbench.errors import UserError
from trackbench.scenarios.recordings.rows_and_reading_context import values_of_nearest_rows

AIRCRAFT = Path2(rows=120, usual_speed=60.0, every=0.5)
UNIX = 1714730400.0


def in_turn(cells: list[str], first: int) -> list[str]:
    """Return the cells with every second one empty, from that with the index 1 - ``first`` on."""
    return [cell if row % 2 == first else "" for row, cell in enumerate(cells)]


def written(path: Path2, velocity: list[list[str]], names: str = "speed,course") -> str:
    """Return a table whose rows of positions and of a velocity alternate."""
    longitude, latitude = (in_turn(cells, 0) for cells in lonlat(path))
    cells = (in_turn(column, 1) for column in velocity)
    return table(f"time,lat,lon,{names}", decimal(UNIX + path.t, 1), latitude, longitude, *cells)


@pytest.mark.parametrize(("unit", "size"), [("kn", KNOT), ("km/h", 1.0 / 3.6), ("m/s", 1.0)])
def test_the_unit_of_a_speed_between_positions_is_found(
    tmp_path: Path, unit: str, size: float
) -> None:
    velocity = [decimal(AIRCRAFT.speed / size, 0), decimal(AIRCRAFT.course, 0)]
    scenario, content = guessed(tmp_path, written(AIRCRAFT, velocity))
    assert content["target"]["units"]["speed"] == unit
    assert [sensor["kind"] for sensor in content["sensor"]] == ["position", "velocity"]
    measured = scenario.target._recording.measurements[2:, :, 0]
    known = np.isfinite(measured).all(axis=0)
    assert known.sum() == AIRCRAFT.rows // 2
    # Speeds are rounded to a unit of at most 0.52 m/s, and courses to 1 deg.
    largest = 0.5 * size + np.radians(0.5) * AIRCRAFT.speed.max()
    differences = measured[:, known] - AIRCRAFT.velocity[:, 1::2]
    assert np.hypot(*differences).max() < largest + 0.05


def test_a_velocity_to_the_north_in_vx_is_found_between_positions(tmp_path: Path) -> None:
    north_first = [decimal(part, 2) for part in AIRCRAFT.velocity[::-1]]
    _, content = guessed(tmp_path, written(AIRCRAFT, north_first, names="vx,vy"))
    assert content["target"]["columns"]["vx"] == "vy"


@pytest.mark.parametrize(
    ("factor", "turn", "reason"),
    [
        (1.7, 0.0, "they are 1.7 times as fast as the positions move"),
        (1.0, -50.0, "they have other directions than the positions move in, usually by 50 deg"),
    ],
)
def test_what_a_velocity_disagrees_by_is_said_and_the_user_may_use_it(
    tmp_path: Path, factor: float, turn: float, reason: str
) -> None:
    course = (AIRCRAFT.course + turn) % 360.0
    velocity = [decimal(factor * AIRCRAFT.speed, 2), decimal(course, 1)]
    text = written(AIRCRAFT, velocity, names="speed_mps,course")
    (tmp_path / "m.csv").write_text(text)
    made = trackbench("new", "experiment", "g", "--from", "m.csv", cwd=tmp_path)
    assert f"velocities are left out: {reason}" in made.stdout
    (tmp_path / "g.yaml").unlink()
    _, options = made.stdout.split("to use them all the same: ")
    assert options.startswith("--set 'columns.speed=speed_mps' --set 'columns.course=course'\n")
    changes = ("--set", "columns.speed=speed_mps", "--set", "columns.course=course")
    made = trackbench("new", "experiment", "g", "--from", "m.csv", *changes, cwd=tmp_path)
    assert f"velocities are used, as you named them; but {reason}" in made.stdout
    assert "{kind: velocity" in (tmp_path / "g.yaml").read_text()


def test_a_message_of_mavlink_in_the_names_is_no_hindrance(tmp_path: Path) -> None:
    """Its positions are in degE7, its velocities in cm/s, and vx points north."""
    longitude, latitude = (decimal(1e7 * part, 0) for part in AIRCRAFT.degrees)
    north, east = (decimal(100.0 * part, 0) for part in AIRCRAFT.velocity[::-1])
    names = ",".join(f"GLOBAL_POSITION_INT.{name}" for name in ("lat", "lon", "vx", "vy"))
    columns = (latitude, longitude, north, east)
    text = table(f"Timestamp,{names}", decimal(UNIX + AIRCRAFT.t, 1), *columns)
    scenario, content = guessed(tmp_path, text)
    assert content["target"]["columns"]["vx"] == "GLOBAL_POSITION_INT.vy"
    measured = scenario.target._recording.measurements[2:, :, 0]
    np.testing.assert_allclose(measured, AIRCRAFT.velocity[:, 1:], atol=0.1)


def test_velocities_of_a_user_in_the_wrong_order_are_told_so(tmp_path: Path) -> None:
    north, east = (decimal(part, 2) for part in AIRCRAFT.velocity[::-1])
    text = table("time,lat,lon,n,e", decimal(AIRCRAFT.t, 1), *lonlat(AIRCRAFT)[::-1], north, east)
    (tmp_path / "m.csv").write_text(text)
    changes = ("--set", "columns.vx=n", "--set", "columns.vy=e")
    made = trackbench("new", "experiment", "--from", "m.csv", *changes, cwd=tmp_path)
    assert (
        "but they have other directions than the positions move in; they agree if vx" in made.stdout
    )


def with_types(path: Path2) -> str:
    """Return a table with a column of the types of messages: 3 has a position, 4 a velocity."""
    velocity = [decimal(path.speed, 2), decimal(path.course, 1)]
    header, *rows = written(path, velocity).splitlines()
    lines = [f"{header},type", *(f"{row},{3 + number % 2}" for number, row in enumerate(rows))]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("answer", ['columns.sensor=""', 'columns.run=""'])
def test_a_column_of_types_of_messages_may_name_no_sensors(tmp_path: Path, answer: str) -> None:
    with pytest.raises(UserError) as error:
        guessed(tmp_path, with_types(AIRCRAFT))
    message = str(error.value)
    assert "column type names 4 beside others, with no x and y" in message
    assert "or if type names no sensors, say `--set 'columns.sensor=\"\"'`" in message
    scenario, content = guessed(tmp_path, with_types(AIRCRAFT), answer)
    assert [sensor["kind"] for sensor in content["sensor"]] == ["position", "velocity"]
    assert np.isfinite(scenario.target._recording.measurements[2, :, 0]).sum() == AIRCRAFT.rows // 2


def test_an_empty_word_in_an_option_is_told(tmp_path: Path) -> None:
    with pytest.raises(UserError, match='null is not a word; write a word, or "" for an empty one'):
        guessed(tmp_path, with_types(AIRCRAFT), "columns.sensor=")


def test_a_column_of_sensors_without_velocities_is_the_reason(tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text(with_types(AIRCRAFT))
    change = ("--set", "columns.sensor=type")
    made = trackbench("new", "experiment", "--from", "m.csv", *change, cwd=tmp_path)
    assert "velocities are left out: they have no numbers in rows whose type is 3" in made.stdout


def test_a_speed_in_another_unit_between_positions_is_noted(tmp_path: Path) -> None:
    velocity = [decimal(AIRCRAFT.speed / KNOT, 1), decimal(AIRCRAFT.course, 1)]
    (tmp_path / "m.csv").write_text(written(AIRCRAFT, velocity))
    columns = {"latitude": "lat", "longitude": "lon"}
    sensors = [{"kind": "position", "sigma": 2}, {"kind": "velocity", "sigma": 1}]
    path = config(tmp_path, {"measurements": "m.csv", "columns": columns}, sensor=sensors)
    (note,) = [n for n in load(path).points[0].scenario.cautions if "velocities" in n]
    assert note.startswith("measured velocities are ")
    assert "times as fast as the positions move: are they in kn? See `units`" in note


@pytest.mark.parametrize("way", [None, "mean", "last"])
def test_a_position_and_a_velocity_of_one_time_are_both_read(
    tmp_path: Path, way: str | None
) -> None:
    """A row of a velocity comes after or before the position of its time, and one time has none."""
    rows = ["0,0,0,,", "0,,,5,0", "1,5,1,,", "2,,,5,0", "2,10,1,,", "3,,,5,1", "3,,,5,1", "4,,,,"]
    (tmp_path / "m.csv").write_text("\n".join(["time,x,y,vx,vy", *rows]) + "\n")
    sensors = [{"kind": "position", "sigma": 2}, {"kind": "velocity", "sigma": 1}]
    target = {"measurements": "m.csv", **({"same_time": way} if way else {})}
    path = config(tmp_path, target, sensor=sensors)
    scenario = load(path).points[0].scenario
    missing = np.nan
    expected = [
        [5.0, 10.0, missing, missing],
        [1.0, 1.0, missing, missing],
        [missing, 5.0, 5.0, missing],
        [missing, 0.0, 1.0, missing],
    ]
    measured = scenario.target._recording.measurements[:, :, 0]
    np.testing.assert_array_equal(measured, expected)
    assert [note for note in scenario.cautions if "row" in note] == [
        "1 row repeats the one before and was left out"
    ]


def test_a_value_far_away_in_time_is_not_the_nearest_one() -> None:
    known_time = np.array([3.0, 0.0, 1.0, np.nan, 2.0])
    values = np.array([[30.0, 0.0, 10.0, 50.0, 20.0]])
    time = np.array([-1.5, -0.5, 0.4, 0.6, 1.0, 3.9, 4.1, np.nan])
    nearest = values_of_nearest_rows(time, known_time, values)
    expected = [[np.nan, 0.0, 0.0, 10.0, 10.0, 30.0, np.nan, np.nan]]
    np.testing.assert_array_equal(nearest, expected)
    assert np.isnan(values_of_nearest_rows(time, known_time, values * np.nan)).all()


@pytest.mark.parametrize(("empty", "notes"), [(20, 1), (5, 0), (0, 0)])
def test_many_steps_with_a_truth_and_no_measurement_are_noted(
    tmp_path: Path, empty: int, notes: int
) -> None:
    time = np.arange(41.0)
    x = decimal(3.0 * time, 1)
    measured = ["" if row and row <= empty else cell for row, cell in enumerate(x)]
    (tmp_path / "m.csv").write_text(table("time,x,y", time, measured, measured))
    (tmp_path / "t.csv").write_text(table("time,px,py", time, x, x))
    path = config(tmp_path, {"measurements": "m.csv", "truth": "t.csv"})
    cautions = load(path).points[0].scenario.cautions
    assert [note.startswith("20 of 40 steps with a truth have no") for note in cautions] == [
        True
    ] * notes
