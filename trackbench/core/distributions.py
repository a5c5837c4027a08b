"""Distributions: samples, densities and the first two moments.

One statement of a model, ``p(x_k | x_{k-1})`` as a distribution, serves the simulation, the particle
filters, the proposals and the Kalman moments.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from trackbench.core import compiled, elementary, linalg
from trackbench.core.arrays import Array, all_finite, with_trailing
from trackbench.core.elementary import log
from trackbench.core.elementary_tables import log_table
from trackbench.core.random_streams import Streams

LOG_2PI = 1.8378770664093453
_SQRT_2 = 1.4142135623730951
_LOG_2 = 0.6931471805599453
_MOST_TWOS = 1000  # exponent of two of a normal number


class Distribution(Protocol):
    """A density over vectors ``(n, *batch)``, as motions, sensors and starts return it."""

    @property
    def mean(self) -> Array:
        """Mean (n, *batch)."""

    @property
    def cov(self) -> Array:
        """Covariance (n, n) or (n, n, *batch)."""

    @property
    def loc(self) -> Array:
        """Value without its noise (n, *batch): the mean, if the noise has mean zero."""

    @property
    def mode(self) -> Array:
        """Point of highest density (n, *batch)."""

    def sample(self, rng: Streams, *trailing: int) -> Array:
        """Draw from the distribution.

        Parameters
        ----------
        rng : Streams
            Random numbers.
        *trailing : int
            Lengths of further axes, such as the number N of particles.

        Returns
        -------
        array (n, *batch, *trailing)
            One draw per batch member and trailing index.
        """

    def log_prob(self, x: Array) -> Array:
        """Evaluate the log-density.

        Parameters
        ----------
        x : array (n, ...)
            Points, whose further axes are broadcast against the batch.

        Returns
        -------
        array (...)
            Log-density at each point.
        """


class Symmetric:
    """Base of distributions whose mode, and value without noise, is the mean."""

    @property
    def loc(self: Distribution) -> Array:
        """Mean."""
        return self.mean

    @property
    def mode(self: Distribution) -> Array:
        """Mean."""
        return self.mean


@dataclass(frozen=True)
class Gaussian(Symmetric):
    """N(mean, cov): mean (n, *batch), cov (n, n) or (n, n, *batch)."""

    mean: Array
    cov: Array

    @cached_property
    def _root(self) -> Array:
        return linalg.cholesky(self.cov)

    def sample(self, rng: Streams, *trailing: int) -> Array:
        """Draw ``mean + L e`` (n, M, *trailing) with e standard normal."""
        shape = self.mean.shape + trailing
        noise = rng.standard_normal(shape)
        # A covariance without a Cholesky factor needs the semidefinite root.
        root = self._root if all_finite(self._root) else linalg.root(self.cov)
        if root.size == len(root) ** 2:
            # One factor for all runs, perhaps as (n, n, 1): as (n, n) it is applied without its zeros.
            root = root.reshape(root.shape[:2])
        if root.ndim > 2:
            root = with_trailing(root, len(shape) - 1, leading=2)
        # x = mean + L e
        x = linalg.matvec(root, noise)
        x += with_trailing(self.mean, len(shape) - 1)
        return x

    def log_prob(self, x: Array) -> Array:
        """Evaluate the log-density, ``-(e' P^-1 e + log det P + n log 2 pi) / 2``."""
        return zero_mean_log_prob(x - self.mean, self.cov, self._root)


@dataclass(frozen=True)
class Factored(Gaussian):
    """N(mean, L L') with the factor L (n, n[, *batch]) that a square-root filter carries."""

    root: Array


def from_root(mean: Array, root: Array) -> Factored:
    """Make N(mean, L L') of its lower factor.

    Parameters
    ----------
    mean : array (n, *batch)
        Mean.
    root : array (n, n[, *batch])
        Lower factor L.

    Returns
    -------
    Factored
        Gaussian with its covariance (n, n[, *batch]), which carries L.
    """
    return Factored(mean, linalg.matmul(root, linalg.transpose(root)), root)


def root_of(state: Gaussian) -> Array:
    """Return the lower factor (n, n[, *batch]) that a Gaussian carries, or that of its covariance."""
    return state.root if isinstance(state, Factored) else linalg.root(state.cov)


def per_run_moments(distribution: Distribution) -> Gaussian:
    """Give each run a covariance of its own.

    Parameters
    ----------
    distribution : Distribution
        Mean (n, M), and a covariance (n, n), (n, n, 1) or (n, n, M).

    Returns
    -------
    Gaussian
        Mean (n, M) and covariance (n, n, M), which is read-only if the runs share one.
    """
    mean = distribution.mean
    cov = distribution.cov
    n, runs = mean.shape
    if cov.shape != (n, n, runs):
        cov = np.broadcast_to(with_trailing(cov, 1, leading=2), (n, n, runs))
    return Gaussian(mean, cov)


def zero_mean_log_prob(e: Array, cov: Array, root: Array | None = None) -> Array:
    """Evaluate log N(e; 0, cov), ``-(e' P^-1 e + log det P + n log 2 pi) / 2``.

    Parameters
    ----------
    e : array (n, *batch)
        Errors.
    cov : array (n, n) or (n, n, *batch)
        Covariances P.
    root : array (n, n) or (n, n, *batch), optional
        Cholesky factor of P, if it is known.

    Returns
    -------
    array (*batch)
        Log-densities.
    """
    # Step 1: e' P^-1 e / 2 as the sum of squares of (sqrt(2) L)^-1 e.
    L = linalg.cholesky(cov) if root is None else root
    log_norm = 0.5 * len(e) * LOG_2PI
    if compiled.kernels and e.ndim > 1:
        out = np.empty(e.shape[1:])
        # The kernel returns False for arrays that it leaves to numpy.
        if compiled.kernels.log_prob(log_table(), L, e, out, log_norm):
            return out
    rows = linalg.whiten(_SQRT_2 * L, e)
    exponent = rows[0]
    exponent *= exponent
    for row in rows[1:]:
        row *= row
        exponent += row
    # Step 2: sqrt(det P) = m 2^e is the product of the diagonal of L.
    mantissa, exponent_of_two = linalg.root_determinant(L)
    # Powers of two beyond the range of floats are added as logarithms.
    within = np.clip(exponent_of_two, -_MOST_TWOS, _MOST_TWOS)
    log_scale = elementary.log(np.ldexp(mantissa, within))
    log_scale = log_scale + (exponent_of_two - within) * _LOG_2 + log_norm
    return np.subtract(-log_scale, exponent, out=exponent)


@dataclass(frozen=True)
class PointMass(Symmetric):
    """A known value (n, *batch): a distribution without spread."""

    mean: Array

    @property
    def cov(self) -> Array:
        """Zeros (n, n)."""
        return np.zeros((len(self.mean),) * 2)

    def sample(self, rng: Streams, *trailing: int) -> Array:
        """Repeat the value along the trailing axes."""
        shape = self.mean.shape + trailing
        return np.broadcast_to(with_trailing(self.mean, len(shape) - 1), shape).copy()

    def log_prob(self, x: Array) -> Array:
        """Return zero at the value and -inf elsewhere."""
        return np.where((x == self.mean).all(axis=0), 0.0, -np.inf)


@dataclass(frozen=True)
class Uniform(Symmetric):
    """Independent uniform components between low and high (n,), in each of M runs.

    A component with ``low = high`` is known.
    """

    low: Array
    high: Array
    runs: int

    @property
    def mean(self) -> Array:
        """Centers (n, M)."""
        return np.tile((0.5 * (self.low + self.high))[:, None], (1, self.runs))

    @property
    def cov(self) -> Array:
        """Diagonal (n, n) of ``(high - low)^2 / 12``."""
        return np.diag(np.square(self.high - self.low) / 12.0)

    def sample(self, rng: Streams, *trailing: int) -> Array:
        """Draw ``low + (high - low) u`` (n, M, *trailing) with u uniform in [0, 1)."""
        u = rng.random((len(self.low), self.runs, *trailing))
        low = with_trailing(self.low, u.ndim - 1)
        width = with_trailing(self.high - self.low, u.ndim - 1)
        return low + width * u

    def log_prob(self, x: Array) -> Array:
        """Compute ``-sum log(high - low)`` within the limits and -inf outside."""
        low = with_trailing(self.low, x.ndim - 1)
        high = with_trailing(self.high, x.ndim - 1)
        inside = ((x >= low) & (x <= high)).all(axis=0)
        width = self.high - self.low
        # A known component, of width zero, is left out.
        log_volume = 0.0
        for log_width in log(width[width > 0.0]):
            log_volume += float(log_width)
        return np.where(inside, -log_volume, -np.inf)

    def intervals(self, deviations: float) -> list[tuple[Array, Array]]:
        """Return the limits of a scalar.

        Parameters
        ----------
        deviations : float
            Standard deviations that an interval of a normal part includes. It has no effect here.

        Returns
        -------
        list of (low, high)
            One interval, with ends (M,) each.
        """
        return [(np.full(self.runs, self.low[0]), np.full(self.runs, self.high[0]))]
