"""Bands of means over runs of different numbers of components, against drawn chi-squares."""

import numpy as np
import pytest

from trackbench.statistics.consistency_bands import (
    anees_band,
    anis_band,
    autocorrelation_band,
    components,
)

DRAWN = 4000
TOLERANCE = 3.0 * np.sqrt(0.95 * 0.05 / DRAWN)


@pytest.mark.parametrize("numbers", [[58, 58, 58, 58, 8], [10, 20, 30], [40] * 6])
def test_95_of_100_means_are_in_the_band(numbers: list[int]) -> None:
    n = np.array(numbers, dtype=float)
    means = (np.random.default_rng(5).chisquare(n, (DRAWN, len(n))) / n).mean(axis=1)
    low, high = anis_band(n)
    assert abs(((low <= means) & (means <= high)).mean() - 0.95) < TOLERANCE
    # The autocorrelation of a run of n whitened innovations has the variance 1 / n.
    means = (np.random.default_rng(6).normal(size=(DRAWN, len(n))) / np.sqrt(n)).mean(axis=1)
    assert abs((np.abs(means) <= autocorrelation_band(n)).mean() - 0.95) < TOLERANCE


def test_equal_runs_are_one_sum() -> None:
    for n, runs in ((58, 5), (7, 49), (3, 1000)):
        assert components(np.full(runs, float(n))) == n * runs
        assert anis_band(np.full(runs, float(n))) == anees_band(1, n * runs)


def test_runs_without_a_measurement_do_not_count() -> None:
    assert components(np.array([4.0, 0.0, np.nan, 4.0])) == 8.0
    assert components(np.array([0.0, np.nan])) == 0.0
