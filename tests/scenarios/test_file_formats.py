"""Tables as loggers and spreadsheets write them: read, or refused with what to write."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from tests.commands import trackbench
from tests.scenarios.test_clocks import config
from trackbench.config.load import load
from trackbench.errors import UserError
from trackbench.scenarios.recordings.missing_cells import outlying
from trackbench.scenarios.recordings.names_and_digests_of_data_files import files_of

pytestmark = pytest.mark.usefixtures("no_report")

T = np.arange(20)
X, Y = 10.0 + 0.5 * T, 5.0 - 0.25 * T
PLAIN = [(f"{t}", f"{x}", f"{y}") for t, x, y in zip(T, X, Y, strict=True)]


def text(*rows: tuple[str, ...], head: str = "time,x,y", separator: str = ",") -> str:
    return "\n".join([head.replace(",", separator), *(separator.join(row) for row in rows)]) + "\n"


def seen(path: Path) -> Any:
    """Return the measurements of a config's only run."""
    return load(path).points[0].scenario.target._recording.measurements[..., 0]


def of_time(form: str) -> list[tuple[str, str, str]]:
    return [(form.format(k), x, y) for k, (_, x, y) in enumerate(PLAIN)]


COMMAS = [tuple(cell.replace(".", ",") for cell in row) for row in PLAIN]
FORMATS = {
    "semicolons": text(*PLAIN, separator=";"),
    "tabs": text(*PLAIN, separator="\t"),
    "white space": text(*PLAIN, separator="  "),
    "decimal commas": "\ufeff" + text(*COMMAS, separator=";"),
    "comments": "# logger v2, unit 7\n# sensor: gps\n" + text(*PLAIN),
    "a header behind #": text(*PLAIN, head="# time,x,y"),
    "a separator by name": "sep=;\n" + text(*PLAIN, separator=";"),
    "latin-1": text(*((*row, "90") for row in PLAIN), head="time,x,y,Kurs (\u00b0)"),
    "days first": text(*of_time("31/12/2024 10:00:{:02}")),
    "months first": text(*of_time("12/31/2024 10:00:{:02}")),
    "either first": text(*of_time("03/09/2024 10:00:{:02}")),
    "digits of some seconds": text(*of_time("31.12.2024 10:00:{:02}")).replace("2,", "2.000000,"),
    "time of day": text(*of_time("10:00:{:02}")),
    "zone in words": text(*of_time("2024-12-31 10:00:{:02} UTC")),
    "two columns": text(
        *(("2024-12-31", *row) for row in of_time("10:00:{:02}")), head="date,time,x,y"
    ),
    "base date time": text(*of_time("2024-12-31T10:00:{:02}"), head="BaseDateTime,x,y"),
}


