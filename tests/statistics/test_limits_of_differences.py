"""A difference of two shares on common runs: how often its intervals miss, by every outcome there is."""

from math import comb, sqrt

import numpy as np
import pytest
from scipy.special import ndtr

from trackbench.statistics.comparison import Sample, compare
from trackbench.statistics.estimate_of_recording import OfSteps
from trackbench.statistics.estimates import RunEstimate
from trackbench.statistics.influential_runs import without_each_batch
from trackbench.statistics.limits_of_differences import (
    Sides,
    correlation,
    interval_of_difference,
    studentized_difference,
)
from trackbench.statistics.ratios import ratio_interval
from trackbench.statistics.share_of_runs import Events
from trackbench.statistics.student_t import deviations, t_of_normal

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


@pytest.mark.parametrize("level", [0.8, 0.95, 0.99])
def test_the_interval_of_a_ratio_is_fiellers(level):
    """Of influences without skewness the ends solve (a - r b)^2 = t^2 var(a - r b)."""
    rng, half = np.random.default_rng(3), 40
    draws = rng.uniform(-1.0, 1.0, (2, half))
    of_a, of_b = np.concatenate([draws, -draws], axis=1)
    runs = 2 * half
    a, b = (RunEstimate(x, 1.0, of, runs) for x, of in ((5.0, 3.0 * of_a), (1.0, 2.0 * of_b)))
    t = t_of_normal(deviations(level), runs - 1)
    scale = t * t / (runs * (runs - 1))
    v_a, v_b = (scale * float((x.influences**2).sum()) for x in (a, b))
    v_ab = scale * float((a.influences * b.influences).sum())
    # (1 - v_b) r^2 - 2 (5 - v_ab) r + 25 - v_a = 0
    ends = np.sort(np.roots([1.0 - v_b, -2.0 * (5.0 - v_ab), 25.0 - v_a]))
    assert ratio_interval(a, b, level) == pytest.approx(tuple(ends), rel=1e-5)


@pytest.mark.parametrize("seed", range(5))
def test_the_interval_of_a_ratio_has_one_unless_the_difference_is_significant(seed):
    rng = np.random.default_rng(seed)
    b = np.exp(rng.standard_normal(30))
    for scale in np.linspace(0.3, 3.0, 15):
        found = compare(
            Sample(scale * np.exp(0.5 * rng.standard_normal(30)), "rms"), Sample(b, "rms")
        )
        low, high = found.ratio_interval
        assert (low < 1.0 < high) == (abs(found.z) < deviations(0.95))


def test_the_interval_of_a_ratio_covers_it_where_the_lower_filter_has_a_heavy_tail():
    """The interval from the ratio's own influences began below zero in half of such samples."""
    rng, trials, runs = np.random.default_rng(5), 300, 50
    covered, positive = 0, 0
    for _ in range(trials):
        b, a = np.exp(rng.standard_normal(runs)), 5.0 + 0.5 * rng.standard_normal(runs)
        low, high = compare(Sample(a), Sample(b)).ratio_interval
        covered += low <= 5.0 / np.exp(0.5) <= high
        positive += low > 0.5
    # 95 % within 3.5 standard errors of 300 samples
    assert 0.905 <= covered / trials <= 0.99
    assert positive >= 0.95 * trials


def test_the_interval_of_a_ratio_without_an_error_or_of_zero():
    alone = compare(Sample(np.array([2.0])), Sample(np.array([1.0])))
    assert np.isnan(alone.ratio_interval).all()
    nothing = compare(Sample(np.ones(9)), Sample(np.zeros(9)))
    assert np.isnan(nothing.ratio_interval).all()
    # A multiple in every run has no spread.
    b = np.random.default_rng(1).random(40) + 1.0
    assert compare(Sample(3.0 * b), Sample(b)).ratio_interval == pytest.approx((3.0, 3.0), rel=1e-4)


def test_a_ratio_of_one_recording_has_the_interval_of_its_logarithm() -> None:
    """Errors are positive, so no interval reaches 0; it covers, and that of b / a is the inverse."""
    rng = np.random.default_rng(31)
    T, trials, covered = 300, 200, 0
    for _ in range(trials):
        # White squares with means of 9 and 1, which share a part.
        shared = rng.standard_normal(T)
        a = 9.0 * np.square(0.6 * shared + 0.8 * rng.standard_normal(T))
        b = np.square(0.6 * shared + 0.8 * rng.standard_normal(T))
        first = OfSteps.from_contributions(float(a.mean()), a)
        second = OfSteps.from_contributions(float(b.mean()), b)
        low, high = ratio_interval(first, second)
        assert 0.0 < low < first.value / second.value < high
        assert ratio_interval(second, first) == pytest.approx((1.0 / high, 1.0 / low), rel=1e-9)
        covered += low <= 9.0 <= high
    # At least the level, since the test of a recording is cautious; 3 standard errors of 200 trials.
    assert covered / trials > 0.95 - 3.0 * sqrt(0.95 * 0.05 / trials)


def test_a_swapped_comparison_of_variances_has_the_opposite_interval() -> None:
    rng = np.random.default_rng(1)
    a = Sample(np.exp(rng.normal(size=60)), "variance")
    b = Sample(np.exp(0.5 * rng.normal(size=60)), "variance")
    swapped = compare(a, b).swapped
    compared = compare(b, a)
    assert swapped.difference.interval() == pytest.approx(compared.difference.interval(), rel=1e-9)
    assert swapped.difference.z() == pytest.approx(compared.z, rel=1e-9)
    for part, expected in zip(
        without_each_batch(swapped.difference, 4),
        without_each_batch(compared.difference, 4),
        strict=True,
    ):
        assert part.z() == pytest.approx(expected.z(), rel=1e-9)
