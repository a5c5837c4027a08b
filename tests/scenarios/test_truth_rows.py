"""Rows of a truth that are repeated or far from their neighbors are noted; others are not."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.scenarios.test_clocks import config, table
from trackbench.config.load import load
from trackbench.core.arrays import Array
from trackbench.scenarios.recordings.truth_rows_check import rows_far_from_neighbors

N = 240
T = np.arange(float(N))
NOISE = np.random.default_rng(5).normal(size=(2, N))
ANGLE = 0.6 + 0.3 * np.sin(T / 25.0)
PATH = np.cumsum(10.0 * np.stack([np.cos(ANGLE), np.sin(ANGLE)]), axis=1)


def notes(folder: Path, truth: Any) -> list[str]:
    """Return the notes on a config with this truth (2, N) that begin with "truth:"."""
    (folder / "m.csv").write_text(table("time,x,y", T, *(PATH + 2.0 * NOISE)))
    (folder / "t.csv").write_text(table("time,px,py", T, *np.round(truth, 2)))
    path = config(folder, {"measurements": "m.csv", "truth": "t.csv"})
    cautions = load(path).points[0].scenario.cautions
    return [note for note in cautions if note.startswith("truth: ")]


@pytest.mark.parametrize("times", [2, 10])
def test_a_truth_that_the_logger_repeats_is_noted(tmp_path: Path, times: int) -> None:
    (note,) = notes(tmp_path, PATH[:, np.arange(N) // times * times])
    assert note.startswith(f"truth: t.csv: most positions are there {times} times")
    assert note.endswith("too old: leave out the rows of the repetitions")


@pytest.mark.parametrize("rows", [[60], [20, 90, 91, 92, 200], [5, 6, 7, 8, 9, 10, 11]])
@pytest.mark.parametrize("move", [(0.0, 5500.0), (-400.0, 300.0)])
def test_outliers_of_a_truth_are_noted(
    tmp_path: Path, rows: list[int], move: tuple[float, float]
) -> None:
    truth = PATH.copy()
    truth[:, rows] += np.array(move)[:, None]
    (note,) = notes(tmp_path, truth)
    assert note.startswith(f"truth: t.csv: {len(rows)} row")
    assert f"(line {rows[0] + 2}" in note
    assert note.endswith("errors would be computed from them; empty their cells")


def test_a_truth_that_goes_on_elsewhere_is_noted(tmp_path: Path) -> None:
    truth = PATH.copy()
    truth[:, 100:] += 3000.0
    (note,) = notes(tmp_path, truth)
    assert note.startswith(
        "truth: t.csv: line 102 lies 4.25 km from the row before it, 1 s earlier"
    )


def test_a_right_truth_has_no_note(tmp_path: Path) -> None:
    assert notes(tmp_path, PATH + 0.05 * NOISE) == []


AT_REST = np.where((T > 100.0) & (T < 160.0), PATH - PATH[:, 100:101], 0.0)
AND_BACK = np.where(T < 120.0, PATH, PATH[:, 240 - 1 - np.arange(N)])


@pytest.mark.parametrize(
    ("interval", "positions"),
    [
        # Straight on; in a pause between two trips; there and back; a ferry that is seen in ports; a
        # car that leaves and returns between a few rows, and is at rest else.
        (1.0, PATH),
        (1.0, AND_BACK),
        (3600.0, 9000.0 * np.stack([T % 2.0, 0.0 * T])),
        (30.0, np.stack([np.where((T > 90.0) & (T < 94.0), 600.0, 0.0), 0.0 * T])),
        (1.0, np.cumsum(NOISE, axis=1)),
        (0.1, 20.0 * np.stack([np.cos(T), np.sin(T)])),
    ],
)
def test_rows_that_a_motion_explains_are_no_outliers(interval: float, positions: Array) -> None:
    noisy = positions + 0.1 * NOISE
    assert rows_far_from_neighbors(interval * T, noisy, counts_steps=False) == []
