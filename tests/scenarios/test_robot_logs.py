"""A config for a robot's log: from where bearings count is asked for, as are the landmarks' places."""

import csv
import math
import re
import runpy
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from tests.commands import trackbench
from tests.conftest import ROOT
from trackbench import api
from trackbench.config.experiment import cautions
from trackbench.config.load import load
from trackbench.core.random_streams import RunStreams
from trackbench.errors import UserError
from trackbench.field_types import DataError
from trackbench.report.plotting import file_formats
from trackbench.scenarios.recordings.guess_table import recognized
from trackbench.scenarios.recordings.guess_truth import recognized_truth
from trackbench.scenarios.recordings.naming_of_columns import Naming
from trackbench.scenarios.recordings.odometry_columns import heading_of, odometry_of
from trackbench.scenarios.recordings.quaternions import quaternion_of

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
    assert (
        "say --set 'columns.w=ITS NAME'; of odometry in another file, name that, --input" in printed
    )
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
        "bearing [deg] and omega [deg/s] agree only if one of them counts clockwise: if the bearings "
        "do, say --set 'clockwise=[bearing]'; if the turn rate does, change its signs in the file; to "
        "read both as they are, say --set 'columns.w=omega [deg/s]'"
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


STAMP = 1_718_023_412_000_000_000  # ns
LINEAR = "field.twist.twist.linear.x"
ANGULAR = "field.twist.twist.angular.z"
TRUTH = [*csv.DictReader((DATA / "robot-truth.csv").read_text().splitlines())]
TAGS = {name: number for number, name in enumerate(SIMULATION["LANDMARKS"], 3)}
FOUR = ("--input", "odom.csv", "--landmarks", "tags.csv", "--truth", "mocap.csv")


def four_tables(folder: Path) -> None:
    """Write the log as a robot's topics: what it saw, its odometry, places of tags, and the truth."""
    seen = "field.header.stamp,field.id,field.range_mm,field.bearing_deg\n"
    odometry = f"%time,field.header.stamp,field.header.frame_id,{LINEAR},{ANGULAR}\n"
    for line in LOG.splitlines()[1:]:
        time, v, w, landmark, distance, bearing = line.split(",")
        stamp = STAMP + round(float(time) * 1e9)
        odometry += f"{stamp + 1000},{stamp},odom,{v},{float(w) * math.pi / 180:.6f}\n"
        if landmark:
            # What was seen comes between two rows of the odometry.
            seen += (
                f"{stamp - 40_000_000},{TAGS[landmark]},{1000 * float(distance):.0f},{bearing}\n"
            )
    truth = "field.header.stamp,field.pose.x,field.pose.y,field.pose.yaw_deg\n"
    for row in TRUTH:
        stamp = STAMP + round(float(row["time"]) * 1e9)
        yaw = float(row["heading"]) * 180 / math.pi
        truth += f"{stamp},{row['px']},{row['py']},{yaw:.4f}\n"
    tags = "tag_id,x_m,y_m\n"
    for name, (x, y) in SIMULATION["LANDMARKS"].items():
        tags += f"{TAGS[name]},{x:g},{y:g}\n"
    for name, text in (
        ("seen", seen), ("odom", odometry), ("mocap", truth), ("tags", tags + "99,1,1\n")
    ):  # fmt: skip
        (folder / f"{name}.csv").write_text(text)


def of_tables(folder: Path, *options: str) -> str:
    """Write a config for the log of the four tables; return what is printed."""
    (folder / "robot.yaml").unlink(missing_ok=True)
    done = trackbench("new", "experiment", "robot", "--from", "seen.csv", *options, cwd=folder)
    return done.stdout + done.stderr


def test_four_tables_of_topics_need_no_answer(tmp_path: Path) -> None:
    four_tables(tmp_path)
    printed = of_tables(tmp_path, *FOUR)
    assert "write into it" not in printed
    (point,) = load(tmp_path / "robot.yaml").points
    scenario = point.scenario
    target = scenario.target
    assert target.input_naming.columns == {"time": "field.header.stamp"}
    assert target.input_naming.units == {"time": "ns", "v": "m/s", "w": "rad/s"}
    # Places in the order of the sensors, those of tags that were not seen left out.
    names = {number: name for name, number in TAGS.items()}
    expected = [SIMULATION["LANDMARKS"][names[int(number)]] for number in target.sensors]
    assert [sensor.at for sensor in scenario.sensor] == expected
    # The first state is the truth at the first row of the odometry.
    first = TRUTH[1]
    pose = [float(first[name]) for name in ("px", "py", "heading")]
    assert scenario.start.mean == pytest.approx(pose, abs=1e-4)


def test_a_robot_of_two_tables_is_asked_for_places_and_start(tmp_path: Path) -> None:
    four_tables(tmp_path)
    printed = of_tables(tmp_path, "--input", "odom.csv")
    assert "do the bearings of the landmarks (field.id) count from the robot's heading?" in printed
    printed = of_tables(
        tmp_path, "--input", "odom.csv", "--set", "columns.bearing=field.bearing_deg"
    )
    assert "write into it where these are: 4, 3, 7, 6, 5, the start\n" in printed


@pytest.mark.parametrize(("name", "factor"), [("stamp_ms", 1e-6), ("t", 1e-9)])
def test_the_odometry_may_have_another_clock_unit(tmp_path: Path, name: str, factor: float) -> None:
    four_tables(tmp_path)
    lines = (tmp_path / "odom.csv").read_text().splitlines()[1:]
    rows = [line.split(",") for line in lines]
    text = f"{name},v,w\n" + "".join(f"{int(t) * factor:.6f},{v},{w}\n" for _, t, _, v, w in rows)
    (tmp_path / "odom.csv").write_text(text)
    assert "wrote robot.yaml" in of_tables(tmp_path, *FOUR)
    (point,) = load(tmp_path / "robot.yaml").points
    assert point.scenario.target.input == {"v": "v", "w": "w"}


