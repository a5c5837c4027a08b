"""Mutation and crossover of differential evolution (Storn & Price 1997).

A population is x (n, M, N): N individuals of n components in each of M runs.
"""

from functools import lru_cache

import numpy as np

from trackbench.core.arrays import Array, Index
from trackbench.core.random_streams import Streams
from trackbench.core.resampling import select


def mutate(x: Array, F: float, rng: Streams) -> Array:
    """Return mutants ``x_i + F (x_r1 - x_r2)``, r1 != r2 != i (hdepf paper, eq. 10).

    Parameters
    ----------
    x : (n, M, N)
        Population, N >= 3.
    F : float
        Scale of the difference.
    rng : Streams

    Returns
    -------
    (n, M, N)
        A mutant of each individual.
    """
    r1, r2 = distinct_pairs(x.shape[1], x.shape[2], rng)
    return x + F * (select(x, r1) - select(x, r2))


def crossover(x: Array, mutant: Array, CR: float, rng: Streams) -> Array:
    """Take each component from the mutant with probability CR, else from x (hdepf paper, eq. 11).

    Both populations are (n, M, N), and so is the result.
    """
    return np.where(rng.random(x.shape) <= CR, mutant, x)


def distinct_pairs(runs: int, N: int, rng: Streams) -> tuple[Index, Index]:
    """Return flat indices r1, r2 (M, N), uniform over pairs with r1, r2, i all different; N >= 3."""
    # Step 1: draw r1 = i + steps[0], 1 <= steps[0] <= N - 1.
    u = rng.random((2, runs, N))
    u[0] *= N - 1
    u[1] *= N - 2
    steps = u.astype(np.intp)
    steps += 1
    # Step 2: draw r2 from the N - 2 steps that are neither 0 nor steps[0].
    steps[1] += steps[1] >= steps[0]
    # Step 3: wrap around within each run.
    around, start = _wrap_tables(runs, N)
    steps += start
    r1, r2 = around.take(steps, mode="clip")
    return r1, r2


@lru_cache(maxsize=8)
def _wrap_tables(runs: int, N: int) -> tuple[Index, Index]:
    """Return flat indices of each run's particles twice (2 M N,), and their places in it (M, N)."""
    i, run = np.arange(N), np.arange(runs)[:, None]
    return (run * N + np.concatenate([i, i])).ravel(), run * (2 * N) + i
