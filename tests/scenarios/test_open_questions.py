"""`new experiment --from` reads units, columns and truths that a table leaves open right, or asks."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from trackbench.config.load import load
from trackbench.errors import UserError
from trackbench.new_experiment_from_tables import WrittenConfig, write_config_for
from trackbench.scenarios.recordings.recognize_column_names import words_of
from trackbench.scenarios.recordings.unit_names_and_sizes import unit_in

pytestmark = pytest.mark.usefixtures("no_report")

RNG = np.random.default_rng(4)
T = np.arange(0.0, 120.0, 2.0)
X = 12.0 * T - 2500.0
Y = 1500.0 + 9.0 * T
RANGE = np.hypot(X, Y) + 5.0 * RNG.normal(size=len(T))
NORTH = (np.degrees(np.arctan2(X, Y)) + 0.1 * RNG.normal(size=len(T))) % 360.0
DATES = [f"2024-06-03T08:{int(t // 60):02}:{t % 60:06.3f}Z" for t in T]


def table(path: Path, names: str, *columns: Any) -> Path:
    rows = (",".join(map(str, row)) for row in zip(*columns, strict=True))
    path.write_text("\n".join([names, *rows]) + "\n")
    return path


def written(
    path: Path, *changes: str, truth: Path | None = None, name: str = "g"
) -> tuple[WrittenConfig, Any]:
    """Write a config for a table; return what was written, and the config's content."""
    config = write_config_for(path, name, path.parent, changes, truth)
    return config, yaml.safe_load(config.paths[0].read_text())


def asked(path: Path, *changes: str, truth: Path | None = None) -> str:
    """Return the question that a table raises; no config may be left."""
    with pytest.raises(UserError) as error:
        write_config_for(path, "g", path.parent, changes, truth)
    assert not list(path.parent.glob("*.yaml"))
    return str(error.value)


@pytest.mark.parametrize(
    ("name", "per_meter"),
    [("rng_km", 1e-3), ("dist_ft", 1 / 0.3048), ("slant range [nmi]", 1 / 1852)],
)
@pytest.mark.parametrize("is_named", [False, True])
def test_the_unit_in_a_name_is_read(
    tmp_path: Path, name: str, per_meter: float, is_named: bool
) -> None:
    """Also if the user names the column, or its name is an abbreviation."""
    path = table(tmp_path / "m.csv", f"when,{name},brg_deg", DATES, RANGE * per_meter, NORTH)
    changes = ["columns.time=when", f"columns.range={name}"] if is_named else []
    _, config = written(path, *changes)
    (sensor,) = config["scenario"]["sensor"]
    assert 2.0 <= sensor["sigma_range"] <= 10.0
    assert config["scenario"]["target"]["clockwise"] == ["azimuth"]


def test_units_that_no_recording_has_are_asked_for(tmp_path: Path) -> None:
    path = table(tmp_path / "m.csv", "t,range_yd,az_deg", T, RANGE / 0.9144, NORTH)
    assert "range_yd: the unit yd is unknown here: write the numbers in a known unit" in asked(path)
    written(path, "units.range=ft")


@pytest.mark.parametrize(
    ("names", "example"),
    [("t,x_m,y_m,speed_yd,course_deg", "speed=m/s"), ("t,x_m,y_m,vx_yd,vy_yd", "vx=m/s")],
)
def test_the_example_of_a_known_unit_is_one_of_the_quantity(
    tmp_path: Path, names: str, example: str
) -> None:
    path = table(tmp_path / "m.csv", names, T, X, Y, 10.0 + 0.0 * T, 90.0 + 0.0 * T)
    assert f"such as --set units.{example}" in asked(path)


def test_every_column_in_an_unknown_unit_is_named_in_order(tmp_path: Path) -> None:
    path = table(tmp_path / "m.csv", "t,y_yd,x_yd", T, Y / 0.9144, X / 0.9144)
    lines = asked(path).splitlines()
    named = [line.split(": ")[1] for line in lines if "is unknown here" in line]
    assert named == ["x_yd", "y_yd"]


