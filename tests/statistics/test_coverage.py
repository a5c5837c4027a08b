"""How often 95 % intervals hold the truth: of every statistic, on light and on heavy tails."""

import numpy as np
import pytest

from trackbench.evaluation.run_contributions import time_mean_shares
from trackbench.statistics import sample_statistics as st
from trackbench.statistics.heavy_tails import has_heavy_tail, tail_index
from trackbench.statistics.jackknife import influence_of_ratio
from trackbench.statistics.limits_of_differences import (
    Sides,
    interval_of_difference,
    of_variances,
    studentized_difference,
)
from trackbench.statistics.skewness_corrected_t_test import interval_of, studentized
from trackbench.statistics.student_t import normal_of_t, t_of_normal

RUNS, REPETITIONS, STEPS = 200, 800, 20
LEAST, MOST = 0.93, 0.97
Z = 1.959963984540054


def light(rng, shape):
    """Two filters' root mean squares of a few normal errors, correlated as on common runs."""
    common = rng.chisquare(6, shape)
    return np.sqrt(common + rng.chisquare(3, shape)), np.sqrt(common + rng.chisquare(4, shape))


def heavy(rng, shape, sigma=1.0):
    """Two lognormal values per run, of correlation 0.7 in the logarithm; a skewness of 6."""
    common = np.sqrt(0.7) * rng.standard_normal(shape)
    a, b = (common + np.sqrt(0.3) * rng.standard_normal(shape) for _ in range(2))
    return np.exp(sigma * a), 1.3 * np.exp(sigma * b)


def less_heavy(rng, shape):
    """The same with sigma 0.5, whose squares are as heavy as the others themselves."""
    return heavy(rng, shape, 0.5)


def single(name):
    return lambda a, b: (st.OVER_RUNS[name](a).value, st.influence(name, a))


def difference(name):
    def of(a, b):
        value = st.STATISTICS[name](a).value - st.STATISTICS[name](b).value
        return value, st.influence(name, a) - st.influence(name, b)

    return of


def ratio(name):
    def of(a, b):
        below = st.STATISTICS[name](b).value
        value = st.STATISTICS[name](a).value
        of_both = st.influence(name, a), st.influence(name, b)
        return value / below, influence_of_ratio(value, below, *of_both)

    return of


SINGLE = [single(name) for name in ("mean", "variance", "rms", "median")]
OF_VALUES = [difference("mean"), difference("median"), ratio("mean")]
OF_SQUARES = [single("std"), difference("rms"), ratio("rms")]


def held(found, truth):
    """Whether the hypothesis of the truth is not excluded, which is whether the interval holds it."""
    value, influences = found
    return abs(studentized(value - truth, influences)) <= Z


def check(shares, least=LEAST):
    """Coverage within its bounds, as far as so many repetitions can tell (three standard errors)."""
    room = 3.0 * np.sqrt(0.05 * 0.95 / REPETITIONS)
    assert all(least - room <= share <= MOST + room for share in shares), shares


@pytest.mark.parametrize(
    ("draw", "numbers"),
    [
        (light, SINGLE + OF_VALUES + OF_SQUARES),
        (heavy, SINGLE + OF_VALUES),
        (less_heavy, OF_SQUARES),
    ],
)
def test_intervals_hold_the_truth(draw, numbers):
    rng = np.random.default_rng(2026)
    many = draw(rng, 1_000_000)
    truths = [number(*many)[0] for number in numbers]
    hits = np.zeros(len(numbers))
    for a, b in zip(*draw(rng, (REPETITIONS, RUNS)), strict=True):
        hits += [held(number(a, b), truth) for number, truth in zip(numbers, truths, strict=True)]
    check(hits / REPETITIONS)


@pytest.mark.parametrize("draw", [light, less_heavy, heavy])
def test_differences_of_variances_hold_the_truth(draw):
    """Whose two tails are not seen, each: by the influences of the difference 88 % on the heavy one."""
    rng, repetitions = np.random.default_rng(2031), REPETITIONS // 2
    truth = np.subtract(*(np.var(x) for x in draw(rng, 1_000_000)))
    hits = 0
    for a, b in zip(*draw(rng, (repetitions, RUNS)), strict=True):
        sides = of_variances(st.influence("variance", a), st.influence("variance", b))
        value = st.variance(a).value - st.variance(b).value
        low, high = interval_of_difference(value, sides)
        hits += low <= truth <= high
    room = 3.0 * np.sqrt(0.05 * 0.95 / repetitions)
    assert LEAST - room <= hits / repetitions <= MOST + room


def test_a_difference_is_excluded_where_its_interval_ends():
    a, b = heavy(np.random.default_rng(2032), 60)
    sides = of_variances(st.influence("variance", a), st.influence("variance", b))
    value = st.variance(a).value - st.variance(b).value
    swapped = Sides(sides.second, sides.first, sides.correlation)
    for other in (0.0, 2.0):
        low, high = interval_of_difference(value, sides, other=other)
        assert low < value < high
        assert studentized_difference(value - low, sides, other) == pytest.approx(Z, rel=1e-6)
        assert studentized_difference(value - high, sides, other) == pytest.approx(-Z, rel=1e-6)
        assert interval_of_difference(-value, swapped, other=other) == (-high, -low)


