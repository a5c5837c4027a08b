"""The fading sum's tail against simulated samples and known moments."""

from itertools import pairwise

import numpy as np
import pytest

from trackbench.filters.adaptive_kf.decision_keys_and_thresholds import (
    fading_threshold,
    significance_threshold,
    tail,
)

SAMPLES = 1_000_000


def simulated(gamma: float, rng: np.random.Generator) -> np.ndarray:
    """Independent long-run values of rho = sum gamma^j chi2_2."""
    terms = int(np.ceil(np.log(1e-6) / np.log(gamma)))
    rho = np.zeros(SAMPLES)
    for _ in range(terms):
        rho = gamma * rho + 2.0 * rng.standard_exponential(SAMPLES)
    return rho


def test_tail_and_moments_agree_with_a_million_samples(rng: np.random.Generator) -> None:
    gamma = 0.8
    rho = simulated(gamma, rng)
    mean, variance = 2.0 / (1.0 - gamma), 4.0 / (1.0 - gamma**2)
    assert abs(rho.mean() - mean) < 3.0 * np.sqrt(variance / SAMPLES)
    fourth = ((rho - rho.mean()) ** 4).mean()
    assert abs(rho.var() - variance) < 3.0 * np.sqrt((fourth - variance**2) / SAMPLES)
    for eta in (5.0, 10.0, 15.0, 20.0, 25.0):
        exact = tail(eta, gamma)
        stderr = np.sqrt(exact * (1.0 - exact) / SAMPLES)
        assert abs((rho > eta).mean() - exact) < 3.0 * stderr


def test_tail_is_not_the_chi_square_with_ten_degrees() -> None:
    from scipy.special import chdtrc

    assert tail(35.0, 0.8) < 0.1 * chdtrc(10, 35.0)


def test_a_slow_fade_does_not_cancel_away(rng: np.random.Generator) -> None:
    """At gamma = 0.98 the coefficients exceed 1e35; the probabilities must not feel it."""
    gamma = 0.98
    values = [tail(eta, gamma) for eta in np.linspace(40.0, 250.0, 22)]
    assert values[0] > 0.99
    assert all(0.0 <= b <= a <= 1.0 for a, b in pairwise(values))
    # The mean is the integral of the tail.
    eta = np.linspace(0.0, 240.0, 49)
    p = np.array([tail(e, gamma) for e in eta])
    assert np.trapezoid(p, eta) == pytest.approx(100.0, rel=1e-5)


def test_without_memory_the_tail_is_exponential() -> None:
    for eta in (0.4, 6.0):
        assert tail(eta, 1e-12) == pytest.approx(np.exp(-eta / 2.0), rel=1e-9)
    assert significance_threshold(np.exp(-3.0)) == pytest.approx(6.0)


@pytest.mark.parametrize("alpha", [0.5, 1e-2, 1e-6, 1e-12])
@pytest.mark.parametrize("gamma", [0.5, 0.8, 0.95])
def test_threshold_inverts_the_tail(alpha: float, gamma: float) -> None:
    assert tail(fading_threshold(alpha, gamma), gamma) == pytest.approx(alpha, rel=1e-6)
