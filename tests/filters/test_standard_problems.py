"""Standard problems of the literature against programs of a few lines, on the same measurements."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.conftest import make_filter, shipped
from tests.filters.test_ekfukf import sigma_points
from tests.filters.test_ensembles import in_deviations
from trackbench.core.particles import Particles
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.run_filter import run_filter

Function = Callable[[Any], Any]


def first_block(name: str, label: str, runs: int = 1, last: int | None = None) -> BlockTask:
    """Return runs of a shipped experiment's filter at the first point of its grid, up to a step."""
    point = shipped(name).points[0]
    scenario: Any = point.scenario
    return BlockTask(
        replace(scenario.without_scoring, last=last) if last else scenario, point.filters[label],
        seed=3, index=0, width=runs, runs_used=runs,
        predictive_metrics=("score",), assume=point.assumed.get(label),
    )  # fmt: skip


def filtered(name: str, label: str, last: int | None = None) -> tuple[Any, Any, Any, Any, Any]:
    """Return a run's measurements, estimates (n, K), log-likelihoods, and the prior's moments."""
    task = first_block(name, label, last=last)
    data = task.data
    got, prior = run_filter(task, data), data.prior
    scores = got.diagnostics["log_likelihood"][1:, 0]
    return (
        data.measurements[..., 0], got.mean[:, 1:, 0], scores, prior.mean[:, 0], np.asarray(prior.cov)
    )  # fmt: skip


def check_points(
    name: str,
    label: str,
    f: Function,
    h: Function,
    Q: Any,
    R: Any,
    rule: tuple[float, float],
    last: int | None = None,
) -> None:
    """Compare a shipped filter of sigma points with `sigma_points`."""
    z, mean, _, m, P = filtered(name, label, last)
    expected = sigma_points(m, P, z[:, :last], f, h, Q, R, rule)
    np.testing.assert_allclose(mean[:, :last].T, expected, rtol=1e-6, atol=1e-6)


def test_nile_against_the_joint_normal_distribution() -> None:
    (y,), (level,), scores, _, _ = filtered("nile", "KF")
    year = np.arange(len(y))
    # cov(level_i, level_j) = 1e7 + 1469.1 min(i, j)
    P = 1e7 + 1469.1 * np.minimum.outer(year, year)
    S = P + 15099.0 * np.eye(len(y))
    for k in (1, 2, 40, 100):
        expected = P[k - 1, :k] @ np.linalg.solve(S[:k, :k], y[:k])
        np.testing.assert_allclose(level[k - 1], expected, rtol=1e-9)
    joint = -0.5 * (y @ np.linalg.solve(S, y) + np.linalg.slogdet(2 * np.pi * S)[1])
    np.testing.assert_allclose(scores.sum(), joint, rtol=1e-9)


def runge_kutta(f: Function, x: Any, h: float, steps: int) -> Any:
    for _ in range(steps):
        a = f(x)
        b = f(x + h / 2 * a)
        c = f(x + h / 2 * b)
        x = x + h / 6 * (a + 2 * b + 2 * c + f(x + h * c))
    return x


def lorenz63(x: Any) -> Any:
    return np.stack([10 * (x[1] - x[0]), x[0] * (28 - x[2]) - x[1], x[0] * x[1] - 8 / 3 * x[2]])


def lorenz96(x: Any) -> Any:
    return (np.roll(x, -1, 0) - np.roll(x, 2, 0)) * np.roll(x, 1, 0) - x + 8


def test_fading_ekf_of_the_lorenz_system() -> None:
    """Jacobians by complex steps."""
    z, mean, _, m, P = filtered("lorenz63", "EKF", 40)
    for k in range(40):
        F = runge_kutta(lorenz63, m[:, None] + 1e-30j * np.eye(3), 0.01, 25).imag / 1e-30
        m, P = runge_kutta(lorenz63, m, 0.01, 25), 180**0.25 * F @ P @ F.T
        K = P @ np.linalg.inv(P + 2 * np.eye(3))
        m, P = m + K @ (z[:, k] - m), P - K @ P
        np.testing.assert_allclose(mean[:, k], m, rtol=1e-6, atol=1e-6)


def test_ckf_of_lorenz_96() -> None:
    def moved(x: Any, k: int) -> Any:
        return runge_kutta(lorenz96, x, 0.05, 1)

    noise = np.zeros((10, 10)), 2.25 * np.eye(5)
    check_points("lorenz96", "CKF", moved, lambda x, k: x[::2], *noise, (10, 0), last=40)


