"""`new experiment --from` reads ranges to several places whose names have no numbers."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from trackbench.errors import UserError
from trackbench.new_experiment_from_tables import write_config_for
from trackbench.scenarios.recordings.columns_of_ranges_to_places import ranges_of

pytestmark = pytest.mark.usefixtures("no_report")

RNG = np.random.default_rng(8)
T = np.arange(0.0, 60.0, 0.5)
PLACES = ((0.0, 0.0), (100.0, 0.0), (100.0, 80.0), (0.0, 80.0))
RANGES = [
    np.hypot(20.0 + T - x, 30.0 + 0.5 * T - y) + 0.3 * RNG.normal(size=len(T)) for x, y in PLACES
]


def target_and_sensors(path: Path, names: str, *changes: str) -> tuple[Any, Any]:
    """Write a table of a time and ranges below these names, and return what its config has on it."""
    columns = [T, *RANGES[: names.count(",")]]
    rows = (",".join(f"{value:.3f}" for value in row) for row in zip(*columns, strict=True))
    path.write_text("\n".join([names, *rows]) + "\n")
    config = write_config_for(path, "g", path.parent, changes)
    scenario = yaml.safe_load(config.paths[0].read_text())["scenario"]
    return scenario["target"], scenario["sensor"]


@pytest.mark.parametrize(
    ("names", "places"),
    [
        ("time,range_A,range_B,range_C,range_D", "ABCD"),
        ("time,dist_north,dist_east,dist_south,dist_west", ("NORTH", "EAST", "SOUTH", "WEST")),
        ("time,anchor_a_dist,anchor_b_dist,anchor_c_dist", "ABC"),
        ("time,d_A,d_B,d_C,d_D", "ABCD"),
        ("time,Anchor_A,Anchor_B,Anchor_C", "ABC"),
        ("time,RangeToPier (m),RangeToMast (m),RangeToBuoy (m)", ("PIER", "MAST", "BUOY")),
    ],
)
def test_columns_that_differ_in_one_label_are_ranges(
    tmp_path: Path, names: str, places: tuple[str, ...]
) -> None:
    target, sensors = target_and_sensors(tmp_path / "m.csv", names)
    columns = names.split(",")
    expected = {f"{number}.range": name for number, name in enumerate(columns[1:], 1)}
    assert target["columns"] == {"time": "time", **expected}
    assert [sensor["kind"] for sensor in sensors] == ["range"] * len(places)
    assert [sensor["at"] for sensor in sensors] == [[f"X_{p}", f"Y_{p}"] for p in places]
    # The D of range_D is no unit of a day.
    expected_units = dict.fromkeys(expected, "m") if "(m)" in names else None
    assert target.get("units") == expected_units


def test_the_columns_that_are_read_as_ranges_are_printed(tmp_path: Path) -> None:
    """They are recognized by their names alone, and one of them may be read in their place."""
    rows = (",".join(f"{value:.3f}" for value in row) for row in zip(T, *RANGES[:3], strict=True))
    names = "time,dist_lap,dist_leg,dist_trip"
    (tmp_path / "m.csv").write_text("\n".join([names, *rows]) + "\n")
    config = write_config_for(tmp_path / "m.csv", "g", tmp_path)
    way = "to read one alone: --set 'columns.range=ITS NAME'"
    assert f"read dist_lap, dist_leg, dist_trip as ranges to 3 places; {way}" in config.units
    config.paths[0].unlink()
    _, sensors = target_and_sensors(tmp_path / "o.csv", names, "columns.range=dist_leg")
    assert len(sensors) == 1


@pytest.mark.parametrize(
    "names",
    [
        "range_min range_max range_std",
        "range_m range_ft range_rate",
        "dist_x dist_y dist_z",
        "range_true range_meas range_error",
        "d_roll d_pitch d_yaw",
        "distance_front distance_left distance_right",
        "range_valid range_snr range_count",
        "range_rate_a range_rate_b range_rate_c",
        "anchor_lat anchor_lon anchor_alt",
        "range_a range_b",
    ],
)
def test_statistics_axes_and_units_are_no_places(names: str) -> None:
    assert ranges_of(names.split()) == {}


def test_the_unit_of_labeled_ranges_is_read_from_their_line_of_units(tmp_path: Path) -> None:
    path = tmp_path / "m.csv"
    rows = ["t,range_A,range_B,range_C", "s,cm,cm,cm"]
    for row in zip(T, *RANGES[:3], strict=True):
        rows.append(f"{row[0]},{100 * row[1]:.1f},{100 * row[2]:.1f},{100 * row[3]:.1f}")
    path.write_text("\n".join(rows) + "\n")
    config = write_config_for(path, "g", tmp_path)
    target = yaml.safe_load(config.paths[0].read_text())["scenario"]["target"]
    assert [target["units"][f"{number}.range"] for number in (1, 2, 3)] == ["cm"] * 3


@pytest.mark.parametrize("names", ["t,range_A,range_B,range_C", "t,range_1,range_2,range_3"])
def test_the_unit_that_the_user_names_is_that_of_all_ranges(tmp_path: Path, names: str) -> None:
    """The errors were in this unit, and the config read the ranges in meters."""
    target, sensors = target_and_sensors(tmp_path / "m.csv", names, "units.range=km")
    assert target["units"] == {f"{number}.range": "km" for number in (1, 2, 3)}
    assert all(200.0 <= sensor["sigma"] <= 400.0 for sensor in sensors)


def test_the_question_on_an_unknown_unit_of_ranges_has_an_answer(tmp_path: Path) -> None:
    names = "t,range_A_yd,range_B_yd,range_C_yd"
    with pytest.raises(UserError) as error:
        target_and_sensors(tmp_path / "m.csv", names)
    assert "such as --set units.range=m" in str(error.value)
    target_and_sensors(tmp_path / "m.csv", names, "units.range=ft")


def test_the_question_on_x_offers_no_time(tmp_path: Path) -> None:
    with pytest.raises(UserError) as error:
        target_and_sensors(tmp_path / "m.csv", "time,kitchen,hall,door")
    message = str(error.value)
    assert "`--set 'columns.x=kitchen' --set 'columns.y=hall'`" in message
    assert "ranges to several places have names such as range_1 and range_2" in message


def test_a_question_names_few_of_many_columns(tmp_path: Path) -> None:
    path = tmp_path / "m.csv"
    names = [f"value{number}" for number in range(120)]
    rows = [",".join(["time", *names])]
    rows += [",".join([str(row), *(str(row * k % 7) for k in range(120))]) for row in range(30)]
    path.write_text("\n".join(rows) + "\n")
    with pytest.raises(UserError) as error:
        write_config_for(path, "g", tmp_path)
    assert "value22 and 97 more: say which are" in str(error.value)