def test_a_range_without_a_unit_and_with_an_odd_speed_is_asked_about(tmp_path: Path) -> None:
    path = table(tmp_path / "m.csv", "t,range,azimuth", T, RANGE / 1e3, NORTH)
    message = asked(path)
    # Times in ms would explain it, too.
    assert "the units may be t in ms, with a usual speed of 15 m/s" in message
    assert "range: no unit is named, and in m the usual speed would be 0.0" in message
    assert "say --set units.range=km, or with another unit: mi, nmi, m" in message
    config, content = written(path, "units.range=km")
    assert content["scenario"]["target"]["units"]["range"] == "km"
    unit_line, direction_line = config.units
    assert unit_line == (
        "read azimuth in deg (there are angles beyond 2 pi); another unit: --set units.azimuth=UNIT"
    )
    assert direction_line.startswith("read azimuth clockwise from north (from 0 to 360 deg")
    assert direction_line.endswith("from x to y: --set 'clockwise=[]'")


def test_degrees_near_north_are_no_radians_without_a_question(tmp_path: Path) -> None:
    away = 4000.0 + RNG.normal(size=len(T))
    azimuth = 2.0 + 0.03 * T + 0.01 * RNG.normal(size=len(T))
    path = table(tmp_path / "m.csv", "t,range_m,azimuth", T, away, azimuth)
    message = asked(path)
    assert "azimuth: no unit is named, and its numbers may be degrees or radians" in message
    _, content = written(path, "units.azimuth=deg", "clockwise=[]")
    assert content["scenario"]["sensor"][0]["sigma_azimuth_mrad"] < 5.0


def test_a_range_that_is_not_read_is_a_question(tmp_path: Path) -> None:
    path = table(tmp_path / "m.csv", "t,brg_deg,d_km", T, NORTH, RANGE / 1e3)
    message = asked(path)
    assert "only brg_deg is recognized as measured; is d_km the range?" in message
    _, content = written(path, "columns.range=d_km")
    assert [s["kind"] for s in content["scenario"]["sensor"]] == ["range-azimuth"]
    config, content = written(path, 'columns.range=""', name="bearings")
    assert [s["kind"] for s in content["scenario"]["sensor"]] == ["bearing"]
    assert config.unknown == ["the sensor", "the start"]


def test_a_position_beside_a_radar_is_a_question(tmp_path: Path) -> None:
    path = table(tmp_path / "m.csv", "t,x,y,range,az_deg", T, X, Y, RANGE, NORTH)
    message = asked(path)
    assert "the rows have range and az_deg, and also x and y: which ones were measured?" in message
    _, content = written(path, "columns.range=range", "columns.azimuth=az_deg")
    assert [s["kind"] for s in content["scenario"]["sensor"]] == ["range-azimuth"]
    _, content = written(path, "columns.x=x", "columns.y=y", name="other")
    assert [s["kind"] for s in content["scenario"]["sensor"]] == ["position"]


@pytest.mark.parametrize("names", ["r_mm,theta", "dist_mm,angle"])
def test_a_lidar_is_a_radar_in_millimeters(tmp_path: Path, names: str) -> None:
    angle = np.arctan2(Y, X)
    path = table(tmp_path / "m.csv", f"t,{names}", T, 100.0 * RANGE, angle)
    _, content = written(path)
    assert content["scenario"]["target"]["units"] == {"range": "mm", "azimuth": "rad"}


def test_rows_of_two_targets_without_a_name_are_a_question(tmp_path: Path) -> None:
    north = np.where(np.arange(len(T)) % 2, NORTH, 360.0 - NORTH)
    path = table(tmp_path / "m.csv", "t,range_m,az_deg", T, RANGE, north)
    message = asked(path)
    assert "rows lie far from the row before and near one before that, again and again" in message
    assert "are they several targets? Give each target a number in a column" in message
    # If the user says that they are one target, its azimuths are doubtful all the same.
    message = asked(path, 'columns.run=""')
    assert "az_deg: azimuths jump by some" in message
    assert "are these rows of one target?" in message