def test_questions_on_a_table_name_its_keys(tmp_path: Path) -> None:
    four_tables(tmp_path)
    odometry = (tmp_path / "odom.csv").read_text()
    (tmp_path / "odom.csv").write_text(odometry.replace(ANGULAR, "spin"))
    printed = of_tables(tmp_path, *FOUR)
    assert "odom.csv:1:1: no column looks like its turn rate (w)" in printed
    assert "say --set 'input_naming.columns.w=ITS NAME'" in printed
    assert "wrote" in of_tables(tmp_path, *FOUR, "--set", "input_naming.columns.w=spin")
    printed = of_tables(tmp_path, "--set", "input_naming.columns.w=spin")
    assert (
        "input_naming.columns.w=spin: there is no file of inputs; name it, --input FILE" in printed
    )
    printed = of_tables(tmp_path, "--set", "input_file=odom.csv")
    assert "input_file: this table has an option of its own, --input FILE" in printed


def test_a_gap_of_the_odometry_is_a_question(tmp_path: Path) -> None:
    four_tables(tmp_path)
    lines = (tmp_path / "odom.csv").read_text().splitlines()
    (tmp_path / "odom.csv").write_text("\n".join([*lines[:200], *lines[205:]]) + "\n")
    way = "say --set input_gap=0.6 to hold values over the gap"
    assert way in of_tables(tmp_path, *FOUR)
    assert "wrote" in of_tables(tmp_path, *FOUR, "--set", "input_gap=0.6")
    assert "input_gap: 0.6\n" in (tmp_path / "robot.yaml").read_text()


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("3,-4.5,4", "3,-4.5,", "tags.csv:2:1: landmark 3 has no place: write x and y as numbers"),
        ("3,-4.5,4", "4,-4.5,4", "tags.csv:3:1: landmark 4 has two places: leave one of them out"),
        ("x_m", "where", "tags.csv:1:1: no column looks like its x; there are tag_id, where, y_m: "
         "say --set 'landmarks.columns.x=ITS NAME'"),
        ("99,1,1", "99,500,1", "no unit is named, and 500 m is far for a landmark: say --set "
         "landmarks.units.x=cm or"),
    ],
)  # fmt: skip
def test_mistakes_of_a_table_of_landmarks(
    tmp_path: Path, before: str, after: str, message: str
) -> None:
    four_tables(tmp_path)
    text = (tmp_path / "tags.csv").read_text().replace(before, after)
    if "500" in after:
        text = text.replace("x_m,y_m", "x,y")
    (tmp_path / "tags.csv").write_text(text)
    assert message in of_tables(tmp_path, *FOUR)


def test_a_landmark_may_stand_in_any_row_of_its_table(tmp_path: Path) -> None:
    four_tables(tmp_path)
    names, *rows = (tmp_path / "tags.csv").read_text().splitlines()
    others = [f"{1000 + row},{row % 90},{row % 70}" for row in range(10_100)]
    (tmp_path / "tags.csv").write_text("\n".join([names, *others, *rows]) + "\n")
    printed = of_tables(tmp_path, *FOUR)
    assert "wrote" in printed
    assert "write into it where these are" not in printed


@pytest.mark.parametrize("name", ["odom.csv", "tags.csv", "mocap.csv"])
def test_a_table_with_names_alone_is_one_line_with_its_file(tmp_path: Path, name: str) -> None:
    four_tables(tmp_path)
    names = (tmp_path / name).read_text().splitlines()[0]
    (tmp_path / name).write_text(names + "\n")
    (line,) = of_tables(tmp_path, *FOUR).splitlines()
    assert line.startswith(f"{name}:1:1: has no rows")


def test_units_of_places_and_a_table_without_names(tmp_path: Path) -> None:
    four_tables(tmp_path)
    lines = (tmp_path / "tags.csv").read_text().splitlines()[1:]
    rows = [line.split(",") for line in lines]
    centimeters = "".join(f"{n},{100 * float(x):g},{100 * float(y):g}\n" for n, x, y in rows)
    for text in ("tag_id,x [cm],y [cm]\n" + centimeters, "\n".join(lines) + "\n"):
        (tmp_path / "tags.csv").write_text(text)
        assert "wrote robot.yaml" in of_tables(tmp_path, *FOUR)
        (point,) = load(tmp_path / "robot.yaml").points
        assert point.scenario.sensor[0].at in SIMULATION["LANDMARKS"].values()


def test_a_landmark_without_a_place_is_asked_for(tmp_path: Path) -> None:
    four_tables(tmp_path)
    text = (tmp_path / "tags.csv").read_text()
    (tmp_path / "tags.csv").write_text(text.replace("\n3,", "\n33,"))
    assert "write into it where these are: 3\n" in of_tables(tmp_path, *FOUR)
    config = (tmp_path / "robot.yaml").read_text()
    way = "which tags.csv lacks; or leave out the line, and the name in `sensors`"
    assert f"write where 3 is, m, {way}" in config
    tag = text.replace("\n", "\ntag").removesuffix("tag")
    (tmp_path / "tags.csv").write_text(tag)
    printed = of_tables(tmp_path, *FOUR, "--set", "columns.sensor=field.id")
    assert "tags.csv:1:1: has none of " in printed
    assert "write the names alike in both files" in printed


