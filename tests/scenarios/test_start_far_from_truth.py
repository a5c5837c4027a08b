"""A `given` start that lies far from the recorded truth of a run is noted, shared or not."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.scenarios.test_clocks import config, table
from trackbench.config.experiment import cautions
from trackbench.config.load import load
from trackbench.core.distributions import Gaussian
from trackbench.scenarios.start_far_from_truth import note_on_far_start

N = 40
GRID = "`grid: {scenario.target.runs & scenario.start.mean: [...]}` gives each run its own"


def recorded(folder: Path, begins: dict[str, float]) -> dict[str, Any]:
    """Write measurements and truth of runs to the east, which begin at these x; return the target."""
    runs = np.repeat([*begins], N)
    times = np.tile(np.arange(float(N)), len(begins))
    x = np.repeat([*begins.values()], N) + 5.0 * times
    y = 2.0 * times
    noise = np.random.default_rng(2).normal(size=(2, len(x)))
    measured = np.round(np.stack([x, y]) + noise, 2)
    (folder / "m.csv").write_text(table("run,time,x,y", runs, times, *measured))
    (folder / "truth.csv").write_text(table("run,time,px,py", runs, times, x, y))
    return {"measurements": "m.csv", "truth": "truth.csv", "columns": {"run": "run"}}


def notes(folder: Path, target: dict[str, Any], x: float) -> list[str]:
    """Return the notes on a config whose start is at x and 0 with standard deviations of 2 m."""
    start = {"kind": "given", "mean": [x, 5, 0, 2], "sigma": [2, 1, 2, 1]}
    return cautions(load(config(folder, target, start=start)).points)


def test_a_start_far_from_the_truth_of_one_of_several_runs_is_noted(tmp_path: Path) -> None:
    target = recorded(tmp_path, {"a": 0.0, "b": 500.0})
    # The state lies a step before the first truth: 5 m, or 10 m if the target moves twice as fast.
    (note,) = notes(tmp_path, target, x=-5.0)
    advice = f"correct its mean, or raise its sigma; {GRID}"
    assert note == (
        f"`start` lies 248 of its standard deviations (px) from the truth of run b: {advice}"
    )
    (note,) = notes(tmp_path, target, x=250.0)
    assert "lies up to 120 of its standard deviations (px) from the truth of runs a, b" in note
    assert notes(tmp_path, {**target, "runs": ["a"]}, x=-5.0) == []
    (note,) = notes(tmp_path, {**target, "runs": ["b"]}, x=-5.0)
    assert "from the truth of run b" in note


def test_a_start_far_from_a_single_truth_is_noted(tmp_path: Path) -> None:
    target = recorded(tmp_path, {"0": 100.0})
    (note,) = notes(tmp_path, target, x=65.0)
    assert note == (
        "`start` lies 12.5 of its standard deviations (px) from the truth: correct its mean, or raise "
        "its sigma"
    )
    assert notes(tmp_path, target, x=75.0) == []


@pytest.mark.parametrize(("angle", "is_far"), [(3.1, False), (-3.1, False), (0.0, True)])
def test_an_angle_is_far_by_the_shorter_way(angle: float, is_far: bool) -> None:
    truth = np.full((1, 3, 1), 3.1)
    start = Gaussian(np.array([angle]), np.array([[0.01]]))
    written = note_on_far_start(
        start, truth, np.arange(3.0), ["heading"], angle_rows=[0], runs=["0"]
    )
    assert bool(written) == is_far


def test_a_truth_that_begins_late_shows_nothing_about_the_start() -> None:
    truth = np.arange(6.0).reshape(1, 6, 1)
    truth[:, :3] = np.nan
    start = Gaussian(np.array([100.0]), np.eye(1))
    late = note_on_far_start(start, truth, np.arange(6.0), ["px"], angle_rows=[], runs=["0"])
    assert late == []
