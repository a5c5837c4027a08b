"""Standard errors against brute force, tails and limits against scipy."""

import numpy as np
import pytest
from scipy import stats

from trackbench.statistics import sample_statistics as st
from trackbench.statistics.collapsed_runs import collapsed_in_words
from trackbench.statistics.comparison import Comparison, paired_difference
from trackbench.statistics.consistency_bands import anees_band
from trackbench.statistics.estimates import RunEstimate, Share, linear_combination
from trackbench.statistics.holm_correction import as_family, holm
from trackbench.statistics.indefinite_covariances import indefinite_runs
from trackbench.statistics.share_of_runs import Events, share_interval, share_z
from trackbench.statistics.significance_rules import loses_more
from trackbench.statistics.skewness_corrected_t_test import interval_of, spread, studentized
from trackbench.statistics.student_t import deviations, stderr_of, two_sided


@pytest.fixture(scope="module")
def sample():
    """A skewed sample like per-run RMSEs: (4000, 80)."""
    return np.random.default_rng(1).gamma(3.0, 0.1, (4000, 80))


@pytest.mark.parametrize("name", ["mean", "rms", "variance", "median"])
def test_standard_error_is_the_spread_over_repetitions(sample, name):
    found = np.array([st.STATISTICS[name](x) for x in sample])
    spread = found[:, 0].std(ddof=1)
    # The spread of 4000 repetitions is itself known to 1/sqrt(8000) = 1.1 % (more for a skewed one).
    assert np.sqrt(np.mean(found[:, 1] ** 2)) == pytest.approx(spread, rel=0.06)


@pytest.mark.parametrize("name", ["mean", "rms", "variance"])
def test_standard_error_is_the_jackknife(sample, name):
    x = sample[0]
    left_out = np.array([st.STATISTICS[name](np.delete(x, i)).value for i in range(len(x))])
    M = len(x)
    jackknife = np.sqrt((M - 1) / M * ((left_out - left_out.mean()) ** 2).sum())
    close = 1e-9 if name == "variance" else 3.0 / M
    assert st.STATISTICS[name](x).stderr == pytest.approx(jackknife, rel=close)