@pytest.mark.parametrize("what", FORMATS)
def test_a_table_is_read(tmp_path: Path, what: str) -> None:
    encoding = "latin-1" if what == "latin-1" else "utf-8"
    (tmp_path / "m.csv").write_bytes(FORMATS[what].encode(encoding))
    made = trackbench("new", "experiment", "--from", "m.csv", cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    scenario = load(tmp_path / "m.yaml").points[0].scenario
    np.testing.assert_array_equal(scenario.target._recording.measurements[..., 0], [X[1:], Y[1:]])
    np.testing.assert_array_equal(np.diff(scenario.times), 1.0)


def test_whole_numbers_of_degrees(tmp_path: Path) -> None:
    rows = [(f"{t}", f"{52 * 10**7 + 9 * t}", f"{-4 * 10**7}") for t in T]
    (tmp_path / "m.csv").write_text(text(*rows, head="time,lat,lon"))
    options = ("--set", "units.latitude=degE7", "--set", "units.longitude=degE7")
    asked = trackbench("new", "experiment", "--from", "m.csv", cwd=tmp_path)
    assert asked.returncode == 2
    assert "the units may be lat, lon in degE7" in asked.stderr
    assert (
        trackbench("new", "experiment", "--from", "m.csv", *options, cwd=tmp_path).returncode == 0
    )
    x, y = seen(tmp_path / "m.yaml")
    # The radius of curvature of the meridian at 52 degrees is 6 375 km.
    np.testing.assert_allclose(y, np.radians(9e-7 * T[1:]) * 6.375e6, rtol=1e-3)
    np.testing.assert_allclose(x, 0.0, atol=1e-6)
    columns = {"latitude": "lat", "longitude": "lon"}
    with pytest.raises(UserError, match=r"units: \{latitude: degE7\}"):
        load(config(tmp_path, {"measurements": "m.csv", "columns": columns}))


def test_numbers_for_missing_cells(tmp_path: Path) -> None:
    rows = [
        (t, "-9999", "-9999") if i in (4, 5) else (t, x, y) for i, (t, x, y) in enumerate(PLAIN)
    ]
    (tmp_path / "m.csv").write_text(text(*rows))
    noted = load(config(tmp_path, {"measurements": "m.csv"})).points[0].scenario.cautions
    assert len(noted) == 2
    assert "x: 2 cells are -9999, far outside the others" in noted[0]
    assert "`missing: [-9999]`" in noted[0]
    assert trackbench("new", "experiment", "--from", "m.csv", cwd=tmp_path).returncode == 0
    assert np.isnan(seen(tmp_path / "m.yaml")[:, [3, 4]]).all()
    assert np.isfinite(seen(tmp_path / "m.yaml")).sum() == 2 * 17


def test_numbers_for_missing_speeds(tmp_path: Path) -> None:
    """A speed without a course may be negative, but not by far."""
    rows = [(*row, f"{0.1 * i - 0.5:g}") for i, row in enumerate(PLAIN)]
    rows[9] = (*PLAIN[9], "-9999")
    (tmp_path / "m.csv").write_text(text(*rows, head="time,x,y,speed"))
    sensor = {"kind": "function", "h": {"x": "px", "y": "py", "speed": "vx"}, "R": [1, 1, 1]}
    start = {"kind": "given", "mean": [10, 0, 5, 0], "sigma": [1, 1, 1, 1]}
    filters = {"EKF": {"kind": "ekf"}}
    target = {"measurements": "m.csv"}
    path = config(tmp_path, target, sensor=sensor, start=start, filters=filters)
    noted = load(path).points[0].scenario.cautions
    assert ["speed: 1 cell is -9999, far outside the others" in note for note in noted] == [True]


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([*range(20), 32767, -32768], {-32768.0: 1, 32767.0: 1}),
        ([52.0, 52.1, 52.2, 52.3, 52.4, 52.5, 0.0, 0.0], {0.0: 2}),
        ([*range(0, 20000, 500), -9999], {-9999.0: 1}),
        ([*range(-9999, 20000, 500)], {}),
        ([1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0], {}),
        ([5.0] * 20 + [6.0], {}),
    ],
)
def test_numbers_far_outside(values: list[float], expected: dict[float, int]) -> None:
    assert outlying(np.array(values, dtype=float)) == expected


def test_a_cell_of_two_lines_is_read(tmp_path: Path) -> None:
    rows = [(*row, '"a note\nof two lines"') for row in PLAIN]
    (tmp_path / "m.csv").write_text(text(*rows, head="time,x,y,note"))
    assert seen(config(tmp_path, {"measurements": "m.csv"})).shape == (2, 19)


def test_lines_of_separators_alone_are_skipped(tmp_path: Path) -> None:
    """Spreadsheets write them for rows whose cells were emptied."""
    (tmp_path / "m.csv").write_text(text(*PLAIN, ("", "", ""), ("", "", "")))
    np.testing.assert_allclose(seen(config(tmp_path, {"measurements": "m.csv"})), [X[1:], Y[1:]])


