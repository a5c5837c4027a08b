"""`trackbench new experiment` with a file for each of several sensors."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from tests.commands import trackbench
from trackbench.config.component_as_config import _as_plain_data
from trackbench.config.load import load
from trackbench.errors import UserError
from trackbench.new_experiment_from_tables import WrittenConfig, write_config_for
from trackbench.scenarios.recordings.naming_of_columns import Naming
from trackbench.scenarios.recordings.recording_keys import RecordingKeys

BEGIN = 1715679062.0  # 2024-05-14T09:31:02Z
PLACE = (48.2651, 11.6689)
RNG = np.random.default_rng(8)
T = np.arange(0.0, 120.0, 1.0)
EAST = 400.0 + 12.0 * T
NORTH = 300.0 + 40.0 * np.sin(T / 15.0)
METERS_PER_DEGREE = np.pi / 180.0 * 6.37e6


def write(path: Path, names: str, *columns: object, separator: str = ",") -> Path:
    """Write a table."""
    rows = [separator.join(map(str, row)) for row in zip(*columns, strict=True)]  # type: ignore[call-overload]
    path.write_text("\n".join([names, *rows]) + "\n")
    return path


def dates(times: np.ndarray, zone: str = "Z") -> list[str]:
    """ISO 8601 dates of times after `BEGIN`."""
    moments = (datetime.fromtimestamp(BEGIN + t, UTC) for t in times)
    return [moment.strftime("%Y-%m-%dT%H:%M:%S.%f")[:-3] + zone for moment in moments]


def degrees() -> tuple[np.ndarray, np.ndarray]:
    """Latitudes and longitudes of the path."""
    latitude = PLACE[0] + NORTH / METERS_PER_DEGREE
    longitude = PLACE[1] + EAST / METERS_PER_DEGREE / np.cos(np.deg2rad(PLACE[0]))
    return latitude, longitude


def radar(folder: Path, clock: str = "time_unix_ms") -> Path:
    """A radar's log with UNIX times in ms, semicolons and azimuths clockwise from north."""
    milliseconds = np.rint(1000.0 * (BEGIN + T + 0.37)).astype(int)
    distance = np.round(np.hypot(EAST, NORTH) + 4.0 * RNG.normal(size=len(T)), 1)
    azimuth = np.round(
        np.rad2deg(np.arctan2(EAST, NORTH)) % 360.0 + 0.3 * RNG.normal(size=len(T)), 2
    )
    names = f"{clock};range_m;azimuth_deg;snr_db"
    snr = np.round(RNG.uniform(9, 24, len(T)), 1)
    return write(
        folder / "radar_log.csv", names, milliseconds, distance, azimuth, snr, separator=";"
    )


def gps(folder: Path, zone: str = "Z", name: str = "Timestamp") -> Path:
    """A GPS logger's file with dates."""
    latitude, longitude = degrees()
    names = f"{name},Latitude,Longitude,Speed (km/h)"
    speed = np.full(len(T), 45.0)
    digits = [[f"{value:.7f}" for value in values] for values in (latitude, longitude)]
    return write(folder / "gps_logger.csv", names, dates(T, zone), *digits, speed)


def written(first: Path, *further: Path, changes: tuple[str, ...] = ()) -> WrittenConfig:
    """Write the config ``both`` into the folder of the first file."""
    return write_config_for(first, "both", first.parent, changes, further=further)


def test_both_files_are_read_each_with_its_own_names(tmp_path: Path) -> None:
    config = written(radar(tmp_path), gps(tmp_path))
    assert config.unknown == ["the radar"]
    assert config.unused == ["snr_db of radar_log.csv", '"Speed (km/h)" of gps_logger.csv']
    text = config.paths[0].read_text()
    target = yaml.safe_load(text)["scenario"]["target"]
    assert target["measurements"] == ["radar_log.csv", "gps_logger.csv"]
    of_radar, of_gps = target["measurement_naming"]
    assert of_radar["columns"] == {
        "time": "time_unix_ms",
        "range": "range_m",
        "azimuth": "azimuth_deg",
    }
    assert of_radar["units"] == {"time": "ms", "range": "m", "azimuth": "deg"}
    assert of_radar["clockwise"] == ["azimuth"]
    assert "clockwise: [azimuth]  # as the positions of gps_logger.csv show" in text
    assert of_radar["format"] == {"separator": ";"}
    assert of_gps == {
        "columns": {"time": "Timestamp", "latitude": "Latitude", "longitude": "Longitude"}
    }
    config.paths[0].write_text(text.replace("[LATITUDE, LONGITUDE]", str(list(PLACE))))
    scenario = load(config.paths[0]).points[0].scenario
    # Steps of both files, less the first scan of the radar and the row of the GPS before it.
    assert len(scenario.times) == 2 * len(T) - 1
    assert [sensor["kind"] for sensor in yaml.safe_load(text)["scenario"]["sensor"]] == [
        "range-azimuth",
        "position",
    ]