def test_a_column_that_would_not_be_read_is_a_mistake(tmp_path: Path) -> None:
    path = table(tmp_path / "m.csv", "t,x,y,h", T, X, Y, T)
    message = asked(path, "columns.altitude=h")
    assert (
        "columns.altitude: no sensor of the config would read altitude: it has `position`"
        in message
    )
    assert "there is no columns.height; known: " in asked(path, "columns.height=h")


def test_a_speed_without_a_course_is_offered_and_refused_with_what_it_lacks(tmp_path: Path) -> None:
    path = table(tmp_path / "m.csv", "t,x,y,Speed (km/h)", T, X, Y, T)
    message = asked(path, "columns.speed=Speed (km/h)")
    assert (
        "columns.speed: no sensor of the config would read speed: it has `position`; leave"
        in message
    )
    assert "or name a course, too: a speed and a course together measure the velocity" in message
    config, _ = written(path)
    assert config.quantities == ["course", "run", "sensor", "received"]


LOG = [
    "t,vel,yaw_rate,COLUMN,dist_m,brg_deg",
    *(f"{0.1 * k:.1f},0.5,0.2,{('a1', 'b2')[k % 10 // 5]},{4 + 0.01 * k:.2f},{10 + k % 7}"
      if k % 5 == 3 else f"{0.1 * k:.1f},0.5,0.2,,," for k in range(100)),
]  # fmt: skip


@pytest.mark.parametrize("column", ["tag", "tag_id", "id", "marker", "seen"])
def test_words_that_stand_beside_measurements_name_landmarks(tmp_path: Path, column: str) -> None:
    path = tmp_path / "log.csv"
    path.write_text("\n".join(LOG).replace("COLUMN", column) + "\n")
    assert f"do the bearings of the landmarks ({column}) count from the robot's" in asked(path)
    config, content = written(path, "columns.bearing=brg_deg")
    assert content["scenario"]["target"]["columns"]["sensor"] == column
    assert config.unknown == ["a1", "b2", "the start"]
    text = config.paths[0].read_text()
    assert "# write the pose at t = 0 s, m and rad" in text  # the first row has no measurement
    assert "w: rad/s  # guess: nine of ten are below 0.2" in text
    config.paths[0].unlink()
    message = asked(path, f"columns.landmark={column}")
    assert f"`--set 'columns.sensor={column}'`" in message
    fast = "\n".join(LOG).replace("COLUMN", column).replace(",0.2,", ",12,")
    path.write_text(fast + "\n")
    message = asked(path, "columns.bearing=brg_deg")
    assert "yaw_rate: no unit is named, and 12 rad/s is unusual for a robot" in message
    assert "say --set units.w=deg/s or --set units.w=rad/s" in message


def degrees() -> tuple[Any, Any]:
    """Return latitude and longitude of the path, seen from 54.18 N 12.09 E."""
    latitude = 54.18 + Y / 111300.0
    return latitude, 12.09 + X / (111300.0 * np.cos(np.radians(54.18)))


def test_a_truth_is_guessed_and_the_place_of_the_radar_asked_for(tmp_path: Path) -> None:
    path = table(tmp_path / "m.csv", "when,rng_km,brg_deg", DATES, RANGE / 1e3, NORTH)
    truth = table(tmp_path / "gps.csv", "time,lat,lon,vessel", DATES, *degrees(), ["a"] * len(T))
    config, content = written(path, truth=truth)
    assert config.unknown == ["the radar"]
    target = content["scenario"]["target"]
    assert target["truth"] == "gps.csv"
    assert target["truth_gap"] == 3.0
    assert target["origin"] == ["LATITUDE", "LONGITUDE"]
    assert "hold_out" not in content
    assert content["tables"]["errors"]["columns"]["ANEES"] == "anees_position"
    file = config.paths[0]
    file.write_text(file.read_text().replace("LATITUDE, LONGITUDE", "54.18, 12.09"))
    scenario: Any = load(file).points[0].scenario
    assert not any("beyond" in note for note in scenario.cautions)


