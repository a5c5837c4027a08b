"""The exact posterior of two components: against Kalman filters, a change of variables and a lattice."""

from pathlib import Path

import numpy as np
import pytest

from trackbench.config.load import load
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.posterior_scores import NormalPosterior
from trackbench.errors import UserError
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.filter_output import FilterOutput
from trackbench.evaluation.run_filter import run_filter
from trackbench.filters.base import WrongReturnError
from trackbench.filters.grid_2d import (
    Box,
    Map,
    Plane,
    PlaneGrid,
    PlanePosterior,
    UnresolvedError,
    condition,
    over_prior,
)
from trackbench.scenarios.base import Simulation

CONFIG = """name: c
scenario:
  kind: tracking
  T: 1
  last: {last}
  target: {{kind: driven, motion: {{kind: map, components: [a, b], next: {next}, Q: {Q}}}}}
  sensor: {{kind: function, h: {{z: {h}}}, R: {R}}}
  start: {{kind: gaussian, sigma: {sigma}}}
filters:
  Exact: {{kind: grid-2d, nodes: {nodes}}}
  Other: {{kind: {other}}}
metrics: [rmse_a, log_score]
"""
LINEAR = "{a: a + 0.5*b, b: 0.9*b}"


def outputs(
    folder: Path, runs: int = 2, nodes: int = 128, other: str = "kf", **keys: str
) -> tuple[Simulation, list[FilterOutput]]:
    """Return the data of some runs, and what each filter makes of them."""
    whole = {"last": "12", "R": "0.3", "h": "a", "sigma": "[1, 0.5]", **keys}
    (folder / "c.yaml").write_text(CONFIG.format(nodes=nodes, other=other, **whole))
    point = load(folder / "c.yaml").points[0]
    tasks = [
        BlockTask(point.scenario, f, 3, 0, runs, runs, predictive_metrics=("score",))
        for f in point.filters.values()
    ]
    with np.errstate(all="ignore"):
        return tasks[0].data, [run_filter(task, task.data, runs) for task in tasks]


@pytest.mark.parametrize(
    "Q", ["[0.5, 0.2]", "[[0.02, 0.03], [0.03, 0.05]]", "[0, 0.1]", "[1e-9, 1e-7]", "[0, 0]"]
)
def test_of_a_linear_model_it_is_the_kalman_filter(Q: str, tmp_path: Path) -> None:
    """Wide, correlated and narrow noise, noise of one component, and none."""
    _, (exact, kf) = outputs(tmp_path, last="8", next=LINEAR, Q=Q)
    assert kf.cov is not None
    assert exact.cov is not None
    sd = np.sqrt(np.moveaxis(np.diagonal(kf.cov), -1, 0))
    assert (np.abs(exact.mean - kf.mean) / sd).max() < 1e-6
    np.testing.assert_allclose(exact.cov, kf.cov, rtol=1e-5, atol=1e-9)
    scores = [o.diagnostics["log_likelihood"] for o in (exact, kf)]
    np.testing.assert_allclose(*scores, atol=1e-6)


def test_of_a_bent_linear_model_it_is_the_kalman_filter_bent(tmp_path: Path) -> None:
    """In the components x and b = v + x^2 / 4 of a linear model in x and v the noise stays additive."""
    v = "(b - a**2/4)"
    bent = f"{{a: a + 0.3*{v}, b: {v} + (a + 0.3*{v})**2/4}}"
    data, (exact, _) = outputs(
        tmp_path, next=bent, Q="[0, 0.04]", sigma="[0.02, 0.5]", other="ekf", nodes=144, last="6"
    )
    assert exact.cov is not None
    F, Q = np.array([[1.0, 0.3], [0.0, 1.0]]), np.diag([0.0, 0.04])
    for run in range(2):
        # Prior: x is so narrow that v = b - x^2 / 4 is normal to 1e-4.
        m, P = np.zeros(2), np.diag([0.0004, 0.25])
        for k in range(6):
            m, P = F @ m, F @ P @ F.T + Q
            gain = P[:, 0] / (P[0, 0] + 0.3)
            m, P = m + gain * (data.measurements[0, k, run] - m[0]), P - np.outer(gain, P[0])
            b = m[1] + (m[0] ** 2 + P[0, 0]) / 4
            var = P[1, 1] + m[0] * P[0, 1] + (2 * P[0, 0] ** 2 + 4 * m[0] ** 2 * P[0, 0]) / 16
            np.testing.assert_allclose(exact.mean[:, k + 1, run], [m[0], b], atol=2e-4)
            np.testing.assert_allclose(exact.cov[1, 1, k + 1, run], var, rtol=2e-3)


def test_of_growth_with_a_drift_it_is_a_sum_over_a_lattice(tmp_path: Path) -> None:
    """The growth model, whose map has no inverse, with a drift b; posteriors have two modes."""
    growth = "{a: a/2 + 25*a/(1 + a**2) + 8*cos(1.2*k) + b, b: 0.9*b}"
    data, (exact, _) = outputs(
        tmp_path, runs=1, last="2", next=growth, Q="[10, 1]", h="a**2/20", R="1", sigma="[0.5, 1]",
        other="ekf", nodes=136,
    )  # fmt: skip
    a, b = np.linspace(-32, 32, 801), np.linspace(-9, 9, 41)
    A, B = (g.ravel() for g in np.meshgrid(a, b, indexing="ij"))
    p = np.exp(-0.5 * (4 * A**2 + B**2)) / np.pi
    cell = (a[1] - a[0]) * (b[1] - b[0])
    for k in range(1, 3):
        f = A / 2 + 25 * A / (1 + A**2) + 8 * np.cos(1.2 * k) + B
        of_a = np.exp(-0.05 * (a[:, None] - f) ** 2) / np.sqrt(20 * np.pi)
        of_b = np.exp(-0.5 * (b[:, None] - 0.9 * B) ** 2) / np.sqrt(2 * np.pi)
        p = ((of_a * p) @ of_b.T).ravel() * cell
        z = data.measurements[0, k - 1, 0]
        p *= np.exp(-0.5 * (z - A**2 / 20) ** 2) / np.sqrt(2 * np.pi)
        found = exact.diagnostics["log_likelihood"][k, 0]
        np.testing.assert_allclose(found, np.log(p.sum() * cell), atol=1e-5)
        p /= p.sum() * cell
        mean = [(A * p).sum() * cell, (B * p).sum() * cell]
        np.testing.assert_allclose(exact.mean[:, k, 0], mean, atol=1e-4)