def test_a_start_that_the_truth_lacks_is_asked_for(tmp_path: Path) -> None:
    four_tables(tmp_path)
    text = (tmp_path / "mocap.csv").read_text()
    (tmp_path / "mocap.csv").write_text(text.replace("yaw_deg", "other"))
    assert "write into it where these are: the heading of the start\n" in of_tables(tmp_path, *FOUR)
    lines = text.splitlines()
    (tmp_path / "mocap.csv").write_text("\n".join([lines[0], *lines[30:]]) + "\n")
    assert "write into it where these are: the start\n" in of_tables(tmp_path, *FOUR)


def test_a_table_of_odometry_alone_has_no_measurements(tmp_path: Path) -> None:
    four_tables(tmp_path)
    done = trackbench("new", "experiment", "--from", "odom.csv", cwd=tmp_path)
    assert done.stderr == (
        f"odom.csv:1:1: this table has inputs, {LINEAR} and {ANGULAR}, and no measurements: name the "
        "table of what the robot measured, --from MEASUREMENTS --input odom.csv (docs/your-robot.md)\n"
    )


@pytest.mark.parametrize("answer", [(), ("--set", "columns.azimuth=field.bearing_deg")])
def test_ids_are_landmarks_targets_or_sensors(tmp_path: Path, answer: tuple[str, ...]) -> None:
    four_tables(tmp_path)
    printed = of_tables(tmp_path, *answer).splitlines()
    azimuth = "--set 'columns.azimuth=field.bearing_deg'"
    assert printed[0].endswith(
        "landmarks that a robot sees? Say --set 'columns.bearing=field.bearing_deg', and name its "
        "odometry, --input FILE"
    )
    assert printed[1:] == [
        f"seen.csv:1:1: or targets, of a radar? Say {azimuth} --set 'columns.run=field.id'",
        f"seen.csv:1:1: or sensors, which see one target? Say {azimuth} "
        "--set 'columns.sensor=field.id'",
    ]


@pytest.mark.parametrize(
    ("v", "w"),
    [
        ("field.twist.twist.linear.x", "field.twist.twist.angular.z"),
        ("twist.twist.linear.x", "twist.twist.angular.z"),
        ("twist.linear.x", "twist.angular.z"),
        (".linear.x", ".angular.z"),
        ("cmd_vel.linear.x", "imu.angular_velocity.z"),
    ],
)
def test_the_names_of_odometry_in_ros(v: str, w: str) -> None:
    names = ["field.header.stamp", "field.pose.pose.position.x", "field.twist.twist.linear.y", v, w]
    assert {name: named.column for name, named in odometry_of(names).items()} == {"v": v, "w": w}


@pytest.mark.parametrize(
    "prefix", ["pose.orientation.", "field.pose.pose.orientation.", "orientation_"]
)
def test_a_component_of_a_quaternion_is_no_heading(prefix: str) -> None:
    """Its z is the sine of half the heading."""
    names = [prefix + axis for axis in "xyzw"]
    assert heading_of(names) is None
    assert heading_of([*names, "yaw"]) == ("yaw", None)
    assert heading_of([*names, "orientation"]) == ("orientation", None)


def test_a_merged_table_of_topics(tmp_path: Path) -> None:
    four_tables(tmp_path)
    rows = []
    for line in (tmp_path / "odom.csv").read_text().splitlines()[1:]:
        _, stamp, _, v, w = line.split(",")
        rows.append(f"{stamp},{v},{w},,,\n")
    for line in (tmp_path / "seen.csv").read_text().splitlines()[1:]:
        stamp, rest = line.split(",", 1)
        rows.append(f"{stamp},,,{rest}\n")
    names = f"field.header.stamp,{LINEAR},{ANGULAR},field.id,field.range_mm,field.bearing_deg\n"
    log = names + "".join(sorted(rows))
    assert (
        "do the bearings of the landmarks (field.id) count"
        in written(tmp_path, log).splitlines()[0]
    )
    printed = written(tmp_path, log, "columns.bearing=field.bearing_deg")
    assert "wrote log.yaml" in printed
    assert "time: ns" in (tmp_path / "log.yaml").read_text()


def test_check_says_the_notes_of_run(tmp_path: Path) -> None:
    four_tables(tmp_path)
    of_tables(tmp_path, *FOUR)
    config = tmp_path / "robot.yaml"
    text = config.read_text()
    rows = sum(",4," in line for line in (tmp_path / "seen.csv").read_text().splitlines())
    lines = [line for line in text.splitlines() if "# 4: place" not in line]
    config.write_text("\n".join(lines).replace("sensors: [4, ", "sensors: [") + "\n")
    done = trackbench("check", "robot.yaml", cwd=tmp_path)
    assert done.stdout == "robot.yaml: good, 4 filters\n"
    assert f"note: {rows} rows of 4 were left out (`sensors`)\n" in done.stderr


BIASED = """
  Biased:
    kind: ekf
    assume:
      START
      motion:
        kind: map
        components: [px, py, heading, bias]
        input: [v, w]
        where: {c: cos(heading + (w - bias)*T/2), s: sin(heading + (w - bias)*T/2)}
        next: {px: px + v*T*c, py: py + v*T*s, heading: heading + (w - bias)*T, bias: bias}
        Q: {px: 1e-4, py: 1e-4, heading: 1e-5, bias: 1e-9}
"""