def test_step_of_lorenz_96_with_40_components() -> None:
    scenario: Any = shipped("lorenz96-40").points[0].scenario
    x = 3.0 + np.random.default_rng(1).standard_normal((40, 5))
    moved = scenario.model.motion.transition(x, 1).mean
    np.testing.assert_allclose(moved, runge_kutta(lorenz96, x, 0.05, 1), rtol=1e-12)


def turn(x: Any, k: int) -> Any:
    px, vx, py, vy, w = x
    s, c = np.sin(w), np.cos(w)
    return np.stack(
        [px + s / w * vx - (1 - c) / w * vy, c * vx - s * vy,
         py + (1 - c) / w * vx + s / w * vy, s * vx + c * vy, w]
    )  # fmt: skip


def test_ckf_of_the_turning_aircraft() -> None:
    Q = np.zeros((5, 5))
    Q[:2, :2] = Q[2:4, 2:4] = 0.1 * np.array([[1 / 3, 1 / 2], [1 / 2, 1]])
    Q[4, 4] = 1.75e-4

    def polar(x: Any, k: int) -> Any:
        return np.stack([np.hypot(x[0], x[2]), np.arctan2(x[2], x[0])])

    check_points("turning-aircraft", "CKF", turn, polar, Q, np.diag([100.0, 1e-5]), (5, 0))


def test_imm_of_the_air_traffic() -> None:
    """Two linear models; the transition matrix is the exponential of the switching rates times 5 s."""
    z, mean, _, m, P = filtered("air-traffic", "IMM, linear")
    rates = 5 * np.array([[-0.005, 0.005], [0.04, -0.04]])
    p = np.eye(2) + rates * (1 - np.exp(np.trace(rates))) / -np.trace(rates)
    F = np.kron(np.eye(2), np.array([[1.0, 5.0], [0.0, 1.0]]))
    G = np.kron(np.eye(2), np.array([[12.5], [5.0]]))
    states, mu = [(m, P)] * 2, np.array([0.5, 0.5])
    for k, measured in enumerate(z.T):
        c, updated, likelihood = mu @ p, [], []
        for j, q in enumerate((0.01, 4.0)):
            w = p[:, j] * mu / c[j]
            m0 = sum(a * x for a, (x, _) in zip(w, states, strict=True))
            P0 = sum(
                a * (V + np.outer(x - m0, x - m0)) for a, (x, V) in zip(w, states, strict=True)
            )
            m1, P1 = F @ m0, F @ P0 @ F.T + q * G @ G.T
            S, nu = P1[::2, ::2] + 1e4 * np.eye(2), measured - m1[::2]
            K = P1[:, ::2] @ np.linalg.inv(S)
            updated.append((m1 + K @ nu, P1 - K @ P1[::2]))
            likelihood.append(np.exp(-nu @ np.linalg.inv(S) @ nu / 2) / np.sqrt(np.linalg.det(S)))
        states, mu = updated, c * np.array(likelihood) / (c @ likelihood)
        expected = sum(a * x for a, (x, _) in zip(mu, states, strict=True))
        np.testing.assert_allclose(mean[:, k], expected, rtol=1e-6, atol=1e-6)


def test_ckf_of_the_moving_observer() -> None:
    """The observer's place is the sum of its minutes at 5 knots."""
    z, mean, _, m, P = filtered("moving-observer", "CKF")
    headings = np.deg2rad(np.repeat([140, 18, 90, 180, -18, -60], [12, 11, 6, 5, 5, 10]))
    minutes = 5 * 1852 / 60 * np.stack([np.sin(headings), np.cos(headings)])
    at = np.c_[np.zeros(2), np.cumsum(minutes, axis=1)]
    G = np.kron(np.eye(2), np.array([[1800.0], [60.0]]))
    F = np.kron(np.eye(2), np.array([[1.0, 60.0], [0.0, 1.0]]))

    def bearing(x: Any, k: int) -> Any:
        return np.arctan2(x[2:3] - at[1, k], x[0:1] - at[0, k])

    R = np.deg2rad(1.0) ** 2 * np.eye(1)
    expected = sigma_points(m, P, z, lambda x, k: F @ x, bearing, 1.6e-6 * G @ G.T, R, (4, 0))
    assert np.abs(np.diff(z[0])).max() < 3.0  # no bearing crosses the cut
    np.testing.assert_allclose(mean.T, expected, rtol=1e-6, atol=1e-5)


def test_jitter_pf_comes_close_to_the_kalman_filter() -> None:
    errors, ratios = in_deviations("jitter-pf", N=1000, ess_threshold=0.5, bandwidth_scale=0.3)
    assert np.sqrt(np.mean(errors**2)) < 10.0 / np.sqrt(1000)
    assert abs(ratios.mean() - 1.0) < 0.15


