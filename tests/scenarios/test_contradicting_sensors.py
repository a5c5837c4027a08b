"""Notes on a radar whose clock, origin or angles contradict a truth or another sensor."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from trackbench.config.load import load
from trackbench.core.arrays import Array

STEPS = 1200
INTERVAL = 2.5
SIGMA_RANGE = 15.0
SIGMA_AZIMUTH = 7e-3
SENSOR = {"kind": "range-azimuth", "sigma_range": 15, "sigma_azimuth_mrad": 7}
POSITION = {"kind": "position", "sigma": 1}


def path_of_ship(time: Array) -> Array:
    """Return the positions (2, K) of a ship at 4 m/s that turns now and then."""
    fine = np.arange(-8000.0, 12000.0)
    heading = 0.4 + 0.9 * np.sin(fine / 300.0) + 0.5 * np.sin(fine / 1100.0 + 1.0)
    x = 500.0 + np.cumsum(4.0 * np.cos(heading))
    y = 6500.0 + np.cumsum(4.0 * np.sin(heading))
    return np.stack([np.interp(time, fine, x), np.interp(time, fine, y)])


def write_radar(folder: Path, seed: int = 1, move: tuple[float, float] = (0.0, 0.0)) -> None:
    """Write the table of a radar, radar.csv, whose origin is off by ``move``, m."""
    rng = np.random.default_rng(seed)
    t = INTERVAL * np.arange(STEPS)
    x, y = path_of_ship(t) + np.array(move)[:, None]
    r = np.hypot(x, y) + SIGMA_RANGE * rng.normal(size=STEPS)
    a = np.arctan2(y, x) + SIGMA_AZIMUTH * rng.normal(size=STEPS)
    lines = [f"{a_},{b_:.2f},{c_:.6f}" for a_, b_, c_ in zip(t, r, a, strict=True)]
    (folder / "radar.csv").write_text("\n".join(["time,range,azimuth", *lines]))


def write_positions(folder: Path, late: float = 0.0, sigma: float = 0.5, seed: int = 2) -> None:
    """Write the table of positions each second, gps.csv, whose clock is ``late`` by so many s."""
    rng = np.random.default_rng(seed)
    t = np.arange(8.0, INTERVAL * STEPS)
    x, y = path_of_ship(t) + sigma * rng.normal(size=(2, len(t)))
    lines = [f"{a_ + late:.3f},{b_:.2f},{c_:.2f}" for a_, b_, c_ in zip(t, x, y, strict=True)]
    (folder / "gps.csv").write_text("\n".join(["time,x,y", *lines]))


def notes(folder: Path, target: dict[str, Any], sensor: Any) -> tuple[str, ...]:
    """Return the notes on a config with these keys of the target and this sensor."""
    config = {
        "name": "ship",
        "scenario": {
            "kind": "tracking",
            "target": {"kind": "measured", **target},
            "sensor": sensor,
            "start": {"kind": "one-scan", "sigma_velocity": 10},
            "assume": {"motion": {"kind": "cwna", "q": 0.06}},
        },
        "filters": {"EKF": {"kind": "ekf"}},
    }
    (folder / "ship.yaml").write_text(yaml.safe_dump(config))
    return load(folder / "ship.yaml").points[0].scenario.cautions


BESIDE_TRUTH = {
    "measurements": "radar.csv",
    "truth": "gps.csv",
    "truth_naming": {"columns": {"time": "time", "px": "x", "py": "y"}},
    "truth_gap": 1.5,
}


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("late", [12.0, -20.0, 25.0, -30.0, 60.0, -300.0, 1800.0])
def test_a_delay_beside_a_truth_is_named_with_its_size(
    tmp_path: Path, late: float, seed: int
) -> None:
    """The delay is within 3 % or 0.3 s; its standard error is some 0.1 s, and it has two digits."""
    write_radar(tmp_path, seed)
    write_positions(tmp_path, late)
    (note,) = notes(tmp_path, BESIDE_TRUTH, SENSOR)
    match = re.search(r"some ([\d.]+) s (ahead of|behind) the truth: check the clocks", note)
    assert match
    assert float(match[1]) == pytest.approx(abs(late), rel=0.03, abs=0.3)
    assert match[2] == ("ahead of" if late > 0.0 else "behind")


@pytest.mark.parametrize("late", [0.0, 1.0])
def test_a_right_clock_beside_a_truth_has_no_note(tmp_path: Path, late: float) -> None:
    write_radar(tmp_path)
    write_positions(tmp_path, late)
    assert notes(tmp_path, BESIDE_TRUTH, SENSOR) == ()


BESIDE_POSITIONS = {
    "measurements": ["radar.csv", "gps.csv"],
    "measurement_naming": [
        {"columns": {"time": "time", "range": "range", "azimuth": "azimuth"}},
        {"columns": {"time": "time", "x": "x", "y": "y"}},
    ],
}


@pytest.mark.parametrize("late", [15.0, -30.0, 1800.0])
def test_a_delay_beside_positions_is_named_with_its_size(tmp_path: Path, late: float) -> None:
    write_radar(tmp_path)
    write_positions(tmp_path, late)
    found = notes(tmp_path, BESIDE_POSITIONS, [SENSOR, POSITION])
    (note,) = [note for note in found if "check the clocks" in note]
    match = re.search(
        r"of sensor 1 .* ([\d.]+) s (ahead of|behind) the positions of sensor 2:", note
    )
    assert match
    assert float(match[1]) == pytest.approx(abs(late), rel=0.03, abs=0.3)
    assert match[2] == ("ahead of" if late > 0.0 else "behind")


@pytest.mark.parametrize("move", [(0.0, 1000.0), (-700.0, 900.0)])
@pytest.mark.parametrize("is_first", [True, False])
def test_a_radar_with_another_origin_than_positions_is_noted(
    tmp_path: Path, move: tuple[float, float], is_first: bool
) -> None:
    """The note says by how much, whichever of both sensors comes first."""
    write_radar(tmp_path, move=move)
    write_positions(tmp_path)
    target = BESIDE_POSITIONS
    sensors = [SENSOR, POSITION]
    if not is_first:
        target = {key: value[::-1] for key, value in target.items()}
        sensors = [POSITION, SENSOR]
    found = notes(tmp_path, target, sensors)
    (note,) = [note for note in found if "they agree if the positions of sensor" in note]
    match = re.search(r"are moved by \[(-?\d+), (-?\d+)\] m: do both count from one origin", note)
    assert match
    assert np.allclose([float(match[1]), float(match[2])], move, atol=20.0)


def test_a_radar_with_another_origin_than_the_truth_is_noted(tmp_path: Path) -> None:
    write_radar(tmp_path, move=(0.0, 1000.0))
    write_positions(tmp_path)
    (note,) = notes(tmp_path, BESIDE_TRUTH, SENSOR)
    assert "they agree if the truth is moved by [" in note


def test_mirrored_azimuths_beside_positions_are_noted(tmp_path: Path) -> None:
    write_radar(tmp_path)
    write_positions(tmp_path)
    naming = [
        {**BESIDE_POSITIONS["measurement_naming"][0], "clockwise": ["azimuth"]},
        BESIDE_POSITIONS["measurement_naming"][1],
    ]
    target = {**BESIDE_POSITIONS, "measurement_naming": naming}
    (note,) = notes(tmp_path, target, [SENSOR, POSITION])
    assert "measurement of sensor 1 disagrees with the positions of sensor 2" in note
    assert note.endswith("counts from x to y: leave `clockwise: [azimuth]` out")


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize(("sigma", "late"), [(0.5, 0.0), (0.5, 2.0), (40.0, 0.0)])
def test_a_radar_that_agrees_with_positions_has_no_note(
    tmp_path: Path, seed: int, sigma: float, late: float
) -> None:
    """Positions may also be less accurate than the radar, and their sigma in the config too small."""
    write_radar(tmp_path, seed)
    write_positions(tmp_path, late, sigma, seed)
    assert notes(tmp_path, BESIDE_POSITIONS, [SENSOR, POSITION]) == ()


@pytest.mark.parametrize("move", [0.0, 1000.0])
def test_two_radars_are_compared(tmp_path: Path, move: float) -> None:
    write_radar(tmp_path, seed=2)
    (tmp_path / "radar.csv").rename(tmp_path / "other.csv")
    write_radar(tmp_path, seed=3, move=(0.0, move))
    found = notes(tmp_path, {"measurements": ["other.csv", "radar.csv"]}, [SENSOR, SENSOR])
    assert len(found) == (move > 0.0)
    assert all("the positions of sensor 1 are moved by [" in note for note in found)


@pytest.mark.parametrize("read", ["m", "km", "ft", "mi"])
@pytest.mark.parametrize("sigma", [15.0, 0.008])
def test_ranges_in_nautical_miles_are_named(tmp_path: Path, read: str, sigma: float) -> None:
    """The unit of a truth of latitudes is right. The sigma may be guessed from the wrong ranges."""
    write_radar(tmp_path)
    write_positions(tmp_path)
    for name, factors in (("radar", (1.0, 1.0 / 1852.0, 1.0)), ("gps", (1.0, 1.0, 1.0))):
        rows = np.loadtxt(tmp_path / f"{name}.csv", delimiter=",", skiprows=1)
        header = "time,range,azimuth"
        if name == "gps":
            # Some 111 km a degree at the equator.
            rows = np.stack([rows[:, 0], rows[:, 2] / 110574.3, rows[:, 1] / 111319.5], axis=1)
            header = "time,latitude,longitude"
        table = rows * np.array(factors)
        np.savetxt(tmp_path / f"{name}.csv", table, "%.9f", ",", header=header, comments="")
    naming = {"columns": {"time": "time", "latitude": "latitude", "longitude": "longitude"}}
    target = {**BESIDE_TRUTH, "truth_naming": naming, "origin": [0.0, 0.0]}
    (note,) = notes(
        tmp_path, {**target, "units": {"range": read}}, {**SENSOR, "sigma_range": sigma}
    )
    assert "they agree if its range is in nmi: say `units: {range: nmi}`" in note
    assert note.endswith("check its sigma") == (sigma < 1.0)
    assert notes(tmp_path, {**target, "units": {"range": "nmi"}}, SENSOR) == ()


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_errors_of_the_truth_do_not_bias_a_delay(tmp_path: Path, seed: int) -> None:
    write_radar(tmp_path, seed)
    write_positions(tmp_path, 12.0, 8.0, seed)
    (note,) = notes(tmp_path, BESIDE_TRUTH, SENSOR)
    assert "seem to be some 12 s ahead of the truth" in note
