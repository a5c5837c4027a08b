"""A config for a robot's log: from where bearings count is asked for, as are the landmarks' places."""

import runpy
from pathlib import Path

import pytest
import yaml

from tests.commands import trackbench
from tests.conftest import ROOT
from trackbench.config.load import load
from trackbench.errors import UserError

pytestmark = pytest.mark.usefixtures("no_report")

DATA = ROOT / "experiments" / "data"
LOG = (DATA / "robot-log.csv").read_text()
SIMULATION = runpy.run_path(str(DATA / "robot_log.py"))  # not imported: the wheel has the folder
NAME = "columns.bearing=bearing [deg]"


def written(folder: Path, log: str, *sets: str) -> str:
    """Write a config for a log; return what is printed."""
    (folder / "log.csv").write_text(log)
    (folder / "log.yaml").unlink(missing_ok=True)
    options = [word for each in sets for word in ("--set", each)]
    done = trackbench("new", "experiment", "--from", "log.csv", *options, cwd=folder)
    return done.stdout + done.stderr


def test_from_where_bearings_count_is_a_question(tmp_path: Path) -> None:
    printed = written(tmp_path, LOG).splitlines()
    assert printed == [
        "log.csv:1:1: bearing [deg]: do the bearings of the landmarks (landmark) count from the robot's "
        f"heading? Say --set '{NAME}'",
        "log.csv:1:1: or do fixed sensors, such as radars, measure the direction to what moves, from "
        "the axis x or from north? Say --set 'columns.azimuth=bearing [deg]'",
    ]
    assert not (tmp_path / "log.yaml").exists()


def test_one_landmark_without_a_name_is_not_a_radar_at_the_origin(tmp_path: Path) -> None:
    lines = [line.split(",") for line in LOG.splitlines()[:300]]
    log = "\n".join(",".join([*cells[:3], *cells[4:]]) for cells in lines) + "\n"
    assert "do the bearings count from the robot's heading?" in written(tmp_path, log)
    printed = written(tmp_path, log, NAME)
    assert "write into it where these are: the landmark, the start\n" in printed
    config = yaml.safe_load((tmp_path / "log.yaml").read_text())
    assert config["scenario"]["sensor"][0]["at"] == ["X_SENSOR", "Y_SENSOR"]


def test_the_config_asks_for_places_and_start_and_guesses_the_rest(tmp_path: Path) -> None:
    printed = written(tmp_path, LOG, NAME)
    assert "write into it where these are: shelf, door, plant, desk, lamp, the start\n" in printed
    path = tmp_path / "log.yaml"
    with pytest.raises(UserError, match=r"at\.0: 'X_shelf' is not a number"):
        load(path)
    text = path.read_text()
    for name, (x, y) in SIMULATION["LANDMARKS"].items():
        text = text.replace(f"X_{name}, Y_{name}", f"{x}, {y}")
    assert "# write the pose at t = 0.1 s, m and rad," in text
    path.write_text(text.replace("X, Y, HEADING", "0, 0, 0.2"))
    (point,) = load(path).points
    target, motion = point.scenario.target, point.scenario.model.motion
    assert target.input == {"v": "v [m/s]", "w": "omega [deg/s]"}
    assert target.units == {"time": "s", "v": "m/s", "w": "deg/s", "range": "m", "bearing": "deg"}
    # The first step ends at the second row: 0.579 m/s and 23.23 deg/s.
    assert motion.known_inputs.at(1) == pytest.approx((0.579, 23.23 * 3.141592653589793 / 180))
    parameters = point.scenario.assume.motion.parameters
    assert parameters["sv"] == pytest.approx(SIMULATION["SIGMA_V"], rel=0.2)
    assert parameters["sw"] == pytest.approx(SIMULATION["SIGMA_W"], rel=0.2)


def test_without_odometry_its_columns_are_asked_for(tmp_path: Path) -> None:
    log = LOG.replace("omega [deg/s]", "spin")
    printed = written(tmp_path, log, NAME)
    assert (
        "no column looks like its turn rate (w), by which the robot's heading moves on" in printed
    )
    assert "say --set 'columns.w=ITS NAME'; odometry of another file is `input_file`" in printed
    printed = written(tmp_path, log, NAME, "columns.w=spin", "units.w=deg/s")
    assert "wrote log.yaml" in printed


@pytest.mark.parametrize("column", [2, 5])
def test_bearings_and_turn_rates_of_opposite_directions_are_a_question(
    tmp_path: Path, column: int
) -> None:
    """Column 2 has the turn rate, column 5 the bearing; each may count clockwise."""
    lines = [line.split(",") for line in LOG.splitlines()]
    for cells in lines[1:]:
        if cells[column]:
            cells[column] = str(-float(cells[column]))
    log = "\n".join(map(",".join, lines)) + "\n"
    printed = written(tmp_path, log, NAME)
    assert (
        "bearing [deg] and omega [deg/s] agree only if one of them counts clockwise: change the signs"
    ) in printed
    assert not (tmp_path / "log.yaml").exists()
    assert "wrote log.yaml" in written(tmp_path, log, NAME, "columns.w=omega [deg/s]")


def test_a_measurement_without_a_landmark_is_a_mistake(tmp_path: Path) -> None:
    printed = written(tmp_path, LOG.replace("shelf,4.11,-105.7", ",4.11,-105.7"), NAME)
    assert "log.csv:6:1: landmark: is missing beside a value of range [m]" in printed


def test_rows_of_odometry_must_name_no_landmark(tmp_path: Path) -> None:
    printed = written(tmp_path, LOG.replace(",,,\n", ",wheels,,\n"), NAME)
    assert (
        "landmark: rows of wheels have no range and no bearing; leave this cell of theirs empty, as "
        "rows of odometry alone see no landmark"
    ) in printed
