"""Estimates and influences by hand, and the test of one recording's differences by simulated series."""

import numpy as np
import pytest
import scipy.fft
import scipy.signal
import scipy.stats

from trackbench.core.arrays import Array
from trackbench.statistics import sample_statistics as st
from trackbench.statistics.correlated_series import series_mean
from trackbench.statistics.efficiency_with_control_variate import plain_efficiency
from trackbench.statistics.jackknife import influence_of_ratio

REPEATS = 600


def simulated(kind: str, T: int, rng: np.random.Generator) -> Array:
    """Return a series (T,) with mean zero."""
    normal = rng.standard_t(3, T + 200) if kind == "heavy tails" else rng.standard_normal(T + 200)
    if kind == "moving average":
        return (normal[1:] + 0.8 * normal[:-1])[-T:]
    r = {"white": 0.0, "0.5": 0.5, "0.8": 0.8, "-0.5": -0.5, "heavy tails": 0.5}[kind]
    x = normal.copy()
    for k in range(1, len(x)):
        x[k] += r * x[k - 1]
    return x[-T:]


@pytest.mark.parametrize("T", [100, 600])
@pytest.mark.parametrize("kind", ["white", "0.5", "0.8", "-0.5", "moving average", "heavy tails"])
def test_five_percent_of_series_without_a_difference_are_rejected(kind: str, T: int) -> None:
    rng = np.random.default_rng([201, T, len(kind)])
    rejected = sum(abs(series_mean(simulated(kind, T, rng)).z) > 1.96 for _ in range(REPEATS))
    # 3.5 to 6.5 %, and four standard errors of the simulation.
    margin = 4.0 * np.sqrt(0.05 * 0.95 / REPEATS)
    assert 0.035 - margin < rejected / REPEATS < 0.065 + margin


def test_the_error_is_that_of_the_long_run() -> None:
    """Of an autoregression of 0.8 it is five times that of white noise."""
    rng = np.random.default_rng(202)
    errors = [series_mean(simulated("0.8", 2000, rng)).stderr for _ in range(50)]
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(5.0 / np.sqrt(2000), rel=0.1)


def test_what_can_be_said_without_spread_or_steps() -> None:
    for value, z in ((0.0, 0.0), (-2.0, -np.inf)):
        found = series_mean(np.full(100, value))
        assert (found.value, found.stderr, found.z) == (value, 0.0, z)
    assert np.isnan(series_mean(np.arange(49.0)).z)
    x = np.random.default_rng(203).standard_normal(200)
    gaps = np.insert(x, [3, 50, 200], np.nan)
    assert series_mean(gaps)[:2] == series_mean(x)[:2]


@pytest.mark.parametrize("scale", [1e-310, 1e-170, 1e-162, 1e170, 1e300])
def test_differences_whose_squares_are_no_numbers_have_the_z_of_others(scale: float) -> None:
    """The squares of 1e-170 are zero and those of 1e170 infinite."""
    x = 0.3 + np.random.default_rng(204).standard_normal(80)
    expected = series_mean(x)
    found = series_mean(scale * x)
    assert found.z == pytest.approx(expected.z, rel=1e-8)
    assert found.stderr == pytest.approx(scale * expected.stderr, rel=1e-8)
    assert series_mean(np.tile([scale, -scale], 40)).z == 0.0


@pytest.mark.parametrize("T", [80, 200])
def test_one_more_step_hardly_changes_the_test(rng: np.random.Generator, T: int) -> None:
    """From 199 to 200 steps a slower model was added, and the power fell from 0.50 to 0.15."""
    for _ in range(10):
        x = 5.0 / np.sqrt(T) + rng.standard_normal(T)
        assert series_mean(x[:-1]).z == pytest.approx(series_mean(x).z, rel=0.1)


def test_a_series_that_is_nearly_a_random_walk_has_a_reason(rng: np.random.Generator) -> None:
    found = series_mean(np.cumsum(rng.standard_normal(400)))
    assert np.isnan(found.z)
    assert found.why == "the autocorrelation of neighboring steps may be 0.97 or more"


