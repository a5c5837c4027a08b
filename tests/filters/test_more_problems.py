"""Further problems of the literature against programs of a few lines, on the same measurements."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.conftest import EXPERIMENT_FILES
from tests.filters.test_ekfukf import straight, white_acceleration
from tests.filters.test_standard_problems import (
    check_points,
    filtered,
    first_block,
    lorenz63,
    lorenz96,
    runge_kutta,
)
from trackbench.config.load import load
from trackbench.core.random_streams import block_stream

TURN = np.array(
    [[np.cos(np.pi / 18), -np.sin(np.pi / 18)], [np.sin(np.pi / 18), np.cos(np.pi / 18)]]
)


def kalman_step(m: Any, P: Any, z: Any, model: tuple[Any, ...]) -> tuple[Any, Any, float]:
    """Return the moments and the log-likelihood for F, u, Q, H, a, R: x' = F x + u, z = H x + a."""
    F, u, Q, H, a, R = model
    m, P = F @ m + u, F @ P @ F.T + Q
    nu, S = z - H @ m - a, H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    score = -0.5 * (nu @ np.linalg.solve(S, nu) + np.linalg.slogdet(2 * np.pi * S)[1])
    return m + K @ nu, P - K @ S @ K.T, score


def kalman(m: Any, P: Any, z: Any, model: tuple[Any, ...]) -> tuple[Any, Any]:
    """Return means (n, K) and log-likelihoods (K,) of all steps."""
    means, scores = [], []
    for at_step in z.T:
        m, P, score = kalman_step(m, P, at_step, model)
        means.append(m)
        scores.append(score)
    return np.transpose(means), np.array(scores)