def test_a_filter_with_a_larger_state_is_told_the_way(tmp_path: Path) -> None:
    """It passed the check, and failed with a TypeError of numpy when it ran."""
    four_tables(tmp_path)
    of_tables(tmp_path, *FOUR)
    config = tmp_path / "robot.yaml"
    text = config.read_text()
    way = r"needs it in the target's `state`: \[px, py, heading, bias\], and the truth may lack it"
    start = "start: {kind: given, mean: [0, 0, 0.2, 0], sigma: [0.1, 0.1, 0.1, 0.01]}"
    for line in (start, ""):
        biased = BIASED.replace("START", line).lstrip("\n")
        config.write_text(text.replace("  UKF: {kind: ukf}\n", biased))
        with pytest.raises(UserError, match=way):
            load(config)
    # The state of the target, and of all filters, has the further component.
    motion = biased.split("      motion:\n")[1].replace("        ", "      ")
    head, rest = text.split("    motion:")
    _, tail = rest.split("\nfilters:")
    larger = f"{head}    motion:\n{motion}filters:{tail}"
    larger = larger.replace("state: [px, py, heading]", "state: [px, py, heading, bias]")
    mean = re.search(r"mean: \[(.*?)\]", larger)[1]  # type: ignore[index]
    larger = larger.replace(
        f"mean: [{mean}], sigma: [0.1, 0.1, 0.1]", start[len("start: {kind: given, ") : -1]
    )
    config.write_text(larger)
    (point,) = load(config).points
    assert point.scenario.components == ("px", "py", "heading", "bias")


def test_what_was_seen_before_the_first_odometry_is_left_out(tmp_path: Path) -> None:
    four_tables(tmp_path)
    lines = (tmp_path / "odom.csv").read_text().splitlines()
    (tmp_path / "odom.csv").write_text("\n".join([lines[0], *lines[16:-30]]) + "\n")
    assert "wrote robot.yaml" in of_tables(tmp_path, *FOUR)
    done = trackbench("check", "robot.yaml", cwd=tmp_path)
    assert "note: 9 rows of measurements before the first or after the last inputs (" in done.stderr
    # The first state is the truth at the first row of the odometry that is left.
    (point,) = load(tmp_path / "robot.yaml").points
    pose = [float(TRUTH[16][name]) for name in ("px", "py", "heading")]
    assert point.scenario.start.mean == pytest.approx(pose, abs=1e-4)


def test_clockwise_bearings_of_two_tables_are_a_question_and_a_note(tmp_path: Path) -> None:
    four_tables(tmp_path)
    rows = [line.split(",") for line in (tmp_path / "seen.csv").read_text().splitlines()[1:]]
    mirrored = "field.header.stamp,field.id,field.range_mm,field.bearing_deg\n"
    mirrored += "".join(f"{t},{tag},{r},{-float(b)}\n" for t, tag, r, b in rows)
    (tmp_path / "seen.csv").write_text(mirrored)
    printed = of_tables(tmp_path, *FOUR)
    option = f"input_naming.columns.w={ANGULAR}"
    assert f"field.bearing_deg and {ANGULAR} agree only if one of them counts clockwise" in printed
    assert f"to read both as they are, say --set '{option}'" in printed
    printed = of_tables(tmp_path, *FOUR, "--set", option)
    assert "they agree if its bearing counts from the heading clockwise" in printed


def test_bearings_declared_as_clockwise_are_those_of_the_mirrored_file(tmp_path: Path) -> None:
    """They were read as if they counted from north."""
    four_tables(tmp_path)
    assert "wrote robot.yaml" in of_tables(tmp_path, *FOUR)
    (point,) = load(tmp_path / "robot.yaml").points
    expected = point.scenario.simulate(RunStreams(1, range(1)), 1).measurements
    rows = [line.split(",") for line in (tmp_path / "seen.csv").read_text().splitlines()[1:]]
    mirrored = "field.header.stamp,field.id,field.range_mm,field.bearing_deg\n"
    mirrored += "".join(f"{t},{tag},{r},{-float(b)}\n" for t, tag, r, b in rows)
    (tmp_path / "seen.csv").write_text(mirrored)
    (tmp_path / "robot.yaml").unlink()
    printed = of_tables(tmp_path, *FOUR, "--set", "clockwise=[bearing]")
    assert "wrote robot.yaml" in printed
    assert "clockwise" not in printed
    assert "clockwise: [bearing]" in (tmp_path / "robot.yaml").read_text()
    (point,) = load(tmp_path / "robot.yaml").points
    read = point.scenario.simulate(RunStreams(1, range(1)), 1).measurements
    np.testing.assert_allclose(read, expected, atol=1e-12)


def test_detections_of_two_cameras_are_no_runs(tmp_path: Path) -> None:
    """The rows of one of the two frames were left out without a word."""
    four_tables(tmp_path)
    header, *rows = (tmp_path / "seen.csv").read_text().splitlines()
    lines = [f"{header},field.header.frame_id"]
    for row in rows:
        bearing = float(row.rpartition(",")[2])
        lines.append(f"{row},{'camera_front' if abs(bearing) < 90.0 else 'camera_rear'}")
    (tmp_path / "seen.csv").write_text("\n".join(lines) + "\n")
    of_tables(tmp_path, *FOUR)
    (point,) = load(tmp_path / "robot.yaml").points
    assert "run" not in point.scenario.target.columns
    assert not point.scenario.target.runs


def test_an_error_of_the_position_without_its_key_is_told_the_key(tmp_path: Path) -> None:
    """The message named rmse_heading, which is the nearest name."""
    four_tables(tmp_path)
    of_tables(tmp_path, *FOUR)
    config = tmp_path / "robot.yaml"
    lines = [line for line in config.read_text().splitlines() if "  score: " not in line]
    config.write_text("\n".join(lines) + "\n")
    way = r"`score: {errors: {position: \[px, py\]}}` of the scenario adds it"
    with pytest.raises(UserError, match=rf"'rmse_position' is no metric here; {way}"):
        load(config)