@pytest.mark.parametrize(("kind", "T"), [("0.8", 60), ("white", 200)])
def test_the_mean_of_a_series_by_a_scalar_program(kind: str, T: int) -> None:
    """Covariances of every model in full, projected on the cosines; Bayes' rule by plain numbers."""
    x = 0.4 + simulated(kind, T, np.random.default_rng(204))
    q, lags = min(T // 2, 64), np.abs(np.subtract.outer(np.arange(T), np.arange(T)))
    basis = scipy.fft.dct(np.eye(T), axis=0, norm="ortho")
    weights = (basis @ x)[1 : q + 1]
    models = [(0.4, np.ones(q + 1))]
    # No correlation time 1 / (1 - r) is longer than 2.5 times the series.
    slowest = 1.0 - 1.0 / (2.5 * T)
    tabulated = (0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 0.99, 0.995, 0.998)
    coefficients = [min(r, slowest) for r in tabulated]
    for r in coefficients:
        of_r = np.diag(basis @ (r**lags) @ basis.T)[: q + 1]
        for share in (0.01, 0.02, 0.05, 0.1, 0.2, 0.4, 0.7, 1.0):
            models.append((0.6 / (8 * len(coefficients)), 1.0 - share + share * of_r))
    likelihoods, tails = [], []
    for prior, v in models:
        Q = (weights**2 / v[1:]).sum()
        likelihoods.append(np.log(prior) - 0.5 * np.log(v[1:]).sum() - 0.5 * q * np.log(Q))
        tails.append(scipy.stats.t.sf(x.mean() * np.sqrt(q * T / (v[0] * Q)), q))
    posterior = np.exp(np.array(likelihoods) - max(likelihoods))
    expected = scipy.stats.norm.isf(posterior @ tails / posterior.sum())
    found = series_mean(x)
    assert found.value == pytest.approx(x.mean())
    assert found.z == pytest.approx(expected, rel=0.002)
    # The interval has every mean that the test accepts.
    for level in (0.6827, 0.95):
        at_end = x - x.mean() + found.half_width(level)
        assert series_mean(at_end).z == pytest.approx(
            scipy.stats.norm.isf((1 - level) / 2), rel=1e-5
        )
    assert found.stderr == pytest.approx(found.half_width(0.682689492), rel=1e-6)


@pytest.mark.parametrize(("share", "r"), [(0.2, 0.99), (0.05, 0.99), (0.1, 0.995)])
@pytest.mark.parametrize("T", [500, 2000])
def test_white_noise_above_a_slow_part_keeps_the_level(share: float, r: float, T: int) -> None:
    """A fifth to a third were called different at 1 %: the lag of one step shows the white part."""
    rng, repeats = np.random.default_rng([205, T]), 150
    # At most 7 % at 500 steps, 3 % at 2000, and three standard errors.
    most = 0.07 if T == 500 else 0.03
    rejected, beyond_three = 0, 0
    for _ in range(repeats):
        slow = scipy.signal.lfilter([1.0], [1.0, -r], rng.standard_normal(T + 2000))[-T:]
        slow *= np.sqrt(share * (1.0 - r * r))
        z = series_mean(slow + np.sqrt(1.0 - share) * rng.standard_normal(T)).z
        rejected += abs(z) > 2.576
        beyond_three += abs(z) > 3.0
    assert rejected / repeats < most + 3.0 * np.sqrt(most / repeats)
    assert beyond_three / repeats < 0.02 + 3.0 * np.sqrt(0.02 / repeats)


@pytest.mark.parametrize(("T", "least"), [(500, 0.4), (1000, 0.65), (2000, 0.8)])
def test_a_difference_of_five_standard_errors_is_found(T: int, least: float) -> None:
    rng, repeats = np.random.default_rng([206, T]), 100
    found = 0
    for _ in range(repeats):
        found += series_mean(5.0 / np.sqrt(T) + rng.standard_normal(T)).z > 2.576
    assert found / repeats > least - 3.0 * np.sqrt(0.25 / repeats)


X = np.array([1.0, 2.0, 4.0, 7.0, 11.0])
"""Five values: mean 5, squared deviations 16, 9, 1, 4, 36, which sum to 66."""


def test_estimates_of_five_values_by_hand() -> None:
    squares = np.square(X)
    of_squares = np.sqrt(np.square(squares - 38.2).sum() / 4 / 5)
    rms = np.sqrt(38.2)
    assert st.rms(X) == pytest.approx((rms, of_squares / (2 * rms)))
    ds = (np.square(X - 5.0) - 13.2) / (2 * np.sqrt(13.2))
    assert st.deviation(X) == pytest.approx((np.sqrt(13.2), np.sqrt(np.square(ds).sum() / 4 / 5)))
    for alone in (st.deviation(X[:1]), st.variance(X[:1])):  # one run has no spread
        assert np.isnan(alone).all()
    sums = (np.array([a]) for a in (X.sum(), squares.sum(), 5.0))
    found = st.mean_from_sums(*sums)
    assert (found.value[0], found.stderr[0]) == pytest.approx(tuple(st.mean(X)))
    of_root = st.rooted(st.Estimates(np.array([38.2]), np.array([of_squares])))
    assert (of_root.value[0], of_root.stderr[0]) == pytest.approx(tuple(st.rms(X)))


def test_estimates_of_zeros_and_of_few_values() -> None:
    assert st.rms(np.zeros(5)) == (0.0, 0.0)
    # 1.96 ranks do not fit into a sample of three: its ends are 2 sqrt(3) standard errors apart.
    assert st.median(X[:3]) == pytest.approx((2.0, 3.0 / (2.0 * np.sqrt(3.0))))


def test_the_median_of_log_scores_may_be_minus_infinity() -> None:
    """Weights of zero have the log score -inf; the median of three of them was the largest value."""
    assert st.median(np.array([-np.inf, -np.inf, -np.inf, -1.0])).value == -np.inf
    assert st.median(np.array([np.inf, np.inf, np.inf, -1.0])).value == np.inf


def test_a_ratio_leaves_one_run_out_of_both() -> None:
    def left_out(a: Array, b: Array) -> Array:
        ratios = [np.delete(a, i).mean() / np.delete(b, i).mean() for i in range(5)]
        return 4.0 * (np.mean(ratios) - ratios)

    Y = np.array([3.0, 1.0, 2.0, 5.0, 2.0])
    of = st.influence("mean", X), st.influence("mean", Y)
    np.testing.assert_allclose(influence_of_ratio(5.0, 2.6, *of), left_out(X, Y))
    # The root of a ratio of squares: half the relative influence.
    found = plain_efficiency(Y, X)
    expected = left_out(np.square(Y), np.square(X)) / (2.0 * found.value)
    np.testing.assert_allclose(found.influences, expected)


@pytest.mark.parametrize("M", [2, 3, 4, 7, 50, 3200])
@pytest.mark.parametrize("infinite", [0.0, 0.4])
def test_the_median_and_its_interval_are_numpys_quantiles(M: int, infinite: float) -> None:
    rng = np.random.default_rng(M)
    deviations = min(1.96, np.sqrt(M))
    share = 0.5 * deviations / np.sqrt(M)
    for _ in range(20):
        x = np.square(rng.standard_normal(M))
        x[rng.random(M) < infinite] = np.inf
        with np.errstate(invalid="ignore"):
            quantiles = np.quantile(x, [0.5 - share, 0.5, 0.5 + share])
            # Between two infinities numpy has NaN.
            low, middle, high = np.where(np.isnan(quantiles), np.inf, quantiles)
            stderr = (high - low) / (2.0 * deviations)
        np.testing.assert_array_equal(st.median(x), (middle, stderr))


def test_the_median_of_many_values_in_any_order_is_numpys():
    """The range of the middle is guessed from every so many-th value: orders that mislead this guess."""
    M = 10_000
    deviations = 1.96
    share = 0.5 * deviations / np.sqrt(M)
    every_25th_is_small = np.tile(np.concatenate([[-5.0], np.arange(24.0)]), M // 25)
    two_values = np.repeat([0.0, 1.0], [M // 2 + 3, M // 2 - 3])
    ascending = np.arange(M) / 7.0
    for x in (every_25th_is_small, two_values, ascending, ascending[::-1], np.zeros(M)):
        low, middle, high = np.quantile(x, [0.5 - share, 0.5, 0.5 + share])
        assert st.median(x) == (middle, (high - low) / (2.0 * deviations))


def test_the_median_takes_196_standard_errors_of_a_rank():
    """Woodruff 1952: of evenly spaced values, so that its interval is as wide as its ranks are apart."""
    for M in (25, 101, 10_001):
        x = np.linspace(0.0, 1.0, M)
        assert st.median(x).stderr == pytest.approx(0.5 / np.sqrt(M), rel=1e-9)
    # Where the density falls outwards, the width counts: 0.5 +- 0.98 / sqrt(M) of the ranks.
    from scipy.special import ndtri

    x = ndtri((np.arange(100_001) + 0.5) / 100_001)[::1000]
    M = len(x)
    share = 0.98 / np.sqrt(M)
    low, high = np.quantile(x, [0.5 - share, 0.5 + share])
    assert st.median(x).stderr == pytest.approx((high - low) / 3.92, rel=1e-12)


@pytest.mark.parametrize("n", [*range(2, 30), 100, 200, 401, 800, 5000, 100_001])
@pytest.mark.parametrize("level", [0.9, 0.95, 0.99, 0.999])
def test_the_interval_of_a_median(n: int, level: float, rng: np.random.Generator) -> None:
    x = rng.standard_normal(n)
    found = scipy.stats.quantile_test(x, p=0.5).confidence_interval(level)
    assert np.array_equal(st.interval("median", x, level), tuple(found), equal_nan=True)
