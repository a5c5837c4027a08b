import numpy as np
import pytest

from trackbench.core.polar_conversions import position
from trackbench.models.sensors.range_azimuth import RangeAzimuth
from trackbench.models.two_scan_prior import TwoPoint

SENSOR = RangeAzimuth(sigma_range=0.2, sigma_azimuth_mrad=2.0)


@pytest.fixture
def start() -> TwoPoint:
    first = np.array([[2.0e5], [3.0]])
    second = np.array([[2.002e5], [3.02]])
    return TwoPoint(SENSOR, first, second, 1.0, 0.5)


def test_draws_have_the_moments_of_the_gaussian_start(
    start: TwoPoint, rng: np.random.Generator
) -> None:
    n = 200_000
    x = start.sample(rng, n)[:, 0]
    gaussian = start.gaussian("mucm")
    scale = np.sqrt(np.diagonal(gaussian.cov[..., 0]))
    assert (np.abs(x.mean(axis=1) - gaussian.mean[:, 0]) < 4 * scale / np.sqrt(n)).all()
    # Sample correlations have standard errors of at most 1 / sqrt(n); variances sqrt(2 / n).
    white = np.cov(x) / np.outer(scale, scale)
    exact = gaussian.cov[..., 0] / np.outer(scale, scale)
    assert np.abs(white - exact).max() < 4 * np.sqrt(2 / n)


def test_log_density_of_the_start(start: TwoPoint, rng: np.random.Generator) -> None:
    """Its mean over draws is the negative entropy: of two Gaussian scans, and of the change to x."""
    n = 100_000
    x = start.sample(rng, n)
    log_p = start.log_prob(x)[0]
    r1, r2 = start.first[0, 0], start.second[0, 0]
    walked = start.q / 3.0
    sigmas = [0.2, 2e-3, np.sqrt(0.04 + walked), np.sqrt(4e-6 + walked / r1**2)]
    exact = -sum(0.5 * np.log(2 * np.pi * np.e * s**2) for s in sigmas) - np.log(r1 * r2)
    assert abs(log_p.mean() - exact) < 4 * log_p.std() / np.sqrt(n) + 1e-5


def test_positions_lie_on_the_measured_arc(start: TwoPoint, rng: np.random.Generator) -> None:
    _, p2, log_w = start.positions(rng, 1000)
    r = np.sqrt(np.square(p2).sum(axis=0))
    assert np.abs(r - 2.002e5).max() < 0.2 * 5
    center = position(start.second[0], start.second[1])
    squares = np.square(p2[:, 0] - center).sum(axis=0)
    assert 300 < np.sqrt((squares * np.exp(log_w[0])).mean()) < 500


def test_a_weighted_cover_has_the_moments_of_plain_draws(
    start: TwoPoint, rng: np.random.Generator
) -> None:
    """And holds the second scan where the first one's azimuth would not let it be."""
    n = 200_000
    x, log_w = start.cover(rng, n)
    w = np.exp(log_w[0]) / n
    gaussian = start.gaussian("mucm")
    scale = np.sqrt(np.diagonal(gaussian.cov[..., 0]))
    e = (x[:, 0] - gaussian.mean[:, :1]) / scale[:, None]
    assert abs(w.sum() - 1.0) < 1e-3
    assert (np.abs(e @ w) < 4 / np.sqrt(n)).all()
    exact = gaussian.cov[..., 0] / np.outer(scale, scale)
    assert np.abs((e * w) @ e.T - exact).max() < 4 * np.sqrt(2 / n)
    plain = start.sample(rng, n)[:, 0] - gaussian.mean[:, :1]
    assert (np.abs(e) > 4.5).sum(axis=1).max() > 100 * (np.abs(plain / scale[:, None]) > 4.5).sum()
