"""Gamma variates and noise of a gamma law: draws, density, moments."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from trackbench.core import compiled, elementary
from trackbench.core.arrays import Array, with_trailing
from trackbench.core.elementary_tables import log_table
from trackbench.core.random_streams import Streams
from trackbench.core.read_only import fixed

_SMALLEST = float(np.finfo(float).tiny)


@dataclass(frozen=True)
class Gamma:
    """A scalar Gamma(shape, rate) variate as a vector (1, *batch): mean shape/rate."""

    shape: float
    rate: float

    @property
    def expectation(self) -> float:
        """Shape / rate."""
        return self.shape / self.rate

    @property
    def variance(self) -> float:
        """Shape / rate^2."""
        return self.shape / (self.rate * self.rate)

    @cached_property
    def cov(self) -> Array:
        """Variance as a matrix (1, 1)."""
        return fixed(np.array([[self.variance]]))

    @property
    def peak(self) -> float:
        """Value of highest density: (shape - 1) / rate, or zero."""
        return max(self.shape - 1.0, 0.0) / self.rate

    def draw(self, rng: Streams, size: tuple[int, ...]) -> Array:
        """Draw variates.

        Parameters
        ----------
        rng : Streams
            Random numbers.
        size : tuple of int
            Shape of the result, such as (1, M, N).

        Returns
        -------
        array (*size)
            Independent variates.
        """
        x: Array = rng.standard_gamma(self.shape, size)
        x *= 1.0 / self.rate
        return x

    def density(self, v: Array) -> Array:
        """Evaluate the density.

        Parameters
        ----------
        v : array (...)
            Values of the variate.

        Returns
        -------
        array (...)
            Density at each value. Where v < 0 it is zero, or the value of its formula if
            ``has_integer_shape``. The formula is smooth across zero, as a quadrature up to an edge
            inside a panel needs it (`grid_quadrature`). At zero the density of a shape below 1 is
            infinite.
        """
        base = v if self.has_integer_shape else np.maximum(v, 0.0)
        # p(v) = exp(log_norm - rate v) v^(shape - 1)
        density = base * -self.rate
        density += self._log_norm
        density = elementary.exp(density, out=density)
        density *= elementary.power(base, self.shape - 1.0)
        if self.shape < 1.0:
            density[v < 0.0] = 0.0
        return density

    @property
    def has_integer_shape(self) -> bool:
        """True if the shape is an integer, so that the density's formula is smooth across zero."""
        return self.shape == int(self.shape)

    def log_density(self, v: Array) -> Array:
        """Evaluate the log-density.

        Parameters
        ----------
        v : array (...)
            Values of the variate.

        Returns
        -------
        array (...)
            Log-density at each value, -inf where v <= 0.
        """
        # log p(v) = (shape - 1) log v - rate v + log_norm
        if compiled.kernels and v.dtype == np.float64:
            out = np.empty(v.shape)
            v = np.ascontiguousarray(v)
            compiled.kernels.gamma_log_density(
                log_table(), v, out, self.shape - 1.0, self.rate, self._log_norm
            )
            return out
        # Any number above zero stands for v <= 0, whose result is replaced at the end.
        log_p = np.maximum(v, _SMALLEST)
        log_p = elementary.log(log_p, out=log_p)
        log_p *= self.shape - 1.0
        log_p -= self.rate * v
        log_p += self._log_norm
        return np.where(v <= 0.0, -np.inf, log_p)

    @cached_property
    def _log_norm(self) -> float:
        """``log(rate^shape / Gamma(shape))``."""
        return float(self.shape * elementary.log(self.rate)) - elementary.log_gamma(self.shape)


@dataclass(frozen=True)
class Shifted:
    """``loc + v`` with v a scalar Gamma variate: loc (1, *batch)."""

    noise: Gamma
    loc: Array

    @property
    def mean(self) -> Array:
        """``loc`` plus the mean of the noise."""
        return self.loc + self.noise.expectation

    @property
    def mode(self) -> Array:
        """``loc`` plus the mode of the noise."""
        return self.loc + self.noise.peak

    @property
    def cov(self) -> Array:
        """The noise's variance (1, 1)."""
        return self.noise.cov

    def sample(self, rng: Streams, *trailing: int) -> Array:
        """Draw ``loc`` plus a fresh variate per batch member.

        Parameters
        ----------
        rng : Streams
            Random numbers.
        *trailing : int
            Lengths of further axes, such as the number N of particles.

        Returns
        -------
        array (1, *batch, *trailing)
            One draw per batch member and trailing index.
        """
        shape = self.loc.shape + trailing
        x = self.noise.draw(rng, shape)
        # `loc` (1, *batch) gets an axis of length one for each further axis; all but the first of
        # ``shape`` are batch axes.
        x += with_trailing(self.loc, len(shape) - 1)
        return x

    def prob(self, x: Array) -> Array:
        """Evaluate the density at x (1, ...), with the shape (...); below ``loc`` as `Gamma.density`."""
        return self.noise.density(x[0] - self.loc[0])

    def log_prob(self, x: Array) -> Array:
        """Evaluate the log-density at x (1, ...), with the shape (...); it is -inf below ``loc``."""
        return self.noise.log_density(x[0] - self.loc[0])