@pytest.mark.parametrize("name", ["mean", "rms", "variance"])
def test_the_influence_is_what_leaving_a_run_out_changes(sample, name):
    x = sample[1]
    left_out = np.array([st.STATISTICS[name](np.delete(x, i)).value for i in range(len(x))])
    changes = (len(x) - 1) * (left_out.mean() - left_out)
    assert st.influence(name, x) == pytest.approx(changes, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("name", ["mean", "rms", "variance", "median"])
def test_the_influence_has_the_standard_error_of_its_statistic(sample, name):
    x = sample[1]
    from_influence = st.influence(name, x).std(ddof=1) / np.sqrt(len(x))
    # The root mean square's leaves each run out, its standard error is that of the delta method.
    room = 0.05 if name == "rms" else 0.02
    assert from_influence == pytest.approx(st.STATISTICS[name](x).stderr, rel=room)


def contrast(name, a, b, factor):
    """``statistic(a) - factor * statistic(b)`` on common runs, as a claim is judged."""
    value = st.STATISTICS[name](a).value - factor * st.STATISTICS[name](b).value
    return value, st.mean(st.influence(name, a) - factor * st.influence(name, b)).stderr


@pytest.mark.parametrize("name", ["mean", "rms", "variance", "median"])
def test_contrast_of_common_runs_against_brute_force(name):
    rng = np.random.default_rng(2)
    a = rng.gamma(3.0, 0.1, (2000, 400))  # many runs: the median needs a density from them, twice
    b = a + rng.gamma(2.0, 0.05, a.shape)
    found = np.array([contrast(name, x, y, 0.7) for x, y in zip(a, b, strict=True)])
    spread = found[:, 0].std(ddof=1)
    assert np.sqrt(np.mean(found[:, 1] ** 2)) == pytest.approx(spread, rel=0.06)


def test_a_contrast_with_itself_is_nothing():
    x = np.array([1.0, 2.0, 5.0])
    assert contrast("rms", x, x, 1.0) == (0.0, 0.0)
    assert np.isnan(st.z_score(st.Estimate(0.0, 0.0)))


def test_an_unknown_statistic_has_no_influence():
    with pytest.raises(ValueError, match="no influence"):
        st.influence("mode", np.ones(3))


def test_a_paired_difference_is_the_mean_of_the_differences(sample):
    a, b = sample[0], sample[0] + 0.01 * sample[1]
    assert paired_difference(a, b) == pytest.approx(st.mean(a - b), rel=1e-9)


def test_holm_is_the_stepwise_rule():
    adjusted = holm(np.array([0.01, 0.04, 0.03, np.nan, 0.005]))
    # by hand: 0.005 * 4, 0.01 * 3, 0.03 * 2, then 0.04 * 1 may not fall below 0.06
    np.testing.assert_allclose(adjusted, [0.03, 0.06, 0.06, np.nan, 0.02])
    assert holm(np.array([0.9, 0.8]))[0] == 1.0


def test_too_few_runs_have_no_interval():
    assert np.isnan(st.interval("mean", np.ones(1))).all()


def test_an_error_beside_which_ones_own_is_nothing_is_normal():
    influences = np.random.default_rng(3).standard_exponential(50) - 1.0
    assert studentized(1.0, influences, 1e100) == pytest.approx(1e-100)
    assert interval_of(0.0, influences, other=1e100)[1] == pytest.approx(1.959964e100)


def test_an_error_that_is_none_of_the_runs_is_normal():
    """Of equal runs the other's is all there is: no skewness, and no degrees of freedom to lose."""
    assert spread(np.zeros(9), other=0.1) == (0.1, 0.0, np.inf)
    assert spread(np.zeros(9)) == (0.0, 0.0, 8.0)
    assert np.isnan(spread(np.ones(1), other=0.1)).all()
    assert interval_of(1.0, np.zeros(9), other=0.1) == pytest.approx(
        (1 - 0.195996, 1 + 0.195996), abs=1e-6
    )


@pytest.mark.parametrize("level", [0.8, 0.95])
def test_quantiles_and_tails_are_scipys(level):
    normal = stats.norm.ppf(0.5 + level / 2)
    assert deviations(level) == pytest.approx(normal)
    assert two_sided(-normal) == pytest.approx(1 - level)
    assert stderr_of(1.0, 1.0 + 2 * stats.norm.ppf(0.975)) == pytest.approx(1.0)
    band = stats.chi2.ppf([0.5 - level / 2, 0.5 + level / 2], 21) / 21
    assert anees_band(3, 7, level) == pytest.approx(tuple(band))
    for events in (0, 3, 20):
        exact = stats.binomtest(events, 20).proportion_ci(level)
        limits = Events(events, 20, factor=2.0)
        assert limits.below(normal) == pytest.approx(2 * (events / 20 - exact.low))
        assert limits.above(normal) == pytest.approx(2 * (exact.high - events / 20))


def test_moments_of_influences_are_scipys():
    x = np.array([-3.0, -1.0, 0.0, 0.5, 3.5])
    skewness = stats.skew(x) / np.sqrt(5)
    kurtosis = stats.kurtosis(x, fisher=False)
    expected = x.std(ddof=1) / np.sqrt(5), skewness, min(4.0, 2 * 5 / (kurtosis - 1))
    assert spread(x) == pytest.approx(expected)
    # Half of the variance is the hypothesis' own, which is normal: cumulants add up.
    expected = expected[0] * np.sqrt(2), skewness / 2**1.5, expected[2] * 4
    assert spread(x, other=x.std(ddof=1) / np.sqrt(5)) == pytest.approx(expected)


@pytest.mark.parametrize("filters", [2, 3, 10])
def test_losses_are_compared_by_a_sign_test_of_all_pairs(filters):
    """By scipy's binomial test: either of two filters in each of the pairs may lose more by chance."""
    pairs = filters * (filters - 1)
    for alone in range(16):
        for other in range(4):
            a, b = np.ones(40), np.ones(40)  # most runs are lost by both
            b[:alone], a[alone : alone + other] = 0.0, 0.0
            p = stats.binomtest(alone, alone + other, alternative="greater").pvalue if alone else 1
            assert loses_more(a, b, filters) == (p * pairs < 0.05)


@pytest.mark.parametrize(("events", "runs"), [(0, 20), (3, 20), (795, 800), (800, 800)])
@pytest.mark.parametrize("p", [0.001, 0.2, 0.97, 0.999])
def test_z_of_a_share_is_the_exact_tail(events, runs, p):
    side = "greater" if events > runs * p else "less"
    tail = stats.binomtest(events, runs, p, alternative=side).pvalue
    expected = (
        max(stats.norm.isf(tail), 0.0) if side == "greater" else min(stats.norm.ppf(tail), 0.0)
    )
    assert share_z(events, runs, p) == pytest.approx(expected, rel=1e-6, abs=1e-9)
    low, high = share_interval(events, runs)
    exact = stats.binomtest(events, runs).proportion_ci(0.95, method="exact")
    assert (low, high) == pytest.approx((exact.low, exact.high))


def test_every_run_is_refuted_by_one_and_shown_by_none():
    assert share_z(799, 800, 1.0) == -np.inf
    assert share_z(800, 800, 1.0) == 0.0
    assert share_z(0, 800, 0.0) == 0.0
    assert share_z(1, 800, 0.0) == np.inf


def test_a_family_counts_the_differences_that_are_tested():
    """One of four has too few runs: three are tested, and Holm's first step takes three."""
    few, many = (RunEstimate(1.0, 0.1, None, runs) for runs in (4, 40))
    zs = {"a": 3.0, "b": 2.0, "c": 9.0, "d": -4.0}
    terms = {"a": many, "b": many, "c": few, "d": many}
    family = as_family({k: Comparison(many, many, terms[k], z) for k, z in zs.items()})
    assert {comparison.tests for comparison in family.values()} == {3}
    p = {k: 2.0 * stats.norm.sf(abs(z)) for k, z in zs.items()}
    expected = {"d": 3.0 * p["d"], "a": 2.0 * p["a"], "b": p["b"]}
    for key, value in expected.items():
        assert family[key].p == pytest.approx(value)
    assert np.isnan(family["c"].p)
    of_more = as_family({"d": Comparison(many, many, many, -4.0)}, tests=10)["d"]
    assert (of_more.p, of_more.tests) == (pytest.approx(10.0 * p["d"]), 10)


@pytest.mark.parametrize("runs", [7, 100, 1000])
def test_events_of_a_share_are_whole_numbers(runs):
    """29 / 100 times 100 is 28.999999999999996."""
    for events in range(runs + 1):
        assert Share(events / runs, 0.1, None, runs).events == events


def test_a_combination_of_other_runs_has_the_losses_of_the_first():
    a, b = RunEstimate(3.0, 0.3, None, 40, lost=2), RunEstimate(1.0, 0.4, None, 30, lost=5)
    found = linear_combination(1.0, a, b, 1.0, -2.0)
    assert (found.runs, found.lost) == (30, 2)
    assert found.stderr == pytest.approx(np.hypot(0.3, 0.8))


def test_a_collapse_is_counted_among_several_runs():
    assert collapsed_in_words(np.array([1e5, 1.0, np.nan, 9e3])) == "collapsed in 1 of 3 runs"
    assert collapsed_in_words(np.array([1e5, np.nan])) == ""
    assert collapsed_in_words(np.array([1.0, 2.0])) == ""


def test_a_covariance_that_is_not_positive_definite_is_no_collapse():
    anees = np.array([np.inf, 1.0, np.nan, np.inf])
    first = np.array([7.0, np.nan, np.nan, np.nan])  # the last run has a singular covariance
    assert indefinite_runs(anees, first).tolist() == [True, False, False, False]
    assert collapsed_in_words(anees, first) == "not positive definite in 1 of 3 runs"
    assert collapsed_in_words(anees) == "collapsed in 2 of 3 runs"