def test_the_map_shows_the_filter_with_a_gate(tmp_path: Path) -> None:
    """It is written where the log has outliers, and may then be the best filter."""
    four_tables(tmp_path)
    rows = (tmp_path / "seen.csv").read_text().splitlines()
    for number in range(5, len(rows), 20):
        stamp, tag, distance, bearing = rows[number].split(",")
        rows[number] = f"{stamp},{tag},{int(distance) + 6000},{bearing}"
    (tmp_path / "seen.csv").write_text("\n".join(rows) + "\n")
    of_tables(tmp_path, *FOUR)
    text = (tmp_path / "robot.yaml").read_text()
    assert "  EKF with gate: {" in text
    (point,) = load(tmp_path / "robot.yaml").points
    figures = yaml.safe_load(text)["figures"]
    assert figures["track"]["filters"] == ["EKF", "EKF with gate", "Odometry"]
    assert {*figures["track"]["filters"]} <= {*point.filters}


@pytest.mark.parametrize("file", ["seen.csv", "tags.csv"])
def test_ids_that_are_equal_whole_numbers_are_one_landmark(tmp_path: Path, file: str) -> None:
    """A table that pandas wrote has 7.0 if another row has no id."""
    four_tables(tmp_path)
    of_tables(tmp_path, *FOUR)
    places = [sensor.at for sensor in load(tmp_path / "robot.yaml").points[0].scenario.sensor]
    text = (tmp_path / file).read_text()
    pattern = r"(?m)^(\d{19},\d+)(?=,)" if file == "seen.csv" else r"(?m)^(\d+)(?=,)"
    (tmp_path / file).write_text(re.sub(pattern, r"\1.0", text))
    assert "write into it" not in of_tables(tmp_path, *FOUR)
    config = tmp_path / "robot.yaml"
    (point,) = load(config).points
    assert [sensor.at for sensor in point.scenario.sensor] == places
    # A config has whole numbers, as 3.0 in it would be a mistake.
    config.write_text(re.sub(r"sensors: \[.*\]", "sensors: [4, 3, 7, 6, 5]", config.read_text()))
    assert len(load(config).points[0].scenario.sensor) == 5


def test_detections_in_the_frame_of_the_robot_are_a_question(tmp_path: Path) -> None:
    """x ahead and y to the left of the robot were read as the robot's own position."""
    four_tables(tmp_path)
    rows = [*csv.DictReader((tmp_path / "seen.csv").read_text().splitlines())]
    text = "field.header.stamp,field.id,x,y\n"
    for row in rows:
        distance = float(row["field.range_mm"]) / 1000.0
        angle = math.radians(float(row["field.bearing_deg"]))
        x = distance * math.cos(angle)
        y = distance * math.sin(angle)
        text += f"{row['field.header.stamp']},{row['field.id']},{x:.3f},{y:.3f}\n"
    (tmp_path / "seen.csv").write_text(text)
    printed = of_tables(tmp_path, *FOUR)
    assert "x and y in rows of the landmarks (field.id): are they seen from the robot?" in printed
    assert not (tmp_path / "robot.yaml").exists()


def test_names_of_anchors_may_look_like_numbers_or_answers(tmp_path: Path) -> None:
    rows = ["time,anchor,distance"]
    for k in range(60):
        rows += [f"{k / 10},{name},{4.0 + i + 0.01 * (k % 7)}" for i, name in enumerate(NAMES)]
    (tmp_path / "m.csv").write_text("\n".join(rows) + "\n")
    made = trackbench(
        "new", "experiment", "--from", "m.csv", "--set", "units.range=m", cwd=tmp_path
    )
    assert made.returncode == 0, made.stderr
    assert f"sensors: [{', '.join(QUOTED)}]" in (tmp_path / "m.yaml").read_text()


NAMES = ("12e4", "ab12", "off", "yes")
QUOTED = ('"12e4"', "ab12", "off", "yes")


def _with_headings(folder: Path, write: Callable[[np.ndarray], np.ndarray]) -> None:
    """Write the truth of the four tables with other headings, from those in rad along the path."""
    headings = np.unwrap([float(row["heading"]) for row in TRUTH])
    truth = "field.header.stamp,field.pose.x,field.pose.y,field.pose.yaw\n"
    for row, heading in zip(TRUTH, write(headings).tolist(), strict=True):
        stamp = STAMP + round(float(row["time"]) * 1e9)
        truth += f"{stamp},{row['px']},{row['py']},{heading:.6f}\n"
    (folder / "mocap.csv").write_text(truth)


@pytest.mark.parametrize(
    ("names", "prefix"),
    [
        (["quat_x", "quat_y", "quat_z", "quat_w"], "quat_"),
        (["qw", "qx", "qy", "qz"], "q"),
        ([f"field.pose.pose.orientation.{axis}" for axis in "xyzw"], None),
        ([f"q_RS_{axis} []" for axis in "wxyz"], None),
        ([f"Rotation {axis}" for axis in "XYZW"], None),
    ],
)
def test_the_names_of_a_quaternion_tell_its_order(names: list[str], prefix: str | None) -> None:
    columns = quaternion_of(["time", "x", "y", "z", "w", *names])
    assert sorted(columns) == ["qw", "qx", "qy", "qz"]
    for component, name in columns.items():
        axis = component.removeprefix("q")
        assert name.lower().removesuffix(" []").endswith(axis)
        if prefix is not None:
            assert name == prefix + axis


