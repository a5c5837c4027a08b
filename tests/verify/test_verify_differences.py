"""Rounding against a change: the rate of false alarms, and the size of a change that is detected."""

import numpy as np
import pytest

from trackbench.statistics.intervals import holm
from trackbench.verify_differences import FALSE_ALARM, differences, p_of_chance, relative, usual

RUNS, COLUMNS, FOLDERS = 20, 60, 200

KINDS = {
    "normal": lambda rng, shape: rng.standard_normal(shape),
    "cauchy": lambda rng, shape: rng.standard_cauchy(shape),
    "lognormal": lambda rng, shape: np.exp(2.0 * rng.standard_normal(shape)),
    "rare": lambda rng, shape: np.where(rng.random(shape) < 0.05, 100.0, 1.0),
}


@pytest.mark.parametrize("kind", KINDS)
def test_two_draws_of_one_kind_are_no_change(kind):
    """In every folder the least of sixty p, corrected, is above the threshold."""
    rng = np.random.default_rng(4)
    alarms = 0
    for _ in range(FOLDERS):
        a, b = (KINDS[kind](rng, (COLUMNS, RUNS)) for _ in range(2))
        p = [p_of_chance(differences(x, y)) for x, y in zip(a, b, strict=True)]
        alarms += bool((holm(np.array(p)) < FALSE_ALARM).any())
    assert alarms <= 1


@pytest.mark.parametrize(("runs", "deviations"), [(20, 2.0), (200, 0.5)])
def test_a_mean_that_is_off_by_so_many_deviations_is_seen(runs, deviations):
    rng = np.random.default_rng(5)
    seen = [
        p_of_chance(deviations + rng.standard_normal(runs)) * COLUMNS < FALSE_ALARM
        for _ in range(200)
    ]
    assert np.mean(seen) > 0.9


def test_one_far_run_hides_nothing():
    difference = 0.1 + 0.01 * np.random.default_rng(6).standard_normal(RUNS)
    difference[3] = -50.0
    assert p_of_chance(difference) < 1e-4


def test_what_is_not_there_is_no_difference():
    nan, inf = np.nan, np.inf
    a = np.array([1.0, nan, inf, inf, -inf, nan, 1.0, 1.0, 0.0])
    b = np.array([1.0, nan, inf, 1.0, inf, 1.0, 1.0 + 1e-9, 1.1, 0.0])
    assert differences(a, b).tolist() == pytest.approx([0.0, 0.0, -0.1, 0.0])
    expected = [0.0, 0.0, 0.0, inf, inf, inf, 1e-9, 1 / 11, 0.0]
    np.testing.assert_allclose(relative(a, b), expected, rtol=1e-6)
    assert p_of_chance(np.zeros(5)) == 1.0
    assert p_of_chance(np.array([1.0])) == 1.0
    assert usual(np.array([nan, inf])) == 0.0


def test_a_number_near_zero_is_measured_by_what_is_usual():
    a = np.array([1.0, 2.0, 3.0, 1e-9])
    b = np.array([1.0, 2.0, 3.0, 3e-9])
    assert relative(a, b, usual(a)).max() < 1e-8
    assert relative(a, b).max() > 0.5
