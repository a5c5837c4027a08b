"""Constants of the verdicts' rules, each from both of its sides."""

from math import inf, nan, sqrt
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from tests.report.test_verdicts import number
from trackbench.report.verdicts.number_verdicts import _is_near, _verdict
from trackbench.statistics import claim_rules, verdict_rules
from trackbench.statistics import significance_rules as rules
from trackbench.statistics.claim_rules import claim_verdict
from trackbench.statistics.estimates import RunEstimate
from trackbench.statistics.holm_correction import two_sided_p_values
from trackbench.statistics.published_number_rules import combine_batches, number_verdict
from trackbench.statistics.runs_needed import deviations_needed, runs_that_decide
from trackbench.statistics.sample_statistics import Estimate
from trackbench.statistics.skewness_corrected_t_test import interval_of


def word(published, value, stderr, *parts, runs=400):
    terms = (RunEstimate(x, e, None, runs) for x, e in parts)
    return number_verdict(published, RunEstimate(value, stderr, None, runs), list(terms)).word


@pytest.mark.parametrize(("side", "decided"), [(-0.001, False), (0.001, True)])
def test_five_standard_errors_of_all_runs_decide_and_three_without_a_batch(side, decided):
    published, biased = number(1.0, digits=9, runs=0), number("biased", margin=0.5)
    for sign in (1, -1):
        claim = "holds" if sign > 0 else "fails"
        for z, parts in ((5.0 + side, (9.0,) * 4), (9.0, (9.0, 3.0 + side, 9.0, 9.0))):
            found = claim_verdict(sign * z, [sign * part for part in parts])
            assert found.word == (claim if decided else "inconclusive")
            values = [(1.0 + sign * 0.2 * part / 9.0, 0.2 / 9.0) for part in parts]
            measured = word(published, 1.0 + sign * 0.2, 0.2 / z, *values)
            assert measured == ("differs" if decided else "inconclusive")
            values = [(sign * (0.5 + 0.2 * part / 9.0), 0.2 / 9.0) for part in parts]
            measured = word(biased, sign * 0.7, 0.2 / z, *values)
            assert measured == ("agrees" if decided else "inconclusive")


@pytest.mark.parametrize(("side", "shown"), [(-0.001, False), (0.001, True)])
def test_three_standard_errors_show_what_is_equal_or_exact(side, shown):
    z = 3.0 + side
    for exact in (False, True):
        assert (claim_verdict(z, equal=True, exact=exact).word == "holds") == shown
    assert (claim_verdict(-z, exact=True).word == "fails") == shown
    assert claim_verdict(-z, equal=True).word == "inconclusive"  # that it is not equal takes five
    assert (claim_verdict(-z - 2.0, equal=True).word == "fails") == shown
    unbiased = number("unbiased", margin=0.5)
    assert (word(unbiased, 0.2, 0.3 / z) == "agrees") == shown
    # Parts contradict what is equal from three on.
    assert (claim_verdict(9.0, [9.0, -z], equal=True).word == "inconclusive") == shown
    assert (claim_verdict(9.0, [9.0, -z], exact=True).word == "inconclusive") == shown
    assert (word(number(1.0, runs=0), 1.0, 0.01, (1.0 + 0.2, 0.2 / z)) == "inconclusive") == shown


@pytest.mark.parametrize(("side", "off"), [(-0.001, False), (0.001, True)])
def test_a_number_is_compatible_up_to_three_standard_errors(side, off):
    z = 3.0 + side
    published = number(1.0, digits=9, runs=0)
    assert word(published, 1.3, 0.3 / z) == ("inconclusive" if off else "compatible")
    # Its interval reaches 5 % off, half the room, by where it lies and by its error.
    assert word(published, 1.03, 0.03 / z) == ("inconclusive" if off else "agrees")


@pytest.mark.parametrize("sign", [1, -1])
def test_a_tenth_of_the_published_number_is_near(sign):
    published = number(-2.0, runs=0)
    for share, near in ((0.0999, True), (0.1001, False)):
        measured = RunEstimate(-2.0 * (1.0 + sign * share), 1e-3, None, 400)
        verdict = number_verdict(published, measured, [])
        assert verdict.word == "differs"
        assert _is_near(published, measured, verdict) == near
    for reach, expected in ((0.1999, "agrees"), (0.2001, "compatible")):
        stderr = 0.1 / 1.9599639845400543  # the interval reaches 0.1 from the number
        assert word(published, -2.0 + sign * (reach - 0.1), stderr) == expected


def test_a_number_agrees_whose_interval_rounds_to_the_printed_digits():
    published = number(1.0, digits=2, runs=0)
    for reach, expected in ((0.0049, "agrees"), (0.0051, "differs")):
        assert word(published, 1.0 + reach - 1e-6, 1e-6 / 1.9599639845400543) == expected


