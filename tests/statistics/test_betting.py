"""The test of a mean by a bet: its level for skewed numbers, and what it decides."""

import numpy as np
import pytest

from trackbench.statistics.rules import BETTING_LEVEL, exceeds_by_betting


@pytest.mark.parametrize("sigma", [0.5, 2.0, 3.0])
def test_a_mean_of_one_is_hardly_ever_exceeded(sigma: float) -> None:
    """Lognormal numbers with the mean 1: the larger sigma, the fewer of them decide the mean."""
    rng = np.random.default_rng(5)
    samples = rng.lognormal(-0.5 * sigma * sigma, sigma, (20_000, 8))
    wrong = sum(exceeds_by_betting(values, 1.0, tests=1) for values in samples)
    assert wrong <= 20_000 * BETTING_LEVEL


def test_many_large_numbers_decide_and_one_does_not() -> None:
    skewed = np.array([40.0, 60.0, 90.0, 150.0, 250.0, 400.0, 600.0, 1400.0])
    assert exceeds_by_betting(skewed, 1.0, tests=20)
    assert exceeds_by_betting(np.r_[skewed, np.inf], 1.0, tests=20)
    assert not exceeds_by_betting(np.r_[np.full(7, 0.5), 3000.0], 1.0, tests=20)
    assert not exceeds_by_betting(np.array([500.0]), 1.0, tests=1)
    # A gate leaves out large numbers: a mean of 0.8 may then be that of a consistent filter.
    assert exceeds_by_betting(np.full(100, 1.5), 0.8, tests=1)
    assert not exceeds_by_betting(np.full(100, 0.85), 0.8, tests=1)


def test_the_capital_is_that_of_the_bet() -> None:
    """Two runs with the mean 30: the average capital over the stakes by hand."""
    values = np.array([20.0, 40.0])
    stakes = [2.0**-k for k in range(1, 11)]
    capital = np.mean([(1.0 + 19.0 * s) * (1.0 + 39.0 * s) for s in stakes])
    assert capital < 1.0 / BETTING_LEVEL
    assert not exceeds_by_betting(values, 1.0, tests=1)
    repeated = np.tile(values, 3)
    capital = np.mean([((1.0 + 19.0 * s) * (1.0 + 39.0 * s)) ** 3 for s in stakes])
    most = int(capital * BETTING_LEVEL)
    assert exceeds_by_betting(repeated, 1.0, tests=most)
    assert not exceeds_by_betting(repeated, 1.0, tests=most + 1)
