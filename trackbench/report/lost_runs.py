"""Lost runs: how many, how sure that is, and whether one filter loses more than another."""

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation import binomial

_BY_CHANCE = 0.01
"""Probability below which so many more lost runs of one filter are no chance."""


def in_words(lost: int, runs: int, what: str = " runs lost") -> str:
    """Return ``3 of 800 runs lost (0.077 to 1.1 %)``."""
    low, high = (
        f"{100 * end:.{3 if end > 0.995 else 2}g}" for end in binomial.interval(lost, runs)
    )
    return f"{lost} of {runs}{what} ({low} to {high} %)"


def loses_more(a: Array, b: Array) -> bool:
    """Return whether a filter loses more of the same runs, by codes (M,): sign test."""
    return chance_of_losing_more(a, b) < _BY_CHANCE


def chance_of_losing_more(a: Array, b: Array) -> float:
    """Return the probability that the first loses by chance so many of the unequal runs."""
    from scipy.special import bdtrc  # the upper tail of a binomial distribution

    alone, other = int(np.sum((a > 0) & (b == 0))), int(np.sum((b > 0) & (a == 0)))
    return float(bdtrc(alone - 1, alone + other, 0.5)) if alone else 1.0
