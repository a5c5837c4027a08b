import numpy as np
import pytest
from scipy import integrate, special, stats

from trackbench.core.regularization import Mode, bandwidth, jitter, jitter_modes, kernel_draws


@pytest.mark.parametrize("n", [1, 2, 4])
def test_epanechnikov_radius_has_its_density(n: int, rng: np.random.Generator) -> None:
    """Radius density proportional to r^(n-1) (1 - r^2): r^2 ~ Beta(n/2, 2)."""
    r2 = np.square(kernel_draws("epanechnikov", (n, 20_000), rng)).sum(axis=0)
    assert stats.kstest(r2, stats.beta(n / 2, 2).cdf).pvalue > 1e-3


@pytest.mark.parametrize("n", [1, 2, 4])
def test_bandwidth_minimizes_the_expected_error_for_a_gaussian(n: int) -> None:
    """h^(n+4) = n int K^2 / (N (int u_1^2 K)^2 int (laplacian f)^2 ...) of Silverman (1986, 4.14)."""
    ball = np.pi ** (n / 2) / special.gamma(n / 2 + 1)
    height = (n + 2) / (2 * ball)  # K(u) = height (1 - |u|^2)

    def radial(f) -> float:
        surface = n * ball
        return surface * integrate.quad(lambda r: r ** (n - 1) * f(r), 0, 1)[0]

    roughness = radial(lambda r: (height * (1 - r**2)) ** 2)
    second = radial(lambda r: r**2 * height * (1 - r**2)) / n
    # int (laplacian of the standard normal)^2 = (2 sqrt pi)^-n (n/2 + n^2/4)
    curvature = (2 * np.sqrt(np.pi)) ** -n * (n / 2 + n**2 / 4)
    N = 1000
    optimal = (n * roughness / (second**2 * curvature) / N) ** (1 / (n + 4))
    assert bandwidth(n, N, "epanechnikov") == pytest.approx(optimal, rel=1e-9)
    assert bandwidth(n, N, "gaussian") == pytest.approx((4 / (n + 2) / N) ** (1 / (n + 4)))


def test_jitter_adds_the_kernels_covariance_in_the_clouds_metric(rng: np.random.Generator) -> None:
    P = np.array([[4.0, 1.9], [1.9, 1.0]])
    x = np.zeros((2, 1, 100_000))
    moved = jitter(x, P[..., None], "gaussian", rng)[:, 0]
    h2 = bandwidth(2, 100_000, "gaussian") ** 2
    spread = np.sqrt((np.outer(np.diag(P), np.diag(P)) + P**2) / 100_000)
    assert (np.abs(np.cov(moved) / h2 - P) < 4 * spread).all()


def test_a_mode_has_the_bandwidth_of_its_share(rng: np.random.Generator) -> None:
    members = np.arange(20_000)[None] < 5000
    mode = Mode(members, np.array([0.25]), np.full((1, 1, 1), 4.0))
    moved = jitter_modes(np.zeros((1, 1, 20_000)), [mode], "gaussian", rng)[0]
    assert not moved[~members].any()
    h = bandwidth(1, 5000, "gaussian")
    assert moved[members].std() == pytest.approx(2.0 * h, rel=4.5 / np.sqrt(2 * 5000))


def test_a_cloud_without_spread_stays(rng: np.random.Generator) -> None:
    x = np.ones((1, 2, 5))
    np.testing.assert_array_equal(jitter(x, np.zeros((1, 1, 2)), "epanechnikov", rng), x)


def test_a_cloud_on_a_line_stays_beside_one_that_moves(rng: np.random.Generator) -> None:
    """A singular covariance has no Cholesky factor; one that is no number leaves no number."""
    x = np.ones((2, 3, 5))
    covs = np.stack([np.ones((2, 2)), np.eye(2), np.full((2, 2), np.nan)], axis=-1)
    moved = jitter(x, covs, "gaussian", rng)
    np.testing.assert_array_equal(moved[:, 0], x[:, 0])
    assert (moved[:, 1] != x[:, 1]).all()
    assert np.isnan(moved[:, 2]).all()