def test_a_number_beside_one_without_error_has_no_other_limits_than_its_own():
    x = st.influence("variance", heavy(np.random.default_rng(2033), 60)[0])
    assert of_variances(x, np.zeros(60)) is None
    assert of_variances(x, x) is None


@pytest.mark.parametrize("sigma", [0.0, 0.5])
def test_averages_over_correlated_steps_hold_the_truth(sigma):
    """Squared errors of two filters whose runs are wild by a lognormal factor, or are not."""
    rng = np.random.default_rng(2027)
    scale = np.linspace(1.0, 3.0, STEPS)[:, None]
    # The mean square at a step is the scale's, times that of the factor: exp(2 sigma^2).
    truth = scale.mean() * np.exp(sigma**2) * np.array([1.0, 1.0 - np.sqrt(1.25)])
    hits, everyone = np.zeros(2), np.ones(RUNS, dtype=bool)
    for _ in range(REPETITIONS):
        wild = np.exp(sigma * rng.standard_normal(RUNS))
        e = rng.standard_normal((STEPS, RUNS))
        for k in range(1, STEPS):
            e[k] = 0.95 * e[k - 1] + np.sqrt(1 - 0.95**2) * e[k]
        other = e + 0.5 * rng.standard_normal(e.shape)
        a, b = (time_mean_shares(np.square(x * wild * scale), everyone) for x in (e, other))
        for i, shares in enumerate((a, a - b)):
            hits[i] += held((shares.mean(), shares - shares.mean()), truth[i])
    check(hits / REPETITIONS)


def test_the_usual_t_fails_on_heavy_tails():
    """What the correction is for: the variance's plain interval holds the truth in three of four."""
    rng = np.random.default_rng(2028)
    truth = (np.e - 1.0) * np.e
    found = [st.variance(x) for x in heavy(rng, (REPETITIONS, RUNS))[0]]
    assert np.mean([abs(v - truth) <= Z * error for v, error in found]) < 0.8


def test_an_interval_is_what_is_not_excluded():
    x = heavy(np.random.default_rng(2029), 60)[0]
    for name in ("mean", "variance", "rms"):
        value, influences = st.STATISTICS[name](x).value, st.influence(name, x)
        low, high = interval_of(value, influences)
        assert low < value < high
        assert high - value > value - low  # the tail that was not seen
        assert studentized(value - low, influences) == pytest.approx(Z, rel=1e-9)
        assert studentized(value - high, influences) == pytest.approx(-Z, rel=1e-9)
        assert st.interval(name, x) == (low, high)


def test_students_t_of_normal_influences():
    from scipy.stats import norm, t

    for freedom in (4, 19, 199):
        for value in (0.5, 2.0, 3.5):
            exact = norm.isf(t.sf(value, freedom))
            assert normal_of_t(value, freedom) == pytest.approx(exact, rel=0.01)
            assert t_of_normal(normal_of_t(-value, freedom), freedom) == pytest.approx(-value)
    assert 3.0 < normal_of_t(156774.0, 1) < 6.0  # two blocks are not sure of anything


def test_an_error_of_the_hypothesis_adds_up():
    x = np.random.default_rng(2030).standard_normal(400)
    stderr = st.mean(x).stderr
    z = studentized(0.3, x - x.mean(), other=3.0 * stderr)
    assert z == pytest.approx(0.3 / (stderr * np.sqrt(10.0)), rel=1e-3)
    low, high = interval_of(0.3, x - x.mean(), other=3.0 * stderr)
    assert high - low == pytest.approx(2.0 * Z * stderr * np.sqrt(10.0), rel=1e-3)


def test_what_has_no_error():
    nothing, one = np.zeros(5), np.array([np.nan, 1.0])
    assert np.isnan(studentized(0.0, nothing))
    assert studentized(1.0, nothing) == np.inf
    assert np.isnan(studentized(1.0, one))
    assert np.isnan(interval_of(1.0, one)).all()


@pytest.mark.parametrize("index", [1.5, 3.0])
def test_a_tail_has_paretos_index(index):
    """Hill's 1 / index is, of Pareto's law, a mean of k exponentials: variance 1 / (k index^2)."""
    rng = np.random.default_rng(7)
    found = np.array([tail_index(rng.pareto(index, 1600) + 1.0)[0] for _ in range(200)])  # k = 20
    assert np.mean(1.0 / found) == pytest.approx(1.0 / index, abs=4.0 / index / np.sqrt(200 * 20))
    assert np.std(1.0 / found) == pytest.approx(
        1.0 / index / np.sqrt(20), rel=4.0 / np.sqrt(2 * 200)
    )


def test_few_runs_show_no_tail():
    rng = np.random.default_rng(8)
    assert np.isinf(tail_index(rng.pareto(2.5, 60))[0])
    assert np.isinf(tail_index(np.ones(400))[0])


@pytest.mark.parametrize("runs", [100, 400, 1600])
def test_squared_normals_have_no_heavy_tail(runs):
    """At most 5 % are called so, though a smaller index is often estimated; rare failures are found."""
    rng = np.random.default_rng(9)
    squares = rng.normal(size=(400, runs)) ** 2
    assert np.mean([has_heavy_tail(x - x.mean()) for x in squares]) < 0.05 + 3 * 0.011
    rare = squares * np.where(rng.random(squares.shape) < 0.02, 400.0, 1.0)
    assert np.mean([has_heavy_tail(x - x.mean()) for x in rare]) > 0.4
