"""Moves of particles: Metropolis-Hastings, differential evolution, kernel smoothing.

Metropolis-Hastings moves separate copies after resampling (Gilks & Berzuini 2001; van der Merwe et al.
2000, the MCMC step). Mutation and crossover are those of Storn & Price (1997). Kernel smoothing makes
resampled particles draws from a continuous density (Musso, Oudjane & Le Gland 2001, section 12.2): add
``h`` times a draw from the kernel, scaled by the particles' covariance; the bandwidth h is optimal for
a Gaussian target. Particles x are (n, M, N): N of n components in each of M runs.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from math import pi, sqrt
from typing import Literal, NamedTuple

import numpy as np

from trackbench.core import compiled, elementary, linalg
from trackbench.core.arrays import Array, Index, Mask, all_finite, choose
from trackbench.core.random_streams import Streams
from trackbench.core.resampling import select


def metropolis(gain: Array, temperature: float, rng: Streams) -> Mask:
    """Accept every gain (M, N) of log-density, and a loss with probability ``exp(gain / temperature)``.

    At temperature 0 no loss is accepted.
    """
    # u < exp(gain / temperature) for a uniform u is gain > -temperature e, e = -log u exponential.
    threshold: Array = rng.standard_gamma(1, gain.shape)
    threshold *= -temperature
    return np.asarray(gain > threshold)


def independence_moves(
    x: Array,
    draw: Callable[[Streams], Array],
    log_ratio: Callable[[Array], Array],
    steps: int,
    rng: Streams,
) -> Array:
    """Move particles by steps of an independence chain (Tierney 1994).

    A proposal is accepted with the quotient of its ratio and that of x. A particle without density
    under the target moves to the first proposal that has one; a proposal without density is rejected.

    Parameters
    ----------
    x : (n, M, N)
        Particles.
    draw : callable
        Proposals (n, M, N), drawn independently of x.
    log_ratio : callable
        Log of target over proposal density (M, N) at particles, up to a constant of each particle.
    steps : int
        Number of moves.
    rng : Streams

    Returns
    -------
    (n, M, N)
        Moved particles.
    """
    current = log_ratio(x)
    for _ in range(steps):
        trial = draw(rng)
        proposed = log_ratio(trial)
        # Accept with probability min(1, exp(proposed - current)).
        with np.errstate(invalid="ignore"):
            accept = metropolis(proposed - current, 1.0, rng)
        x = choose(accept, trial, x)
        current = choose(accept, proposed, current)
    return x


def mutate(x: Array, F: float, rng: Streams) -> Array:
    """Make a mutant ``x_i + F (x_r1 - x_r2)`` of each individual (hdepf paper, eq. 10).

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
    """Take each component from the mutant with probability CR, else from x (hdepf paper, eq. 11).

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
    """Draw flat indices r1, r2 (M, N), uniform over pairs with r1, r2, i all different; N >= 3."""
    # Step 1: draw r1 = i + steps[0], 1 <= steps[0] <= N - 1.
    u = rng.random((2, runs, N))
    if compiled.kernels:
        r1 = np.empty((runs, N), dtype=np.intp)
        r2 = np.empty((runs, N), dtype=np.intp)
        compiled.kernels.pairs(u, r1, r2, N)
        return r1, r2
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


Kernel = Literal["epanechnikov", "gaussian"]


class Mode(NamedTuple):
    """Particles that one kernel moves."""

    members: Mask | None
    """particles (M, N) of the mode; None for all"""
    share: Array | None
    """their share of the weight (M,); None for all"""
    cov: Array
    """their covariance (n, n, M)"""


def displaced(x: Array, T: float, nu: Array, K: float) -> Array:
    """Move particles by ``p' = p + T v + nu`` and ``v' = v + K nu`` along each axis.

    Parameters
    ----------
    x : array (4, M, N)
        Particles (px, vx, py, vy).
    T : float
        Time, s.
    nu : array (2, M, N)
        Displacements along the axes, m.
    K : float
        Change of the velocity per displacement, 1/s.

    Returns
    -------
    array (4, M, N)
        Moved particles, a new array.
    """
    out = np.empty_like(x)
    alike = x.dtype == nu.dtype == np.float64 and nu.shape == (2, *x.shape[1:])
    if compiled.kernels and alike and x.flags.c_contiguous:
        compiled.kernels.displaced(x, np.ascontiguousarray(nu), out, T, K)
        return out
    out[0::2] = T * x[1::2] + x[0::2] + nu
    out[1::2] = K * nu + x[1::2]
    return out


def bandwidth(n: int, N: Array | int, kernel: Kernel) -> Array:
    """Choose the optimal bandwidth for N particles, () or (M,), in n dimensions.

    Epanechnikov: ``[8 (n + 4) (2 sqrt pi)^n / c_n]^(1/(n+4)) N^(-1/(n+4))`` with c_n the volume of the
    unit ball; Gaussian: ``[4 / (n + 2)]^(1/(n+4)) N^(-1/(n+4))``.
    """
    if kernel == "gaussian":
        factor = 4.0 / (n + 2.0)
    else:
        factor = 8.0 * (n + 4.0) / _unit_ball(n)
        # times (2 sqrt pi)^n
        for _ in range(n):
            factor *= 2.0 * sqrt(pi)
    return elementary.power(factor / np.asarray(N), 1.0 / (n + 4))


def _unit_ball(n: int) -> float:
    """Return the volume of the unit ball in n dimensions, ``V_n = 2 pi / n V_{n-2}``."""
    if n == 0:
        return 1.0
    if n == 1:
        return 2.0
    return 2.0 * pi / n * _unit_ball(n - 2)


def kernel_draws(kernel: Kernel, shape: tuple[int, ...], rng: Streams) -> Array:
    """Draw (n, *batch) from the standard kernel.

    An Epanechnikov draw is the first n coordinates of a uniform point on the sphere in n + 4
    dimensions: each dropped pair of coordinates raises the power of ``1 - r^2`` by one, from -1.
    """
    e = rng.standard_normal(shape)
    if kernel == "gaussian":
        return e
    # The squared norm of the four dropped coordinates is chi-square: twice a Gamma(2) variate.
    square: Array = rng.standard_gamma(2, shape[1:])
    if compiled.kernels and e.flags.c_contiguous and square.flags.c_contiguous:
        compiled.kernels.epanechnikov(square, e)
        return e
    square *= 2.0
    for row in e:
        square += row * row
    e /= np.sqrt(square, out=square)
    return e


def jitter(x: Array, cov: Array, kernel: Kernel, rng: Streams, scale: float = 1.0) -> Array:
    """Move particles to ``x + scale h A e`` with e from the kernel and the optimal bandwidth h.

    Parameters
    ----------
    x : array (n, M, N)
        Particles.
    cov : array (n, n, M)
        Their covariance ``A A'``. A run whose covariance is singular keeps its particles.
    kernel : {"epanechnikov", "gaussian"}
        Kernel.
    rng : Streams
        Random numbers.
    scale : float
        Factor on the bandwidth.

    Returns
    -------
    array (n, M, N)
        Moved particles.
    """
    everything = Mode(members=None, share=None, cov=cov)
    return jitter_modes(x, [everything], kernel, rng, scale)


def jitter_modes(
    x: Array, modes: Sequence[Mode], kernel: Kernel, rng: Streams, scale: float = 1.0
) -> Array:
    """Apply `jitter` to the particles x (n, M, N) of each mode, by its own bandwidth and covariance.

    Each bandwidth is multiplied by ``scale``.
    """
    n, _, N = x.shape
    e = kernel_draws(kernel, x.shape, rng)
    for mode in modes:
        # Step 1: the bandwidth h for the mode's number of particles; without a share these are all N.
        if mode.share is None:
            h = _bandwidth_of_all(n, N, kernel)
        else:
            h = bandwidth(n, np.maximum(mode.share * N, 1.0), kernel)
        # Step 2: move the mode's particles by scale h A e.
        x = _move_members(x, scale * h * _root_or_zero(mode.cov), e, mode.members)
    return x


def _move_members(x: Array, A: Array, e: Array, members: Mask | None) -> Array:
    """Move the members (M, N) to ``x + A e`` for a lower triangle per run A (n, n, M)."""
    mask = np.zeros(0, np.bool_) if members is None else members  # empty: all are members
    # The kernel reads only float64, one triangle per run, and a mask of all particles.
    fits = A.shape[2:] == x.shape[1:2] and mask.shape in ((0,), x.shape[1:])
    alike = x.dtype == A.dtype == e.dtype == np.float64 and mask.dtype == np.bool_
    if compiled.kernels and fits and alike:
        out = np.empty(x.shape)
        compiled.kernels.move(*map(np.ascontiguousarray, (A, e, mask, x)), out, len(x))
        return out
    move = linalg.lower_product(A, e)
    moved = move if members is None else np.where(members, move, 0.0)
    moved += x
    return moved


_bandwidth_of_all = lru_cache(bandwidth)


def _root_or_zero(cov: Array) -> Array:
    """Factor a covariance (n, n, M) by Cholesky; zero in a run where it is finite but has no factor."""
    A = linalg.cholesky(cov)
    if all_finite(A):
        return A
    has_root = np.isfinite(A).all(axis=(0, 1))
    is_finite = np.isfinite(cov).all(axis=(0, 1))
    return np.where(has_root | ~is_finite, A, 0.0)
