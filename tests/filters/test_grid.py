"""The exact posterior of scalar models against the Kalman filter and a brute-force program."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from trackbench.config.load import load
from trackbench.core.distributions import Gaussian
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.filter_output import FilterOutput
from trackbench.evaluation.run_filter import run_filter
from trackbench.filters.grid import Grid
from trackbench.models.base import Model
from trackbench.models.motions.map_or_ode import MapMotion
from trackbench.models.sensors.function import FunctionSensor
from trackbench.scenarios.base import Simulation

CONFIG = """name: c
runs: 6
scenario:
  kind: tracking
  last: 12
  target: {{kind: driven, motion: {motion}}}
  sensor: {sensor}
  start: {{kind: gaussian, sigma: [{sigma}]}}
filters:
  Exact: {{kind: grid, nodes: {nodes}}}
  KF: {{kind: {other}}}
metrics: [rmse, log_score]
"""
GROWTH = "{kind: map, components: [x], next: {x: x/2 + 25*x/(1 + x**2) + 8*cos(1.2*k)}, Q: 10}"
SQUARE = "{kind: function, h: {z: x**2/20}, R: 1}"


def outputs(folder: Path, nodes: int = 128, **keys: str) -> tuple[Simulation, list[FilterOutput]]:
    """Return the data of six runs, and what each filter makes of them, log scores included."""
    whole = {"sigma": "2", "other": "ekf", **keys}
    (folder / "c.yaml").write_text(CONFIG.format(nodes=nodes, **whole))
    point = load(folder / "c.yaml").points[0]
    tasks = [
        BlockTask(point.scenario, f, 3, 0, 6, 6, predictive_metrics=("score",))
        for f in point.filters.values()
    ]
    with np.errstate(all="ignore"):
        return tasks[0].data, [run_filter(task, task.data) for task in tasks]


@pytest.mark.parametrize(
    ("motion", "sensor"),
    [
        ("{kind: ar1, phi: 0.9, q: 0.5}", "{kind: scalar, sigma: 0.7}"),
        (
            "{kind: map, components: [x], next: {x: 0.9*x}, Q: 0.5}",
            "{kind: function, h: {z: x}, R: 0.49}",
        ),
        ("{kind: ar1, q: 0.02}", "{kind: scalar, sigma: 0.1, period: 3}"),
    ],
)
def test_of_a_linear_model_it_is_the_kalman_filter(
    motion: str, sensor: str, tmp_path: Path
) -> None:
    _, (exact, kf) = outputs(
        tmp_path, motion=motion, sensor=sensor, other="kf", nodes=256, sigma="1"
    )
    np.testing.assert_allclose(exact.mean, kf.mean, atol=1e-7)
    scores = [o.diagnostics["log_likelihood"] for o in (exact, kf)]
    np.testing.assert_allclose(*scores, atol=1e-6)


@pytest.mark.parametrize(
    ("sensor", "h", "R"),
    [(SQUARE, lambda x: x**2 / 20, 1.0), ("{kind: function, h: {z: \"3*atan2(x, 2)\"}, R: 0.01}",
      lambda x: 3 * np.arctan2(x, 2), 0.01)],
)  # fmt: skip
def test_of_the_growth_model_it_is_a_sum_over_many_states(
    sensor: str, h: Callable[[np.ndarray], np.ndarray], R: float, tmp_path: Path
) -> None:
    """Point masses from -60 to 60, at a spacing of 0.05: mean, and the density of each measurement."""
    data, (exact, _) = outputs(tmp_path, motion=GROWTH, sensor=sensor, nodes=256, sigma="1")
    x = np.linspace(-60.0, 60.0, 2401)
    f = x / 2 + 25 * x / (1 + x**2)
    p = np.tile(np.exp(-0.5 * x**2)[:, None], 6)
    p /= p.sum(axis=0)
    for k in range(1, 13):
        kernel = np.exp(-0.05 * (x[:, None] - f - 8 * np.cos(1.2 * k)) ** 2)
        p = kernel @ p / np.sqrt(2 * np.pi * 10.0) * (x[1] - x[0])
        z = data.measurements[0, k - 1]
        p *= np.exp(-0.5 * (z - h(x)[:, None]) ** 2 / R) / np.sqrt(2 * np.pi * R)
        found = exact.diagnostics["log_likelihood"][k]
        np.testing.assert_allclose(found, np.log(p.sum(axis=0)), atol=1e-5)
        p /= p.sum(axis=0)
        np.testing.assert_allclose(exact.mean[0, k], x @ p, atol=1e-4)


def test_of_noise_that_depends_on_the_state_it_is_a_sum_over_many_states(tmp_path: Path) -> None:
    """Point masses from -12 to 12, at a spacing of 0.02, of x' = 0.9 x + N(0, 0.1 + 0.01 x^2)."""
    motion = '{kind: map, components: [x], next: {x: 0.9*x}, Q: "0.1 + 0.01*x**2"}'
    data, (exact, _) = outputs(
        tmp_path, motion=motion, sensor="{kind: scalar, sigma: 0.7}", other="pf", sigma="1"
    )
    x = np.linspace(-12.0, 12.0, 1201)
    p = np.tile(np.exp(-0.5 * x**2)[:, None], 6)
    Q = 0.1 + 0.01 * x**2
    kernel = np.exp(-0.5 * (x[:, None] - 0.9 * x) ** 2 / Q) / np.sqrt(Q)
    for k in range(1, 13):
        p = (kernel @ p) * np.exp(-0.5 * (data.measurements[0, k - 1] - x[:, None]) ** 2 / 0.49)
        p /= p.sum(axis=0)
        np.testing.assert_allclose(exact.mean[0, k], x @ p, atol=1e-6)


def test_an_angle_that_may_have_turned_has_the_posterior_of_a_fine_sum() -> None:
    """Likely states lie a turn apart, seven of them; a trapezoidal sum over 4001 states is exact."""
    motion = MapMotion(components=("a",), next={"a": "a + 0.3"}, Q=0.5).sampled(1.0)
    model = Model(motion, FunctionSensor(h={"z": "a"}, R=0.05, angles=("z",), state=("a",)))
    grid, rng = Grid(), np.random.default_rng(0)
    state = grid.init(model, Gaussian(np.zeros((1, 2)), np.array([[9.0]])), rng)
    x = np.linspace(-40.0, 40.0, 4001)
    p = np.exp(-0.5 * x**2 / 9.0)[:, None] * np.ones(2)
    kernel = np.exp(-0.5 * (x[:, None] - x - 0.3) ** 2 / 0.5)
    for k, z in enumerate(([0.4, -2.9], [0.9, 3.1], [-2.0, -0.2]), 1):
        state = grid.step(model, state, np.array([z]), k, rng)
        nu = (np.array(z) - x[:, None] + np.pi) % (2.0 * np.pi) - np.pi
        p = (kernel @ p) * np.exp(-0.5 * nu**2 / 0.05)
        p /= p.sum(axis=0)
        mean = x @ p
        got = grid.estimate(state)
        np.testing.assert_allclose(got.mean[0], mean, atol=1e-4)
        np.testing.assert_allclose(
            got.cov[0, 0], ((x[:, None] - mean) ** 2 * p).sum(axis=0), rtol=1e-4
        )
