"""The ensemble transform Kalman filter against the Kalman update of the members' moments."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.conftest import PLANE, make_filter
from trackbench.config.load import load
from trackbench.core.random_streams import block_stream
from trackbench.errors import UserError
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.run_filter import run_filter
from trackbench.filters.enkf import _rotated
from trackbench.filters.ensemble_base import Ensemble
from trackbench.models.base import Model
from trackbench.models.motions.map_or_ode import MapMotion, OdeMotion
from trackbench.models.sensors.function import FunctionSensor
from trackbench.scenarios.starts.gaussian import GaussianStart
from trackbench.scenarios.targets.driven import Driven
from trackbench.scenarios.tracking import Tracking

NAMES, N, RUNS = ("a", "b", "c"), 7, 2
STILL = MapMotion(components=NAMES, next={n: n for n in NAMES}, Q=0.0).sampled(1.0)
ROWS = {"u": "a - 2*b", "v": "b + 0.5*c", "w": "3*a + c"}
H = np.array([[1, -2, 0], [0, 1, 0.5], [3, 0, 1]])


def updated(z: np.ndarray, R: np.ndarray, N: int = N, **keys: Any) -> tuple[np.ndarray, np.ndarray]:
    """Members (3, M, N) before and after the update with z (n_z, M)."""
    h = dict(list(ROWS.items())[: len(z)])
    cov: Any = tuple(map(tuple, R.tolist()))
    model = Model(STILL, FunctionSensor(h=h, R=cov, state=NAMES))
    x = np.random.default_rng(2).normal(size=(3, RUNS, N)) * [[[1.0]], [[3.0]], [[0.2]]]
    tracker: Any = make_filter("enkf", form="etkf", N=N, **keys)
    state = Ensemble(x, np.full(RUNS, np.nan))
    return x, tracker.step(model, state, z, 1, block_stream(1, 0)).x


@pytest.mark.parametrize("n_z", [1, 2, 3])
@pytest.mark.parametrize("rotation", [False, True])
@pytest.mark.parametrize(("N", "scale"), [(7, 1.0), (7, 1e-12), (3, 1.0), (2, 1.0), (2, 1e-4)])
def test_the_update_is_the_kalman_update_of_the_moments(
    n_z: int, scale: float, rotation: bool, N: int
) -> None:
    root = np.random.default_rng(3).normal(size=(n_z, n_z))
    R = scale * (root @ root.T + np.eye(n_z))
    R = 0.5 * (R + R.T)
    z = np.arange(1.0, 2.0 * n_z + 1.0).reshape(n_z, RUNS)
    z[0, 1] = np.nan
    before, after = updated(z, R, N, rotation=rotation)
    for run in range(RUNS):
        there = np.isfinite(z[:, run])
        Hr, P = H[:n_z][there], np.cov(before[:, run])
        m = before[:, run].mean(axis=1)
        K = np.linalg.solve(Hr @ P @ Hr.T + R[np.ix_(there, there)], Hr @ P).T
        m_new = m + K @ (z[there, run] - Hr @ m)
        A = np.eye(3) - K @ Hr
        P_new = A @ P @ A.T + K @ R[np.ix_(there, there)] @ K.T
        np.testing.assert_allclose(after[:, run].mean(axis=1), m_new, atol=1e-9)
        np.testing.assert_allclose(np.cov(after[:, run]), P_new, atol=1e-9)


@pytest.mark.parametrize("N", [7, 2])
def test_the_root_is_symmetric(N: int) -> None:
    """Hunt et al. 2007, eqs. 20 to 25: weights of the members, by numpy's eigenvectors."""
    R, z = np.array([[2.0, 0.3], [0.3, 1.0]]), np.array([[1.0, 2.0], [0.0, -1.0]])
    before, after = updated(z, R, N)
    for run in range(RUNS):
        m = before[:, run].mean(axis=1, keepdims=True)
        X = before[:, run] - m
        Y = H[:2] @ X
        w, V = np.linalg.eigh((N - 1) * np.eye(N) + Y.T @ np.linalg.solve(R, Y))
        mean = V / w @ V.T @ Y.T @ np.linalg.solve(R, z[:, run] - H[:2] @ m[:, 0])
        W = V * np.sqrt((N - 1) / w) @ V.T
        np.testing.assert_allclose(after[:, run], m + X @ (W + mean[:, None]), rtol=1e-9)


def test_a_rotation_is_uniform_in_the_space_of_mean_zero() -> None:
    """The cosine of the turn of a vector in d dimensions has moments 0, 1/d, 0, 3/(d (d + 2))."""
    runs, d = 20000, 4
    a = np.array([1.0, 0.0, -2.0, 3.0, -2.0]) / np.sqrt(18.0)
    turned = _rotated(np.broadcast_to(a, (1, runs, d + 1)), block_stream(1, 0))[0]
    np.testing.assert_allclose(turned.sum(axis=1), 0.0, atol=1e-14)
    np.testing.assert_allclose((turned**2).sum(axis=1), 1.0, rtol=1e-13)
    cosine = turned @ a
    for power, moment in ((1, 0.0), (2, 1 / d), (3, 0.0), (4, 3 / (d * (d + 2)))):
        values = cosine**power
        assert abs(values.mean() - moment) < 4.0 * values.std() / np.sqrt(runs)


def test_the_lorenz_system_of_sakov_oliver_and_bertino() -> None:
    """N = 10, inflation 1.02, rotation: DAPPER's sakov2012.py has a mean RMSE of .60.

    The errors of adjacent steps are correlated: the standard error is that of the runs' means.
    """
    motion = OdeMotion(
        components=("x", "y", "z"),
        derivative={"x": "10*(y - x)", "y": "x*(28 - z) - y", "z": "x*y - 8/3*z"},
        substeps=25,
        Q=0.0,
    )
    scenario = Tracking(
        T=0.25,
        last=120,
        target=Driven(motion=motion, initial={"x": 1.509, "y": -1.531, "z": 25.46}),
        sensor=FunctionSensor(h={"x": "x", "y": "y", "z": "z"}, R=2.0),
        start=GaussianStart(sigma=(2.0**0.5,) * 3),
    )
    tracker = make_filter("enkf", form="etkf", N=10, inflation=1.02, rotation=True)
    task = BlockTask(scenario, tracker, seed=1, index=0, width=100, runs_used=100)
    data = task.data
    errors = (run_filter(task, data).mean - data.truth)[:, 20:]
    of_runs = np.sqrt((errors**2).mean(axis=0)).mean(axis=0)
    error = of_runs.std(ddof=1) / np.sqrt(len(of_runs))
    assert abs(of_runs.mean() - 0.60) < 4.0 * error + 0.005


@pytest.mark.parametrize(
    ("keys", "what"),
    [
        ("form: etkf, centered: true", "centered: has no effect with `form: etkf`"),
        ("rotation: true", "rotation: has no effect with `form: perturbed`"),
        ("form: etkf, rotation: true, smooth: true", "smooth: follows each member backwards"),
    ],
)
def test_keys_that_exclude_each_other_are_refused(keys: str, what: str, tmp_path: Path) -> None:
    text = f"name: c\n{PLANE}filters: {{E: {{kind: enkf, {keys}}}}}\n"
    (tmp_path / "c.yaml").write_text(text)
    with pytest.raises(UserError, match=what):
        load(tmp_path / "c.yaml")
