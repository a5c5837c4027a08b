"""Regularization: kernel smoothing that makes resampled particles draws from a continuous density.

Musso, Oudjane & Le Gland 2001, section 12.2: add ``h`` times a draw from the kernel, scaled by the
particles' covariance. The bandwidth h is optimal for a Gaussian target. Particles x are (n, M, N): N of
n components in each of M runs.
"""

from collections.abc import Sequence
from functools import lru_cache
from math import pi, sqrt
from typing import Literal, NamedTuple

import numpy as np

from trackbench.core import compiled, elementary, linalg
from trackbench.core.arrays import Array, Mask, all_finite
from trackbench.core.random_streams import Streams

Kernel = Literal["epanechnikov", "gaussian"]


class Mode(NamedTuple):
    """Particles that one kernel moves."""

    members: Mask | None
    """particles (M, N) of the mode; None for all"""
    share: Array | None
    """their share of the weight (M,); None for all"""
    cov: Array
    """their covariance (n, n, M)"""


def bandwidth(n: int, N: Array | int, kernel: Kernel) -> Array:
    """Choose the optimal bandwidth for N particles in n dimensions.

    Epanechnikov: ``[8 (n + 4) (2 sqrt pi)^n / c_n]^(1/(n+4)) N^(-1/(n+4))`` with c_n the volume of the
    unit ball; Gaussian: ``[4 / (n + 2)]^(1/(n+4)) N^(-1/(n+4))``.

    Parameters
    ----------
    n : int
        Number of components of the state.
    N : int or array (M,)
        Number of particles, which may differ from run to run.
    kernel : {"epanechnikov", "gaussian"}
        Kernel.

    Returns
    -------
    array () or (M,)
        Bandwidth h, a factor on the root of the particles' covariance.
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
    """Draw from the standard kernel.

    An Epanechnikov draw, of the density c (1 - r^2), is the first n coordinates of a uniform point on
    the sphere in n + 4 dimensions: each dropped pair of coordinates raises the power of ``1 - r^2`` by
    one, from -1.

    Parameters
    ----------
    kernel : {"epanechnikov", "gaussian"}
        Kernel.
    shape : tuple of int
        Shape (n, *batch) of the draws, such as (n, M, N).
    rng : Streams
        Random numbers.

    Returns
    -------
    array (n, *batch)
        Draws of n components.
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
        Their covariance ``A A'``. In a run whose covariance has no Cholesky factor the particles stay
        where they are.
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


def jitter_if_measured(z: Array, resampled: Array, jittered: Array) -> Array:
    """Return the jittered particles of the runs that have a measurement.

    The other runs keep the ``resampled`` ones. Without a measurement resampling makes no copies that a
    jitter must move apart. It would only widen the particles, by a share of their covariance at every
    step, and so without bound.

    Parameters
    ----------
    z : array (n_z, M)
        Measurement. A run without a measurement has NaN in all components.
    resampled : array (n, M, N)
        Particles after resampling.
    jittered : array (n, M, N)
        Particles after `jitter` or `jitter_modes`.

    Returns
    -------
    array (n, M, N)
        Particles.
    """
    has_measurement: Mask = np.asarray(~np.isnan(z).all(axis=0))
    if has_measurement.all():
        return jittered
    return np.where(has_measurement[:, None], jittered, resampled)


def jitter_modes(
    x: Array, modes: Sequence[Mode], kernel: Kernel, rng: Streams, scale: float = 1.0
) -> Array:
    """Apply `jitter` to the particles of each mode, by its own bandwidth and covariance.

    Parameters
    ----------
    x : array (n, M, N)
        Particles.
    modes : sequence of Mode
        Members (M, N), share of the weight (M,) and covariance (n, n, M) of each mode. In a run whose
        covariance has no Cholesky factor the members stay where they are.
    kernel : {"epanechnikov", "gaussian"}
        Kernel.
    rng : Streams
        Random numbers.
    scale : float
        Factor on each bandwidth.

    Returns
    -------
    array (n, M, N)
        Moved particles. Particles of no mode stay where they are.
    """
    n, _, N = x.shape
    e = kernel_draws(kernel, x.shape, rng)
    for mode in modes:
        # Step 1: the bandwidth h for the mode's number of particles; without a share these are all N.
        # `_bandwidth_of_all` is `bandwidth`, with a cache: N stays the same from step to step.
        if mode.share is None:
            h = _bandwidth_of_all(n, N, kernel)
        else:
            h = bandwidth(n, np.maximum(mode.share * N, 1.0), kernel)
        # Step 2: move the mode's particles by scale h A e.
        x = _move_members(x, scale * h * _root_or_zero(mode.cov), e, mode.members)
    return x


def _move_members(x: Array, A: Array, e: Array, members: Mask | None) -> Array:
    """Move the members (M, N) to ``x + A e`` for a lower triangle per run A (n, n, M).

    x and e are (n, M, N). All particles are members if ``members`` is None.
    """
    mask = np.zeros(0, np.bool_) if members is None else members  # empty: all are members
    # The kernel reads only float64, one triangle per run, and a mask of all particles. An A that all
    # runs share (n, n, 1), or a mask with an axis of length one, is left to numpy.
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
