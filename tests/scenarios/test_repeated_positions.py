"""Positions that a fast logger repeats are noted; those of a slow target or of one at rest are not."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.scenarios.test_clocks import config, table
from trackbench.config.load import load

N = 240
T = np.arange(float(N))
NOISE = np.random.default_rng(3).normal(size=(2, N))
ANGLE = 0.6 + 0.3 * np.sin(T / 25.0)
PATH = np.cumsum(10.0 * np.stack([np.cos(ANGLE), np.sin(ANGLE)]), axis=1)
SECOND = {"kind": "velocity", "sigma": 1}


def notes(folder: Path, positions: Any, digits: int = 2) -> tuple[str, ...]:
    (folder / "m.csv").write_text(table("time,x,y", T, *np.round(positions, digits)))
    return load(config(folder, {"measurements": "m.csv"})).points[0].scenario.cautions


@pytest.mark.parametrize("times", [2, 5, 10])
def test_positions_that_the_logger_repeats_are_noted(tmp_path: Path, times: int) -> None:
    last = np.arange(N) // times * times
    (note,) = notes(tmp_path, (PATH + 2.0 * NOISE)[:, last])
    assert note.startswith(f"most positions are there {times} times, in rows one after the other:")
    assert note.endswith("take each row for a new measurement: empty the cells of the repetitions")


def test_degrees_that_the_logger_repeats_are_noted(tmp_path: Path) -> None:
    """Also beside speeds that are new in each row."""
    last = np.arange(N) // 5 * 5
    east, north = PATH + 2.0 * NOISE
    degrees = [np.round(50.0 + north[last] / 111e3, 6), np.round(1.0 + east[last] / 71e3, 6)]
    speeds = [np.round(10.0 + 0.1 * NOISE[0], 2), np.round(90.0 - np.degrees(ANGLE), 1)]
    names = "time,latitude,longitude,speed,course"
    (tmp_path / "m.csv").write_text(table(names, T, *degrees, *speeds))
    sensors = [{"kind": "position", "sigma": 2}, SECOND]
    path = config(tmp_path, {"measurements": "m.csv"}, sensor=sensors)
    cautions = load(path).points[0].scenario.cautions
    assert "most positions of sensor 1 are there 5 times" in cautions[0]


@pytest.mark.parametrize(
    ("positions", "digits"),
    [
        # New positions in each row; a slow target in whole meters; one at rest, in decimeters.
        (PATH + 2.0 * NOISE, 2),
        (0.05 * PATH, 0),
        (0.1 * NOISE, 1),
        (np.where(T < 120.0, PATH, PATH[:, 120:121]) + 0.0 * NOISE, 1),
    ],
)
def test_other_equal_positions_are_not(tmp_path: Path, positions: Any, digits: int) -> None:
    assert not any("most positions" in note for note in notes(tmp_path, positions, digits))