@pytest.mark.parametrize("names", ["time,x,y", "time, x, y"])
def test_names_that_are_repeated_between_rows_are_a_mistake(tmp_path: Path, names: str) -> None:
    rows = text(*PLAIN).splitlines()
    (tmp_path / "m.csv").write_text("\n".join([*rows[:9], names, *rows[9:]]) + "\n")
    mistake = "m.csv:10:1: repeats the names of the columns: leave such lines out; if another"
    done = trackbench("new", "experiment", "--from", "m.csv", cwd=tmp_path)
    assert done.stderr.startswith(mistake)
    with pytest.raises(UserError, match=r"m\.csv:10:1: scenario: repeats the names of the columns"):
        load(config(tmp_path, {"measurements": "m.csv"}))


def test_a_file_of_that_very_name_comes_first(tmp_path: Path) -> None:
    folder = tmp_path / "data [old]"
    folder.mkdir()
    (folder / "run[1].csv").write_text(text(*PLAIN))
    (folder / "run1.csv").write_text(text(*PLAIN[:5]))
    path = config(tmp_path, {"measurements": "data [old]/run[1].csv"})
    assert seen(path).shape == (2, 19)
    path = config(tmp_path, {"measurements": "data [old]/run1*.csv"})
    assert seen(path).shape == (2, 4)


def sensors(*names: str) -> str:
    """Return a table in which two sensors take turns; the second is 100 m off."""
    rows = [
        (t, names[i % 2], f"{float(x) + 100 * (i % 2)}", y) for i, (t, x, y) in enumerate(PLAIN)
    ]
    return text(*rows, head="time,sensor,x,y")


POSITION = {"kind": "position", "sigma": 5}


@pytest.mark.parametrize("names", [("1", "2"), ("gps", "radar")])
def test_a_column_of_sensors_beside_one_sensor_is_refused(
    tmp_path: Path, names: tuple[str, str]
) -> None:
    (tmp_path / "m.csv").write_text(sensors(*names))
    with pytest.raises(UserError, match=r"names 2 sensors .*, and the config has 1"):
        load(config(tmp_path, {"measurements": "m.csv"}))
    one = config(tmp_path, {"measurements": "m.csv", "sensors": [names[1]]})
    np.testing.assert_array_equal(seen(one)[0], X[3::2] + 100)
    assert load(one).points[0].scenario.cautions == (
        f"10 rows of {names[0]} were left out (`sensors`)",
    )
    both = {"measurements": "m.csv", "sensors": [*names]}
    values = seen(config(tmp_path, both, sensor=[POSITION, POSITION]))
    assert np.isfinite(values).sum(axis=1).tolist() == [9, 9, 10, 10]
    mixed = {"measurements": "m.csv", "columns": {"sensor": ""}}
    assert seen(config(tmp_path, mixed)).shape == (2, 19)