def check_kalman(name: str, label: str, F: Any, Q: Any, R: Any, H: Any = None) -> None:
    """Compare a shipped filter with `kalman`, up to the last measurement; H: positions of two axes."""
    z, mean, scores, m, P = filtered(name, label)
    n, steps = len(F), np.isfinite(z[0]).sum()
    model = F, np.zeros(n), Q, np.eye(4)[::2] if H is None else H, np.zeros(2), R
    expected = kalman(m.reshape(n), P.reshape(n, n), z[:, :steps], model)
    np.testing.assert_allclose(mean[:, :steps], expected[0], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(scores[:steps], expected[1], rtol=1e-6)


def test_ckf_of_the_pendulum() -> None:
    def moved(x: Any, k: int) -> Any:
        return np.stack([x[0] + 0.01 * x[1], x[1] - 0.0981 * np.sin(x[0])])

    Q = 0.01 * np.array([[1e-6 / 3, 1e-4 / 2], [1e-4 / 2, 1e-2]])
    noise = Q, 0.1 * np.eye(1)
    check_points("pendulum", "CKF", moved, lambda x, k: np.sin(x[:1]), *noise, (2, 0))


def test_kalman_filter_of_the_car() -> None:
    check_kalman("car-track", "KF", straight(0.1), white_acceleration(1.0, 0.1), 0.25 * np.eye(2))


@pytest.mark.parametrize(
    ("name", "label", "u", "q", "a", "r"),
    [
        ("nile-models", "EKF", 0.0, 0.0, 0.0, 28351.5675),
        ("nile-diffuse", "KF", 0.0, 1469.1, 0.0, 15099.0),
    ],
)
def test_level_of_the_nile(name: str, label: str, u: float, q: float, a: float, r: float) -> None:
    z, mean, scores, m, P = filtered(name, label)
    one = np.eye(1)
    expected = kalman(m, P, z, (one, np.array([u]), q * one, one, np.array([a]), r * one))
    np.testing.assert_allclose(mean, expected[0], rtol=1e-9)
    np.testing.assert_allclose(scores[1:], expected[1][1:], rtol=1e-9)


@pytest.mark.parametrize(
    ("label", "F", "H"),
    [
        ("Rotated", np.array([[1.0, 1.0], [0.0, 1.0]]) @ TURN, np.eye(2)),
        ("Turned", TURN @ np.array([[1.0, 1.0], [0.0, 1.0]]), np.eye(2)),
        ("Sensor", np.array([[1.0, 1.0], [0.0, 1.0]]), TURN),
    ],
)
def test_wrong_models_of_the_linear_canonical_model(label: str, F: Any, H: Any) -> None:
    check_kalman("kalmannet-linear", label, F, 0.01 * np.eye(2), np.eye(2), H)


def test_stochastic_volatility_is_a_sum_over_many_states() -> None:
    (y,), (mean,), scores, m, _ = filtered("stochastic-volatility", "Exact")
    rho, s = 0.9702, 0.178
    x = m[0] + np.linspace(-6.0, 6.0, 1201)
    kernel = np.exp(-0.5 * ((x[:, None] - m[0] - rho * (x - m[0])) / s) ** 2)
    kernel *= (x[1] - x[0]) / np.sqrt(2 * np.pi) / s
    p = np.exp(-0.5 * (x - m[0]) ** 2 * (1 - rho**2) / s**2)
    p /= p.sum()
    for k in range(200):
        p = kernel @ p * np.exp(-0.5 * (y[k] ** 2 * np.exp(-x) + x + np.log(2 * np.pi)))
        np.testing.assert_allclose(scores[k], np.log(p.sum()), atol=1e-6)
        p /= p.sum()
        np.testing.assert_allclose(mean[k], x @ p, atol=1e-6)


def fading(
    z: Any, m: Any, P: Any, step: Callable[[Any], Any], factor: float, H: Any, R: Any
) -> Any:
    """Return estimates (K, n) of an EKF whose covariance grows; its Jacobians are complex steps."""
    out = []
    for k in range(z.shape[1]):
        F = step(m[:, None] + 1e-30j * np.eye(len(m))).imag / 1e-30
        m, P = step(m), factor * F @ P @ F.T
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        m, P = m + K @ (z[:, k] - H @ m), P - K @ H @ P
        out.append(m)
    return out


def test_fading_ekf_of_the_lorenz_system_of_anderson() -> None:
    z, mean, _, m, P = filtered("lorenz63-anderson", "EKF", 10)

    def moved(x: Any) -> Any:
        return runge_kutta(lorenz63, x, 0.01, 12)

    expected = fading(z[:, :10], m, P, moved, 1.21, np.eye(3), 8 * np.eye(3))
    np.testing.assert_allclose(mean[:, :10].T, expected, rtol=1e-6, atol=1e-6)


def pendulums(x: Any) -> Any:
    """Return the derivative by Lagrange's equations: accelerations solve M(angles) q'' = forces."""
    a, u, b, v = x
    c, s = np.cos(a - b), np.sin(a - b)
    forces = np.stack([-v * v * s - 2 * 9.8 * np.sin(a), u * u * s - 9.8 * np.sin(b)])
    determinant = 2 - c * c  # of M = [[2, c], [c, 1]]
    turn = np.stack([forces[0] - c * forces[1], 2 * forces[1] - c * forces[0]]) / determinant
    return np.stack([u, turn[0], v, turn[1]])


@pytest.mark.parametrize("steps", [10, 20, 30, 60, 100])
def test_step_of_the_double_pendulum(steps: int) -> None:
    scenario: Any = load(EXPERIMENT_FILES[f"double-pendulum-{steps}"]).points[0].scenario
    x = np.random.default_rng(1).standard_normal((4, 5))
    moved = scenario.model.motion.transition(x, 1).mean
    np.testing.assert_allclose(moved, runge_kutta(pendulums, x, 0.01, steps), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("steps", "growth"), [(10, 2.0), (20, 3.0)])
def test_fading_ekf_of_the_double_pendulum(steps: int, growth: float) -> None:
    z, mean, _, m, P = filtered(f"double-pendulum-{steps}", "EKF", 40)

    def moved(x: Any) -> Any:
        return runge_kutta(pendulums, x, 0.01, steps)

    factor, R = growth ** (steps / 100), 0.01 * np.eye(2)
    expected = fading(z[:, :40], m, P, moved, factor, np.eye(4)[::2], R)
    np.testing.assert_allclose(mean[:, :40].T, expected, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize(("steps", "N"), [(30, 20), (60, 20), (100, 40)])
def test_transform_filter_of_the_double_pendulum(steps: int, N: int) -> None:
    """From the members before each step: the mean after it, which no rotation moves."""
    task = first_block(f"double-pendulum-{steps}", f"ETKF (N={N})", last=10)
    model, tracker, rng = task.scenario.model, task.filter, block_stream(1, 0)
    state = tracker.init(model, task.data.prior, rng)
    R_inverse, H = 100 * np.eye(2), np.eye(4)[::2]
    for k in range(1, 11):
        x = runge_kutta(pendulums, state.x[:, 0], 0.01, steps)
        m, z = x.mean(axis=1), task.data.measurements[:, k - 1]
        X = x - m[:, None]
        Y = H @ X
        # w = [(N - 1) I + Y' R^-1 Y]^-1 Y' R^-1 (z - H m)
        C = Y.T @ R_inverse
        w = np.linalg.solve((N - 1) * np.eye(N) + C @ Y, C @ (z[:, 0] - H @ m))
        state = tracker.step(model, state, z, k, rng)
        np.testing.assert_allclose(state.x[:, 0].mean(axis=1), m + X @ w, rtol=1e-6, atol=1e-6)


def test_ckf_of_the_cubes_of_mandel() -> None:
    def moved(x: Any, k: int) -> Any:
        return runge_kutta(lorenz63, x, 0.01, 5)

    noise = 0.01 * np.eye(3), 8 * np.eye(3)
    check_points("lorenz63-mandel", "CKF", moved, lambda x, k: x**3, *noise, (3, 0), last=30)


CLIMATE = np.array([0, 0, 23.55]), np.array([[62.8, 62.8, 0], [62.8, 81.2, 0], [0, 0, 74.4]])
_ROW = [13.25, 0.87, -4.79, -1.71, 0.84, 1.32, 0.43, -0.66, -0.59, 0.09, 0.33, 0.16, -0.1]
_CIRCLE = np.array(_ROW + [0.0] * 15 + _ROW[:0:-1])
CLIMATE_96 = np.full(40, 2.342), _CIRCLE[np.subtract.outer(np.arange(40), np.arange(40))]


@pytest.mark.parametrize(
    ("name", "climate", "H", "r"),
    [
        ("lorenz63-wiljes", CLIMATE, np.eye(3)[:1], 8.0),
        ("lorenz63-ramgraber", CLIMATE, np.eye(3), 4.0),
        ("lorenz96-spantini", CLIMATE_96, np.eye(40)[::2], 0.5),
        ("lorenz96-roots", CLIMATE_96, np.eye(40), 1.0),
    ],
)
def test_optimal_interpolation(name: str, climate: tuple[Any, Any], H: Any, r: float) -> None:
    z, mean, *_ = filtered(name, "OI", 40)
    m, C = climate
    K = C @ H.T @ np.linalg.inv(H @ C @ H.T + r * np.eye(len(H)))
    np.testing.assert_allclose(mean, m[:, None] + K @ (z - (H @ m)[:, None]), rtol=1e-6, atol=1e-6)


def test_step_of_lorenz_96_in_twenty_parts() -> None:
    scenario: Any = load(EXPERIMENT_FILES["lorenz96-spantini"]).points[0].scenario
    x = 3.0 + np.random.default_rng(1).standard_normal((40, 5))
    moved = scenario.model.motion.transition(x, 1).mean
    np.testing.assert_allclose(moved, runge_kutta(lorenz96, x, 0.02, 20), rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "T", "Q", "R", "at"),
    [
        ("radar-turns", 2.0, [[16.0, 16.0], [16.0, 16.0]], [2500.0, 9e-6], (0.0, 0.0)),
        ("uav-radar", 1.0, [[2 / 3, 1.0], [1.0, 2.0]], [100.0, 64e-6], (-1500.0, -1500.0)),
    ],
)
def test_ekf_of_a_radar(name: str, T: float, Q: Any, R: Any, at: tuple[float, float]) -> None:
    z, mean, _, m, P = filtered(name, "EKF")
    F, Q = straight(T), np.kron(np.eye(2), Q)
    m, P = m.reshape(4), P.reshape(4, 4)
    steps = min(mean.shape[1], 100)
    first = z.shape[1] - mean.shape[1]
    for k in range(steps):
        m, P = F @ m, F @ P @ F.T + Q
        x, y = m[0] - at[0], m[2] - at[1]
        r = np.hypot(x, y)
        H = np.array([[x / r, 0, y / r, 0], [-y / r**2, 0, x / r**2, 0]])
        nu = z[:, first + k] - [r, np.arctan2(y, x)]
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + np.diag(R))
        m, P = m + K @ nu, P - K @ H @ P
        np.testing.assert_allclose(mean[:, k], m, rtol=1e-6, atol=1e-6)


