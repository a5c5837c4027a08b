"""Smoothers of draws against exact ones: the joint Gaussian, and a lattice of states."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.conftest import make_filter
from trackbench.config.load import load
from trackbench.core.particles import Particles
from trackbench.core.smoothing import draw_predecessors
from trackbench.errors import UserError
from trackbench.evaluation.block import BlockTask
from trackbench.evaluation.run_filter import FilterOutput, run_filter
from trackbench.scenarios.base import Scenario, Simulation

T, REPEATS = 10, 40
LINEAR = "0.9*x", "x", (0.9, 1.0)
GROWTH = "0.5*x + 25*x/(1 + x**2) + 8*cos(1.2*(k - 1))", "x**2/20", (0.0, 0.0)
CONFIG = """name: c
scenario:
  kind: tracking
  T: 1
  last: {T}
  target:
    kind: driven
    motion: {{kind: map, components: [x], next: {{x: {f}}}, Q: {Q}}}
    initial: {{x: 0.1}}
  sensor: {{kind: function, h: {{y: {h}}}, R: 1}}
  start: {{kind: given, mean: [0.1], sigma: [1]}}
filters: {{F: {{kind: ukf}}}}
"""


def repeated(f: str, h: str, folder: Path) -> tuple[Scenario, Simulation]:
    """Return a scenario, and the measurements of one run in each of REPEATS runs."""
    (folder / "c.yaml").write_text(CONFIG.format(f=f, h=h, T=T, Q=1))
    scenario = load(folder / "c.yaml").points[0].scenario
    data = scenario.simulate(range(REPEATS), 1) if False else task_of(scenario, "kf").data
    z = np.broadcast_to(data.measurements[..., :1], data.measurements.shape)
    return scenario, data._replace(measurements=z.copy())


def task_of(scenario: Scenario, kind: str, **keys: Any) -> BlockTask:
    return BlockTask(scenario, make_filter(kind, **keys), 1, 0, REPEATS, REPEATS)


def estimates(scenario: Scenario, data: Simulation, kind: str, **keys: Any) -> FilterOutput:
    with np.errstate(all="ignore"):
        return run_filter(task_of(scenario, kind, **keys), data, REPEATS)


def on_a_lattice(f: Any, h: Any, z: np.ndarray, lag: int | None = None) -> np.ndarray:
    """Return exact smoothed means and variances (2, T + 1), by a forward-backward pass on a lattice."""
    x = np.linspace(-40.0, 40.0, 1601)

    def normal(e: np.ndarray) -> np.ndarray:
        return np.exp(-0.5 * e**2)

    forward = [normal(x - 0.1)]
    moves = [normal(x[:, None] - f(x, k + 1)) for k in range(T)]
    for k in range(T):
        alpha = moves[k] @ forward[-1] * normal(z[k] - h(x))
        forward.append(alpha / alpha.sum())
    out = []
    for k in range(T + 1):
        beta = np.ones_like(x)
        for j in reversed(range(k, min(T, k + (T if lag is None else lag)))):
            beta = moves[j].T @ (beta * normal(z[j] - h(x)))
            beta /= beta.max()
        p = forward[k] * beta / (forward[k] * beta).sum()
        out.append([p @ x, p @ x**2 - (p @ x) ** 2])
    return np.array(out).T


def linear(x: np.ndarray, k: int) -> np.ndarray:
    return 0.9 * x


def growth(x: np.ndarray, k: int) -> np.ndarray:
    return 0.5 * x + 25 * x / (1 + x**2) + 8 * np.cos(1.2 * (k - 1))


def deviations(out: FilterOutput, exact: np.ndarray) -> np.ndarray:
    """Return mean differences (2, T + 1) of means and variances from exact ones, in standard errors."""
    assert out.cov is not None
    error = np.stack([out.mean[0], out.cov[0, 0]]) - exact[..., None]
    return error.mean(axis=-1) / (error.std(axis=-1, ddof=1) / np.sqrt(REPEATS))