def test_jitter_moves_copies_alone_by_a_kernel_of_the_posterior() -> None:
    """h = 0.7 (4 / (n + 2) / N)^(1 / (n + 4)); the covariance of weighted draws, unbiased."""
    rng = np.random.default_rng(1)
    N, A = 40_000, np.array([[2.0, 0.0], [1.0, 0.5]])
    x = (A @ rng.standard_normal((2, N)))[:, None]
    w = np.where(np.arange(N) < N // 2, 2.0, 1e-9)
    tracker: Any = make_filter("jitter-pf", N=N, ess_threshold=0.9, bandwidth_scale=0.7)
    cloud = Particles(x, (w / w.sum())[None])
    moved = tracker._resample_if_needed(cloud, np.random.default_rng(1), N).x[:, 0]
    # Each of the first half has two copies or, where the rounded sum of weights decides, one or three.
    parents = np.repeat(x[:, 0, : N // 2], 2, axis=1)
    step = moved - parents
    close = np.abs(step).max(axis=0) < 1.0
    assert close.mean() > 0.99
    h = 0.7 * (4 / 4 / N) ** (1 / 6)
    np.testing.assert_allclose(np.cov(step[:, close]), h**2 * A @ A.T, rtol=0.1, atol=1e-4)
    even = Particles(x, np.full((1, N), 1.0 / N))
    np.testing.assert_array_equal(
        tracker._resample_if_needed(even, np.random.default_rng(1), N).x, x
    )


@pytest.mark.parametrize(
    ("weights", "variance"),
    [((0, 0, 1, 0, 0, 0), 3.5), ((0, 0, 0.6, 0.4, 0, 0), 0.5)],
    ids=["one with all the weight: that of 0..5", "two with the weight: (1 - 0)^2 / 2"],
)
def test_variance_of_the_jitter_of_few_particles(
    weights: tuple[float, ...], variance: float
) -> None:
    x, w = np.arange(6.0).reshape(1, 1, 6), np.array([weights])

    def resampled(seed: int, scale: float) -> Any:
        tracker: Any = make_filter("jitter-pf", N=6, ess_threshold=0.5, bandwidth_scale=scale)
        return tracker._resample_if_needed(Particles(x, w), np.random.default_rng(seed), 6).x

    steps = [resampled(seed, 1.0) - resampled(seed, 0.0) for seed in range(1000)]
    expected = variance * (4 / 3 / 6) ** 0.4
    np.testing.assert_allclose(np.var(steps), expected, rtol=6 * np.sqrt(2 / 6000))


def linear(q: float) -> tuple[Any, Any]:
    """Return F and Q of white acceleration for 1 s, of (px, vx, py, vy)."""
    F = np.kron(np.eye(2), np.array([[1.0, 1.0], [0.0, 1.0]]))
    return F, q * np.kron(np.eye(2), np.array([[1 / 3, 1 / 2], [1 / 2, 1.0]]))


def test_gate_after_the_blackout() -> None:
    """GPS at even steps, odometry at odd ones; chi-square of two degrees exceeds -2 log p with p."""
    z, mean, _, m, P = filtered("fault-blackout", "Gate 0.999")
    (F, Q), m, P, refused = linear(0.1), m[:4], P[:4, :4], 0
    for k in range(1, 301):
        m, P = F @ m, F @ P @ F.T + Q
        odometry = k % 2
        H, R = np.eye(4)[odometry::2], (25.0, 0.04)[odometry] * np.eye(2)
        nu, S = z[2 * odometry : 2 * odometry + 2, k - 1] - H @ m, H @ P @ H.T + R
        good = nu @ np.linalg.solve(S, nu) <= -2 * np.log(0.001)  # not without a measurement
        refused += bool(not good and k > 160)
        if good:
            K = P @ H.T @ np.linalg.inv(S)
            m, P = m + K @ nu, P - K @ H @ P
        np.testing.assert_allclose(mean[:4, k - 1], m, rtol=1e-6, atol=1e-6)
    assert refused > 20


def test_filter_that_knows_the_ramp() -> None:
    z, mean, _, m, P = filtered("fault-ramp", "Known")
    (F, Q), m, P, H = linear(0.1), m[:4], P[:4, :4], np.eye(4)[::2]
    for k in range(1, 301):
        m, P = F @ m, F @ P @ F.T + Q
        second = k % 2
        bias = second * (100 <= k <= 200) * (k - 100) * np.array([0.5, 0.25])
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + (100.0, 25.0)[second] * np.eye(2))
        m, P = m + K @ (z[2 * second : 2 * second + 2, k - 1] - bias - H @ m), P - K @ H @ P
        np.testing.assert_allclose(mean[:4, k - 1], m, rtol=1e-6, atol=1e-6)
