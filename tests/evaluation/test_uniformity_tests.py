"""Tests of uniform ranks: against scipy's and by their size where nothing is wrong."""

import numpy as np
import pytest
from scipy import stats

from trackbench.core.arrays import Array
from trackbench.evaluation.calibration_series import TENTHS, in_tenths
from trackbench.evaluation.uniformity_tests import at_step, number_of_places, over_steps
from trackbench.statistics.kolmogorov_distance import kolmogorov_band


def shares(u: Array) -> Array:
    """Shares (TENTHS, M) of the steps of u (T, M)."""
    return np.stack([(np.floor(u * TENTHS) == b).mean(axis=0) for b in range(TENTHS)])


def shares_of_ranks(ranks: Array) -> Array:
    """Shares (TENTHS, M) of the places of ranks (T, M)."""
    return np.mean([in_tenths(row, number_of_places(ranks.ravel())) for row in ranks], axis=0)


def correlated(rng: np.random.Generator, steps: int, runs: int, spread: float = 1.0) -> Array:
    """Uniform values (T, M) that hang together within a run, if the spread is 1."""
    z = np.empty((steps, runs))
    z[0] = rng.normal(size=runs)
    for k in range(1, steps):
        z[k] = 0.9 * z[k - 1] + np.sqrt(1 - 0.81) * rng.normal(size=runs)
    return stats.norm.cdf(spread * z)


@pytest.mark.parametrize(("a", "b"), [(1.1, 1.0), (1.0, 1.1)])
def test_at_a_step_as_scipy_has_it(a: float, b: float) -> None:
    u = np.random.default_rng(2).beta(a, b, size=700)
    found = at_step(np.append(u, [np.nan, np.nan]))
    counts = np.histogram(u, TENTHS, (0.0, 1.0))[0]
    test = stats.kstest(u, "uniform")
    assert found.runs == 700
    np.testing.assert_allclose(found.shares, counts / 700)
    assert found.p == pytest.approx(stats.chisquare(counts).pvalue, rel=1e-9)
    assert found.distance == pytest.approx(test.statistic, rel=1e-12)
    assert found.p_distance == pytest.approx(test.pvalue, rel=0.02)  # scipy's is exact


@pytest.mark.parametrize("M", [100, 2000])
def test_the_band_is_kolmogorovs(M: int) -> None:
    assert kolmogorov_band(M) == pytest.approx(stats.kstwo.ppf(0.95, M), rel=0.005)


def test_over_steps_by_numpy() -> None:
    given = shares(correlated(np.random.default_rng(3), 12, 200, 1.2))
    found = over_steps(np.hstack([given, np.full((TENTHS, 2), np.nan)]))
    center, covariance = given[:-1].mean(axis=1) - 0.1, np.cov(given[:-1])
    T2 = 200 * center @ np.linalg.solve(covariance, center)
    assert found.p == pytest.approx(stats.f.sf(T2 * 191 / (9 * 199), 9, 191), rel=1e-9)
    np.testing.assert_allclose(found.stderr, given.std(axis=1, ddof=1) / np.sqrt(200))
    cumulative = np.abs(np.cumsum(given.mean(axis=1)) - np.arange(1, 11) / 10)
    assert found.distance == pytest.approx(cumulative.max())


def test_nothing_is_found_where_nothing_is_wrong() -> None:
    """p-values of 300 batches are uniform themselves, with steps that hang together, too."""
    rng = np.random.default_rng(4)
    batches = [correlated(rng, 12, 300) for _ in range(300)]
    by_step = [at_step(u[-1]) for u in batches]
    over = [over_steps(shares(u)) for u in batches]
    for p in ([b.p for b in by_step], [b.p_distance for b in by_step], [b.p for b in over]):
        assert stats.kstest(p, "uniform").pvalue > 1e-3
    # The standard errors, against the spread over the batches, which is known to 1 / sqrt(600).
    spread = np.std([b.shares for b in over], axis=0, ddof=1)
    said = np.sqrt(np.mean([b.stderr**2 for b in over], axis=0))
    np.testing.assert_allclose(said, spread, rtol=4.5 / np.sqrt(600))


@pytest.mark.parametrize("N", [4, 10, 14, 30])
def test_ranks_are_not_rejected_for_being_few(N: int) -> None:
    """Uniform ranks among N, in batches of 1000 runs, by their middles as a file has them."""
    rng = np.random.default_rng(8)
    batches = [
        np.round((rng.integers(N + 1, size=(4, 1000)) + 0.5) / (N + 1), 7) for _ in range(200)
    ]
    by_step = [at_step(ranks[0]) for ranks in batches]
    over = [over_steps(shares_of_ranks(ranks)) for ranks in batches]
    # Ten or more of 200 are below 0.01 with a probability of 5e-5.
    for p in ([b.p for b in by_step], [b.p_distance for b in by_step], [b.p for b in over]):
        assert sum(value < 0.01 for value in p) < 10
    assert np.isnan([b.p for b in over]).all() == (N < TENTHS - 1)
    assert stats.kstest([b.p for b in by_step], "uniform").pvalue > 1e-3
    np.testing.assert_allclose(np.mean([b.shares for b in by_step], axis=0), 0.1, atol=0.004)


@pytest.mark.parametrize("N", [4, 10, 99])
def test_ranks_that_are_wrong_are_found(N: int) -> None:
    few = np.random.default_rng(9).binomial(N, 0.5, size=(4, 1000))
    ranks = (few + 0.5) / (N + 1)
    assert max(at_step(ranks[0]).p, at_step(ranks[0]).p_distance) < 1e-6
    assert N < TENTHS or over_steps(shares_of_ranks(ranks)).p < 1e-6


def test_places_are_counted_where_there_are_some() -> None:
    rng = np.random.default_rng(10)
    for N in (2, 10, 99, 1999):
        assert number_of_places((rng.integers(N + 1, size=500) + 0.5) / (N + 1)) == N + 1
    assert number_of_places(rng.random(500)) == number_of_places(np.full(3, 0.5)) == 0


def test_the_share_of_a_place_in_each_tenth_by_hand() -> None:
    """The second of four places is from 1/4 to 2/4."""
    expected = np.array([0, 0, 0.05, 0.1, 0.1, 0, 0, 0, 0, 0]) * 4
    np.testing.assert_allclose(in_tenths(np.array([1.5 / 4]), 4)[:, 0], expected)
    assert np.isnan(in_tenths(np.array([np.nan]), 4)).all()


@pytest.mark.parametrize("spread", [0.8, 1.25])
def test_what_is_wrong_is_found(spread: float) -> None:
    u = correlated(np.random.default_rng(5), 12, 500, spread)
    assert at_step(u[-1]).p < 1e-3
    assert over_steps(shares(u)).p < 1e-6


def test_a_tenth_that_never_comes() -> None:
    u = 0.1 + 0.9 * correlated(np.random.default_rng(6), 12, 50)
    assert over_steps(shares(u)).p == 0.0


@pytest.mark.parametrize("runs", [0, 1, 9])
def test_of_too_few_runs_nothing_is_said(runs: int) -> None:
    few = at_step(np.full(runs, 0.5)), over_steps(np.full((TENTHS, runs), 0.1))
    for found in few:
        assert found.runs == runs
        assert np.isnan([found.distance, found.p, found.p_distance]).all()
