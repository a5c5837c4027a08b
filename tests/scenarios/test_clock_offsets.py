"""Notes on a clock that is off: that of a radar beside a truth, or beside another sensor."""

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