def test_kalman_filter_of_the_lidar() -> None:
    G = np.kron(np.eye(2), np.array([[0.5], [1.0]]))
    check_kalman("lidar", "KF", straight(1.0), 39.5 * G @ G.T, 625.0 * np.eye(2))


def test_kalman_filter_of_calibration() -> None:
    Q, R = white_acceleration(1.0, 1.0), 25.0 * np.eye(2)
    check_kalman("calibration", "KF", straight(1.0), Q, R)


def test_kalman_filter_of_the_ferry() -> None:
    """With the reports' own intervals; positions and velocities are measured."""
    z, mean, scores, m, P = filtered("ais", "KF (CV)")
    apart = np.diff(first_block("ais", "KF (CV)").scenario.times)
    assert len(apart) == z.shape[1]
    m, P = m.reshape(4), P.reshape(4, 4)
    H, R = np.eye(4)[[0, 2, 1, 3]], np.diag([25.0, 25.0, 0.09, 0.09])
    for k, T in enumerate(apart):
        model = straight(T), np.zeros(4), white_acceleration(0.1, T), H, np.zeros(4), R
        m, P, score = kalman_step(m, P, z[:, k], model)
        np.testing.assert_allclose(mean[:, k], m, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(scores[k], score, rtol=1e-6)


def falling(x: Any) -> Any:
    altitude, velocity, ballistic = x
    drag = np.exp(-5e-5 * altitude) * velocity**2 * ballistic
    return np.stack([-velocity, -drag, 0 * drag])


def test_ukf_of_the_falling_body() -> None:
    def moved(x: Any, k: int) -> Any:
        return runge_kutta(falling, x, 0.125, 8)

    def distance(x: Any, k: int) -> Any:
        return np.sqrt(1e10 + (x[:1] - 1e5) ** 2)

    noise = np.zeros((3, 3)), 1e4 * np.eye(1)
    check_points("falling-body", "UKF", moved, distance, *noise, (3, 2), last=20)
