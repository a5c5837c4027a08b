"""Efficiency: a known answer, and its standard error against repeated batches of runs."""

import numpy as np
import pytest

from trackbench.statistics.efficiency_with_control_variate import (
    cross_share,
    efficiency,
    plain_efficiency,
    runs_saved,
)

REPEATED, RUNS = 600, 150
EXTRA = 0.3
"""Standard deviation of what a filter adds to the exact mean."""
KNOWN = np.sqrt(0.5 / (0.5 + EXTRA**2))


def batch(rng, runs, pull=0.0):
    """RMSE per run of the exact mean and of a filter, and the distance between them.

    A standard normal truth seen with unit noise: the posterior mean is half the measurement, its mean
    square error one half. ``pull`` makes the reference a worse mean than that.
    """
    truth = rng.standard_normal(runs)
    seen = truth + rng.standard_normal(runs)
    best = 0.5 * seen
    exact, found = best + pull * seen, best + EXTRA * rng.standard_normal(runs)
    return abs(exact - truth), abs(found - truth), abs(found - exact)


@pytest.fixture(scope="module")
def batches():
    rng = np.random.default_rng(20260)
    return [batch(rng, RUNS) for _ in range(REPEATED)]


def test_the_known_answer():
    floor, error, distance = batch(np.random.default_rng(1), 40_000)
    for found in (efficiency(floor, distance), plain_efficiency(floor, error)):
        value, stderr = found.estimate
        assert 0.0 < stderr < 0.01
        assert abs(value - KNOWN) < 4.0 * stderr


@pytest.mark.parametrize("controlled", [True, False])
def test_its_error_is_that_of_repeated_batches(batches, controlled):
    found = [
        (efficiency(f, d) if controlled else plain_efficiency(f, e)).estimate for f, e, d in batches
    ]
    values, stderrs = np.array(found).T
    spread = values.std(ddof=1)
    # A standard deviation of so many normal values is itself known to 1 / sqrt(2 n).
    assert np.sqrt(np.mean(stderrs**2)) == pytest.approx(spread, rel=4.0 / np.sqrt(2.0 * REPEATED))
    assert abs(values.mean() - KNOWN) < 4.0 * spread / np.sqrt(REPEATED) + 0.1 / RUNS


def test_runs_saved_is_the_ratio_of_variances_of_repeated_batches(batches):
    with_, without = (
        np.array([function(*parts).value for parts in chosen])
        for function, chosen in (
            (efficiency, [(f, d) for f, _, d in batches]),
            (plain_efficiency, [(f, e) for f, e, _ in batches]),
        )
    )
    saved = [runs_saved(plain_efficiency(f, e), efficiency(f, d)).estimate for f, e, d in batches]
    values, stderrs = np.array(saved).T
    known = without.var(ddof=1) / with_.var(ddof=1)
    assert known > 2.0
    assert values.mean() == pytest.approx(known, rel=4.0 / np.sqrt(REPEATED))
    # A ratio of fourth moments: its own error is right to a quarter with so few runs.
    assert np.sqrt(np.mean(stderrs**2)) == pytest.approx(values.std(ddof=1), rel=0.25)


@pytest.mark.parametrize("runs", [1, 2, 3, 5])
def test_few_runs_do_not_tell_how_many_are_saved(runs):
    floor, error, distance = batch(np.random.default_rng(3), runs)
    with_, without = efficiency(floor, distance), plain_efficiency(floor, error)
    assert np.isnan(runs_saved(without, with_).estimate).all()
    assert np.isfinite(with_.value)
    assert np.isnan(with_.estimate.stderr) == (runs == 1)


def test_an_exact_filter_saves_all_runs():
    floor, error, _ = batch(np.random.default_rng(4), 8)
    saved = runs_saved(plain_efficiency(floor, error), efficiency(floor, 0.0 * floor))
    assert saved.value == np.inf
    assert np.isnan(saved.estimate.stderr)


def test_the_reference_itself_is_efficient():
    floor, _, _ = batch(np.random.default_rng(2), 50)
    assert efficiency(floor, 0.0 * floor).estimate == (1.0, 0.0)


def test_the_cross_term_tells_whether_the_reference_is_the_mean():
    rng = np.random.default_rng(3)
    value, stderr = cross_share(*batch(rng, 4000)).estimate
    assert abs(value) < 4.0 * stderr
    floor, error, distance = batch(rng, 4000, pull=0.2)
    # (m - x).(e - m) with m = (1/2 + a) z: E is -2 a^2 of E z^2 = 2, twice of that over the MSE.
    value, stderr = cross_share(floor, error, distance).estimate
    assert abs(value + 4.0 * 0.2**2 / (0.5 + EXTRA**2)) < 4.0 * stderr
    assert value < -4.0 * stderr