@pytest.mark.parametrize(
    "names", ["q0 q1 q2 q3", "qx qy qz", "x y z w", "rot_x rot_y rot_z quat_w"]
)
def test_columns_that_name_no_quaternion_are_none(names: str) -> None:
    assert quaternion_of(names.split()) == {}


def with_quaternions(
    folder: Path, change: Callable[[np.ndarray[Any, Any]], Any] = lambda q: q
) -> None:
    """Write the headings of the truth of `four_tables` as quaternions, which ``change`` may alter.

    It takes and returns the components x, y, z and w, (4, R).
    """
    lines = (folder / "mocap.csv").read_text().splitlines()
    half = 0.5 * np.array([float(row["heading"]) for row in TRUTH])
    components = np.asarray(change(np.stack([0.0 * half, 0.0 * half, np.sin(half), np.cos(half)])))
    rows = [lines[0].replace("field.pose.yaw_deg", "quat_w,quat_x,quat_y,quat_z")]
    for line, (x, y, z, w) in zip(lines[1:], components.T.tolist(), strict=True):
        rows.append(f"{line.rpartition(',')[0]},{w:.6f},{x:.6f},{y:.6f},{z:.6f}")
    (folder / "mocap.csv").write_text("\n".join(rows) + "\n")


def product(first: np.ndarray[Any, Any], second: tuple[float, ...]) -> np.ndarray[Any, Any]:
    """Return the rotation ``second``, about axes of the body, after ``first``: (x, y, z, w) each."""
    x, y, z, w = first
    a, b, c, d = second
    return np.stack(
        [
            w * a + x * d + y * c - z * b,
            w * b - x * c + y * d + z * a,
            w * c + x * b - y * a + z * d,
            w * d - x * a - y * b - z * c,
        ]
    )


@pytest.mark.parametrize("pitch", [0.0, 0.2])
def test_a_heading_is_computed_from_quaternions(tmp_path: Path, pitch: float) -> None:
    """They are written in the order w, x, y, z. A pitch of the body leaves its heading as it is."""
    four_tables(tmp_path)
    assert "write into it" not in of_tables(tmp_path, *FOUR)
    by_yaw = load(tmp_path / "robot.yaml").points[0].scenario
    body = (0.0, math.sin(pitch / 2.0), 0.0, math.cos(pitch / 2.0))
    with_quaternions(tmp_path, lambda quaternions: product(quaternions, body))
    printed = of_tables(tmp_path, *FOUR)
    assert "write into it" not in printed
    assert "not used" not in printed
    scenario = load(tmp_path / "robot.yaml").points[0].scenario
    assert scenario.cautions == ()
    assert scenario.start.mean == pytest.approx(by_yaw.start.mean, abs=1e-4)
    errors = scenario.target.recorded_truth[2] - by_yaw.target.recorded_truth[2]
    errors = errors[np.isfinite(by_yaw.target.recorded_truth[2])]
    # Written with six digits, half an angle is off by at most 1e-6.
    assert np.abs(np.sin(errors)).max() < 1e-5


def test_quaternions_clockwise_from_north(tmp_path: Path) -> None:
    """A quaternion may be in another frame than the positions, which the movement shows."""
    four_tables(tmp_path)
    quarter = math.sin(math.pi / 4.0)

    def to_north(quaternions: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        x, y, z, w = quaternions
        return product(np.stack([x, y, -z, w]), (0.0, 0.0, quarter, quarter))

    with_quaternions(tmp_path, to_north)
    assert "write into it" not in of_tables(tmp_path, *FOUR)
    scenario = load(tmp_path / "robot.yaml").points[0].scenario
    assert scenario.target.truth_naming.clockwise == ("heading",)
    assert scenario.start.mean[2] == pytest.approx(float(TRUTH[1]["heading"]), abs=1e-4)


def test_quaternions_that_are_no_rotations_have_no_heading(tmp_path: Path) -> None:
    """Motion capture writes zeros where it lost the body."""
    four_tables(tmp_path)

    def with_lost_rows(quaternions: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        quaternions[:, 100:110] = 0.0
        return quaternions

    with_quaternions(tmp_path, with_lost_rows)
    assert "wrote robot.yaml" in of_tables(tmp_path, *FOUR)
    scenario = load(tmp_path / "robot.yaml").points[0].scenario
    (note,) = scenario.cautions
    assert "10 rows have no heading, as the quaternion (quat_x, quat_y, quat_z, quat_w)" in note


QUESTION = (
    "mocap.csv:1:1: quat_x, quat_y, quat_z, quat_w: is the heading the turn of this quaternion"
)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda quaternions: 2.0 * quaternions, "most have not the norm 1"),
        (
            # The axes of a camera: z ahead and y down.
            lambda quaternions: product(quaternions, (-0.5, 0.5, -0.5, 0.5)),
            "its axis z is often more than 30 deg from the vertical",
        ),
    ],
)
def test_doubtful_quaternions_are_a_question(
    tmp_path: Path, change: Callable[[np.ndarray[Any, Any]], Any], reason: str
) -> None:
    four_tables(tmp_path)
    with_quaternions(tmp_path, change)
    yes, no = of_tables(tmp_path, *FOUR).splitlines()
    assert yes == (
        f"{QUESTION} about z, though {reason}? Say --set 'truth_naming.columns.qx=quat_x'"
    )
    assert no == (
        "mocap.csv:1:1: or is there no heading? Say --set 'truth_naming.columns.heading=\"\"'"
    )
    printed = of_tables(tmp_path, *FOUR, "--set", 'truth_naming.columns.heading=""')
    assert "write into it where these are: the heading of the start\n" in printed
    printed = of_tables(tmp_path, *FOUR, "--set", "truth_naming.columns.qx=quat_x")
    if "norm" in reason:
        assert "no quaternion has the norm 1: they are no rotations" in printed
    else:
        assert "is often more than 30 deg from the vertical" in printed