def test_a_truth_of_another_time_is_a_mistake_that_names_both(tmp_path: Path) -> None:
    path = table(tmp_path / "m.csv", "t,x,y", T, X, Y)
    truth = table(tmp_path / "gps.csv", "t,px,py", T + 1e4, X, Y)
    message = asked(path, truth=truth)
    assert "its times are from 10000 to 10118 s, and those of" in message
    assert "m.csv from 0 to 118 s: they have no time in common;" in message
    other = table(tmp_path / "other.csv", "t,range,azimuth_deg", T, RANGE, NORTH)
    assert "a truth has positions, x and y or latitude and longitude" in asked(path, truth=other)
    assert "there is no truth; name it, --truth FILE" in asked(path, "truth_naming.columns.x=x")
    assert "--truth FILE" in asked(path, "truth=gps.csv")


def test_questions_on_a_truth_are_answered_by_keys_of_the_truth(tmp_path: Path) -> None:
    path = table(tmp_path / "m.csv", "t,x,y", T, X, Y)
    truth = table(tmp_path / "gps.csv", "t,a,b", T, X, Y)
    message = asked(path, truth=truth)
    assert "--set 'truth_naming.columns.x=a' --set 'truth_naming.columns.y=b'" in message
    changes = ["truth_naming.columns.x=a", "truth_naming.columns.y=b"]
    _, content = written(path, *changes, truth=truth)
    assert content["scenario"]["target"]["truth_naming"] == {
        "columns": {"time": "t", "x": "a", "y": "b"}
    }


@pytest.mark.parametrize(
    ("times", "words"),
    [
        ([f"2024-06-03T09:{date[14:]}" for date in DATES], "they have no time in common"),
        (T, "its column time has seconds, and that of "),
        ([date[11:-1] for date in DATES], "has times of day without a date"),
    ],
)
def test_clocks_are_compared_before_azimuths_are_asked_about(
    tmp_path: Path, times: Any, words: str
) -> None:
    """With the right clock the truth shows from where azimuths count."""
    bearing = np.degrees(np.arctan2(X, Y))
    path = table(tmp_path / "m.csv", "time,range_m,bearing_deg", DATES, RANGE, bearing)
    right = table(tmp_path / "right.csv", "time,latitude,longitude", DATES, *degrees())
    truth = table(tmp_path / "t.csv", "time,latitude,longitude", times, *degrees())
    question = asked(path, truth=truth)
    assert words in question
    assert "clockwise" not in question
    _, config = written(path, truth=right)
    assert config["scenario"]["target"]["clockwise"] == ["azimuth"]
    # Without a truth it is still a question.
    (tmp_path / "g.yaml").unlink()
    assert "clockwise from north" in asked(path)


def test_a_truth_that_contradicts_the_measurements_is_noted_at_once(tmp_path: Path) -> None:
    path = table(tmp_path / "m.csv", "time,range_m,bearing_deg", DATES, RANGE, NORTH)
    truth = table(tmp_path / "t.csv", "time,latitude,longitude", DATES, *degrees())
    config, _ = written(path, "origin=[54.20,12.09]", truth=truth)
    (note,) = config.notes
    assert "they agree if the truth is moved by [" in note
    config, _ = written(path, "origin=[54.18,12.09]", truth=truth, name="right")
    assert config.notes == []


def test_exchanged_columns_of_range_and_azimuth_are_asked_about(tmp_path: Path) -> None:
    path = table(tmp_path / "m.csv", "time,range_m,bearing_deg", DATES, RANGE, NORTH)
    question = asked(
        path, "columns.range=bearing_deg", "columns.azimuth=range_m", "units.azimuth=deg"
    )
    assert "are the columns of range and azimuth exchanged? If not, " in question
    # Counts of a turn beside large ranges are no ranges.
    counts = np.rint(NORTH / 360.0 * 4096.0).astype(int)
    path = table(tmp_path / "c.csv", "time,range_m,bearing_deg", DATES, RANGE, counts)
    assert "exchanged?" not in asked(path, "units.azimuth=deg", "clockwise=[azimuth]")