def test_the_command_takes_a_file_for_each_sensor(tmp_path: Path) -> None:
    radar(tmp_path)
    gps(tmp_path)
    origin = f"origin={list(PLACE)}"
    words = ["new", "experiment", "--from", "radar_log.csv", "--from", "gps_logger.csv"]
    made = trackbench(*words, "--set", origin, cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    assert made.stdout.startswith("wrote radar_log_gps_logger.yaml\n")
    assert "--set 'measurement_naming.0.columns.run=ITS NAME'" in made.stdout
    done = trackbench("run", "radar_log_gps_logger.yaml", "--only", "EKF", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "1 filter x 1 run x" in done.stderr
    twice = trackbench(
        "new", "experiment", "--from", "radar_log.csv", "--from", "radar_log.csv", cwd=tmp_path
    )
    assert twice.returncode == 2
    assert "--from radar_log.csv is there twice" in twice.stderr


def test_questions_name_the_file_and_its_option(tmp_path: Path) -> None:
    """Both files are asked about, and each answer is a key of its own file."""
    first = write(tmp_path / "a.csv", "Zeitpunkt,x,y", T, EAST, NORTH)
    second = write(tmp_path / "b.csv", "moment,x,y", T, EAST, NORTH)
    with pytest.raises(UserError) as caught:
        written(first, second)
    lines = str(caught.value).splitlines()
    assert "a.csv:1:1: no column looks like a time" in lines[0]
    assert "--set 'measurement_naming.0.columns.time=Zeitpunkt'" in lines[0]
    assert "--set 'measurement_naming.1.columns.time=moment'" in lines[1]
    answers = (
        "measurement_naming.0.columns.time=Zeitpunkt",
        "measurement_naming.1.columns.time=moment",
    )
    naming = yaml.safe_load(written(first, second, changes=answers).paths[0].read_text())
    columns = [file["columns"] for file in naming["scenario"]["target"]["measurement_naming"]]
    assert [each["time"] for each in columns] == ["Zeitpunkt", "moment"]


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ("0.units.x=furlong", "--set {0}.units.x=furlong: {0}.units.x: 'furlong' is not one of "),
        ("1.unts.x=m", "--set {1}.unts.x=m: {1}.unts: unknown key; did you mean units?"),
        ("1.columns.x=q", "b.csv:1:1: no column q, which {1}.columns.x names"),
        (
            "1.at=[0,0]",
            "new experiment both: {1}.at: is a key of a sensor: write it into the config",
        ),
    ],
)
def test_mistakes_in_answers_have_the_whole_key(tmp_path: Path, change: str, line: str) -> None:
    first = write(tmp_path / "a.csv", "time,x,y", T, EAST, NORTH)
    second = write(tmp_path / "b.csv", "time,x,y", T, EAST, NORTH)
    with pytest.raises(UserError) as caught:
        written(first, second, changes=(f"measurement_naming.{change}",))
    message = str(caught.value).replace(f"{tmp_path}/", "")
    assert message.startswith(line.format("measurement_naming.0", "measurement_naming.1"))


def test_a_key_without_its_file_and_one_of_no_file_are_mistakes(tmp_path: Path) -> None:
    files = (radar(tmp_path), gps(tmp_path))
    what = (
        "which file. Say --set measurement_naming.0.units.range=km for radar_log.csv or --set meas"
    )
    with pytest.raises(UserError, match=what):
        written(*files, changes=("units.range=km",))
    with pytest.raises(UserError, match="files have the numbers from 0 to 1"):
        written(*files, changes=("measurement_naming.2.units.range=km",))
    with pytest.raises(UserError, match="there is one file alone: leave the words before columns"):
        written(files[0], changes=("measurement_naming.0.units.range=km",))


