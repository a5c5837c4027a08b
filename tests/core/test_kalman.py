"""The Kalman filter against the conditional of the joint Gaussian it stands for."""

import numpy as np
import pytest

from tests.conftest import random_covariance
from trackbench.core import kalman, linalg
from trackbench.core.distributions import Gaussian


@pytest.mark.parametrize(("n_x", "n_z", "steps"), [(1, 1, 5), (3, 2, 6), (4, 2, 8), (6, 3, 4)])
def test_filter_equals_the_conditional_of_the_joint_gaussian(
    n_x: int, n_z: int, steps: int, rng: np.random.Generator
) -> None:
    """Build mean and covariance of (x_K, z_1..z_K) directly, condition, compare."""
    F, H = 0.6 * rng.standard_normal((n_x, n_x)), rng.standard_normal((n_z, n_x))
    Q, R, P0 = (random_covariance(rng, n) for n in (n_x, n_z, n_x))
    m0, z = rng.standard_normal(n_x), rng.standard_normal((n_z, steps))

    state = Gaussian(m0[:, None], P0)
    log_likelihood = 0.0
    for k in range(steps):
        predicted = kalman.predict(state, F, Q)
        nu = z[:, k, None] - linalg.matvec(H, predicted.mean)
        state, innovation = kalman.update(predicted, nu, H, R)
        log_likelihood += innovation.log_likelihood[0]

    # x_k = F^k x_0 + sum_j F^(k-j) w_j as one linear map of (x_0, w_1..w_K)
    powers = [np.linalg.matrix_power(F, k) for k in range(steps + 1)]
    maps = [
        np.hstack([powers[k], *(powers[k - j] if j <= k else 0 * F for j in range(1, steps + 1))])
        for k in range(1, steps + 1)
    ]
    source = np.zeros((n_x * (steps + 1),) * 2)
    source[:n_x, :n_x] = P0
    for j in range(1, steps + 1):
        source[j * n_x : (j + 1) * n_x, j * n_x : (j + 1) * n_x] = Q
    C = np.vstack([H @ m for m in maps])
    S = C @ source @ C.T + np.kron(np.eye(steps), R)
    cross = maps[-1] @ source @ C.T
    z_mean = np.concatenate([H @ powers[k] @ m0 for k in range(1, steps + 1)])
    e = z.T.ravel() - z_mean
    gain = cross @ np.linalg.inv(S)
    expected_cov = maps[-1] @ source @ maps[-1].T - gain @ cross.T

    np.testing.assert_allclose(state.mean[:, 0], powers[-1] @ m0 + gain @ e, rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(state.cov, expected_cov, rtol=1e-8, atol=1e-10)
    exact = -0.5 * (e @ np.linalg.solve(S, e) + np.linalg.slogdet(2 * np.pi * S)[1])
    assert log_likelihood == pytest.approx(exact, rel=1e-9)


def test_a_covariance_per_run_gives_what_a_common_one_gives(rng: np.random.Generator) -> None:
    n, runs = 4, 7
    P, R, H = random_covariance(rng, n), random_covariance(rng, 2), rng.standard_normal((2, n))
    m, nu = rng.standard_normal((n, runs)), rng.standard_normal((2, runs))
    common, _ = kalman.update(Gaussian(m, P), nu, H, R)
    each, _ = kalman.update(Gaussian(m, np.repeat(P[..., None], runs, axis=2)), nu, H, R)
    np.testing.assert_allclose(each.mean, common.mean, rtol=1e-10)
    np.testing.assert_allclose(each.cov, np.repeat(common.cov[..., None], runs, axis=2), rtol=1e-9)


def test_a_missing_measurement_leaves_its_run_at_the_prediction(rng: np.random.Generator) -> None:
    P, H, R = random_covariance(rng, 2), np.array([[1.0, 0.0]]), np.eye(1)
    m, nu = rng.standard_normal((2, 3)), np.array([[0.5, np.nan, -0.5]])
    updated, _ = kalman.update(Gaussian(m, P), nu, H, R)
    np.testing.assert_array_equal(updated.mean[:, 1], m[:, 1])
    np.testing.assert_allclose(updated.cov[..., 1], P)
    alone, _ = kalman.update(Gaussian(m[:, :1], P), nu[:, :1], H, R)
    np.testing.assert_allclose(updated.mean[:, 0], alone.mean[:, 0])


@pytest.mark.parametrize("n_z", [3, 40, 41, 120])
@pytest.mark.parametrize("batch", [(), (7,)])
def test_the_gain_of_many_sensors_of_one_number(n_z: int, batch: tuple[int, ...]) -> None:
    """With variances r_i: posterior 1 / (1 / P + sum 1 / r_i), gains P+ / r_i."""
    variances = np.linspace(1.0, 3.0, n_z)
    P = np.full((1, 1, *batch), 2.0) * np.arange(1.0, 1.0 + (batch or (1,))[0]).reshape(batch)
    nu = np.ones((n_z, *batch)) * np.linspace(-1.0, 2.0, n_z).reshape(n_z, *[1] * len(batch))
    H, R = np.ones((n_z, 1)), np.diag(variances)
    posterior, innovation = kalman.update(Gaussian(np.zeros((1, *batch)), P), nu, H, R)
    variance = 1.0 / (1.0 / P[0, 0] + (1.0 / variances).sum())
    np.testing.assert_allclose(posterior.cov[0, 0], variance, rtol=1e-10)
    mean = variance * (np.linspace(-1.0, 2.0, n_z) / variances).sum()
    np.testing.assert_allclose(posterior.mean[0], mean, rtol=1e-10)
    # by moments in place of H
    before, C = Gaussian(np.zeros((1, *batch)), P), np.repeat(P, n_z, axis=1)
    np.testing.assert_allclose(
        kalman.condition(before, nu, C, innovation.S).mean[0], mean, rtol=1e-9
    )