def test_a_config_has_a_sensor_for_each_name(tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text(sensors("gps", "radar"))
    words = ("new", "experiment", "--from", "m.csv")
    # Positions that lie 100 m apart may be those of two targets.
    asked = trackbench(*words, cwd=tmp_path)
    assert "--set 'columns.sensor=sensor'" in asked.stderr.replace("`", "")
    answer = ("--set", "columns.sensor=sensor")
    assert trackbench(*words, *answer, cwd=tmp_path).returncode == 0
    target = yaml.safe_load((tmp_path / "m.yaml").read_text())["scenario"]["target"]
    assert target["sensors"] == ["gps", "radar"]
    assert np.isfinite(seen(tmp_path / "m.yaml")).sum() == 2 * 19


def test_ranges_to_anchors(tmp_path: Path) -> None:
    places = [(0.0, 0.0), (9.0, 0.0), (5.0, -7.0)]
    ranges = [f"{np.hypot(X[t] - places[t % 3][0], Y[t] - places[t % 3][1])}" for t in T]
    rows = [(f"{t}", f"A{t % 3}", ranges[t]) for t in T]
    (tmp_path / "m.csv").write_text(text(*rows, head="t,anchor,distance"))
    made = trackbench("new", "experiment", "--from", "m.csv", cwd=tmp_path)
    assert "write into it where these are: A0, A1, A2, the start\n" in made.stdout
    unknown = trackbench("check", "m.yaml", cwd=tmp_path)
    assert unknown.returncode == 2
    assert "scenario.sensor.0.at.0: 'X_A0' is not a number" in unknown.stderr
    config = (tmp_path / "m.yaml").read_text().replace("[X, 0, Y, 0]", "[9.5, 0, 5.2, 0]")
    for i, (x, y) in enumerate(places):
        config = config.replace(f"X_A{i}, Y_A{i}", f"{x}, {y}")
    (tmp_path / "m.yaml").write_text(config)
    done = trackbench("run", "m.yaml", "--workers", "1", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert np.isfinite(seen(tmp_path / "m.yaml")).sum() == len(T)


def test_two_vessels_are_not_one_run(tmp_path: Path) -> None:
    rows = [(t, f"{219000111 + i % 2}", x, y) for i, (t, x, y) in enumerate(PLAIN)]
    (tmp_path / "m.csv").write_text(text(*rows, head="time,MMSI,x,y"))
    with pytest.raises(UserError, match="column MMSI has 2 values, which would be one run"):
        load(config(tmp_path, {"measurements": "m.csv"}))
    each = config(tmp_path, {"measurements": "m.csv", "columns": {"run": "MMSI"}})
    assert load(each).points[0].scenario.recorded_runs == 2


def test_a_pattern_may_count_from_the_working_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "data").mkdir()
    for name in ("a.csv", "data/b.csv"):
        (tmp_path / name).write_text("")
    monkeypatch.chdir(tmp_path)
    assert files_of("*.csv") == ["a.csv"]
    assert files_of("./*.csv") == ["./a.csv"]
    assert files_of("./data/*.csv") == ["./data/b.csv"]
    assert files_of("data//*.csv") == ["data/b.csv"]
    assert files_of(f"{tmp_path}/*.csv") == [f"{tmp_path}/a.csv"]


@pytest.mark.parametrize(
    ("line", "way"),
    [
        ("$RATTM,01,1.338,37.1,T,48.0,40.0,T,0.5,3.2,N,DRN,T,,080000.00,A*66", "($RATTM): write"),
        ("$HCHDG,101.1,,,7.1,W*3C", "sentences ($HCHDG): write their fields into a table"),
        ("$PUBX,00,081350.00,4717.11,N,00833.91,E,546.5,G3", "sentences ($PUBX): write"),
        ("$IIRMC,080000.00,A,4815.9,N,01140.1,E,48.60,39.9,030524,,,A*6C", "`gpsbabel -i nmea"),
        ("!BSVDM,1,1,,A,15M67FC000G?ufbE`FepT@3n00Sa,0*5C", "sentences of AIS: decode them"),
    ],
)
def test_sentences_of_nmea_are_recognized(tmp_path: Path, line: str, way: str) -> None:
    (tmp_path / "m.log").write_text(f"{line}\n" * 3)
    made = trackbench("new", "experiment", "--from", "m.log", cwd=tmp_path)
    assert made.returncode == 2
    assert made.stderr.startswith("m.log:1:1: is no table but NMEA")
    assert way in made.stderr


@pytest.mark.parametrize(
    ("content", "what"),
    [
        ('[{"time": 0.0, "x": 6.95}, {"time": 1.0, "x": 16.09}]\n', "JSON"),
        ('[\r\n  {"time": 0.0},\r\n  {"time": 1.0}\r\n]\r\n', "JSON"),
        ('{"time": 0.0}\n{"time": 1.0}\n', "JSON"),
        ("<!DOCTYPE html>\n<html></html>\n", "HTML"),
        ("<html><body>Not found</body></html>\n", "HTML"),
        ('<?xml version="1.0"?>\n<gpx></gpx>\n', "XML"),
    ],
)
def test_a_text_that_is_no_table_is_named(tmp_path: Path, content: str, what: str) -> None:
    (tmp_path / "m.csv").write_text(content, newline="")
    made = trackbench("new", "experiment", "--from", "m.csv", cwd=tmp_path)
    assert made.stderr.startswith(f"m.csv:1:1: is no table but {what}")


@pytest.mark.parametrize(
    ("cell", "advice"),
    [
        ("500 006.95", "write thousands without white space, such as 500006.95"),
        ("5\u202f600\u202f008", "write thousands without white space"),
        ("6.949774D+00", "write powers of ten with E, such as 6.9E+03"),
        ("12.5 m", "write decimal numbers, such as -8.5042, without letters"),
    ],
)
def test_the_advice_on_cells_that_are_no_numbers(tmp_path: Path, cell: str, advice: str) -> None:
    rows = [(time, cell, cell) for time, _, _ in PLAIN]
    (tmp_path / "m.csv").write_text(text(*rows))
    made = trackbench("new", "experiment", "--from", "m.csv", cwd=tmp_path)
    assert advice in made.stderr


def test_a_table_of_names_and_values_is_to_be_pivoted(tmp_path: Path) -> None:
    rows = "".join(f"{time},x,{x}\n{time},y,{y}\n" for time, x, y in PLAIN)
    (tmp_path / "m.csv").write_text(f"t,variable,value\n{rows}")
    made = trackbench("new", "experiment", "--from", "m.csv", cwd=tmp_path)
    assert "column variable names quantities and value has their values" in made.stderr
    assert "`table.pivot(index='t', columns='variable', values='value')`" in made.stderr


@pytest.mark.parametrize(
    "cell", ["6.95, 8.96", "[6.95, 8.96]", "(6.95;8.96)", "POINT (6.95 8.96)", "Point(-6.95 8.96)"]
)
def test_two_numbers_in_a_cell_are_named(tmp_path: Path, cell: str) -> None:
    rows = "".join(f"{time}|{cell}\n" for time, _, _ in PLAIN)
    (tmp_path / "m.csv").write_text(f"time|place\n{rows}")
    made = trackbench("new", "experiment", "--from", "m.csv", cwd=tmp_path)
    assert "column place has two numbers in a cell: give each a column" in made.stderr


TAG = "\\s:rx1,c:1700000000*01\\"
GGA = "$GPGGA,101000.00,5046.600,N,00106.500,W,1,08,0.9,5.4,M,46.9,M,,*76"
AIS = "!AIVDM,1,1,,A,15M67FC000G?ufbE`FepT@3n00Sa,0*5F"


@pytest.mark.parametrize(
    "before",
    [
        "1700000000.123 ",
        "1700000000,",
        "2024-05-03T10:10:00.123Z ",
        "2024-05-03 10:10:00,123 ",
        "2024-05-03 10:10:00.123, ",
        "[10:10:00.123] ",
        '10:10:00\t"',
        TAG,
        f"1700000000 {TAG}",
    ],
)
def test_sentences_behind_a_time_or_a_tag_block_are_recognized(tmp_path: Path, before: str) -> None:
    for sentence, way in (
        (GGA, "`sed 's/^[^$]*//' FILE | gpsbabel -i nmea -f - "),
        (AIS, "decode"),
    ):
        (tmp_path / "m.log").write_text(f"{before}{sentence}\n" * 3)
        made = trackbench("new", "experiment", "--from", "m.log", cwd=tmp_path)
        assert made.returncode == 2
        assert made.stderr.startswith("m.log:1:1: is no table but NMEA")
        assert way in made.stderr
    is_unix_time = "the time before each sentence (`c:`, a UNIX time) into its column `time`"
    assert (is_unix_time in made.stderr) == (TAG in before)


def test_a_name_of_a_column_may_look_like_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text(text(*PLAIN, head="$TIMES,x,y"))
    target = {"measurements": "m.csv", "columns": {"time": "$TIMES"}}
    np.testing.assert_allclose(seen(config(tmp_path, target)), [X[1:], Y[1:]])
