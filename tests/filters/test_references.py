"""Particle filters that are references of standard problems: half their particles are enough.

Of problems that differ in numbers alone the first one stands for the others.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.conftest import EXPERIMENT_FILES, shipped
from tests.filters.test_standard_problems import first_block
from trackbench.config.shipped_problems import problems
from trackbench.evaluation.run_filter import run_filter


def outputs(name: str, label: str, runs: int, particles: float) -> tuple[Any, Any, Any]:
    """Return the block of runs, and the filter's output with this multiple of N and with twice that."""
    task = first_block(name, label, runs)
    tracker: Any = task.filter
    once, twice = (
        replace(task, filter=replace(tracker, N=int(share * tracker.N)))
        for share in (particles, 2 * particles)
    )
    return task, run_filter(once, task.data), run_filter(twice, task.data)


@pytest.mark.parametrize(
    ("name", "quantity", "runs"),
    [
        ("ungm", "", 20),
        ("falling-body", "altitude", 8),
        ("lorenz63", "state", 3),
        ("lorenz96", "state", 3),
        ("double-pendulum-20", "state", 3),
    ],
)
def test_twice_the_particles_change_the_error_by_less_than_its_standard_error(
    name: str, quantity: str, runs: int
) -> None:
    """N / 2 particles are enough, and so are N: their bias is half as large."""
    problem = shipped(name).settings.problem
    assert problem is not None
    assert problem.reference is not None
    task, *both = outputs(name, problem.reference, runs, 0.5)
    scored = task.scenario.windows[""]
    once, twice = (
        np.sqrt(
            (task.scenario.errors(output.mean, task.data.truth)[quantity][:, scored] ** 2)
            .sum(axis=0)
            .mean(axis=0)
        )
        for output in both
    )
    assert abs((twice - once).mean()) < twice.std(ddof=1) / np.sqrt(runs)


def test_twice_the_particles_on_the_recording_of_the_pendulum() -> None:
    """Means differ by a few hundredths of their standard deviation."""
    task, once, twice = outputs("pendulum", "PF", 1, 1)
    apart = (once.mean - twice.mean)[0, 1:, 0]
    scatter = np.sqrt(np.mean(apart**2))
    assert scatter < 0.05 * np.sqrt(np.mean((once.mean - task.data.truth)[0, 1:] ** 2))


@pytest.mark.parametrize("name", [problem.name for problem in problems() if not problem.reference])
def test_a_problem_without_a_reference_says_why(name: str) -> None:
    assert "\n# No reference: " in EXPERIMENT_FILES[name].read_text(encoding="utf-8")
