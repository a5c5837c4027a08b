"""A difference of two shares on common runs: how often its intervals miss, by every outcome there is."""

from math import comb, sqrt

import numpy as np
import pytest
from scipy.special import ndtr

from trackbench.statistics.intervals import (
    Events,
    Sides,
    correlation,
    interval_of_difference,
    studentized_difference,
)

CASES = [
    (0.0, 0.0, 0.001),
    (0.0, 0.05, 0.05),
    (0.0, 0.3, 0.3),
    (0.0, 0.5, 0.5),
    (0.0, 0.02, 0.3),
    (0.4, 0.1, 0.1),
    (0.8, 0.1, 0.02),
    (0.25, 0.25, 0.25),
]
"""Probabilities that both, only the first, only the second filter has the event."""


def sides(both: int, first: int, second: int, runs: int) -> Sides:
    a, b = (np.zeros(runs), np.zeros(runs))
    a[: both + first] = 1.0
    b[:both] = b[both + first : both + first + second] = 1.0
    r = correlation(a - a.mean(), b - b.mean())
    return Sides(Events(both + first, runs), Events(both + second, runs), r)


def probability(counts: tuple[int, int, int], runs: int, p: tuple[float, float, float]) -> float:
    """Of an outcome, by the multinomial distribution."""
    ways, left = 1, runs
    for count in counts:
        ways, left = ways * comb(left, count), left - count
    return float(ways * np.prod(np.power([*p, 1.0 - sum(p)], [*counts, left])))


@pytest.mark.parametrize("p", CASES, ids=str)
@pytest.mark.parametrize("runs", [5, 20])
def test_intervals_miss_as_rarely_as_they_say(runs: int, p: tuple[float, float, float]) -> None:
    truth, every, missed = p[1] - p[2], 0.0, np.zeros(2)
    for both in range(runs + 1):
        for first in range(runs + 1 - both):
            for second in range(runs + 1 - both - first):
                chance = probability((both, first, second), runs, p)
                every += chance
                if chance < 1e-7:
                    continue
                found = sides(both, first, second, runs)
                low, high = interval_of_difference((first - second) / runs, found)
                missed += [chance * (truth < low - 1e-12), chance * (truth > high + 1e-12)]
    assert every == pytest.approx(1.0)
    assert missed.max() <= 0.032  # of 0.025; without the correlation up to 0.058


@pytest.mark.parametrize("runs", [3, 6, 20, 3000])
def test_none_against_all_is_as_sure_as_there_are_runs(runs: int) -> None:
    """Both shares have to move by sqrt(1/2) for the limits of their difference to reach zero."""
    z = studentized_difference(-1.0, sides(0, 0, runs, runs))
    if runs <= 20:  # none of n has the probability p with (1 - p)^n
        assert ndtr(z) == pytest.approx((1.0 - sqrt(0.5)) ** runs, rel=1e-6)
    assert np.isfinite(z)


def test_what_is_not_excluded_is_the_interval() -> None:
    found = sides(4, 5, 1, 20)
    low, high = interval_of_difference(0.2, found)
    assert studentized_difference(0.2 - low, found) == pytest.approx(1.95996, abs=1e-4)
    assert studentized_difference(0.2 - high, found) == pytest.approx(-1.95996, abs=1e-4)
    assert studentized_difference(0.0, found) == 0.0


def test_a_factor_stretches_the_second() -> None:
    plain, twice = Sides(Events(0, 9), Events(4, 9)), Sides(Events(0, 9), Events(4, 9, 2.0))
    assert twice.second.below(1.0) == 2.0 * plain.second.below(1.0)
    assert twice.above(1.0) > plain.above(1.0)


def test_a_difference_has_the_variance_of_correlated_numbers() -> None:
    first, second = Events(4, 10), Events(7, 10)
    a, b = first.below(1.0), second.above(1.0)
    expected = sqrt(a * a + b * b - 2 * 0.6 * a * b + 0.3**2)
    assert Sides(first, second, 0.6).below(1.0, other=0.3) == pytest.approx(expected)


def test_a_correlation_has_no_unit(rng):
    a = rng.standard_normal(50)
    b = a + rng.standard_normal(50)
    a, b = a - a.mean(), b - b.mean()
    for unit in (1e-4, 1.0, 1e4):
        found = correlation(unit * a, unit * b)
        assert found == pytest.approx(np.corrcoef(a, b)[0, 1])
    assert correlation(a, 0.0 * b) == 0.0