def test_the_zone_of_dates_beside_unix_times_is_an_option(tmp_path: Path) -> None:
    files = (radar(tmp_path), gps(tmp_path, zone=""))
    origin = f"origin={list(PLACE)}"
    with pytest.raises(UserError, match=r"which zone .* Say --set measurement_naming\.1\.zone=UTC"):
        written(*files, changes=(origin,))
    changes = (origin, "measurement_naming.1.zone=UTC")
    config = written(*files, changes=changes)
    target = yaml.safe_load(config.paths[0].read_text())["scenario"]["target"]
    assert target["measurement_naming"][1]["zone"] == "UTC"


def test_several_sensors_or_a_robot_in_one_of_the_files_are_refused(tmp_path: Path) -> None:
    both = write(
        tmp_path / "two.csv",
        "time,sensor,x,y",
        np.repeat(T, 2),
        ["a", "b"] * len(T),
        np.repeat(EAST, 2),
        np.repeat(NORTH, 2),
    )
    with pytest.raises(UserError, match=r"two.csv:1:1: has 2 sensors \(a, b\)"):
        written(both, gps(tmp_path))


def test_runs_of_the_files_have_the_same_names(tmp_path: Path) -> None:
    """A single run needs no name; of several, one has to be in all files."""
    ships = ["5"] * len(T)
    named = write(tmp_path / "a.csv", "time,vessel,x,y", T, ships, EAST, NORTH)
    plain = write(tmp_path / "b.csv", "time,x,y", T + 0.5, EAST, NORTH)
    config = written(named, plain)
    target = yaml.safe_load(config.paths[0].read_text())["scenario"]["target"]
    assert target["measurement_naming"][0]["columns"].get("run", "") == ""
    config.paths[0].unlink()
    two = write(
        tmp_path / "c.csv",
        "time,vessel,x,y",
        np.concatenate([T, T]),
        ["5"] * len(T) + ["6"] * len(T),
        np.concatenate([EAST, EAST + 5000.0]),
        np.concatenate([NORTH, NORTH]),
    )
    with pytest.raises(UserError, match=r"c.csv has 5, 6; b.csv has 0; no run is in all files"):
        written(two, plain)


def test_two_sensors_far_apart_in_time_are_noted(tmp_path: Path) -> None:
    times = np.arange(60.0)
    near = write(tmp_path / "a.csv", "time,x,y", times, 3.0 * times, 2.0 * times)
    far = write(tmp_path / "b.csv", "time,x,y", times + 1e6, 3.0 * times, 2.0 * times)
    later = write(tmp_path / "c.csv", "time,x,y", times + 70.0, 3.0 * times, 2.0 * times)
    for second, is_noted in ((far, True), (later, False)):
        (tmp_path / "both.yaml").unlink(missing_ok=True)
        path = written(near, second).paths[0]
        (point,) = load(path).points
        notes = " ".join(point.scenario.cautions)
        assert ("they have no time in common" in notes) == is_noted


def test_a_named_column_that_is_not_there_is_one_line(tmp_path: Path) -> None:
    """It ended in a traceback of numpy."""
    file = write(tmp_path / "a.csv", "time,x,y", np.arange(30.0), np.arange(30.0), np.arange(30.0))
    done = trackbench(
        "new", "experiment", "e", "--from", file, "--set", "columns.time=nope", cwd=tmp_path
    )
    assert done.returncode == 2
    assert "no column nope, which columns.time names; there are time, x, y" in done.stderr
    assert not (tmp_path / "e.yaml").exists()


def test_marks_of_thousands_are_no_digits_behind_the_point(tmp_path: Path) -> None:
    """A sigma was as large as 1 because 1.003,2 had its digits counted from the mark."""
    t = np.arange(60.0)
    rng = np.random.default_rng(4)
    values = 1000.0 + 3.0 * t + 0.2 * rng.standard_normal(60)
    plain = [f"{v:.1f}".replace(".", ",") for v in values]
    marked = [f"{v:,.1f}".replace(",", "_").replace(".", ",").replace("_", ".") for v in values]
    sigmas = []
    for name, cells in (("plain", plain), ("marked", marked)):
        file = write(tmp_path / f"{name}.csv", "time;x;y", range(60), cells, cells, separator=";")
        (tmp_path / "both.yaml").unlink(missing_ok=True)
        sigmas.append(
            next(
                line for line in written(file).paths[0].read_text().splitlines() if "sigma:" in line
            )
        )
    assert sigmas[0] == sigmas[1]


