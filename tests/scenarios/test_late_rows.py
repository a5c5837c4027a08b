"""`new experiment --from` reads what begins in a long table only after its first 10 000 rows."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from trackbench.config.load import load
from trackbench.errors import UserError
from trackbench.new_experiment_from_tables import write_config_for
from trackbench.scenarios.recordings.csv_layout_and_rows import TextFormat
from trackbench.scenarios.recordings.guess_table_sample import TableSample
from trackbench.scenarios.recordings.guess_time_and_date_columns import day_column
from trackbench.scenarios.recordings.naming_of_columns import Naming

pytestmark = pytest.mark.usefixtures("no_report")

RNG = np.random.default_rng(3)
ROWS = 11_000
T = 0.1 * np.arange(ROWS)
NOISE = {"a": 1.0, "b": 3.0, "c": 2.0, "": 1.0}


def position(row: int, sensor: str = "") -> tuple[str, str]:
    """Return the measured x and y of a row."""
    sigma = NOISE[sensor]
    x = 3.0 * T[row] + sigma * RNG.normal()
    y = 100.0 + 2.0 * T[row] + sigma * RNG.normal()
    return f"{x:.2f}", f"{y:.2f}"


def written(
    path: Path, rows: Sequence[Sequence[str]], *changes: str, truth: Path | None = None
) -> Any:
    """Write a table, of which the first row has the names, and return the scenario of its config."""
    path.write_text("\n".join(map(",".join, rows)) + "\n")
    config = write_config_for(path, path.stem, path.parent, changes, truth)
    return yaml.safe_load(config.paths[0].read_text())["scenario"]


def test_a_sensor_that_begins_late_is_one_of_the_config(tmp_path: Path) -> None:
    rows = [("time", "sensor", "x", "y")]
    for row in range(ROWS):
        sensor = "ab"[row % 2] if row < 10_100 else "abc"[row % 3]
        rows.append((f"{T[row]:.1f}", sensor, *position(row, sensor)))
    scenario = written(tmp_path / "m.csv", rows)
    assert scenario["target"]["sensors"] == ["a", "b", "c"]
    assert [round(sensor["sigma"]) for sensor in scenario["sensor"]] == [1, 3, 2]


def test_a_table_sorted_by_sensor_has_all_of_them(tmp_path: Path) -> None:
    """Also if a later one measures a quantity of its own, with the digits of its own column."""
    rows = [("time", "sensor", "x", "y", "range")]
    for row in range(ROWS):
        rows.append((f"{T[row]:.1f}", "gps", *position(row), ""))
    for row in range(0, ROWS, 10):
        distance = np.hypot(3.0 * T[row], 100.0 + 2.0 * T[row]) + 0.1 * RNG.normal()
        rows.append((f"{T[row]:.1f}", "uwb", "", "", f"{distance:.3f}"))
    scenario = written(tmp_path / "m.csv", rows)
    assert scenario["target"]["sensors"] == ["gps", "uwb"]
    assert [sensor["kind"] for sensor in scenario["sensor"]] == ["position", "range"]
    assert scenario["sensor"][1]["sigma"] < 0.5


def test_a_sensor_may_have_no_rows_in_the_longest_run(tmp_path: Path) -> None:
    """Its errors are those in another run, and the config runs without its rows."""
    rows = [("time", "run", "sensor", "x", "y")]
    for run, length in (("1", 600), ("2", 400)):
        for row in range(length):
            sensor = "ab"[row % 2] if run == "1" else "bc"[row % 2]
            rows.append((f"{T[row]:.1f}", run, sensor, *position(row, sensor)))
    scenario = written(tmp_path / "m.csv", rows)
    assert scenario["target"]["runs"] == [1]
    assert [round(sensor["sigma"]) for sensor in scenario["sensor"]] == [1, 3, 2]


def test_a_number_for_missing_cells_may_be_late(tmp_path: Path) -> None:
    rows = [("time", "x", "y")]
    rows += [(f"{T[row]:.1f}", *position(row)) for row in range(ROWS)]
    for row in (10_200, 10_500):
        rows[row] = (rows[row][0], "-9999", "-9999")
    scenario = written(tmp_path / "m.csv", rows)
    assert scenario["target"]["missing"] == [-9999]
    assert written(tmp_path / "other.csv", rows, "missing=[]")["target"]["missing"] == []


def test_an_empty_list_says_that_no_number_is_missing(tmp_path: Path) -> None:
    """A number far outside the others, among the first rows, was guessed in spite of it."""
    rows = [("time", "x", "y")]
    rows += [(f"{T[row]:.1f}", *position(row)) for row in range(100)]
    for row in (10, 40):
        rows[row] = (rows[row][0], "-9999", "-9999")
    assert written(tmp_path / "m.csv", rows)["target"]["missing"] == [-9999]
    # The answer stands in the config, which has no note that proposes the number again.
    for name, answer, noted in (
        ("all", "missing=[]", []),
        ("x", "missing.x=[]", ["y"]),
        ("y", "missing.y=[]", ["x"]),
    ):
        scenario = written(tmp_path / f"{name}.csv", rows, answer)
        numbers: Any = [] if name == "all" else {name: []}
        assert scenario["target"]["missing"] == numbers
        notes = load(tmp_path / f"{name}.yaml").points[0].scenario.cautions
        assert [note.partition(": 2 cells are -9999")[0] for note in notes] == [
            f"{name}.csv: {column}" for column in noted
        ]
    # In one of several files it undoes the key of the target; so does that of one of several columns.
    target = Naming(missing=(-9999.0,))
    assert Naming(missing=()).with_defaults(target).missing_numbers("x") == ()
    assert Naming().with_defaults(target).missing_numbers("x") == (-9999.0,)
    ranges = Naming(missing={"range": (0.0,), "2.range": ()})
    assert [ranges.missing_numbers(name) for name in ("1.range", "2.range")] == [(0.0,), ()]


def test_rows_of_a_sensor_that_measures_nothing_known_may_be_left_out(tmp_path: Path) -> None:
    """100 rows of an IMU a second stand beside one of a GPS receiver."""
    rows = [("time", "sensor", "ax", "ay", "x", "y")]
    for row in range(5000):
        rows.append(
            (f"{0.01 * row:.2f}", "imu", f"{RNG.normal():.3f}", f"{RNG.normal():.3f}", "", "")
        )
        if row % 100 == 0:
            rows.append((f"{0.01 * row:.2f}", "gps", "", "", *position(row // 10)))
    with pytest.raises(UserError) as error:
        written(tmp_path / "m.csv", rows)
    assert "column sensor names imu beside others, with no x and y" in str(error.value)
    assert "leave their rows out, `--set 'columns.sensor=sensor'`" in str(error.value)
    scenario = written(tmp_path / "other.csv", rows, "columns.sensor=sensor")
    assert scenario["target"]["sensors"] == ["gps"]


def long_recording(folder: Path, begin_of_truth: int) -> Any:
    """Write a recording of 104 000 steps and a truth from a step on; return the scenario."""
    times = np.arange(104_000)
    rows = [("time", "x", "y")]
    rows += [(str(t), f"{3 * t + RNG.normal():.1f}", f"{RNG.normal():.1f}") for t in times]
    truth = folder / "truth.csv"
    lines = ["time,x,y", *(f"{t},{3 * t},0" for t in times[begin_of_truth:])]
    truth.write_text("\n".join(lines) + "\n")
    return written(folder / "m.csv", rows, truth=truth)


def test_the_last_step_of_a_long_recording_is_after_the_begin_of_its_truth(tmp_path: Path) -> None:
    assert long_recording(tmp_path, 50_000)["last"] == 70_000


def test_a_truth_that_begins_too_late_is_a_question(tmp_path: Path) -> None:
    with pytest.raises(UserError) as error:
        long_recording(tmp_path, 102_000)
    message = str(error.value)
    assert (
        "the truth begins some 102000 steps after these rows, and a run has at most 100000"
        in message
    )
    assert "leave out the rows before the truth" in message


@pytest.mark.parametrize("cell", ["", "nan"])
def test_positions_may_begin_after_the_first_rows(tmp_path: Path, cell: str) -> None:
    """A logger that runs before the receiver has a fix writes empty cells."""
    rows = [("time", "x", "y")]
    for row in range(ROWS):
        place = position(row) if row > 10_100 else (cell, cell)
        rows.append((f"{T[row]:.1f}", *place))
    scenario = written(tmp_path / "m.csv", rows)
    assert [sensor["kind"] for sensor in scenario["sensor"]] == ["position"]
    assert round(scenario["sensor"][0]["sigma"]) == 1


def test_a_sensor_may_measure_only_after_the_first_rows(tmp_path: Path) -> None:
    """Its rows before have empty cells, beside those of a sensor that measures from the beginning."""
    rows = [("time", "sensor", "x", "y", "range")]
    for row in range(ROWS):
        if row % 2:
            distance = np.hypot(3.0 * T[row], 100.0 + 2.0 * T[row]) + 0.1 * RNG.normal()
            rows.append((f"{T[row]:.1f}", "uwb", "", "", f"{distance:.3f}"))
        else:
            place = position(row) if row > 10_100 else ("", "")
            rows.append((f"{T[row]:.1f}", "gps", *place, ""))
    scenario = written(tmp_path / "m.csv", rows)
    assert scenario["target"]["sensors"] == ["uwb", "gps"]
    assert [sensor["kind"] for sensor in scenario["sensor"]] == ["range", "position"]
    assert round(scenario["sensor"][1]["sigma"]) == 1


def test_a_question_names_the_line_of_the_first_row_of_its_sample(tmp_path: Path) -> None:
    """Nothing is measured in the first rows, so that the sample begins after them."""
    rows = [("time", "x", "y")]
    for row in range(ROWS):
        place = position(row) if row > 10_100 else ("", "")
        rows.append((f"{2024.33701 + 3e-8 * row:.9f}", *place))
    with pytest.raises(UserError, match=r"m\.csv:10103:1: time: is 2024\.337313030 a year"):
        written(tmp_path / "m.csv", rows)


@pytest.mark.parametrize(
    ("names", "cells", "message"),
    [
        ("time,latitude,longitude", ("", "47N"), r"m\.csv:5:1: latitude: '47N' is not a number"),
        ("time,x,y,utm_zone", ("32T", "33T"), r"m\.csv:5:1: utm_zone has 32T, 33T"),
        ("time,lat,lon,lat_dir", ("", "up"), r"m\.csv:5:1: lat_dir has up: does it name the"),
    ],
)
def test_a_question_names_the_line_of_the_cell_that_it_shows(
    tmp_path: Path, names: str, cells: tuple[str, str], message: str
) -> None:
    first, later = cells
    rows = [tuple(names.split(","))]
    for row in range(9):
        cell = first if row < 3 else later
        if names.endswith("longitude"):
            rows.append((str(row), cell, f"{8.0 + 1e-4 * row:.5f}"))
        else:
            rows.append((str(row), f"{47.0 + 1e-4 * row:.5f}", f"{8.0 + 2e-4 * row:.5f}", cell))
    with pytest.raises(UserError, match=message):
        written(tmp_path / "m.csv", rows)


def test_later_rows_are_read_for_each_choice_of_measured_columns(tmp_path: Path) -> None:
    """A sensor whose first rows lack a number in these columns counts as lacking itself."""
    path = tmp_path / "m.csv"
    lines = ["time,sensor,x,range"]
    for row in range(ROWS):
        x = "1.0" if row > 10_100 else ""
        lines.append(f"{row},{'ab'[row % 2]},{x},5.0")
    path.write_text("\n".join(lines) + "\n")
    sample = TableSample(str(path), ["time", "sensor", "x", "range"], TextFormat())
    assert len(sample.further("sensor", ["range"])) == 0
    assert sample.further("sensor", ["x"]).words("sensor") == ["b", "a"]


def test_an_unnamed_column_of_dates_is_no_column_of_days(tmp_path: Path) -> None:
    path = tmp_path / "m.csv"
    path.write_text(",time,x\n2024-05-03,10:00,1\n2024-05-03,10:01,2\n")
    assert day_column(TableSample(str(path), ["", "time", "x"], TextFormat())) is None
    assert day_column(TableSample(str(path), ["Day", "time", "x"], TextFormat())) == "Day"
