"""Latitude and longitude in a plane: velocities, origins, hemispheres, altitudes; runs of a truth."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.scenarios.test_clocks import config, table, tracked
from trackbench import api
from trackbench.config.load import load
from trackbench.errors import UserError

pytestmark = pytest.mark.usefixtures("no_report")

BOTH = [{"kind": "position", "sigma": 5}, {"kind": "velocity", "sigma": 1}]
PATH = [(0.0, 51.0, 2.0), (10.0, 51.004, 2.03), (20.0, 51.007, 2.07), (30.0, 51.012, 2.1)]
"""Time, s, latitude and longitude, deg."""


def cartesian(latitude: float, longitude: float, height: float = 0.0) -> np.ndarray:
    """WGS 84, one place at a time."""
    p, q = math.radians(latitude), math.radians(longitude)
    a, e2 = 6378137.0, 6.69437999014e-3
    n = a / math.sqrt(1 - e2 * math.sin(p) ** 2)
    flat = (n + height) * math.cos(p)
    return np.array([flat * math.cos(q), flat * math.sin(q), (n * (1 - e2) + height) * math.sin(p)])


def plane(place: Sequence[float], origin: Sequence[float]) -> np.ndarray:
    """East and north of the origin."""
    p, q = math.radians(origin[0]), math.radians(origin[1])
    east = [-math.sin(q), math.cos(q), 0.0]
    north = [-math.sin(p) * math.cos(q), -math.sin(p) * math.sin(q), math.cos(p)]
    return np.array([east, north]) @ (cartesian(*place) - cartesian(*origin))


def measured(path: Path) -> np.ndarray:
    """Measurements (n_z, K) of the first run, those of the start included."""
    recording = load(path).points[0].scenario.target._recording
    return np.concatenate([recording.scans, recording.measurements], axis=1)[:, :, 0]


def refused(path: Path) -> str:
    with pytest.raises(UserError) as caught:
        load(path)
    return str(caught.value)


def flight(speed: float = 230.0, course: float = 80.0, last: float = 4000.0) -> list[Any]:
    """Rows of an aircraft that keeps its course: time, place and its velocity east and north."""
    a, e2 = 6378137.0, 6.69437999014e-3
    latitude, longitude, rows = 50.0, 2.0, []
    east, north = speed * math.sin(math.radians(course)), speed * math.cos(math.radians(course))
    for t in np.arange(0.0, last + 1.0, 1.0):
        if t % 500 == 0:
            rows.append((t, latitude, longitude, east, north))
        # dphi/dt = v_n / M, dlambda/dt = v_e / (N cos phi)
        for _ in range(4):
            s2 = math.sin(math.radians(latitude)) ** 2
            meridian, across = a * (1 - e2) / (1 - e2 * s2) ** 1.5, a / math.sqrt(1 - e2 * s2)
            latitude += 0.25 * math.degrees(north / meridian)
            longitude += 0.25 * math.degrees(east / (across * math.cos(math.radians(latitude))))
    return rows


@pytest.mark.parametrize("form", ["speed and course", "vx and vy"])
@pytest.mark.parametrize("part", ["measurements", "truth"])
def test_velocities_are_those_of_the_plane(tmp_path: Path, form: str, part: str) -> None:
    """The velocity in the plane is the derivative of the position there, 900 km from the origin."""
    rows = flight()
    names = "time,latitude,longitude," + ("speed,course" if form[0] == "s" else "vx,vy")
    moved = [(230.0, 80.0) if form[0] == "s" else row[3:] for row in rows]
    text = [[*row[:3], *velocity] for row, velocity in zip(rows, moved, strict=True)]
    (tmp_path / "m.csv").write_text(table(names, *zip(*text, strict=True)))
    target = {"measurements": "m.csv"} | ({"truth": "m.csv"} if part == "truth" else {})
    path = config(tmp_path, target, sensor=BOTH)
    recording = load(path).points[0].scenario.target._recording
    found = measured(path)[2:] if part == "measurements" else recording.truth[1::2, :, 0]
    origin = rows[0][1:3]
    for k, (_, latitude, longitude, east, north) in enumerate(rows):
        if k == 0 and part == "measurements":
            continue  # the start takes the first position alone
        # Half a second along the parallel and the meridian to both sides.
        p = math.radians(latitude)
        s2 = math.sin(p) ** 2
        meridian, across = (
            6378137.0 * (1 - 6.69437999014e-3) / (1 - 6.69437999014e-3 * s2) ** 1.5,
            6378137.0 / math.sqrt(1 - 6.69437999014e-3 * s2),
        )
        dp = math.degrees(0.5 * north / meridian)
        dq = math.degrees(0.5 * east / (across * math.cos(p)))
        after = plane((latitude + dp, longitude + dq), origin)
        before = plane((latitude - dp, longitude - dq), origin)
        np.testing.assert_allclose(found[:, k], after - before, atol=2e-3)
    # The meridians converge by 10 deg on the way.
    turned = math.degrees(math.atan2(found[0, -1], found[1, -1]))
    assert turned == pytest.approx(80.0 - 9.9, abs=0.2)


def test_a_velocity_without_a_place_has_that_of_its_run_nearby(tmp_path: Path) -> None:
    rows = [[str(cell) for cell in row] for row in flight()]
    rows[-1][1:3] = ["", ""]
    text = table("time,latitude,longitude,vx,vy", *zip(*rows, strict=True))
    (tmp_path / "m.csv").write_text(text)
    path = config(tmp_path, {"measurements": "m.csv"}, sensor=BOTH)
    found = measured(path)
    assert np.isnan(found[:2, -1]).all()
    np.testing.assert_allclose(found[2:, -1], found[2:, -2], rtol=1e-9)
    # Velocities beside x and y have their axes, whatever else the table has.
    text = table("time,x,y,latitude,longitude,vx,vy", *[[0, 1, 2]] * 3, *[[50, 51, 52]] * 4)
    (tmp_path / "m.csv").write_text(text)
    np.testing.assert_array_equal(measured(path)[2:, 1:], [[51.0, 52.0]] * 2)


def test_the_origin_is_the_first_position_that_is_read(tmp_path: Path) -> None:
    rows = [f"ship,{t},{p},{q}" for t, p, q in PATH]
    miami = "other,0,25.76,-80.13"
    head = "run,time,latitude,longitude"
    (tmp_path / "m.csv").write_text("\n".join([head, miami, *rows]) + "\n")
    path = config(tmp_path, {"measurements": "m.csv", "runs": ["ship"]})
    expected = np.array([plane(place[1:], PATH[0][1:]) for place in PATH]).T
    np.testing.assert_allclose(measured(path), expected, atol=1e-3)
    assert load(path).points[0].scenario.cautions == ()
    # A sensor that is not read does not give it either.
    (tmp_path / "m.csv").write_text("\n".join([head.replace("run", "sensor"), miami, *rows]) + "\n")
    path = config(tmp_path, {"measurements": "m.csv", "sensors": ["ship"]})
    np.testing.assert_allclose(measured(path), expected, atol=1e-3)
    # A recorded path that is flown by a simulated target.
    (tmp_path / "m.csv").write_text("\n".join([head, miami, *rows]) + "\n")
    target = {"kind": "recorded", "file": "m.csv", "run": "ship"}
    scenario = load(config(tmp_path, target, last=30)).points[0].scenario
    states = scenario.target.states(np.array([0.0, 10.0, 20.0, 30.0]))
    np.testing.assert_allclose(states[0::2], expected, atol=1e-3)


def test_a_run_far_from_the_others_has_its_own_origin(tmp_path: Path) -> None:
    rows = [f"{run},{t},{p},{q + 60 * (run == 'B')}" for run in "AB" for t, p, q in PATH]
    text = "\n".join(["run,time,latitude,longitude", *rows]) + "\n"
    (tmp_path / "m.csv").write_text(text)
    (tmp_path / "truth.csv").write_text(text)
    path = config(tmp_path, {"measurements": "m.csv", "truth": "truth.csv"})
    scenario = load(path).points[0].scenario
    expected = np.array([plane(place[1:], PATH[0][1:]) for place in PATH]).T
    for run in range(2):
        found = scenario.target._recording.measurements[:, :, run]
        np.testing.assert_allclose(found, expected[:, 1:], atol=1e-3)
        found = scenario.target._recording.truth[0::2, :, run]
        np.testing.assert_allclose(found, expected, atol=1e-3)
    (note,) = scenario.cautions
    assert note.startswith("runs that begin far from the first position that is read: B by 4")
    assert note.endswith(" km; x and y of each count from its own first position")
    # A truth without runs is in one place only.
    (tmp_path / "truth.csv").write_text(text.replace("run,", "label,").split("B")[0])
    line = refused(path)
    assert "truth.csv:1:1: scenario: names no runs, and run B has an origin of its own" in line
    # A given origin is that of all runs.
    line = refused(config(tmp_path, {"measurements": "m.csv", "origin": [51, 2]}))
    assert "m.csv:6:1: scenario: latitude and longitude: 4" in line
    assert " km from `origin`, as are 3 more; a plane serves for 2000 km" in line


@pytest.mark.parametrize(
    ("origin", "way"),
    [
        ([2, 51], "with latitude and longitude exchanged, [51, 2], it would be 0 m away"),
        ([51, -2], "with the other sign of the longitude, [51, 2], it would be 0 m away"),
        ([-51.1, 2], "with the other sign of the latitude, [51.1, 2], it would be 11.1 km away"),
        ([20, -60], "a plane serves for 2000 km: write latitude and longitude of a point near"),
    ],
)
def test_an_origin_far_from_the_positions_is_refused(
    tmp_path: Path, origin: list[float], way: str
) -> None:
    (tmp_path / "m.csv").write_text(table("time,latitude,longitude", *zip(*PATH, strict=True)))
    line = refused(config(tmp_path, {"measurements": "m.csv", "origin": origin}))
    assert "scenario.target.origin: lies " in line
    assert f" from the first position (m.csv:2); {way}" in line
    load(config(tmp_path, {"measurements": "m.csv", "origin": [50.5, 3]}))


@pytest.mark.parametrize("columns", [{}, {"run": "name"}])
def test_a_truth_with_exchanged_coordinates_is_told_so(
    tmp_path: Path, columns: dict[str, str]
) -> None:
    rows = [(*row, "A") for row in PATH]
    (tmp_path / "m.csv").write_text(table("time,lat,lon,name", *zip(*rows, strict=True)))
    (tmp_path / "truth.csv").write_text(table("time,latitude,longitude", *zip(*PATH, strict=True)))
    target = {
        "measurements": "m.csv",
        "columns": {"latitude": "lon", "longitude": "lat", **columns},
        "truth": "truth.csv",
        "truth_naming": {},
    }
    line = refused(config(tmp_path, target))
    assert "truth.csv:" in line
    assert " km from the first position (m.csv:2)" in line
    assert "with latitude and longitude exchanged, [2, 51], it would be 0 m away" in line
    assert "correct the columns or the signs of one of the two files" in line
    # A truth from 1100 km away has no such explanation.
    places = [(t, latitude - 10.0, longitude + 3.0) for t, latitude, longitude in PATH]
    text = table("time,latitude,longitude", *zip(*places, strict=True))
    (tmp_path / "truth.csv").write_text(text)
    target["columns"] = {"latitude": "lat", "longitude": "lon", **columns}
    if columns:
        line = refused(config(tmp_path, target))
        assert "is it the truth of these measurements, and are its units right?" in line


def test_distances_from_the_origin(tmp_path: Path) -> None:
    rows = [*PATH, (4000.0, 51.0, 16.0)]
    (tmp_path / "m.csv").write_text(table("time,latitude,longitude", *zip(*rows, strict=True)))
    path = config(tmp_path, {"measurements": "m.csv"})
    (note,) = load(path).points[0].scenario.cautions
    # 14 deg along the parallel of 51 N: 979 km on a sphere; 1 - cos(979 / 6378) = 1.2 %.
    assert note.startswith("positions lie up to 981 km from the origin, where the tangent plane")
    assert "shortens distances by 1.2 %" in note
    rows[3] = (30.0, 1.0, 1.0)
    (tmp_path / "m.csv").write_text(table("time,latitude,longitude", *zip(*rows, strict=True)))
    line = refused(path)
    assert "m.csv:5:1: scenario: latitude and longitude: 55" in line
    assert " km from the first position (m.csv:2), the origin; a plane serves for 2000 km" in line


def test_velocities_without_places_are_not_rotated(tmp_path: Path) -> None:
    rows = [*PATH, (400.0, 51.0, 4.0)]
    (tmp_path / "m.csv").write_text(table("time,latitude,longitude", *zip(*rows, strict=True)))
    (tmp_path / "v.csv").write_text(table("time,vx,vy", [10, 20], [1, 2], [3, 4]))
    path = config(tmp_path, {"measurements": ["m.csv", "v.csv"]}, sensor=BOTH)
    np.testing.assert_array_equal(measured(path)[2:, 1:3], [[1, 2], [3, 4]])
    (note,) = load(path).points[0].scenario.cautions
    # 2 deg sin(51) = 1.55 deg.
    assert note.endswith(
        "not rotated: north at the target differs from that of the origin by up to 1.6 deg"
    )


def test_longitudes_from_0_to_360(tmp_path: Path) -> None:
    rows = [(t, p, q - 2.05) for t, p, q in PATH]
    (tmp_path / "m.csv").write_text(table("time,latitude,longitude", *zip(*rows, strict=True)))
    path = config(tmp_path, {"measurements": "m.csv"})
    expected = measured(path)
    rows = [(t, p, q % 360.0) for t, p, q in rows]
    (tmp_path / "m.csv").write_text(table("time,latitude,longitude", *zip(*rows, strict=True)))
    np.testing.assert_allclose(measured(path), expected, atol=1e-6)
    assert load(path).points[0].scenario.cautions == ()


def test_a_longitude_of_181_among_those_to_360_is_a_place(tmp_path: Path) -> None:
    rows = [(0, 10, 180.9), (1, 10, 181), (2, 10, 181.1)]
    (tmp_path / "m.csv").write_text(table("time,latitude,longitude", *zip(*rows, strict=True)))
    path = config(tmp_path, {"measurements": "m.csv"})
    np.testing.assert_allclose(np.diff(measured(path)[0]), 10964.0, atol=3.0)


def test_hemispheres(tmp_path: Path) -> None:
    rows = [(t, 50.98 - p, q - 2.05) for t, p, q in PATH]  # across the equator and Greenwich
    (tmp_path / "m.csv").write_text(table("time,latitude,longitude", *zip(*rows, strict=True)))
    path = config(tmp_path, {"measurements": "m.csv"})
    expected = measured(path)
    text = [(t, -abs(p), "NS"[p < 0], abs(q), "EW"[q < 0]) for t, p, q in rows]
    text = [(t, abs(p), ns, q, ew) for t, p, ns, q, ew in text]
    names = "time,latitude,ns,longitude,ew"
    (tmp_path / "m.csv").write_text(table(names, *zip(*text, strict=True)))
    line = refused(path)
    assert (
        "m.csv:2:1: scenario: ns: S beside a latitude of 0.02: say `columns: {north_south: ns}`"
        in line
    )
    columns = {"north_south": "ns", "east_west": "ew"}
    path = config(tmp_path, {"measurements": "m.csv", "columns": columns})
    np.testing.assert_allclose(measured(path), expected, atol=1e-6)
    # Letters beside numbers that have their signs change nothing, and need no key.
    signed = [(t, p, "NS"[p < 0], q, "EW"[q < 0]) for t, p, q in rows]
    (tmp_path / "m.csv").write_text(table(names, *zip(*signed, strict=True)))
    np.testing.assert_allclose(measured(path), expected, atol=1e-6)
    path = config(tmp_path, {"measurements": "m.csv"})
    np.testing.assert_allclose(measured(path), expected, atol=1e-6)
    path = config(tmp_path, {"measurements": "m.csv", "columns": columns})
    (tmp_path / "m.csv").write_text(table(names, [0, 1], [-5, 5], "NN", [1, 1], "EE"))
    assert "m.csv:2:1: scenario: latitude: -5 beside N in column ns: correct one" in refused(path)
    # Nor may the sign and the letter differ in a column that the config does not name.
    unnamed = config(tmp_path, {"measurements": "m.csv"})
    line = refused(unnamed)
    assert "m.csv:2:1: scenario: ns: N beside a latitude of -5: correct one of them, or say" in line
    path = config(tmp_path, {"measurements": "m.csv", "columns": columns})
    (tmp_path / "m.csv").write_text(table(names, [0, 1], [5, 5], "NO", [1, 1], "EE"))
    assert "m.csv:3:1: scenario: ns: 'O' is no hemisphere; allowed: N and S" in refused(path)


def test_an_altitude_does_not_move_a_place_in_the_plane(tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text(table("time,latitude,longitude", *zip(*PATH, strict=True)))
    path = config(tmp_path, {"measurements": "m.csv"})
    expected = measured(path)
    rows = [(*place, height) for place, height in zip(PATH, [9000, "", 11000, 0], strict=True)]
    names = "time,latitude,longitude,altitude"
    (tmp_path / "m.csv").write_text(table(names, *zip(*rows, strict=True)))
    np.testing.assert_array_equal(measured(path), expected)
    # In space it is the height, and a row without it has no position.
    space = {"kind": "position-3d", "sigma": 5}
    path = config(tmp_path, {"measurements": "m.csv", "axes": 3}, sensor=space)
    scenario = load(path).points[0].scenario
    assert np.isnan(measured(path)).any(axis=0).tolist() == [False, True, False, False]
    assert any("1 row of" in note and "has no altitude" in note for note in scenario.cautions)
    # All heights are that of the origin, if it has one.
    path = config(tmp_path, {"measurements": "m.csv", "origin": [51, 2, 6378.137e1]})
    np.testing.assert_allclose(measured(path)[:, 1:], 1.01 * expected[:, 1:], rtol=1e-4)


TRUTH = "run,time,px,py\n01,0,0,0\n01,1,1,1\n{},0,0,0\n{},1,1,1\n"


def test_runs_without_a_truth(tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text("run,time,x,y\n01,0,0,0\n01,1,1,1\n02,0,9,9\n02,1,9,8\n")
    path = config(tmp_path, {"measurements": "m.csv", "truth": "truth.csv"})
    (tmp_path / "truth.csv").write_text(TRUTH.format("2", "2"))
    line = refused(path)
    assert "truth.csv:1:1: scenario: has no run '02', but '2' (1 run has no truth: 02)" in line
    (tmp_path / "truth.csv").write_text(TRUTH.format("B", "B"))
    (note,) = load(path).points[0].scenario.cautions
    assert note == "truth: 1 of 2 runs has none at any step (02): errors are those of the others"
    (tmp_path / "truth.csv").write_text(TRUTH.format("02", "02").replace(",0,", ",7,"))
    tracked(path)
    (tmp_path / "truth.csv").write_text(TRUTH.format("B", "B").replace("01", "A"))
    assert "has no run 01, 02; there are A, B: give runs one name in both files" in refused(path)


def test_of_many_runs_without_a_truth_some_are_named_and_the_others_counted(tmp_path: Path) -> None:
    rows = [[f"A{run:02}", t, run, t] for run in range(11) for t in range(2)]
    (tmp_path / "m.csv").write_text(table("run,time,x,y", *zip(*rows, strict=True)))
    path = config(tmp_path, {"measurements": "m.csv", "truth": "truth.csv"})
    (tmp_path / "truth.csv").write_text(TRUTH.replace("01", "A00").format("A01", "A01"))
    (note,) = load(path).points[0].scenario.cautions
    names = "A02, A03, A04, A05, A06, A07, A08, A09 and 1 more"
    assert (
        note
        == f"truth: 9 of 11 runs have none at any step ({names}): errors are those of the others"
    )


def test_the_ranking_counts_the_runs_with_a_truth(tmp_path: Path) -> None:
    rows = [[run, t, t + run, 2 * t] for run in range(4) for t in range(12)]
    (tmp_path / "m.csv").write_text(table("run,time,x,y", *zip(*rows, strict=True)))
    rows = [[*row[:2], row[2] + 0.1 * row[0] ** 2, row[3]] for row in rows if row[0] in (1, 3)]
    (tmp_path / "truth.csv").write_text(table("run,time,px,py", *zip(*rows, strict=True)))
    path = config(tmp_path, {"measurements": "m.csv", "truth": "truth.csv"})
    report = api.run(path, out=tmp_path / "out", workers=1, quiet=True, formats=())
    (ranking,) = report.ranking()
    assert ranking.title.startswith("Ranking over 2 of 4 runs by position RMSE")


def test_a_filter_over_900_km(tmp_path: Path) -> None:
    """Error, ANIS and log score of a Kalman filter of speeds and courses, by another program."""
    rng = np.random.default_rng(4)
    rows, times = flight(), np.arange(0.0, 4001.0, 500.0)
    origin = rows[0][1:3]
    sigma_position, sigma_velocity, q = 15.0, 1.0, 1e-3
    noisy, truth = [], []
    for t, latitude, longitude, east, north in rows:
        speed, course = math.hypot(east, north), math.degrees(math.atan2(east, north))
        truth.append((t, latitude, longitude, speed, course))
        latitude += sigma_position * rng.normal() / 111e3
        longitude += sigma_position * rng.normal() / (111e3 * math.cos(math.radians(latitude)))
        east, north = (part + sigma_velocity * rng.normal() for part in (east, north))
        speed, course = math.hypot(east, north), math.degrees(math.atan2(east, north))
        noisy.append((t, latitude, longitude, speed, course))
    names = "time,latitude,longitude,speed,course"
    (tmp_path / "m.csv").write_text(table(names, *zip(*noisy, strict=True)))
    (tmp_path / "truth.csv").write_text(table(names, *zip(*truth, strict=True)))
    origin = noisy[0][1:3]

    def state(row: Any) -> np.ndarray:
        """Return px, vx, py, vy: the velocity from the places half a second before and after."""
        _, latitude, longitude, speed, course = row
        p, c = math.radians(latitude), math.radians(course)
        s2 = math.sin(p) ** 2
        meridian = 6378137.0 * (1 - 6.69437999014e-3) / (1 - 6.69437999014e-3 * s2) ** 1.5
        across = 6378137.0 / math.sqrt(1 - 6.69437999014e-3 * s2)
        dp = math.degrees(0.5 * speed * math.cos(c) / meridian)
        dq = math.degrees(0.5 * speed * math.sin(c) / (across * math.cos(p)))
        x, y = plane((latitude, longitude), origin)
        after = plane((latitude + dp, longitude + dq), origin)
        vx, vy = after - plane((latitude - dp, longitude - dq), origin)
        return np.array([x, vx, y, vy])

    z, exact = np.array([state(row) for row in noisy]), np.array([state(row) for row in truth])
    R = np.diag([sigma_position**2, sigma_velocity**2] * 2)
    m, P = np.array([z[0, 0], 0.0, z[0, 2], 0.0]), np.diag([sigma_position**2, 250.0**2] * 2)
    dt = times[1]
    F = np.kron(np.eye(2), [[1.0, dt], [0.0, 1.0]])
    Q = q * np.kron(np.eye(2), [[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    errors, nis, scores = [(m - exact[0])[::2]], [], []
    for k in range(1, len(times)):
        m, P = F @ m, F @ P @ F.T + Q
        S, innovation = P + R, z[k] - m
        nis.append(innovation @ np.linalg.solve(S, innovation))
        scores.append(-0.5 * (nis[-1] + np.linalg.slogdet(2 * np.pi * S)[1]))
        gain = P @ np.linalg.inv(S)
        m, P = m + gain @ innovation, P - gain @ P
        errors.append((m - exact[k])[::2])
    target = {"measurements": "m.csv", "truth": "truth.csv"}
    start = {"kind": "one-scan", "sigma_velocity": 250}
    sensor = [
        {"kind": "position", "sigma": sigma_position},
        {"kind": "velocity", "sigma": sigma_velocity},
    ]
    assume = {"motion": {"kind": "cwna", "q": q}}
    path = config(tmp_path, target, sensor=sensor, start=start, assume=assume)
    columns = "{A: mean(anis), L: mean(log_score), R: mean(rmse_position)}"
    path.write_text(f"{path.read_text()}tables: {{t: {{kind: metrics, columns: {columns}}}}}\n")
    report = api.run(path, out=tmp_path / "out", workers=1, quiet=True, formats=())
    found = report.per_run.set_index("metric")["value"]
    assert found["anis"] == pytest.approx(np.mean(nis) / 4, rel=1e-3)
    assert found["log_score"] == pytest.approx(np.mean(scores), rel=1e-3)
    squares = np.square(errors).sum(axis=1)
    assert found["rmse_position"] == pytest.approx(math.sqrt(squares.mean()), rel=1e-3)
