"""Weighted particles, and their moments.

A particle set is x (n, M, N) with weights (M, N): N particles in each of M runs.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from trackbench.core import compiled
from trackbench.core.arrays import Array, with_axes_of
from trackbench.core.distributions import Gaussian
from trackbench.core.sums import dot, total


class Particles(NamedTuple):
    """Particles x (n, M, N) with normalized weights w (M, N)."""

    x: Array
    w: Array

    @property
    def mean(self) -> Array:
        """Weighted mean (n, M)."""
        return dot(self.x, self.w)

    def expectation(self, g: Callable[[Array], dict[str, Array]]) -> dict[str, Array]:
        """Average functions of the particles by their weights.

        Parameters
        ----------
        g : callable
            Functions of the particles x (n, M, N): a dictionary of the values (M, N) by name.

        Returns
        -------
        dict of array (M,)
            Average of each function in each run.
        """
        return {name: dot(self.w, v) for name, v in g(self.x).items()}

    def moments(self) -> Gaussian:
        """Compute weighted mean and covariance, about the mean to keep digits.

        Returns
        -------
        Gaussian
            Mean (n, M) and covariance (n, n, M).
        """
        x = np.asarray(self.x, dtype=np.float64)
        if compiled.kernels:
            n, runs, _ = x.shape
            mean = np.empty((n, runs))
            cov = np.empty((n, n, runs))
            w = np.ascontiguousarray(self.w, dtype=np.float64)
            # The kernel takes the number n of components from its last argument.
            compiled.kernels.moments(np.ascontiguousarray(x), w, mean, cov, n)
            return Gaussian(mean, cov)
        # Step 1: m = sum_i w_i x_i.
        products = x * self.w
        mean = total(products)
        e = x - mean[..., None]
        # Step 2: P = sum_i w_i e_i e_i', row by row up to the diagonal; products is reused as memory.
        n = len(e)
        weighted = np.empty_like(x[0])
        cov = np.empty((n, n, *mean.shape[1:]))
        for i in range(n):
            np.multiply(e[i], self.w, out=weighted)
            np.multiply(e[: i + 1], weighted, out=products[: i + 1])
            cov[i, : i + 1] = cov[: i + 1, i] = total(products[: i + 1])
        return Gaussian(mean, cov)


def moments_together(estimate: Gaussian, cloud: Particles, together: Particles) -> Gaussian:
    """Replace the estimate by the moments of ``together`` in runs where it differs from ``cloud``.

    Parameters
    ----------
    estimate : Gaussian
        Mean (n, M) and covariance (n, n[, M]) of the state.
    cloud : Particles
        Particles x (n, M, N), weights (M, N).
    together : Particles
        Particles of ``cloud`` with their angles shifted by `bring_together`.

    Returns
    -------
    Gaussian
        Mean (n, M) and covariance (n, n, M). If no angle was shifted, it is the ``estimate`` itself.
    """
    shifted = (cloud.x != together.x).any(axis=(0, 2))
    if not shifted.any():
        return estimate
    moments = together.moments()
    mean = np.where(shifted, moments.mean, estimate.mean)
    return Gaussian(mean, np.where(shifted, moments.cov, with_axes_of(moments.cov, estimate.cov)))


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
    # The C kernel takes contiguous doubles only.
    alike = x.dtype == nu.dtype == np.float64 and nu.shape == (2, *x.shape[1:])
    if compiled.kernels and alike and x.flags.c_contiguous:
        compiled.kernels.displaced(x, np.ascontiguousarray(nu), out, T, K)
        return out
    out[0::2] = T * x[1::2] + x[0::2] + nu
    out[1::2] = K * nu + x[1::2]
    return out