@pytest.mark.parametrize(("value", "z"), [
    (0.12, 0.0), (0.1151, 0.0), (0.1249, 0.0), (0.126, 1.0), (0.113, -2.0), (0.129, 4.0), (0.131, 6.0),
])  # fmt: skip
def test_a_difference_is_that_to_the_nearest_number_that_rounds_to_the_printed_one(value, z):
    for sign in (1, -1):
        published = number(sign * 0.12, digits=2, runs=0)
        found = number_verdict(published, RunEstimate(sign * value, 1e-3, None, 400), [])
        assert found.z == pytest.approx(sign * z, abs=1e-9)
        decided = "differs" if z == 6.0 else "inconclusive" if z == 4.0 else "agrees"
        assert found.word == decided


def test_a_value_that_rounds_to_the_printed_number_needs_an_error_and_may_be_wide():
    published = number(0.2, digits=1, runs=0)
    for stderr, expected in ((0.005, "agrees"), (0.02, "compatible"), (nan, "inconclusive")):
        assert word(published, 0.24, stderr) == expected
    assert word(published, 0.24, 0.0) == "agrees"
    found = number_verdict(published, RunEstimate(0.24, 0.0, None, 400), [])
    assert found.z == 0.0
    # Ten percent of the printed number are less than half a unit of its last digit.
    assert word(published, 0.16, 0.005) == word(published, 0.2, 0.025) == "agrees"


def test_the_rounding_of_the_printed_number_turns_no_verdict():
    """2.5 printed for 2.5425, as for the climatology of `lorenz96-spantini`: 2.8 errors from 2.5."""
    measured = RunEstimate(2.5425, 0.0101, None, 16)
    coarse, fine = (number(2.5, digits=n, runs=13) for n in (1, 4))
    assert number_verdict(coarse, measured, []) == verdict_rules.Verdict("agrees", 0.0)
    found = number_verdict(fine, measured, [])
    assert (found.word, found.fragile) == ("agrees", True)
    assert found.z == pytest.approx(2.8, abs=0.05)


@pytest.mark.parametrize(("value", "expected"), [
    (0.125, "equal"), (0.12500001, "equal"), (0.1251, "differs"), (0.1149, "differs"),
])  # fmt: skip
def test_a_deterministic_number_is_equal_if_it_rounds_to_the_printed_one(value, expected):
    """0.12500001: per_run.csv has seven digits."""
    measured = RunEstimate(value, nan, None, 1)
    results = SimpleNamespace(deterministic=["KF"], digits_of=lambda label: 7, experiment_runs=None)
    found = _verdict(number(0.12, digits=2), measured, "KF", results)
    assert found.word == expected


@pytest.mark.parametrize(("value", "stored", "expected"), [
    (0.42538246605265, 15, "equal"), (0.42538246615265, 15, "differs"),
    (0.4253825, 7, "agrees"), (0.4253826, 7, "differs"),
])  # fmt: skip
def test_equal_are_all_printed_digits(value, stored, expected):
    """A folder of seven digits cannot show ten."""
    measured = RunEstimate(value, nan, None, 1)
    results = SimpleNamespace(
        deterministic=["KF"], digits_of=lambda label: stored, experiment_runs=None
    )
    found = _verdict(number(0.4253824661, digits=10), measured, "KF", results)
    assert found.word == expected


@pytest.mark.parametrize(("value", "digits", "expected"), [
    (0.4253824661, 10, 10), (-632.537695048, 9, 12), (0.0952439213, 10, 9), (0.12, 2, 2), (0.0, 2, 2),
    (1000.0, 0, 4), (999.9, 1, 4), (0.0, 0, 0), ("biased", 0, 0),
])  # fmt: skip
def test_significant_digits_of_a_printed_number(value, digits, expected):
    assert number(value, digits=digits).significant_digits == expected


@pytest.mark.parametrize(("kept", "gone", "expected"), [
    (50, 50, "agrees"), (49, 50, "differs"), (34, 66, "differs"), (1, 2, "differs"), (0, 3, "differs"),
])  # fmt: skip
def test_more_lost_runs_than_others_differ(kept, gone, expected):
    measured = RunEstimate(1.0 if kept else nan, 0.01, None, kept, lost=gone)
    assert number_verdict(number(1.0, runs=0), measured, []).word == expected


def test_a_few_lost_runs_of_which_none_has_a_number_differ():
    assert (
        number_verdict(number(1.0), RunEstimate(inf, nan, None, 90, lost=10), []).word == "differs"
    )
    assert number_verdict(number(1.0), RunEstimate(inf, nan, None, 90), []).word == "inconclusive"


