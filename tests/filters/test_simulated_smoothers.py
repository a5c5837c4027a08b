"""Smoothers of draws against exact ones: forward and backward passes on a lattice of states."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.conftest import make_filter
from trackbench.config.load import load
from trackbench.core.particles import Particles
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.filter_output import FilterOutput
from trackbench.evaluation.run_filter import run_filter
from trackbench.filters.particle_smoother import Trajectories, draw_predecessors
from trackbench.filters.smoother_keys import FixedLag
from trackbench.scenarios.base import Scenario, Simulation

T, REPEATS = 10, 40
LINEAR = "0.9*x", "x"
GROWTH = "0.5*x + 25*x/(1 + x**2) + 8*cos(1.2*(k - 1))", "x**2/20"
CONFIG = """name: c
scenario:
  kind: tracking
  T: 1
  last: {T}
  target:
    kind: driven
    motion: {{kind: map, components: [x], next: {{x: {f}}}, Q: 1}}
    initial: {{x: 0.1}}
  sensor: {{kind: function, h: {{y: {h}}}, R: 1}}
  start: {{kind: given, mean: [0.1], sigma: [1]}}
filters: {{F: {{kind: ukf}}}}
"""
Function = Callable[..., np.ndarray]


def linear(x: np.ndarray, k: int) -> np.ndarray:
    return 0.9 * x


def growth(x: np.ndarray, k: int) -> np.ndarray:
    return 0.5 * x + 25 * x / (1 + x**2) + 8 * np.cos(1.2 * (k - 1))


def square(x: np.ndarray) -> np.ndarray:
    return x**2 / 20


def repeated(model: tuple[str, str], folder: Path) -> tuple[Scenario, Simulation]:
    """Return a scenario, and the measurements of one run in each of REPEATS runs."""
    f, h = model
    (folder / "c.yaml").write_text(CONFIG.format(f=f, h=h, T=T))
    scenario = load(folder / "c.yaml").points[0].scenario
    data = task_of(scenario, "pf").data
    z = np.broadcast_to(data.measurements[..., :1], data.measurements.shape)
    return scenario, data._replace(measurements=z.copy())


def task_of(scenario: Scenario, kind: str, **keys: Any) -> BlockTask:
    return BlockTask(scenario, make_filter(kind, **keys), 1, 0, REPEATS, REPEATS)


def estimates(scenario: Scenario, data: Simulation, kind: str, **keys: Any) -> FilterOutput:
    wanted = keys.pop("wanted", ())
    task = replace(task_of(scenario, kind, **keys), predictive_metrics=wanted)
    with np.errstate(all="ignore"):
        return run_filter(task, data, REPEATS)


def exact(f: Function, h: Function, z: np.ndarray, lag: int = T) -> np.ndarray:
    """Return means and variances (2, T + 1) given z (T,), by both passes on a lattice of states."""
    x = np.linspace(-40.0, 40.0, 801)
    moves = [np.exp(-0.5 * (x[:, None] - f(x, k + 1)) ** 2) for k in range(T)]
    seen = [np.exp(-0.5 * (z[k] - h(x)) ** 2) for k in range(T)]
    forward = [np.exp(-0.5 * (x - 0.1) ** 2)]
    for k in range(T):
        alpha = moves[k] @ forward[-1] * seen[k]
        forward.append(alpha / alpha.sum())
    out = []
    for k in range(T + 1):
        beta = np.ones_like(x)
        for j in reversed(range(k, min(T, k + lag))):
            beta = moves[j].T @ (beta * seen[j])
            beta /= beta.max()
        p = forward[k] * beta / (forward[k] @ beta)
        out.append([p @ x, p @ x**2 - (p @ x) ** 2])
    return np.array(out).T


def test_the_lattice_against_the_joint_gaussian() -> None:
    """Of the linear model: states and measurements are jointly Gaussian."""
    z = np.random.default_rng(1).normal(size=T)
    A = np.array([[0.9 ** (i - j) if i >= j else 0.0 for j in range(T + 1)] for i in range(T + 1)])
    P, m = A @ A.T, 0.1 * A[:, 0]
    K = P[:, 1:] @ np.linalg.inv(P[1:, 1:] + np.eye(T))
    expected = m + K @ (z - m[1:]), np.diag(P - K @ P[1:])
    np.testing.assert_allclose(exact(linear, lambda x: x, z), expected, atol=1e-9)


def deviations(out: FilterOutput, moments: np.ndarray, draws: int) -> np.ndarray:
    """Return differences (2, T + 1) of the mean moments from the exact ones, in standard errors."""
    assert out.cov is not None
    found = np.stack([out.mean[0], out.cov[0, 0] * draws / (draws - 1.0)])
    error = found - moments[..., None]
    return error.mean(axis=-1) / (error.std(axis=-1, ddof=1) / np.sqrt(REPEATS))


@pytest.mark.parametrize("lag", [None, 2])
@pytest.mark.parametrize("kind", ["pf", "apf"])
@pytest.mark.parametrize(
    ("model", "f", "h"), [(LINEAR, linear, lambda x: x), (GROWTH, growth, square)]
)
def test_backward_simulation_is_exact_on_average(
    model: tuple[str, str], f: Function, h: Function, kind: str, lag: int | None, tmp_path: Path
) -> None:
    """The filter is far from it; five standard errors are a chance of 1 in 80 000 for each number."""
    scenario, data = repeated(model, tmp_path)
    moments = exact(f, h, data.measurements[0, :, 0], lag or T)
    keys = Trajectories(trajectories=100, lag=lag)
    smoothed = estimates(scenario, data, kind, N=1000, smooth=keys)
    assert np.abs(deviations(smoothed, moments, 100)).max() < 5.0
    if lag is None:
        filtered = estimates(scenario, data, kind, N=1000)
        assert np.abs(deviations(filtered, moments, 10**9)).max() > 50.0


def test_regularized_particles_are_smoothed_as_well(tmp_path: Path) -> None:
    """Up to the kernel's width, which is some tenth of the posterior's deviation."""
    scenario, data = repeated(GROWTH, tmp_path)
    mean, variance = exact(growth, square, data.measurements[0, :, 0])
    out = estimates(scenario, data, "rpf", N=1000, smooth=True)
    assert (np.abs(out.mean[0].mean(axis=-1) - mean) < 0.15 * np.sqrt(variance)).all()


@pytest.mark.parametrize("lag", [None, 3])
def test_the_ensemble_smoother_of_a_linear_model(lag: int | None, tmp_path: Path) -> None:
    scenario, data = repeated(LINEAR, tmp_path)
    moments = exact(linear, lambda x: x, data.measurements[0, :, 0], lag or T)
    keys = True if lag is None else FixedLag(lag=lag)
    smoothed = estimates(scenario, data, "enkf", N=1000, smooth=keys)
    assert np.abs(deviations(smoothed, moments, 10**9)).max() < 5.0
    if lag is None:
        filtered = estimates(scenario, data, "enkf", N=1000)
        assert np.abs(deviations(filtered, moments, 10**9)).max() > 50.0


@pytest.mark.parametrize("kind", ["pf", "rpf", "apf", "enkf"])
def test_the_filter_draws_as_without_a_smoother(kind: str, tmp_path: Path) -> None:
    """Scores, NIS and other diagnostics are the filter's; ranks are the smoother's."""
    scenario, data = repeated(LINEAR, tmp_path)
    keys: dict[str, Any] = {"N": 50, "wanted": ("score", "calibration")}
    alone, smoothed = (estimates(scenario, data, kind, smooth=s, **keys) for s in (False, True))
    same = {
        n
        for n, rows in alone.diagnostics.items()
        if rows.tobytes() == smoothed.diagnostics[n].tobytes()
    }
    assert {"log_likelihood", "nis" if kind == "enkf" else "ess"} <= same
    assert not {"pit_x", "coverage_50"} & same
    assert (alone.mean != smoothed.mean)[:, :-1].any()


def test_a_later_state_without_a_predecessor_and_a_run_without_weights() -> None:
    """The first has the filter's weights, the second stays NaN, and a weight of zero is never drawn."""
    x = np.arange(12.0).reshape(1, 3, 4)
    w = np.array([[0.0, 1.0, 0.0, 0.0], [0.25] * 4, [np.nan] * 4])

    def log_density(later: np.ndarray) -> np.ndarray:
        out = np.where(later[0] == 1.0, -np.inf, np.zeros((3, 4)))
        out[1] = [-np.inf, -np.inf, 0.0, -np.inf]
        return out

    later = np.ones((1, 3, 50))
    later[0, 1] = 2.0
    with np.errstate(all="ignore"):
        drawn = draw_predecessors(Particles(x, w), log_density, later, np.random.default_rng(1))
    assert (drawn[0, 0] == 1.0).all()
    assert (drawn[0, 1] == 6.0).all()
    assert np.isnan(drawn[0, 2]).all()


def test_draws_have_the_probabilities_of_their_weights() -> None:
    """Four particles of weight w and density p, 40 000 draws."""
    w, p = np.array([[0.1, 0.2, 0.3, 0.4]]), np.array([[4.0, 1.0, 2.0, 0.5]])
    cloud, later = Particles(np.arange(4.0).reshape(1, 1, 4), w), np.zeros((1, 1, 40_000))
    drawn = draw_predecessors(cloud, lambda x: np.log(p), later, np.random.default_rng(5))
    expected = (w * p / (w * p).sum())[0]
    shares = (drawn[0, 0] == np.arange(4.0)[:, None]).mean(axis=1)
    assert (np.abs(shares - expected) < 4.5 * np.sqrt(expected * (1 - expected) / 40_000)).all()
