"""Codes for missing cells in recordings: a note counts them."""

from pathlib import Path

import numpy as np
import pytest

from tests.scenarios.test_clocks import config
from trackbench.config.load import load
from trackbench.scenarios.recordings.missing_cells import blank_codes, note_on_codes
from trackbench.scenarios.recordings.unit_names_and_sizes import UNITS

pytestmark = pytest.mark.usefixtures("no_report")

BOTH = [{"kind": "position", "sigma": 5}, {"kind": "velocity", "sigma": 1}]


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
    first, *others = scenario.cautions
    assert first == note
    # Where 102.3 kn is a speed, it was measured before the first position.
    assert len(others) == ("MMSI" not in heads)
    assert all(other.startswith("1 measurement of sensor 2 before") for other in others)
    # The plane touches the Earth at the first true position, and filters start there.
    x, y, vx, vy = scenario.target._recording.measurements[..., 0]
    np.testing.assert_allclose(y, [111.229, 222.459], rtol=1e-4)
    np.testing.assert_allclose(x, 0.0, atol=1e-6)
    assert np.isnan(vx[0]) == np.isnan(vy[0]) == ("MMSI" in heads)
    assert np.isnan(vx[1])


def test_what_is_no_code_is_a_value(tmp_path: Path) -> None:
    """A position of 511 m, an angle of a scalar, and a course of 360 in a table that is not of AIS."""
    (tmp_path / "m.csv").write_text("time,x,y\n0,511,91\n1,181,102.3\n2,360,511\n")
    scenario = load(config(tmp_path, {"measurements": "m.csv"})).points[0].scenario
    assert scenario.cautions == ()
    np.testing.assert_array_equal(
        scenario.target._recording.measurements[..., 0], [[181, 360], [102.3, 511]]
    )


@pytest.mark.parametrize(
    ("unit", "code", "value", "note"),
    [
        ("km/h", "189.46", "102.30", "speed 189.46 (1)"),
        ("km/h", "189.5", "102.3", "speed 189.5 (1)"),
        ("mph", "117.7", "102.3", "speed 117.7 (1)"),
        ("m/s", "52.63", "10.25", "speed 52.63 (1)"),
        ("m/s", "102.3", "10.2", "speed 102.3 (1)"),  # not converted, and beyond all speeds of AIS
        ("kn/10", "1023", "102", "speed 1023 (1)"),
        ("km/h", "", "189", ""),  # a rounded 102.1 kn
    ],
)
def test_codes_of_ais_have_the_unit_of_the_column(
    unit: str, code: str, value: str, note: str
) -> None:
    cells = [code or "nan", value, "nan"]
    speeds = np.array([float(cell) for cell in cells])
    counts = blank_codes("speed", speeds, of_ais=True, scale=UNITS[unit])
    np.testing.assert_array_equal(np.isfinite(speeds), [False, True, False])
    assert (note_on_codes(counts) if counts else "").endswith(note)


def test_codes_of_positions_have_their_unit() -> None:
    latitudes = np.array([1.588250, 0.872665, -1.588250])
    assert blank_codes("latitude", latitudes, of_ais=False, scale=1.0).total() == 1
    near_the_equator = np.array([91.0, 910000000.0, -91.0])
    assert (
        blank_codes("latitude", near_the_equator, of_ais=False, scale=UNITS["degE7"]).total() == 1
    )
    assert near_the_equator[0] == 91.0
    nearly_north = np.array([6.28, 3.14, 1.57])  # 359.8 deg, too
    assert not blank_codes("course", nearly_north, of_ais=True, scale=1.0)
