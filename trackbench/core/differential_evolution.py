"""Differential evolution of particles: mutation and crossover (Storn & Price 1997).

Particles x are (n, M, N): N of n components in each of M runs.
"""

from functools import lru_cache

import numpy as np

from trackbench.core import compiled
from trackbench.core.arrays import Array, Index, choose
from trackbench.core.random_streams import Streams
from trackbench.core.resampling import select


def mutate(x: Array, F: float, rng: Streams) -> Array:
    """Make a mutant ``x_i + F (x_r1 - x_r2)`` of each individual (Zhang & Li, HDEPF, eq. 10).

    Parameters
    ----------
    x : array (n, M, N)
        Populations of N >= 3 individuals. r1, r2 and i are all different.
    F : float
        Scaling factor.
    rng : Streams
        Random numbers.

    Returns
    -------
    array (n, M, N)
        Mutants.
    """
    r1, r2 = distinct_pairs(x.shape[1], x.shape[2], rng)
    return x + F * (select(x, r1) - select(x, r2))


def crossover(x: Array, mutant: Array, CR: float, rng: Streams) -> Array:
    """Take each component from the mutant with probability CR, else from x (Zhang & Li, HDEPF, eq. 11).

    Parameters
    ----------
    x, mutant : array (n, M, N)
        Individuals and their mutants.
    CR : float
        Crossover probability.
    rng : Streams
        Random numbers.

    Returns
    -------
    array (n, M, N)
        Trials.
    """
    return choose(rng.random(x.shape) <= CR, mutant, x)


def distinct_pairs(runs: int, N: int, rng: Streams) -> tuple[Index, Index]:
    """Draw two individuals for each individual i, uniform over pairs with r1, r2 and i all different.

    Parameters
    ----------
    runs : int
        Number M of populations.
    N : int
        Individuals of each population, at least 3.
    rng : Streams
        Random numbers.

    Returns
    -------
    r1, r2 : array (M, N) of int
        Individuals of the same run, as flat indices ``m N + j`` for `select`.
    """
    # Step 1: draw r1 = i + steps[0], 1 <= steps[0] <= N - 1.
    u = rng.random((2, runs, N))
    if compiled.kernels:
        r1 = np.empty((runs, N), dtype=np.intp)
        r2 = np.empty((runs, N), dtype=np.intp)
        compiled.kernels.pairs(u, r1, r2, N)
        return r1, r2
    # The kernel gives the same pairs as the code below.
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
    """Return tables to go s < N particles on from particle i of a run, and from the last to the first.

    ``around`` (2 M N,) has the flat indices m N + i of each run's particles twice in a row. ``start``
    (M, N) is the place in it of each particle. The particle s places on is ``around[start + s]``.
    """
    i = np.arange(N)
    run = np.arange(runs)[:, None]
    around = (run * N + np.concatenate([i, i])).ravel()
    start = run * (2 * N) + i
    return around, start
