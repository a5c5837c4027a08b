"""Several targets or sensors in one table, which a column of words names; columns that name neither."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.commands import trackbench
from tests.scenarios.test_clocks import config, table
from trackbench.config.load import load
from trackbench.errors import UserError
from trackbench.scenarios.recordings.compare_parts_of_rows import is_regular, split_by
from trackbench.scenarios.recordings.guess_jumps import first_return
from trackbench.scenarios.recordings.guess_table import recognized
from trackbench.scenarios.recordings.naming_of_columns import Naming

pytestmark = pytest.mark.usefixtures("no_report")

N = 120
T = np.arange(float(N))
RNG = np.random.default_rng(8)
NOISE = RNG.normal(size=(2, N))
LINE = np.stack([8.0 * T, 3.0 * T + 0.01 * np.square(T)])
TURNS = np.arange(N) % 2
WORDS = np.array(["A", "B"])


def write(folder: Path, name: str, words: Any, values: Any, times: Any = T) -> Path:
    path = folder / "m.csv"
    path.write_text(table(f"time,{name},x,y", times, words, *np.round(values, 3)))
    return path


def refused(path: Path) -> str:
    with pytest.raises(UserError) as caught:
        load(path)
    return str(caught.value)


@pytest.mark.parametrize(
    "name", ["ship", "drone", "name", "target", "Boot", "kuda", "id", "source"]
)
def test_two_targets_in_one_table_are_refused(tmp_path: Path, name: str) -> None:
    apart = np.where(TURNS, 60.0, 0.0)
    write(tmp_path, name, WORDS[TURNS], LINE + 2.0 * NOISE + apart)
    line = refused(config(tmp_path, {"measurements": "m.csv"}))
    assert (
        f"m.csv:1:1: scenario: column {name} has 2 values (A, B), which would be one run and"
        in line
    )
    assert f"say `columns: {{run: {name}}}` for a run each, `columns: {{sensor: {name}}}`" in line
    for columns in ({"run": ""}, {"sensor": ""}, {"run": name}):
        load(config(tmp_path, {"measurements": "m.csv", "columns": columns}))
    # A quality of that name would not be asked about.
    write(tmp_path, "fix_type", WORDS[TURNS], LINE + 2.0 * NOISE + apart)
    load(config(tmp_path, {"measurements": "m.csv"}))


@pytest.mark.parametrize("name", ["ship", "drone", "name", "target", "vessel", "mmsi", "kuda"])
def test_targets_that_the_config_mixes_are_noted(tmp_path: Path, name: str) -> None:
    """The note is no question: an empty name is the answer that the rows belong together."""
    path = write(tmp_path, name, WORDS[TURNS], LINE + 2.0 * NOISE + np.where(TURNS, 3000.0, 0.0))
    note = f"column {name} has 2 values (A, B), whose rows lie apart; they are mixed, as"
    note += ' `columns: {run: ""}` says'
    done = trackbench(
        "new", "experiment", "g", "--from", path.name, "--set", 'columns.run=""', cwd=tmp_path
    )
    assert done.returncode == 0
    assert note in done.stdout
    assert f'      run: ""  # {note}\n' in (tmp_path / "g.yaml").read_text()
    by_hand = config(tmp_path, {"measurements": "m.csv", "columns": {"run": ""}})
    for written in (tmp_path / "g.yaml", by_hand):
        notes = load(written).points[0].scenario.cautions
        assert notes[0] == f"m.csv: {note}"
    # Rows of one path, whatever they are called, are no several targets.
    write(tmp_path, name, WORDS[TURNS], LINE + 2.0 * NOISE)
    assert not load(by_hand).points[0].scenario.cautions
    assert "mixed" not in recognized(str(path), Naming(columns={"run": ""})).reasons


@pytest.mark.parametrize("distance", [300.0, 30000.0])
def test_a_velocity_that_mixed_rows_contradict_is_left_out_for_this_reason(
    tmp_path: Path, distance: float
) -> None:
    positions = LINE + 2.0 * NOISE + np.where(TURNS, distance, 0.0)
    velocity = np.stack([np.full(N, 8.0), 3.0 + 0.02 * T])
    rows = table("time,ship,x,y,vx,vy", T, WORDS[TURNS], *np.round([*positions, *velocity], 3))
    path = tmp_path / "m.csv"
    path.write_text(rows)
    reasons = recognized(str(path), Naming(columns={"run": ""})).reasons
    reason = "rows that lie apart are mixed, so that positions jump between them"
    assert reasons["velocity"].startswith(f"velocities are left out: {reason}; to use them all")
    named = recognized(str(path), Naming(columns={"run": "", "vx": "vx", "vy": "vy"})).reasons
    assert named["velocity"] == f"velocities are used, as you named them; but {reason}"
    # One ship after the other agrees.
    assert "velocity" not in recognized(str(path), Naming(columns={"run": "ship"})).reasons


@pytest.mark.parametrize("name", ["sensor_id", "Sensor", "source", "provider", "capteur"])
def test_two_sensors_in_one_table_are_refused(tmp_path: Path, name: str) -> None:
    write(tmp_path, name, WORDS[TURNS], LINE + np.where(TURNS, 0.5, 20.0) * NOISE)
    line = refused(config(tmp_path, {"measurements": "m.csv"}))
    assert f"m.csv:1:1: scenario: column {name} has 2 values (A, B)" in line
    guess = recognized(str(tmp_path / "m.csv"))
    assert guess.naming.columns["sensor"] == name
    assert [sensor.name for sensor in guess.sensors] == ["A", "B"]
    (large, _), (small, _) = (sensor.sigmas for sensor in guess.sensors)
    assert 12.0 < large < 30.0
    assert 0.3 < small < 0.8


def circles(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A target that turns, and the half turn that it is in."""
    angle = 0.3 * T
    path = 50.0 * np.stack([np.cos(angle), np.sin(angle)])
    return (angle // np.pi).astype(int) % 2, path + 0.3 * rng.normal(size=(2, N))


def test_what_splits_the_rows_of_a_run() -> None:
    """Targets and sensors split them; stations, laps and a fix that comes and goes do not."""
    kinds: dict[str, list[tuple[str, bool]]] = {}
    for seed in range(20):
        rng = np.random.default_rng(seed)
        noise = rng.normal(size=(2, N))
        halves, turning = circles(rng)
        flicker = (rng.random(N) < 0.2).astype(int)
        tables = {
            "targets": (TURNS, LINE + 2.0 * noise + np.where(TURNS, 15.0, 0.0)),
            "targets, one after the other": (TURNS.repeat(60)[:N], LINE + 2.0 * noise),
            "sensors": (TURNS, LINE + np.where(TURNS, 0.5, 20.0) * noise),
            "fast and slow": ((np.arange(N) % 11 == 0) * 1, LINE + noise),
            "stations": (rng.integers(0, 3, N), LINE + 3.0 * noise),
            "a lap": (np.arange(N) // 30, LINE + 2.0 * noise),
            "a half turn": (halves, turning),
            "a poor fix": (flicker, LINE + np.where(flicker, 10.0, 0.5) * noise),
        }
        codes, values = tables["targets, one after the other"]
        values = values + np.where(codes, 3000.0, 0.0)
        tables["targets, one after the other"] = codes, values
        for name, (labels, positions) in tables.items():
            answer = split_by(labels, T, positions), is_regular(labels, T)
            kinds.setdefault(name, []).append(answer)
    assert {split for split, _ in kinds["targets"]} == {"apart"}
    assert {split for split, _ in kinds["targets, one after the other"]} == {"apart"}
    assert {*kinds["sensors"]} == {("errors", True)}
    # A name of no meaning is asked about only if parts are apart, or alternate with unequal errors.
    for name in ("fast and slow", "stations", "a lap", "a half turn", "a poor fix"):
        asked = [split == "apart" or (split == "errors" and even) for split, even in kinds[name]]
        assert sum(asked) <= 1, name


def test_targets_at_the_same_times(tmp_path: Path) -> None:
    """The way on is a run each, not `same_time`."""
    times = np.repeat(np.arange(N // 2), 2)
    write(tmp_path, "boat", WORDS[TURNS], LINE + 100.0 * TURNS + NOISE, times)
    assert "`columns: {run: boat}` for a run each" in refused(
        config(tmp_path, {"measurements": "m.csv"})
    )
    guess = recognized(str(tmp_path / "m.csv"))
    assert guess.naming.columns["run"] == "boat"
    assert guess.runs == [("A", 60), ("B", 60)]


def test_many_targets(tmp_path: Path) -> None:
    """Also if the rows are sorted by their names."""
    ships = np.arange(N) % 40
    values = LINE[:, ships] + 500.0 * ships + NOISE
    write(tmp_path, "vessel name", [f"ship {ship}" for ship in ships], values, T // 40)
    line = refused(config(tmp_path, {"measurements": "m.csv"}))
    assert "column vessel name has 40 values (ship 0, ship 1, ship 2, ship 3, ship 4, " in line
    times = np.concatenate([np.arange(1200.0)] * 2)
    words = np.repeat(WORDS, 1200)
    values = np.stack([np.where(words == "A", times, 900.0 - times), 0.1 * times])
    write(tmp_path, "drone", words, values, times)
    line = refused(config(tmp_path, {"measurements": "m.csv"}))
    assert "column drone has 2 values (A, B)" in line


@pytest.mark.parametrize("name", ["storm", "storm_id", "STORM_NAME", "cyclone", "hurricane"])
def test_storms_one_after_the_other_are_runs(tmp_path: Path, name: str) -> None:
    """After a pause of days their positions show no jump, but the column's name says enough."""
    storm = np.arange(N) // 40
    hours = 6.0 * T + 300.0 * storm
    latitude = np.round(12.0 + 0.2 * (T % 40) + 0.05 * NOISE[0], 1)
    longitude = np.round(-40.0 - 0.4 * (T % 40) + 0.05 * NOISE[1] - 5.0 * storm, 1)
    names = [f"AL0{number + 1}2020" for number in storm]
    head = f"{name},time (h),latitude,longitude,wind"
    wind = 35 + 5 * (np.arange(N) % 7)
    (tmp_path / "m.csv").write_text(table(head, names, hours, latitude, longitude, wind))
    guess = recognized(str(tmp_path / "m.csv"))
    assert guess.naming.columns["run"] == name
    assert guess.runs == [("AL012020", 40), ("AL022020", 40), ("AL032020", 40)]


def test_sensors_that_lie_apart_are_a_question(tmp_path: Path) -> None:
    write(tmp_path, "provider", WORDS[TURNS], LINE + 80.0 * TURNS + NOISE)
    done = trackbench("new", "experiment", "--from", "m.csv", cwd=tmp_path)
    assert done.returncode == 2
    assert (
        "m.csv:1:1: column provider splits the rows into parts that lie apart: are they "
        in done.stderr
    )
    assert "`--set 'columns.run=provider'`, `--set 'columns.sensor=provider'`" in done.stderr


def test_a_track_beside_a_speed_is_a_course(tmp_path: Path) -> None:
    p = 51.0 + 0.0008 * T
    q = 4.0 + 0.0016 * T + 1e-6 * NOISE[0]
    for name in ("gs", "gs_kt", "gs_kn", "kts"):
        rows = table(f"timestamp,latitude,longitude,{name},track", T, p, q, [277.1] * N, [52] * N)
        (tmp_path / "m.csv").write_text(rows)
        guess = recognized(str(tmp_path / "m.csv"))
        assert guess.naming.columns["speed"] == name
        assert guess.naming.columns["course"] == "track"
        assert guess.naming.units["speed"] == "kn"
        assert "run" not in guess.naming.columns
        assert guess.runs == [("0", N)]
    # Without a speed it names what moves.
    (tmp_path / "m.csv").write_text(table("time,x,y,track", T, *LINE, [4] * N))
    assert recognized(str(tmp_path / "m.csv")).naming.columns["run"] == "track"


def test_places_of_landmarks_are_asked_for(tmp_path: Path) -> None:
    marks = np.array([[0.0, 30.0], [50.0, -10.0]])[:, TURNS]
    dx, dy = marks - 0.1 * LINE
    bearing = np.arctan2(dy, dx) + 0.01 * NOISE[1]
    rows = table(
        "time,landmark,range,bearing", T, 1 + TURNS, np.hypot(dx, dy) + 0.1 * NOISE[0], bearing
    )
    (tmp_path / "m.csv").write_text(rows)
    words = ("new", "experiment", "--from", "m.csv", "--set", "columns.azimuth=bearing")
    words += ("--set", "clockwise=[]")
    done = trackbench(*words, cwd=tmp_path)
    assert "write into it where these are: 1, 2\n" in done.stdout, done.stderr
    assert refused(tmp_path / "m.yaml").count("is not a number") == 4
    sensor = {"kind": "range-azimuth", "sigma_range": 1, "sigma_azimuth_mrad": 5}
    target = {"measurements": "m.csv", "columns": {"azimuth": "bearing"}}
    line = refused(config(tmp_path, target, sensor=sensor))
    assert "column landmark has 2 values (1, 2)" in line


def test_hemispheres_are_read(tmp_path: Path) -> None:
    rows = table("time,lat,N/S,lon,E/W", T, 33.8 + 1e-5 * T, ["S"] * N, 151.2 + 1e-5 * T, ["E"] * N)
    (tmp_path / "m.csv").write_text(rows)
    done = trackbench("new", "experiment", "--from", "m.csv", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    target = load(tmp_path / "m.yaml").points[0].scenario.target
    assert target.columns["north_south"] == "N/S"
    # The path leads south and east: 1.11 m and 0.925 m a second.
    x, y = target._recording.measurements[:2, -1, 0]
    np.testing.assert_allclose([x, y], [119 * 0.925, -119 * 1.109], rtol=2e-3)


def test_a_position_and_a_radar_in_turn(tmp_path: Path) -> None:
    """The form that the page on recordings shows: empty cells are those of the other sensor."""
    t = np.arange(60)
    x = 1000.0 + 8.0 * t
    y = 500.0 + 3.0 * t
    rows = ["time,sensor,x,y,range,azimuth"]
    for i in t:
        if i % 2:
            polar = f"{np.hypot(x[i] + 900.0, y[i]):.2f},{np.arctan2(y[i], x[i] + 900.0):.5f}"
            rows.append(f"{i},radar,,,{polar}")
        else:
            rows.append(f"{i},gps,{x[i] + 2.0 * np.sin(i):.2f},{y[i] + 2.0 * np.cos(i):.2f},,")
    (tmp_path / "m.csv").write_text("\n".join(rows) + "\n")
    sensors = recognized(str(tmp_path / "m.csv")).sensors
    assert [sensor.kind for sensor in sensors] == ["position", "range-azimuth"]


def taking_turns(folder: Path, name: str, words: Any, times: Any = T) -> str:
    """Write rows of targets 3 km apart, one after the other in turn, and return what `new` says."""
    words = np.asarray(words)
    _, codes = np.unique(words, return_inverse=True)
    write(folder, name, words, LINE[:, : len(words)] + 2.0 * NOISE + 3000.0 * codes, times)
    done = trackbench("new", "experiment", "--from", "m.csv", cwd=folder)
    return done.stdout + done.stderr


@pytest.mark.parametrize("name", ["ship", "nr"])
def test_names_of_targets_that_are_written_with_a_point(tmp_path: Path, name: str) -> None:
    taking_turns(tmp_path, name, np.array(["1.0", "2.0"])[TURNS])
    guess = recognized(str(tmp_path / "m.csv"))
    assert guess.naming.columns["run"] == name
    assert guess.runs == [("1.0", 60), ("2.0", 60)]


@pytest.mark.parametrize(
    "name", ["class", "class_name", "state", "status_id", "level", "mode", "q"]
)
def test_targets_in_a_column_that_is_called_like_a_quality_are_a_question(
    tmp_path: Path, name: str
) -> None:
    said = taking_turns(tmp_path, name, np.array(["car", "bike"])[TURNS])
    assert f"column {name} splits the rows into parts that lie apart: are they several tar" in said
    for option in (f"columns.run={name}", f"columns.sensor={name}", 'columns.run=""'):
        assert f"--set '{option}'" in said
        done = trackbench("new", "experiment", "--from", "m.csv", "--set", option, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        (tmp_path / "m.yaml").unlink()


@pytest.mark.parametrize("name", ["device_id", "device", "node", "source", "station", "type"])
def test_targets_in_a_column_that_is_called_like_sensors_are_a_question(
    tmp_path: Path, name: str
) -> None:
    said = taking_turns(tmp_path, name, np.array(["A7", "B2"])[TURNS])
    assert f"column {name} splits the rows into parts that lie apart: are they several tar" in said
    options = re.findall("--set '(.*?)'", said)
    assert options[:2] == [f"columns.run={name}", f"columns.sensor={name}"]
    for option in options:
        done = trackbench("new", "experiment", "--from", "m.csv", "--set", option, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        (tmp_path / "m.yaml").unlink()


@pytest.mark.parametrize("name", ["ship", "partner"])
def test_a_target_without_a_name_beside_one_with_a_name_is_a_question(
    tmp_path: Path, name: str
) -> None:
    said = taking_turns(tmp_path, name, np.array(["", "B"])[TURNS])
    assert f"column {name}: B is the only name, and rows without one lie far from its" in said
    option = 'columns.run=""'
    assert f"--set '{option}'" in said
    done = trackbench("new", "experiment", "--from", "m.csv", "--set", option, cwd=tmp_path)
    assert done.returncode == 0, done.stderr


def test_many_targets_with_numbers(tmp_path: Path) -> None:
    jersey = 1 + np.arange(N) % 20
    write(tmp_path, "jersey", jersey, LINE / 8.0 + 0.1 * NOISE + 30.0 * jersey)
    guess = recognized(str(tmp_path / "m.csv"))
    assert guess.naming.columns["run"] == "jersey"
    assert len(guess.runs) == 20


@pytest.mark.parametrize("names", ["team,no", "fleet,boat"])
def test_targets_that_two_columns_name_are_a_question(tmp_path: Path, names: str) -> None:
    words = np.array(["A,1", "A,2", "B,1", "B,2"])[np.arange(N) % 4]
    said = taking_turns(tmp_path, names, words)
    first, second = names.split(",")
    assert f"m.csv:1:1: columns {first} and {second} together split the rows into parts tha" in said
    option = 'columns.run=""'
    assert f"--set '{option}'" in said
    done = trackbench("new", "experiment", "--from", "m.csv", "--set", option, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    (tmp_path / "m.yaml").unlink()
    # Rows of one time.
    same_times = (np.arange(N) // 4).astype(float)
    assert "together split the rows into parts" in taking_turns(tmp_path, names, words, same_times)
    # The other way: both in one column.
    write(tmp_path, "player", np.char.replace(words, ",", ""), LINE + 3000.0 * (np.arange(N) % 4))
    assert len(recognized(str(tmp_path / "m.csv")).runs) == 4


def test_measured_whole_numbers_name_no_targets(tmp_path: Path) -> None:
    for numbers in (RNG.integers(0, 30, N), 60 - np.arange(N) // 4, np.rint(LINE[0] / 40)):
        write(tmp_path, "value", numbers.astype(int), LINE + 2.0 * NOISE)
        assert "run" not in recognized(str(tmp_path / "m.csv")).naming.columns


def test_a_second_target_that_appears_late(tmp_path: Path) -> None:
    times = np.arange(1500.0)
    is_late = (times >= 1100) & (times % 2 == 1)
    values = np.stack([3.0 * times, times]) + 3000.0 * is_late
    values += np.random.default_rng(1).normal(size=values.shape)
    write(tmp_path, "name", np.where(is_late, "B", "A"), values, times)
    guess = recognized(str(tmp_path / "m.csv"))
    assert guess.naming.columns["run"] == "name"
    assert guess.runs == [("A", 1300), ("B", 200)]


@pytest.mark.parametrize("speed", ["gnd_speed", "km/h", "mph", "tas", "v"])
@pytest.mark.parametrize("track", ["track", "gnd_track", "true_track", "track_deg"])
def test_a_track_in_whole_degrees_names_nothing(tmp_path: Path, speed: str, track: str) -> None:
    """Its numbers are the directions of the positions, whether the speed is recognized or not."""
    angle = 0.7 + 0.1 * np.sin(T / 9.0)
    course = np.round(np.degrees(angle)).astype(int)
    east, north = np.cumsum(100.0 * np.stack([np.sin(angle), np.cos(angle)]), axis=1) + NOISE
    meters = 6371000.0 * np.pi / 180.0
    latitude = np.round(51.0 + north / meters, 7)
    longitude = np.round(4.0 + east / meters / np.cos(np.radians(51.0)), 7)
    meters_per_second = {"km/h": 3.6, "mph": 2.236936}.get(speed, 1.0)
    speeds = np.full(N, round(100.0 * meters_per_second, 2))
    names = f"time,latitude,longitude,{speed},{track}"
    (tmp_path / "m.csv").write_text(table(names, T, latitude, longitude, speeds, course))
    guess = recognized(str(tmp_path / "m.csv"))
    assert not {"run", "sensor"} & guess.naming.columns.keys()
    assert guess.runs == [("0", N)]
    assert guess.measures_velocity == (speed not in ("tas", "v"))
    # Neither does a config by hand ask what it names.
    load(config(tmp_path, {"measurements": "m.csv"}))


def test_targets_that_no_column_names(tmp_path: Path) -> None:
    """Rows jump to and fro between the targets; those of one target with outliers do not."""
    rng = np.random.default_rng(5)
    in_turn = {"in turn": TURNS, "by chance": rng.integers(0, 2, N), "three": np.arange(N) % 3}
    for targets in in_turn.values():
        values = LINE + 2.0 * NOISE + 3000.0 * targets
        (tmp_path / "m.csv").write_text(table("time,x,y", T, *np.round(values, 3)))
        done = trackbench("new", "experiment", "--from", "m.csv", cwd=tmp_path)
        assert done.returncode == 2
        assert "again and again: are they several targets? Give each target a numb" in done.stderr
        # A config by hand runs, with a note.
        written = config(tmp_path, {"measurements": "m.csv"})
        (note,) = load(written).points[0].scenario.cautions
        assert "again and again: are they several targets? A column that names them is" in note
        written.unlink()
        assert "--set 'columns.run=\"\"'" in done.stderr
    recognized(str(tmp_path / "m.csv"), Naming(columns={"run": ""}))
    for share in (0.05, 0.15, 0.3):
        far = np.where(rng.random(N) < share, 1000.0 * rng.normal(size=(2, N)), 0.0)
        assert first_return(LINE + 2.0 * NOISE + far) is None
    assert first_return(2.0 * NOISE) is None


@pytest.mark.parametrize("name", ["id", "gps_id", "frame_id", "id_sensor"])
def test_ids_of_sensors_in_turn_are_a_question(tmp_path: Path, name: str) -> None:
    """A name with id means targets, but rows in turn that follow one path may be those of sensors."""
    write(tmp_path, name, WORDS[TURNS], LINE + np.where(TURNS, 0.5, 20.0) * NOISE)
    done = trackbench("new", "experiment", "--from", "m.csv", cwd=tmp_path)
    assert done.returncode == 2
    assert f"rows of {name} A, B follow one path in turn: are these sensors of on" in done.stderr
    assert f"--set 'columns.sensor={name}'" in done.stderr
    guess = recognized(str(tmp_path / "m.csv"), Naming(columns={"sensor": name}))
    assert [sensor.name for sensor in guess.sensors] == ["A", "B"]
    guess = recognized(str(tmp_path / "m.csv"), Naming(columns={"run": name}))
    assert guess.runs == [("A", 60), ("B", 60)]
    # Two recordings of one way, one after the other, and two targets raise no question.
    half = N // 2
    values = np.concatenate([LINE[:, :half], LINE[:, :half]], axis=1) + NOISE
    write(tmp_path, name, WORDS.repeat(half), values, np.concatenate([T[:half], T[:half]]))
    assert recognized(str(tmp_path / "m.csv")).naming.columns["run"] == name
    write(tmp_path, name, WORDS[TURNS], LINE + 2.0 * NOISE + 300.0 * TURNS)
    if name != "id_sensor":
        assert recognized(str(tmp_path / "m.csv")).naming.columns["run"] == name