def test_another_seed_lies_within_164_errors_of_a_difference_of_two():
    """nine in ten: 1.6449 sqrt(2)."""
    another = 1.6448536269514722 * sqrt(2.0)
    for z, side in ((5.0, 1), (5.0, -1)):
        for off, fragile in ((-1e-3, True), (1e-3, False)):
            assert claim_verdict(side * (z + another + off)).fragile == fragile
    published = number(1.0, digits=9, runs=0)
    for off, fragile in ((-1e-3, True), (1e-3, False)):
        measured = RunEstimate(1.0 + 1e-3 * (5.0 + another + off), 1e-3, None, 100)
        assert number_verdict(published, measured, []).fragile == fragile


def test_a_chosen_number_is_never_fragile_and_an_undecided_one_neither():
    measured = RunEstimate(1.007, 0.001, None, 100)
    assert number_verdict(number(1.0, digits=9, runs=0), measured, []).fragile
    assert not number_verdict(number(1.0, digits=9, runs=0, chosen="R"), measured, []).fragile
    assert not number_verdict(number(1.0, runs=0), RunEstimate(1.35, 0.1, None, 100), []).fragile


def test_words_are_contradicted_by_their_opposites_only():
    for parts, expected in (
        (["agrees", "compatible"], "agrees"),
        (["agrees", "differs"], "inconclusive"),
    ):
        assert combine_batches("agrees", parts) == expected
        assert combine_batches("compatible", parts) == expected.replace("agrees", "compatible")
    assert combine_batches("differs", ["differs", "differs"]) == "differs"
    assert combine_batches("differs", ["differs", "compatible"]) == "inconclusive"


def test_the_interval_of_the_rules_is_of_95_percent():
    rng = np.random.default_rng(1)
    x = rng.standard_normal(100)
    term = RunEstimate(1.0, 0.1, x - x.mean(), 100)
    assert term.interval() == interval_of(1.0, x - x.mean(), 0.95)


def test_the_weakest_of_comparisons_that_must_all_hold_needs_no_correction():
    assert claim_rules.weakest([4.0, 2.5, 3.0]) == 2.5
    assert claim_rules.weakest([-2.5]) == -2.5
    # One that is unknown decides.
    assert np.isnan(claim_rules.weakest([4.0, nan, -3.0]))


@pytest.mark.parametrize("zs", [[-3.0, 1.0], [2.0, -4.0, 0.5, 7.0], [-6.0] * 50], ids=len)
def test_the_weakest_of_many_comparisons_that_fails_is_corrected_by_bonferroni(zs):
    """n times the tail probability of the least z, also of several filters at one step."""
    expected = stats.norm.ppf(len(zs) * stats.norm.cdf(min(zs)))
    assert claim_rules.weakest(zs) == pytest.approx(expected, rel=1e-9)
    assert min(zs) < claim_rules.weakest(zs) < 0.0


def test_a_corrected_probability_is_a_half_at_most():
    """Of fifty steps the least is below -1 by chance alone: that shows nothing."""
    assert claim_rules.weakest([-1.0, *np.linspace(0.0, 3.0, 49)]) == pytest.approx(0.0)


def test_runs_that_decide_grow_with_the_square_of_what_is_missing():
    assert runs_that_decide(100, 2.5, 5.0) == pytest.approx(400.0)
    assert runs_that_decide(100, -2.5, 5.0) == pytest.approx(400.0)
    # More than there are, unless there is one recording, of which a longer one is wanted.
    assert runs_that_decide(100, 7.0, 5.0) == 101.0
    assert runs_that_decide(1, 10.0, 5.0) == pytest.approx(0.25)


@pytest.mark.parametrize("tests", [1, 3, 45])
def test_deviations_needed_are_those_of_holms_first_step(tests):
    z = deviations_needed(tests)
    for side, significant in ((-1e-6, False), (1e-6, True)):
        p = two_sided_p_values([z + side] + [0.0] * (tests - 1))[0]
        assert (p < rules.LEVEL) == significant
    assert z == pytest.approx(stats.norm.isf(0.5 * rules.LEVEL / tests))


@pytest.mark.parametrize("runs", [5, 9, 40, 1000])
def test_no_chance_is_judged_by_students_t(runs):
    """Four standard errors of the normal: with few runs their own error counts."""
    limit = stats.t.isf(stats.norm.sf(4.0), runs - 1)
    for sign in (1.0, -1.0):
        assert not rules.is_no_chance(Estimate(sign * 0.9 * limit, 1.0), runs)
        assert rules.is_no_chance(Estimate(sign * 1.1 * limit, 1.0), runs)