def test_measurements_before_the_first_state_are_noted(tmp_path: Path) -> None:
    radar_log = radar(tmp_path)
    gps_logger = gps(tmp_path)
    written(radar_log, gps_logger, changes=(f"origin={list(PLACE)}",))
    config = tmp_path / "both.yaml"
    late = "1 measurement of sensor 2 before the first state left out, up to 0.37 s earlier: "
    assert any(late in note for note in load(config).points[0].scenario.target.notices)
    # The sensor that begins first gives the first state.
    config.unlink()
    written(gps_logger, radar_log, changes=(f"origin={list(PLACE)}",))
    assert not any("first state" in note for note in load(config).points[0].scenario.target.notices)


def test_the_order_of_days_is_asked_only_beside_a_file_with_another_one(tmp_path: Path) -> None:
    """05/03/2024 was read as 5 March beside a file of 3 May."""
    began = datetime(2024, 5, 3, 10, tzinfo=UTC).timestamp()
    moments = [datetime.fromtimestamp(began + t, UTC) for t in T]
    columns = [np.round(EAST, 2), np.round(NORTH, 2)]
    iso = write(
        tmp_path / "iso.csv", "time,x,y", [f"{m:%Y-%m-%d %H:%M:%S}" for m in moments], *columns
    )
    days = [f"{m:%m/%d/%Y %H:%M:%S}" for m in moments]
    one = write(tmp_path / "one.csv", "time,x,y", days, *columns)
    two = write(tmp_path / "two.csv", "time,x,y", days, *columns)
    asked = "a day in either order, which matters beside the other file"
    month_first = 'time_format="%m/%d/%Y %H:%M:%S"'
    for first, second, number in ((iso, one, 1), (one, iso, 0)):
        with pytest.raises(UserError, match=asked) as error:
            written(first, second)
        answer = f"measurement_naming.{number}.{month_first}"
        assert f"--set '{answer}'" in str(error.value)
        config = written(first, second, changes=(answer,)).paths[0]
        scenario: Any = load(config).points[0].scenario
        assert np.ptp(scenario.times) == pytest.approx(np.ptp(T), abs=5.0)
        config.unlink()
    with pytest.raises(UserError, match=asked) as error:
        write_config_for(iso, "both", tmp_path, truth=one)
    answer = f"truth_naming.{month_first}"
    assert f"--set '{answer}'" in str(error.value)
    write_config_for(iso, "both", tmp_path, [answer], truth=one).paths[0].unlink()
    with pytest.raises(UserError, match=asked):
        write_config_for(one, "both", tmp_path, truth=iso)
    written(one, two)


def test_the_run_that_is_read_of_several_is_named(tmp_path: Path) -> None:
    times = np.concatenate([np.arange(50.0), np.arange(30.0), np.arange(20.0)])
    names = np.repeat(["A", "B", "C"], [50, 30, 20])
    noise = np.random.default_rng(3).normal(size=(2, 100))
    rows = ["time,run,x,y"]
    for row in range(100):
        x, y = 3.0 * times[row] + noise[0, row], 2.0 * times[row] + noise[1, row]
        rows.append(f"{times[row]:.0f},{names[row]},{x:.2f},{y:.2f}")
    (tmp_path / "m.csv").write_text("\n".join(rows) + "\n")
    made = trackbench("new", "experiment", "--from", "m.csv", cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    line = "read run A (50 rows), the longest of 3; to read B, C, too, change `runs` in the config"
    assert line in made.stdout.splitlines()


def test_one_of_several_files_may_have_azimuths_from_x_to_y(tmp_path: Path) -> None:
    """An empty list did not undo the key of the target, so that azimuths were read the wrong way."""
    target = Naming(clockwise=("azimuth",), columns={"time": "t"})
    assert Naming(clockwise=()).with_defaults(target).clockwise == ()
    assert Naming().with_defaults(target).is_clockwise("azimuth")
    write(tmp_path / "a.csv", "t,range,azimuth", [0, 1, 2], [100.0] * 3, [0.1, 0.2, 0.3])
    write(tmp_path / "b.csv", "t,range,azimuth", [0, 1, 2], [100.0] * 3, [0.1, 0.2, 0.3])
    keys = {"measurements": ("a.csv", "b.csv"), "clockwise": ("azimuth",)}
    undone = RecordingKeys(**keys, measurement_naming=(Naming(), Naming(clockwise=())))
    assert [naming.is_clockwise("azimuth") for naming in undone.namings] == [True, False]
    # It stays in the config of a results folder, and in the key of the cache.
    unset, empty = (_as_plain_data(naming, str) for naming in undone.measurement_naming)
    assert "clockwise" not in unset
    assert empty["clockwise"] == []
