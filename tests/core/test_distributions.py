import numpy as np
import pytest
from scipy import special, stats

from tests.conftest import random_covariance
from trackbench.core import compiled
from trackbench.core.distributions import Gaussian, PointMass, zero_mean_log_prob
from trackbench.core.gamma_noise import Gamma, Shifted
from trackbench.models.first_particles import heavy_tailed_normal

RUNS, N = 40, 5000


def test_gaussian_density_and_draws(rng: np.random.Generator) -> None:
    P, m = random_covariance(rng, 3), rng.standard_normal(3)
    x = rng.standard_normal((3, 40))
    g = Gaussian(m[:, None] + np.zeros((3, 40)), P)
    np.testing.assert_allclose(
        g.log_prob(x), stats.multivariate_normal(m, P).logpdf(x.T), rtol=1e-10
    )
    draws = Gaussian(m[:, None], P).sample(rng, 100_000)[:, 0]
    standard_error = np.sqrt(np.diag(P) / draws.shape[1])
    assert (np.abs(draws.mean(axis=1) - m) < 4 * standard_error).all()
    # Var of a sample covariance entry: (P_ii P_jj + P_ij^2) / n
    spread = np.sqrt((np.outer(np.diag(P), np.diag(P)) + P**2) / draws.shape[1])
    assert (np.abs(np.cov(draws) - P) < 4 * spread).all()


@pytest.mark.parametrize("shape", [3.0, 2.5, 1.0, 7.0, 0.5])
def test_gamma_density_and_draws(shape: float, rng: np.random.Generator) -> None:
    gamma, exact = Gamma(shape, 2.0), stats.gamma(shape, scale=0.5)
    v = np.linspace(0.01, 6, 50)
    np.testing.assert_allclose(gamma.log_density(v), exact.logpdf(v), rtol=1e-12)
    np.testing.assert_allclose(gamma.density(v), exact.pdf(v), rtol=1e-12)
    assert (gamma.log_density(np.array([0.0, -1.0])) == -np.inf).all()
    # Below zero: the formula of a whole shape goes on there, another's density ends.
    below = 2.0**shape / special.gamma(shape) * (-1.0) ** round(shape - 1.0) * np.exp(2.0)
    expected = below if shape % 1.0 == 0.0 else 0.0
    assert gamma.density(np.array([-1.0]))[0] == pytest.approx(expected)
    assert stats.kstest(gamma.draw(rng, (20_000,)), exact.cdf).pvalue > 1e-3
    assert (gamma.expectation, gamma.variance) == pytest.approx((exact.mean(), exact.var()))
    peak = v[np.argmax(exact.pdf(v))]
    assert abs(gamma.peak - peak) <= v[1] - v[0]


def test_shifted_is_the_noise_around_its_location() -> None:
    loc = np.array([[1.0, 2.0]])
    shifted = Shifted(Gamma(3.0, 2.0), loc)
    np.testing.assert_allclose(shifted.mean, loc + 1.5)
    np.testing.assert_allclose(shifted.cov, [[0.75]])
    x = np.array([[2.5, 1.5]])
    expected = [stats.gamma(3, scale=0.5).logpdf(1.5), -np.inf]
    np.testing.assert_allclose(shifted.log_prob(x), expected)


def test_point_draws_itself(rng: np.random.Generator) -> None:
    point = PointMass(np.array([[1.0, 2.0]]))
    np.testing.assert_array_equal(point.sample(rng, 3)[0, 1], [2.0] * 3)
    np.testing.assert_array_equal(point.log_prob(np.array([[1.0, 3.0]])), [0.0, -np.inf])


def test_weighted_draws_are_standard_normal(rng: np.random.Generator) -> None:
    """Mean weight, moments and tail probabilities; errors from the spread over independent rows."""
    x, log_w = heavy_tailed_normal(RUNS, N, rng)
    w = np.exp(log_w)
    for values, exact in (
        (w, 1.0),
        (w * x, 0.0),
        (w * x**2, 1.0),
        (w * x**4, 3.0),
        (w * (x > 3.0), 1.349898e-3),
        (w * (x < -4.5), 3.397673e-6),
    ):
        found = values.mean(axis=1)
        assert abs(found.mean() - exact) < 4 * found.std() / np.sqrt(RUNS)


def test_no_stratum_is_empty_and_no_weight_large(rng: np.random.Generator) -> None:
    x, log_w = heavy_tailed_normal(RUNS, N, rng)
    assert (np.diff(x, axis=1) > 0).all()
    assert np.exp(log_w).max() < 1.77
    for edge in (3.0, 4.0, 5.0):  # of N(0, 1)'s own draws 7, 0.2 and 0.001 are beyond
        beyond = 2.0 * N / (1.0 + np.exp(edge * np.pi / (2.0 * np.sqrt(3.0))))
        assert (np.abs((np.abs(x) > edge).sum(axis=1) - beyond) <= 2).all()


@pytest.mark.parametrize("kernels", [True, False])
@pytest.mark.parametrize(("n", "sigma"), [(100, 1e-4), (100, 1e4), (6, 1e-60), (5, 1e70)])
def test_a_density_has_a_determinant_beyond_the_range_of_floats(
    n: int, sigma: float, kernels: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not kernels:
        monkeypatch.setattr(compiled, "kernels", None)
    e = np.full((n, 3), sigma)
    expected = -0.5 * n - n * np.log(sigma) - 0.5 * n * np.log(2.0 * np.pi)
    for cov in (np.eye(n) * sigma**2, np.stack([np.eye(n) * sigma**2] * 3, axis=-1)):
        np.testing.assert_allclose(zero_mean_log_prob(e, cov), expected, rtol=1e-12)
