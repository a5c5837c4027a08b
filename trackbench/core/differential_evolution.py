"""Moves of differential evolution (Storn & Price 1997), and the Metropolis criterion.

A population is x (n, M, N): N individuals in each of M runs.
"""

from functools import lru_cache

import numpy as np

from trackbench.core.arrays import Array, Index, Mask
from trackbench.core.random_streams import Streams
from trackbench.core.resampling import select


def mutate(x: Array, F: float, rng: Streams) -> Array:
    """Return ``x_i + F (x_r1 - x_r2)``, r1 != r2 != i (hdepf paper, eq. 10)."""
    r1, r2 = distinct_pairs(x.shape[1], x.shape[2], rng)
    return x + F * (select(x, r1) - select(x, r2))


def crossover(x: Array, mutant: Array, CR: float, rng: Streams) -> Array:
    """Take each component from the mutant with probability CR, else from x (hdepf paper, eq. 11)."""
    return np.where(rng.random(x.shape) <= CR, mutant, x)


def metropolis(gain: Array, temperature: float, rng: Streams) -> Mask:
    """Accept every gain, and a loss with probability ``exp(gain / temperature)`` (none below 1e-5)."""
    # -log u of a uniform u < exp(gain / temperature)
    loss: Array = rng.standard_gamma(1, gain.shape)
    loss *= -temperature
    return np.asarray(gain > loss)


def distinct_pairs(runs: int, N: int, rng: Streams) -> tuple[Index, Index]:
    """Return flat indices r1, r2 (M, N), uniform over pairs with r1, r2, i all different; N >= 3."""
    u = rng.random((2, runs, N))
    u[0] *= N - 1
    u[1] *= N - 2
    steps = u.astype(np.intp)
    steps += 1  # r1 = i + steps[0], 1 <= steps[0] <= N - 1
    steps[1] += steps[1] >= steps[0]  # the N - 2 steps that are neither 0 nor steps[0]
    around, start = _rounds(runs, N)
    steps += start
    r1, r2 = around.take(steps, mode="clip")
    return r1, r2


@lru_cache(maxsize=8)
def _rounds(runs: int, N: int) -> tuple[Index, Index]:
    """Return flat indices of each run's particles twice (2 M N,), and their places in it (M, N)."""
    i, run = np.arange(N), np.arange(runs)[:, None]
    return (run * N + np.concatenate([i, i])).ravel(), run * (2 * N) + i
