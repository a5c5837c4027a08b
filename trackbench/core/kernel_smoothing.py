"""Kernel smoothing: make resampled particles draws from a continuous density.

Musso, Oudjane & Le Gland (2001), section 12.2: add ``h`` times a draw from the kernel, scaled by the
particles' covariance; the bandwidth h is optimal for a Gaussian target.
"""

from collections.abc import Sequence
from functools import lru_cache
from math import pi, sqrt
from typing import Literal, NamedTuple

import numpy as np

from trackbench.core import elementary, linalg
from trackbench.core.arrays import Array, Mask
from trackbench.core.random_streams import Streams

Kernel = Literal["epanechnikov", "gaussian"]


class Mode(NamedTuple):
    """A mode: its particles (M, N) and their share of the weight (M,), None for all; cov (n, n, M)."""

    members: Mask | None
    share: Array | None
    cov: Array


def bandwidth(n: int, N: Array | int, kernel: Kernel) -> Array:
    """Return the optimal bandwidth for N particles, () or (M,), in n dimensions.

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
    return (1.0, 2.0)[n] if n < 2 else 2.0 * pi / n * _unit_ball(n - 2)


def kernel_draws(kernel: Kernel, shape: tuple[int, ...], rng: Streams) -> Array:
    """Return draws (n, *batch) from the standard kernel.

    An Epanechnikov draw is the first n coordinates of a uniform point on the sphere in n + 4
    dimensions: each dropped pair of coordinates raises the power of ``1 - r^2`` by one, from -1.
    """
    e = rng.standard_normal(shape)
    if kernel == "gaussian":
        return e
    # The squared norm of the four dropped coordinates is chi-square: twice a Gamma(2) variate.
    square: Array = rng.standard_gamma(2, shape[1:])
    square *= 2.0
    for row in e:
        square += row * row
    e /= np.sqrt(square, out=square)
    return e


def jitter(x: Array, cov: Array, kernel: Kernel, rng: Streams, scale: float = 1.0) -> Array:
    """Return ``x + scale h A e`` for particles x (n, M, N) with covariance ``A A'`` (n, n, M).

    A run whose covariance is singular keeps its particles.
    """
    return jitter_modes(x, [Mode(None, None, cov)], kernel, rng, scale)


def jitter_modes(
    x: Array, modes: Sequence[Mode], kernel: Kernel, rng: Streams, scale: float = 1.0
) -> Array:
    """Apply `jitter` to the particles of each mode, with the mode's own bandwidth and covariance."""
    n, _, N = x.shape
    e = kernel_draws(kernel, x.shape, rng)
    for mode in modes:
        # Step 1: the bandwidth h for the mode's number of particles.
        if mode.share is None:
            h = _bandwidth_of_all(n, N, kernel)
        else:
            h = bandwidth(n, np.maximum(mode.share * N, 1.0), kernel)
        # Step 2: move the mode's particles by scale h A e.
        move = linalg.lower_product(scale * h * _spread(mode.cov), e)
        moved = move if mode.members is None else np.where(mode.members, move, 0.0)
        moved += x
        x = moved
    return x


@lru_cache
def _bandwidth_of_all(n: int, N: int, kernel: Kernel) -> Array:
    return bandwidth(n, N, kernel)


def _spread(cov: Array) -> Array:
    """Return the Cholesky factor (n, n, M), zero for a singular covariance."""
    A = linalg.cholesky(cov)
    return np.where(np.isfinite(A).all(axis=(0, 1)) | ~np.isfinite(cov).all(axis=(0, 1)), A, 0.0)
