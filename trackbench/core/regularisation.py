"""Kernels that turn a resampled cloud into draws from a continuous density.

Musso, Oudjane & Le Gland (2001), section 12.2: whiten by the cloud's covariance, add ``h`` times a draw
from the kernel, with the bandwidth that is optimal for a Gaussian target.
"""

from math import gamma, pi, sqrt
from typing import Literal

import numpy as np

from trackbench.core import linalg
from trackbench.core.arrays import Array
from trackbench.core.streams import Streams

Kernel = Literal["epanechnikov", "gaussian"]


def bandwidth(n: int, N: int, kernel: Kernel) -> float:
    """Optimal bandwidth for N particles in n dimensions.

    Epanechnikov: ``[8 (n + 4) (2 sqrt pi)^n / c_n]^(1/(n+4)) N^(-1/(n+4))`` with c_n the volume of the
    unit ball; Gaussian: ``[4 / (n + 2)]^(1/(n+4)) N^(-1/(n+4))``.
    """
    if kernel == "gaussian":
        factor = 4.0 / (n + 2.0)
    else:
        ball = pi ** (n / 2) / gamma(n / 2 + 1)
        factor = 8.0 * (n + 4.0) * (2.0 * sqrt(pi)) ** n / ball
    return float((factor / N) ** (1.0 / (n + 4)))


def kernel_draws(kernel: Kernel, shape: tuple[int, ...], rng: Streams) -> Array:
    """Draws (n, *batch) from the standard kernel.

    An Epanechnikov draw is the first n coordinates of a uniform point on the sphere in n + 4
    dimensions (each dropped pair of coordinates raises the power of ``1 - r^2`` by one, from -1);
    the other four enter through their squared norm only, ``-2 log(u1 u2)``.
    """
    e = rng.standard_normal(shape)
    if kernel == "gaussian":
        return e
    u = rng.random((2, *shape[1:]))
    rest = -2.0 * np.log((1.0 - u[0]) * (1.0 - u[1]))
    norm = np.sqrt(np.square(e).sum(axis=0) + rest)
    e /= norm
    return e


def jitter(x: Array, cov: Array, kernel: Kernel, rng: Streams, scale: float = 1.0) -> Array:
    """``x + scale h A e`` for a cloud x (n, M, N), with ``A A'`` the cloud's covariance (n, n, M).

    A cloud without spread in some direction (its covariance is singular) is left as it is.
    """
    n, _, N = x.shape
    A = linalg.cholesky(cov)
    A = np.where(np.isfinite(A).all(axis=(0, 1)) | ~np.isfinite(cov).all(axis=(0, 1)), A, 0.0)
    e = kernel_draws(kernel, x.shape, rng)
    moved = linalg.lower_product((scale * bandwidth(n, N, kernel) * A)[..., None], e)
    moved += x
    return moved