def test_scores_of_a_normal_density_are_those_in_closed_form(tmp_path: Path) -> None:
    outputs(tmp_path, last="1", next=LINEAR, Q="[0.5, 0.2]")
    point = load(tmp_path / "c.yaml").points[0]
    grid, model = point.filters["Exact"], point.scenario.model
    assert isinstance(grid, PlaneGrid)
    rng = np.random.default_rng(1)
    state = grid.init(model, Gaussian(np.zeros((2, 2)), np.diag([1.0, 0.25])), rng)
    state = grid.step(model, state, np.array([[0.7, np.nan]]), 1, rng)
    ours, x = grid.posterior(state), np.array([[0.4, -1.0], [0.3, 0.6]])
    assert isinstance(ours, PlanePosterior)
    exact = NormalPosterior(grid.estimate(state))
    np.testing.assert_allclose(ours.below(x), exact.below(x), atol=2e-3)
    np.testing.assert_allclose(ours.within(x), exact.within(x), atol=5e-3)
    np.testing.assert_allclose(ours.crps(x), exact.crps(x), atol=2e-3)


def test_the_mass_of_a_cell_lies_as_wide_as_a_uniform_one() -> None:
    """A cell of 2 by 4 about (1, 2) has the deviations 2 and 4 over sqrt(12)."""
    box = Box(np.eye(2), np.zeros(2), np.array([2.0, 4.0]), (1, 1))
    x = box.nodes + np.array([[2.0], [-4.0]]) / np.sqrt(12.0)
    found = PlanePosterior((Plane(box, np.zeros(1)),)).below(x)
    np.testing.assert_allclose(found[:, 0], [0.841345, 0.158655], atol=1e-6)


def test_a_known_first_state(tmp_path: Path) -> None:
    _, (exact, kf) = outputs(tmp_path, nodes=96, next=LINEAR, Q="[0.5, 0.2]", sigma="[0, 0]")
    np.testing.assert_allclose(exact.mean, kf.mean, atol=1e-6)


@pytest.mark.parametrize(
    ("nodes", "keys", "what"),
    [
        (32, {"next": "{a: a + sin(3*b), b: b}", "Q": "[0.01, 0.01]"}, "raise `nodes`"),
        (64, {"next": "{a: abs(a), b: b}", "Q": "[1e-6, 1e-6]"}, "its map has no inverse"),
        (64, {"next": LINEAR, "Q": "[0, 0.1]", "sigma": "[0, 0]"}, "needs noise of both"),
        (64, {"next": LINEAR, "Q": "[0.1, 0.1]", "sigma": "[1, 0]"}, "has no density"),
    ],
)
def test_what_it_cannot_resolve_is_a_reason(
    nodes: int, keys: dict[str, str], what: str, tmp_path: Path
) -> None:
    with pytest.raises(WrongReturnError, match=what):
        outputs(tmp_path, nodes=nodes, other="prior-mean", **keys)


def test_noise_that_depends_on_the_state_is_a_line(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="constant covariance"):
        outputs(tmp_path, next=LINEAR, Q="[0.1*a**2 + 0.1, 0.1]")


def _folded(x: Array) -> Array:
    """Map a to |a|, which has no inverse."""
    return np.stack([np.abs(x[0]), x[1]])


def _slopes_of_folded(x: Array) -> Array:
    """Return the Jacobians (2, 2, N) of `_folded`."""
    zero = np.zeros_like(x[0])
    return np.array([[np.sign(x[0]), zero], [zero, zero + 1.0]])


FOLDED = Map(_folded, _slopes_of_folded, 0.1 * np.eye(2))


def _flat(x: Array) -> Array:
    return np.zeros(x.shape[1])


def test_too_few_nodes_are_a_reason() -> None:
    prior = Gaussian(np.zeros(2), np.eye(2))
    with pytest.raises(UnresolvedError, match="6 nodes or more"):
        condition(over_prior(prior, 2), FOLDED, _flat, 2)
    # Only one node in the middle is relevant, so that it has no relevant neighbor.
    plane = over_prior(prior, 9)
    log_density = np.where(np.abs(plane.box.nodes).max(axis=0) < 0.1, 0.0, -30.0)
    with pytest.raises(UnresolvedError, match="too far apart"):
        condition(Plane(plane.box, log_density), FOLDED, _flat, 32)


@pytest.mark.parametrize("value", [-np.inf, np.nan])
def test_a_measurement_without_a_likelihood_is_a_reason(value: float) -> None:
    plane = over_prior(Gaussian(np.zeros(2), np.eye(2)), 32)
    still = Map(lambda x: x, lambda x: np.eye(2)[..., None] + 0.0 * x[0], 0.1 * np.eye(2))
    with pytest.raises(UnresolvedError, match="no likelihood at any node"):
        condition(plane, still, lambda x: np.full(x.shape[1], value), 32)