def test_outliers_add_a_filter_with_a_gate(tmp_path: Path) -> None:
    north = NORTH.copy()
    north[[10, 30, 45]] += 20.0
    path = table(tmp_path / "m.csv", "t,range_m,az_deg", T, RANGE, north)
    config, content = written(path)
    assert content["filters"]["EKF with gate"] == {"kind": "ekf", "gate": 0.999}
    assert "some 5 % of the rows are far from the line" in config.paths[0].read_text()
    student = {"kind": "student-t", "df": 4}
    assert content["filters"]["EKF with Student t"] == {"kind": "ekf", "robust": student}
    shown = ["EKF", "EKF with gate", "EKF with Student t", "IMM"]
    assert content["figures"]["track"]["filters"] == shown
    path = table(tmp_path / "n.csv", "t,range_m,az_deg", T, RANGE, NORTH)
    _, content = written(path, name="plain")
    assert "EKF with gate" not in content["filters"]


def test_several_runs_are_a_grid_in_a_comment_and_share_a_clock_with_a_note(tmp_path: Path) -> None:
    runs = ["a", "b"] * (len(T) // 2)
    x = np.where(np.array(runs) == "a", X, 9e3 - X)
    path = table(tmp_path / "m.csv", "t,boat,x,y", T, runs, x, Y)
    config, _ = written(path)
    file = config.paths[0]
    text = file.read_text()
    assert "\n# grid: {scenario.target.runs: [[a], [b]]}  # all runs, each" in text
    (line,) = [line for line in text.splitlines() if line.startswith("    runs: ")]
    file.write_text(text.replace(line + "\n", ""))
    scenario: Any = load(file).points[0].scenario
    # The starts are shifted onto each other: of alternate rows all times but those are shared.
    assert not any("share" in note for note in scenario.cautions)
    late = T + np.where(np.array(runs) == "a", 0.0, 0.7) * (T > 10.0)
    table(path, "t,boat,x,y", late, runs, x, Y)
    (note,) = [note for note in load(file).points[0].scenario.cautions if "share" in note]
    assert "each run is also judged at the times of the others" in note
    assert "(numbers of the runs: 0 is a, 1 is b)" in note


def in_degrees(path: Path, latitude: Any, longitude: Any) -> Path:
    """Write a table of positions in degrees, one a minute."""
    time = 60.0 * np.arange(len(latitude))
    rounded = [np.round(values, 6) for values in (latitude, longitude)]
    return table(path, "time_s,latitude,longitude", time, *rounded)


def test_the_origin_of_a_long_way_is_in_its_middle(tmp_path: Path) -> None:
    """Also across 180 deg, and if most rows are at one end."""
    share = np.linspace(0.0, 1.0, 300)
    latitude = 50.0 + 1e-5 * RNG.normal(size=300)
    path = in_degrees(tmp_path / "cut.csv", 0.0 * share, (345.0 + 30.0 * share) % 360.0 - 180.0)
    assert "or say `origin: [0, 180]`, in the middle" in asked(path)
    waiting = np.append(np.zeros(400), share)
    path = in_degrees(tmp_path / "end.csv", 50.0 + 0.0 * waiting, -5.0 - 40.0 * waiting)
    assert "or say `origin: [51.7, -25]`, in the middle" in asked(path)
    path = in_degrees(tmp_path / "m.csv", latitude, -5.0 - 40.0 * share)
    assert "or say `origin: [50, -25]`, in the middle" in asked(path)
    written(path, "origin=[50,-25]")


def test_a_way_too_long_for_any_origin_is_told_so(tmp_path: Path) -> None:
    share = np.linspace(0.0, 1.0, 300)
    path = in_degrees(tmp_path / "m.csv", 50.0 + 0.0 * share, -60.0 + 120.0 * share)
    message = asked(path)
    assert "no one origin serves for all: take a part of the recording" in message
    assert "`origin: [" not in message


@pytest.mark.parametrize("row", [0, 150])
def test_the_row_that_is_far_from_all_others_is_blamed(tmp_path: Path, row: int) -> None:
    """Also if it is the first one, from which positions count."""
    latitude = 47.0 + 0.05 * np.arange(300.0) / 3.0
    latitude[row] = 12.0
    path = in_degrees(tmp_path / "m.csv", latitude, 8.0 + 0.0 * latitude)
    message = asked(path)
    assert f"m.csv:{row + 2}:1: " in message
    assert (
        "km from most positions; a plane serves for 2000 km: correct or empty the cells" in message
    )


def test_missing_names_of_targets_are_one_line(tmp_path: Path) -> None:
    names = ["" if row % 7 == 3 else "ab"[row % 2] for row in range(len(T))]
    path = table(tmp_path / "m.csv", "t,track_id,x,y", T, names, X, Y)
    line = "m.csv:5:1: track_id: is missing (8 more rows are alike): write it in each row, or say"
    assert f"{line} --set 'columns.run=\"\"' to mix all rows" in asked(path)
    assert asked(path).count("is missing") == 1
    written(path, 'columns.run=""')


def clock(t: float) -> str:
    """Write a time of day."""
    return f"{int(t // 3600):02}:{int(t // 60) % 60:02}:{t % 60:02.0f}"


@pytest.mark.parametrize("names", ["Flight day,Clock", "date,clock", "acq_date,acq_clock"])
def test_a_date_and_a_time_of_day_in_two_columns_are_asked_for(tmp_path: Path, names: str) -> None:
    clocks = [clock(36000.0 + t) for t in T]
    path = table(tmp_path / "m.csv", f"{names},x,y", ["2024-05-03"] * len(T), clocks, X, Y)
    date, time = names.split(",")
    answers = [f"columns.date={date}", f"columns.time={time}"]
    options = " ".join(f"--set '{answer}'" for answer in answers)
    assert f"{date} has no time of day: is it in {time}? Say {options}" in asked(path)
    _, content = written(path, *answers)
    assert content["scenario"]["target"]["columns"]["date"] == date


def test_parts_of_a_day_beside_dates_are_asked_for(tmp_path: Path) -> None:
    """As Excel writes them: within one day the dates do not count, over midnight they must."""
    parts = [f"{(86340.0 + t) % 86400.0 / 86400.0:.9f}" for t in T]
    days = ["2024-05-03" if t < 60.0 else "2024-05-04" for t in T]
    for name in ("time", "day fraction"):
        path = table(tmp_path / f"{name}.csv", f"date,{name},x,y", days, parts, X, Y)
        message = asked(path)
        assert f".csv:32:1: {name} falls from 0.999976852 to 0 where date changes" in message
        assert "write both into one column, such as 2024-05-03 10:00:59" in message
    parts = [f"{(36000.0 + t) / 86400.0:.9f}" for t in T]
    days = ["2024-05-03"] * len(T)
    path = table(tmp_path / "m.csv", "date,day fraction,x,y", days, parts, X, Y)
    answers = ["columns.date=date", "columns.time=day fraction", "units.time=d"]
    assert "--set 'columns.time=day fraction' --set units.time=d" in asked(path)
    written(path, *answers)


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("Peilung [°]", "deg"),
        ("azimuth (°)", "deg"),
        ("Peilung [º]", "deg"),
        ("azimuth_°", "deg"),
        ("rumbo °", "deg"),
        ("Temp [°C]", None),
        ("Temp °F", None),
        ("Nº", None),
    ],
)
def test_the_sign_of_a_degree_is_read(name: str, unit: str | None) -> None:
    assert unit_in(words_of(name), "azimuth") == unit
