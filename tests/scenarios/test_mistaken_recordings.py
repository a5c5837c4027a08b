"""Recordings that mean something else than they say: one line with its place, or a note that counts."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.scenarios.test_clocks import config
from trackbench.config.load import load
from trackbench.errors import UserError

PLAIN = "time,x,y\n0,1,2\n1,2,3\n2,3,4\n3,4,6\n"
DATES = "time,x,y\n" + "".join(f"2026-01-01T00:00:0{k},{k},{k}\n" for k in range(4))
EARTH = "time,latitude,longitude,speed,course\n" + "".join(
    f"{k},50.00{k},-1.0,10,{10 * k}\n" for k in range(4)
)
POLAR = "time,range,azimuth\n0,100,0.1\n1,-5,0.1\n2,120,0.1\n3,-7,0.1\n"
BOTH = [{"kind": "position", "sigma": 5}, {"kind": "velocity", "sigma": 1}]
RADAR = {"kind": "range-azimuth", "sigma_range": 5, "sigma_azimuth_mrad": 9}


def score(*windows: dict[str, Any], **keys: Any) -> dict[str, Any]:
    return {"score": {"windows": list(windows), **keys}}


@pytest.mark.parametrize(
    ("rows", "target", "changes", "expected"),
    [
        # An origin of plane coordinates.
        (PLAIN, {"origin": [50, 4]}, {}, "target.origin: no file has latitude and longitude"),
        # A unit of another dimension than the column's.
        (PLAIN, {"units": {"x": "deg"}}, {}, "units.x: 'deg' is not a unit of length, which x has"),
        (PLAIN, {"units": {"time": "km"}}, {}, "units.time: 'km' is not a unit of time"),
        (PLAIN, {"units": {"run": "s"}}, {}, "units.run: a run has no unit: leave it out"),
        (EARTH, {"units": {"latitude": "m"}}, {}, "units.latitude: 'm' is not a unit of angle"),
        (EARTH, {"units": {"speed": "km"}}, {}, "units.speed: 'km' is not a unit of speed"),
        # Values that a quantity cannot have: the first line, and how many.
        (
            EARTH.replace("50.001", "95").replace("50.003", "-95"),
            {},
            {},
            "m.csv:3:1: scenario: latitude: 95 deg is impossible, as are 1 more; "
            "a latitude is within -90 and 90 deg",
        ),
        (EARTH.replace("-1.0", "-190"), {}, {}, "m.csv:2:1: scenario: longitude: -190 deg is imp"),
        (POLAR, {}, {"sensor": RADAR}, "m.csv:3:1: scenario: range: -5 m is impossible, as are 1"),
        (
            EARTH.replace(",30\n", ",720\n"),
            {},
            {"sensor": BOTH},
            "m.csv:5:1: scenario: course: 720",
        ),
        # One column for two quantities.
        (PLAIN, {"columns": {"y": "x"}}, {}, "m.csv:1:1: scenario: column x is both x and y"),
        (PLAIN, {"columns": {"time": "x"}}, {}, "m.csv:1:1: scenario: column x is both x and time"),
        # Clocks.
        (
            DATES,
            {"units": {"time": "ms"}},
            {},
            "time has dates, which have no unit: leave `time: m",
        ),
        (
            PLAIN.replace("time", "step"),
            {"units": {"time": "ms"}},
            {},
            "m.csv:1:1: scenario: step has numbers of steps, which have no unit",
        ),
        (
            DATES.replace(":02,", ":02Z,"),
            {},
            {},
            "m.csv:4:1: scenario: time: '2026-01-01T00:00:02Z'",
        ),
        (
            re.sub(r"(:0[0-2]),", r"\1+01:00,", DATES),
            {},
            {},
            "' is not a time with a zone, as that of the f",
        ),
        (
            PLAIN,
            {"truth": "dates.csv"},
            {},
            "dates.csv:1:1: scenario: its column time has dates, and that of ",
        ),
        (
            re.sub(r"(:0\d),", r"\1Z,", DATES),
            {"truth": "dates.csv"},
            {},
            "dates.csv:1:1: scenario: its column time has dates, and that of ",
        ),
        (PLAIN, {"resample": 1e-9}, {}, "m.csv:1:1: scenario: gives 3e+09 steps, more than 100000"),
        (
            "step,x,y\n1,1,1\n999999999,2,2\n",
            {},
            {},
            "m.csv:1:1: scenario: gives 999999999 steps, more than 100000",
        ),
        # Windows.
        (
            PLAIN,
            {},
            score({"name": "a", "first": 1}, {"name": "a", "last": 2}),
            "score.windows.1.name: there are two windows 'a': give each a name of its own",
        ),
        (
            PLAIN,
            {},
            score({"name": "a", "first": 3, "last": 1}),
            "score.windows.0.last: ends at step 1, before its first, 3",
        ),
        (
            PLAIN,
            {},
            score({"name": "all"}, {"name": "b", "first": 9}),
            "score.windows.1: holds no scored step; steps 0 to 3 are scored",
        ),
        (
            PLAIN,
            {},
            score({"name": "early", "last": 1}, train=0.5),
            "score.windows.0: holds no scored step; steps 2 to 3 are scored",
        ),
    ],
)
def test_a_mistake_is_one_line(
    tmp_path: Path, rows: str, target: dict[str, Any], changes: dict[str, Any], expected: str
) -> None:
    (tmp_path / "m.csv").write_text(rows)
    (tmp_path / "dates.csv").write_text(DATES)
    with pytest.raises(UserError) as caught:
        load(config(tmp_path, {"measurements": "m.csv"} | target, **changes))
    (line,) = str(caught.value).splitlines()
    assert expected in line


@pytest.mark.parametrize(
    ("heads", "note"),
    [
        (
            "time,MMSI,latitude,longitude,SOG,COG",
            '7 cells hold a code for "not available" and count as missing: course 360 (2), '
            "course 511 (1), latitude 91 (1), longitude 181 (1), speed 102.3 (2)",
        ),
        (
            "time,name,latitude,longitude,v,track",  # 102.3 kn and due north may be an aircraft's
            '3 cells hold a code for "not available" and count as missing: course 511 (1), '
            "latitude 91 (1), longitude 181 (1)",
        ),
    ],
)
def test_codes_for_not_available_are_missing(tmp_path: Path, heads: str, note: str) -> None:
    rows = [
        "0,1,91,181,102.3,360",
        "1,1,50,-1,10,90",
        "2,1,50.001,-1,102.3,360",
        "3,1,50.002,-1,9,511",
    ]
    (tmp_path / "m.csv").write_text("\n".join([heads, *rows]) + "\n")
    _, run, *_, speed, course = heads.split(",")
    columns = {"run": run, "speed": speed, "course": course}
    target = {"measurements": "m.csv", "columns": columns, "units": {"speed": "kn"}}
    scenario = load(config(tmp_path, target, sensor=BOTH)).points[0].scenario
    assert scenario.cautions == (note,)
    # The plane touches the Earth at the first true position, and filters start there.
    x, y, vx, vy = scenario.target._recording.measurements[..., 0]
    np.testing.assert_allclose(y, [111.229, 222.459], rtol=1e-4)
    np.testing.assert_allclose(x, 0.0, atol=1e-6)
    assert np.isnan(vx[0]) == np.isnan(vy[0]) == ("MMSI" in heads)
    assert np.isnan(vx[1])


def test_a_recording_of_codes_alone_has_no_origin(tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text("time,latitude,longitude\n0,91,181\n1,91,181\n")
    with pytest.raises(UserError):
        load(config(tmp_path, {"measurements": "m.csv"}))


def test_what_is_no_code_is_a_value(tmp_path: Path) -> None:
    """A position of 511 m, an angle of a scalar, and a course of 360 in a table that is not of AIS."""
    (tmp_path / "m.csv").write_text("time,x,y\n0,511,91\n1,181,102.3\n2,360,511\n")
    scenario = load(config(tmp_path, {"measurements": "m.csv"})).points[0].scenario
    assert scenario.cautions == ()
    np.testing.assert_array_equal(
        scenario.target._recording.measurements[..., 0], [[181, 360], [102.3, 511]]
    )