def test_answers_on_a_quaternion_name_all_its_columns(tmp_path: Path) -> None:
    four_tables(tmp_path)
    with_quaternions(tmp_path)
    text = (tmp_path / "mocap.csv").read_text()
    (tmp_path / "mocap.csv").write_text(text.replace("quat_w,quat_x,quat_y,quat_z", "a,b,c,d"))
    named = ("qx=b", "qy=c", "qz=d", "qw=a")
    answers = [word for name in named for word in ("--set", f"truth_naming.columns.{name}")]
    assert "name the others, too, --set truth_naming.columns.qw=NAME" in of_tables(
        tmp_path, *FOUR, *answers[:6]
    )
    assert "write into it" not in of_tables(tmp_path, *FOUR, *answers)
    known = of_tables(tmp_path, *FOUR, "--set", "truth_naming.columns.nope=a").partition("known: ")[
        2
    ]
    names = known.strip().split(", ")
    assert len(names) == len(set(names))
    assert {"heading", "qx", "qy", "qz", "qw"} < set(names)


def test_the_start_is_moved_back_if_a_landmark_is_seen_in_the_first_row(tmp_path: Path) -> None:
    """The filters then begin a step before all rows, also before those of the truth."""
    (tmp_path / "log.csv").write_text(
        "\n".join([LOG.splitlines()[0], *LOG.splitlines()[5:]]) + "\n"
    )
    truth = (DATA / "robot-truth.csv").read_text().splitlines()
    first = next(k for k, row in enumerate(TRUTH) if float(row["time"]) == pytest.approx(0.5))
    (tmp_path / "truth.csv").write_text("\n".join([truth[0], *truth[1 + first :]]) + "\n")
    words = (
        "new",
        "experiment",
        "robot",
        "--from",
        "log.csv",
        "--truth",
        "truth.csv",
        "--set",
        NAME,
    )
    done = trackbench(*words, cwd=tmp_path)
    assert "write into it where these are: shelf, door, plant, desk, lamp\n" in done.stdout
    text = (tmp_path / "robot.yaml").read_text()
    assert "# the truth's pose 0.1 s after t = 0.4 s, moved back by the odometry" in text
    mean = yaml.safe_load(text)["scenario"]["start"]["mean"]
    # The wheels have errors of 0.1 m/s and 0.05 rad/s (one standard deviation) over 0.1 s.
    before = [float(TRUTH[first - 1][name]) for name in ("px", "py", "heading")]
    assert mean[:2] == pytest.approx(before[:2], abs=4.0 * 0.01)
    assert mean[2] == pytest.approx(before[2], abs=4.0 * 0.005)
    # A later truth does not show the pose.
    (tmp_path / "robot.yaml").unlink()
    (tmp_path / "truth.csv").write_text("\n".join([truth[0], *truth[11 + first :]]) + "\n")
    assert "lamp, the start\n" in trackbench(*words, cwd=tmp_path).stdout
    assert "; the truth begins 1.1 s later" in (tmp_path / "robot.yaml").read_text()


def test_each_run_of_a_robot_has_its_own_start(tmp_path: Path) -> None:
    """In run b a landmark is seen in the first row, and in the others later."""
    log = LOG.splitlines()
    rows = {"a": log[1:400], "b": log[5:300], "c": log[21:200]}
    lines = [f"drive,{log[0]}", *(f"{run},{row}" for run in rows for row in rows[run])]
    (tmp_path / "log.csv").write_text("\n".join(lines) + "\n")
    places = [f"{name},{x},{y}" for name, (x, y) in SIMULATION["LANDMARKS"].items()]
    (tmp_path / "tags.csv").write_text("\n".join(["name,x,y", *places]) + "\n")
    (tmp_path / "truth.csv").write_text((DATA / "robot-truth.csv").read_text())
    words = ("new", "experiment", "robot", "--from", "log.csv", "--landmarks", "tags.csv")
    words += ("--truth", "truth.csv", "--set", NAME, "--set", "columns.run=drive")
    done = trackbench(*words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    measured = sum(1 for row in rows["a"] if not row.endswith(",,,"))
    assert f"read run a ({measured} rows with measurements), the longest of 3;" in done.stdout
    config = (tmp_path / "robot.yaml").read_text()
    assert "its pose at t = 0.1 s, t = 0.4 s, t = 2.1 s\n" in config
    (tmp_path / "robot.yaml").write_text(config.replace("# grid:", "grid:"))
    points = load(tmp_path / "robot.yaml").points
    assert cautions(points) == []
    for point, time in zip(points, (0.1, 0.4, 2.1), strict=True):
        (row,) = [row for row in TRUTH if float(row["time"]) == pytest.approx(time)]
        pose = [float(row[name]) for name in ("px", "py", "heading")]
        assert point.scenario.start.mean == pytest.approx(pose, abs=1e-4)
    # One start for all runs would be a state at the first row of two of them alone.
    shared = re.sub("# grid:.*", "grid: {scenario.target.runs: [[a], [b], [c]]}", config)
    (tmp_path / "robot.yaml").write_text(shared)
    (note,) = cautions(load(tmp_path / "robot.yaml").points)
    assert note == (
        "`start` is the state at the first row in a, c, and a step before it in b: give each its own, "
        "`grid: {scenario.target.runs & scenario.start.mean: [...]}`"
    )


def results_of_tables(folder: Path) -> Any:
    """Write a config for the four tables, and return the results of its EKF over 30 s."""
    of_tables(folder, *FOUR)
    config = (folder / "robot.yaml").read_text().replace("HEADING]", "0.2]")
    (folder / "robot.yaml").write_text(config)
    chosen = (
        "filters={EKF: {kind: ekf}}",
        "figures={track: {kind: track, filters: [EKF]}}",
        "scenario.last=300",
    )
    return api.run(
        folder / "robot.yaml",
        set=chosen,
        out=folder / "out",
        engine="serial",
        quiet=True,
        formats=(),
    ).results


def legend_of_map(results: Any) -> list[str]:
    figure = results.parts("figures")["track"].draw(results)
    (legend,) = figure.legends
    texts = [text.get_text() for text in legend.get_texts()]
    file_formats.close(figure)
    return texts


def test_the_legend_of_the_map_says_whose_headings_are_drawn(tmp_path: Path) -> None:
    four_tables(tmp_path)
    assert "Heading of the truth" in legend_of_map(results_of_tables(tmp_path))


def test_empty_columns_name_the_heading_that_the_truth_lacks(tmp_path: Path) -> None:
    """Of a robot's state a config cannot add the ANEES of the position."""
    four_tables(tmp_path)
    text = (tmp_path / "mocap.csv").read_text()
    (tmp_path / "mocap.csv").write_text(text.replace("yaw_deg", "other"))
    results = results_of_tables(tmp_path)
    # The map has the headings of the filter in their place.
    assert "Heading" in legend_of_map(results)
    lacks = "is empty, as the truth has no heading at any scored step"
    notes = results.tables["errors"].notes
    assert f"Heading {lacks}." in notes
    assert f"ANEES {lacks}, and it is of the whole state." in notes


HEADINGS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "rad": lambda h: np.arctan2(np.sin(h), np.cos(h)),
    "several turns in rad": lambda h: h + 4.0 * np.pi,
    "deg": lambda h: np.degrees(h) % 360.0,
    "a compass": lambda h: (90.0 - np.degrees(h)) % 360.0,
    "a compass in rad": lambda h: np.pi / 2.0 - h,
}


