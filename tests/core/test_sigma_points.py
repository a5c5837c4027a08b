import numpy as np
import pytest

from tests.conftest import random_covariance
from trackbench.core import kalman
from trackbench.core.distributions import Gaussian
from trackbench.core.sigma_points import Unscented
from trackbench.filters.assumed_noise import AssumedNoise
from trackbench.filters.ekf import extended_step
from trackbench.filters.sigma_point_steps import augmented_step
from trackbench.models.base import Model


@pytest.mark.parametrize("parameters", [(1.0, 0.0, 2.0), (1e-3, 2.0, 0.0), (0.5, 1.0, 1.0)])
def test_linear_maps_are_exact(
    parameters: tuple[float, float, float], rng: np.random.Generator
) -> None:
    P, m, A = random_covariance(rng, 3, 5), rng.standard_normal((3, 5)), rng.standard_normal((2, 3))
    sigma = Unscented(*parameters).points(Gaussian(m, P))
    got = sigma.moments(np.einsum("ij,jsb->isb", A, sigma.x))
    np.testing.assert_allclose(got.mean, A @ m, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(got.cov, np.einsum("ij,jkb,lk->ilb", A, P, A), rtol=1e-6)


def test_square_of_a_scalar_has_its_exact_mean_and_variance() -> None:
    """E x^2 = m^2 + P and Var x^2 = 4 m^2 P + 2 P^2, with n + kappa = 3 (Julier & Uhlmann 1997)."""
    m, P = np.array([[0.3, 1.0, -2.0]]), np.array([[[0.5, 1.0, 2.0]]])
    sigma = Unscented(alpha=1.0, beta=0.0, kappa=2.0).points(Gaussian(m, P))
    got = sigma.moments(sigma.x**2)
    np.testing.assert_allclose(got.mean[0], m[0] ** 2 + P[0, 0])
    np.testing.assert_allclose(got.cov[0, 0], 4 * m[0] ** 2 * P[0, 0] + 2 * P[0, 0] ** 2)


class _Linear:
    """x' = F x + w, z = H x + n; both roles, for the steps under test."""

    components = ("a", "b")

    def __init__(self, F: np.ndarray, Q: np.ndarray) -> None:
        self.F, self.Q = F, Q

    def transition(self, x: np.ndarray, k: int) -> Gaussian:
        return Gaussian(np.einsum("ij,j...->i...", self.F, x), self.Q)

    measurement = transition

    def innovation(self, z: np.ndarray, z_pred: np.ndarray) -> np.ndarray:
        return z - z_pred

    def jacobian(self, x: np.ndarray, k: int) -> np.ndarray:
        return self.F


def test_both_steps_are_the_kalman_filter_on_a_linear_model(rng: np.random.Generator) -> None:
    motion = _Linear(rng.standard_normal((2, 2)), random_covariance(rng, 2))
    sensor = _Linear(rng.standard_normal((1, 2)), random_covariance(rng, 1))
    state = Gaussian(rng.standard_normal((2, 6)), random_covariance(rng, 2, 6))
    z = rng.standard_normal((1, 6))
    z[:, 2] = np.nan
    predicted = kalman.predict(state, motion.F, motion.Q)
    exact, _ = kalman.update(predicted, z - sensor.F @ predicted.mean, sensor.F, sensor.Q)
    model = Model(motion, sensor)
    for got, _ in (
        extended_step(model, state, z, 1, AssumedNoise()),
        augmented_step(model, state, z, 1, AssumedNoise(), Unscented(1.0, 0.0, 2.0)),
    ):
        np.testing.assert_allclose(got.mean, exact.mean, rtol=1e-8)
        np.testing.assert_allclose(got.cov, exact.cov, rtol=1e-7, atol=1e-10)
