"""Draws that cover a normal's tails: their weights make them N(0, 1) again."""

import numpy as np

from trackbench.core.distributions import heavy_tailed_normal

RUNS, N = 40, 5000


def test_weighted_draws_are_standard_normal(rng: np.random.Generator) -> None:
    """Mean weight, moments and tail probabilities; errors from the spread over independent rows."""
    x, log_w = heavy_tailed_normal(RUNS, N, rng)
    w = np.exp(log_w)
    for values, exact in (
        (w, 1.0),
        (w * x, 0.0),
        (w * x**2, 1.0),
        (w * x**4, 3.0),
        (w * (x > 3.0), 1.349898e-3),
        (w * (x < -4.5), 3.397673e-6),
    ):
        found = values.mean(axis=1)
        assert abs(found.mean() - exact) < 4 * found.std() / np.sqrt(RUNS)


def test_no_stratum_is_empty_and_no_weight_large(rng: np.random.Generator) -> None:
    x, log_w = heavy_tailed_normal(RUNS, N, rng)
    assert (np.diff(x, axis=1) > 0).all()
    assert np.exp(log_w).max() < 1.77
    for edge in (3.0, 4.0, 5.0):  # of N(0, 1)'s own draws 7, 0.2 and 0.001 are beyond
        beyond = 2.0 * N / (1.0 + np.exp(edge * np.pi / (2.0 * np.sqrt(3.0))))
        assert (np.abs((np.abs(x) > edge).sum(axis=1) - beyond) <= 2).all()