@pytest.mark.parametrize("written_as", HEADINGS)
def test_the_movement_shows_how_headings_of_a_truth_count(tmp_path: Path, written_as: str) -> None:
    """Headings beyond a turn may be in rad, and those of a compass count clockwise from north."""
    four_tables(tmp_path)
    _with_headings(tmp_path, HEADINGS[written_as])
    assert "write into it" not in of_tables(tmp_path, *FOUR)
    scenario = load(tmp_path / "robot.yaml").points[0].scenario
    assert scenario.cautions == ()
    errors = scenario.target.recorded_truth[2, :, 0] - scenario.start.mean[2]
    assert math.isclose(math.cos(errors[0]), 1.0, abs_tol=1e-6)
    first = float(TRUTH[1]["heading"])
    assert math.cos(scenario.start.mean[2] - first) == pytest.approx(1.0, abs=1e-6)


def test_landmarks_in_a_column_called_object(tmp_path: Path) -> None:
    """The same column names no targets in the rows that hold odometry alone."""
    log = LOG.replace("landmark", "object", 1)
    (tmp_path / "log.csv").write_text(log)
    places = [f"{name},{x},{y}" for name, (x, y) in SIMULATION["LANDMARKS"].items()]
    (tmp_path / "tags.csv").write_text("\n".join(["name,x,y", *places]) + "\n")
    words = ("new", "experiment", "robot", "--from", "log.csv", "--landmarks", "tags.csv")
    done = trackbench(*words, "--set", NAME, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "write into it where these are: the start\n" in done.stdout
    content = (tmp_path / "robot.yaml").read_text().replace("[X, Y, HEADING]", "[0, 0, 0.2]")
    (tmp_path / "robot.yaml").write_text(content)
    assert len(load(tmp_path / "robot.yaml").points[0].scenario.target.sensors) == 5


def test_the_heading_of_a_truth_is_the_column_that_the_user_names(tmp_path: Path) -> None:
    """The key `truth_naming.columns.heading` was refused, and a guess took another column."""
    angles = 0.05 * np.arange(60)
    lines = ["time,x,y,heading,psi_hat"]
    for k, angle in enumerate(angles.tolist()):
        x, y = 20.0 * math.sin(angle), 20.0 - 20.0 * math.cos(angle)
        lines.append(f"{k},{x:.3f},{y:.3f},0.0,{angle:.4f}")
    path = tmp_path / "truth.csv"
    path.write_text("\n".join(lines) + "\n")
    robot = replace(recognized(str(path)), inputs=dict.fromkeys(("v", "w"), 0.1))

    def naming_of(**keys: Any) -> Naming:
        return recognized_truth(str(path), robot, Naming(**keys)).naming

    assert naming_of().columns["heading"] == "heading"
    named = {"columns": {"heading": "psi_hat"}}
    assert naming_of(**named).columns["heading"] == "psi_hat"
    assert naming_of(**named).units["heading"] == "rad"
    assert naming_of(**named, units={"heading": "deg"}).units["heading"] == "deg"
    assert naming_of(**named, clockwise=("heading",)).clockwise == ("heading",)
    assert naming_of(columns={"heading": ""}).columns["heading"] == ""
    with pytest.raises(DataError, match=r"no column nope, which columns\.heading names"):
        naming_of(columns={"heading": "nope"})
    with pytest.raises(DataError, match=r"units\.heading: m is not one of rad"):
        naming_of(units={"heading": "m"})
