"""Noise of sensors: Student's t, mixtures with outliers, counts, and scaled standard deviations."""

from collections.abc import Callable
from dataclasses import dataclass
from math import inf, pi
from typing import Literal

import numpy as np

from trackbench.core.arrays import Array, with_trailing
from trackbench.core.distributions import LOG_2PI, Gaussian
from trackbench.core.elementary import cos_sin, exp, expm1, log, log_gamma, logaddexp
from trackbench.core.random_streams import Streams
from trackbench.core.sums import total
from trackbench.field_types import InvalidKeyError, OpenShare, Positive
from trackbench.models.sensors.stacked import Sensors

NoiseKind = Literal["student-t", "mixture", "poisson"]
_KEYS = {"student-t": ("df", "scale"), "mixture": ("outliers", "factor"), "poisson": ()}
_REQUIRED = {"student-t": ("df",), "mixture": ("outliers", "factor"), "poisson": ()}
_RADII = 4001  # points of the integral of the mixture's Fisher information
_HALF_ULP = 2.0**-54  # moves uniforms of [0, 1) into (0, 1)


@dataclass(frozen=True, kw_only=True)
class Noise:
    """Noise of each component of a measurement, independent of the others.

    ``student-t`` is ``scale root(R)`` times a Student t variate. ``mixture`` is N(0, R), and
    N(0, factor^2 R) for a share of ``outliers``. ``poisson`` is a count of rate h(x).
    """

    kind: NoiseKind
    """student-t, mixture or poisson"""
    df: Positive | None = None
    """degrees of freedom of Student's t"""
    scale: Positive = 1.0
    """factor on the root of R, which is 1 unless it is set"""
    outliers: OpenShare | None = None
    """share of outliers of a mixture"""
    factor: Positive | None = None
    """ratio of the outliers' standard deviation to that of the others"""

    def check_keys(self) -> None:
        """Raise InvalidKeyError if a key of the noise's kind is missing, or belongs to another kind."""
        values = {"df": self.df, "outliers": self.outliers, "factor": self.factor}
        # A scale of 1 is the default, so it counts as unset.
        values["scale"] = None if self.scale == 1.0 else self.scale
        for key, value in values.items():
            if value is not None and key not in _KEYS[self.kind]:
                raise InvalidKeyError(f"is no key of `{self.kind}`", "noise", key)
            if value is None and key in _REQUIRED[self.kind]:
                raise InvalidKeyError(f"`{self.kind}` needs `{key}`", "noise")

    @property
    def variance(self) -> float:
        """Variance of the noise of a component with R = 1; infinite for Student's t with df <= 2."""
        if self.df is not None and self.df <= 2.0:
            return inf
        if self.df is not None:
            return self.scale * self.scale * self.df / (self.df - 2.0)
        share, factor = self._mixture
        return 1.0 + share * (factor * factor - 1.0)

    @property
    def why_no_variance(self) -> str:
        """Reason why the noise has no variance; empty if it has one."""
        if self.df is None or self.variance < inf:
            return ""
        return f"Student's t of df {self.df:g} has no variance, which needs df > 2"

    @property
    def _mixture(self) -> tuple[float, float]:
        """Share of outliers, and the factor on their standard deviation."""
        assert self.outliers is not None
        assert self.factor is not None
        return self.outliers, self.factor

    def log_density(self, e: Array) -> Array:
        """Evaluate the log-density of the noise of a component with R = 1.

        Parameters
        ----------
        e : array (...)
            Errors, divided by the root of R.

        Returns
        -------
        array (...)
            Log-density at each error.
        """
        if self.df is not None:
            return self._log_student_t(e, self.df)
        share, factor = self._mixture
        # log((1 - p) N(e; 0, 1) + p N(e; 0, f^2))
        half = 0.5 * np.square(e)
        regular = float(log(1.0 - share)) - 0.5 * LOG_2PI - half
        ratio = float(log(share / factor))
        outlier = ratio - 0.5 * LOG_2PI - half / (factor * factor)
        return logaddexp(regular, outlier)

    def _log_student_t(self, e: Array, df: float) -> Array:
        """Evaluate the log-density of Student's t of df degrees of freedom at e (...)."""
        # log Gamma((v+1)/2) - log Gamma(v/2) - log(pi v s^2)/2 - (v+1)/2 log(1 + e^2 / (v s^2))
        spread = df * self.scale * self.scale
        norm = log_gamma(0.5 * (df + 1.0)) - log_gamma(0.5 * df) - 0.5 * float(log(pi * spread))
        return norm - 0.5 * (df + 1.0) * log(1.0 + np.square(e) / spread)

    def draw(self, normal: Array, rng: Streams) -> Array:
        """Draw noise for R = 1.

        Student's t then has the scale `scale`, and the part of a mixture without outliers the variance
        one. `variance` is that of the whole noise.

        Parameters
        ----------
        normal : array (n_z, M)
            Standard normal noise. Student's t uses only its shape.
        rng : Streams
            Uniform random numbers, for the law of the noise.

        Returns
        -------
        array (n_z, M)
            Noise, to be multiplied by the root of R.
        """
        if self.df is not None:
            # t = sqrt(v (u^(-2/v) - 1)) cos(2 pi w) of uniform u, w (Bailey 1994, eq. 2). Half a unit in
            # the last place is added to u, which may be zero.
            u, w = rng.random((2, *normal.shape))
            radius = np.sqrt(self.df * expm1(-2.0 / self.df * log(u + _HALF_ULP)))
            return self.scale * radius * cos_sin(2.0 * pi * w)[0]
        share, factor = self._mixture
        is_outlier = rng.random(normal.shape) < share
        return np.where(is_outlier, factor * normal, normal)

    @property
    def information(self) -> float:
        """Fisher information about its mean of a component with R = 1."""
        if self.df is not None:
            return (self.df + 1.0) / (self.df + 3.0) / (self.scale * self.scale)
        share, factor = self._mixture
        # Integral of p'(e)^2 / p(e), by the trapezoidal rule over e = sinh(s) in both tails.
        # The nodes are dense within the narrowest sigma, and reach to 40 of the widest.
        widest = max(factor, 1.0)
        narrowest = min(factor, 1.0)
        s = np.linspace(-1.0, 1.0, _RADII) * float(log(80.0 * widest / narrowest))
        e = 0.5 * narrowest * (exp(s) - exp(-s))
        step = 0.5 * narrowest * (exp(s) + exp(-s)) * (s[1] - s[0])
        log_p = self.log_density(e)
        regular = exp(float(log(1.0 - share)) - 0.5 * LOG_2PI - 0.5 * e * e - log_p)
        # The score p'/p weighs both precisions by their posterior probabilities.
        score = -e * (regular + (1.0 - regular) / (factor * factor))
        return float(total(exp(log_p) * score * score * step))


@dataclass(frozen=True, eq=False)
class ScaledNoise:
    """A sensor whose standard deviations have factors (n_z, T), from step ``first`` on."""

    sensor: Sensors
    first: int
    scales: Array

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the measurement's components, in order."""
        return self.sensor.components

    def measurement(self, x: Array, k: int) -> Gaussian:
        """Return N(h(x), D R D) of z_k given x_k = x (n_x, *batch).

        The diagonal of D are the factors of step k on the standard deviations.
        """
        unscaled = self.sensor.measurement(x, k)
        d = self.scales[:, k - self.first]
        factors = with_trailing(np.outer(d, d), unscaled.cov.ndim - 2, leading=2)
        return Gaussian(unscaled.mean, unscaled.cov * factors)

    def innovation(self, z: Array, z_pred: Array) -> Array:
        """Return ``z - z_pred``, angles wrapped."""
        return self.sensor.innovation(z, z_pred)

    def jacobian(self, x: Array, k: int) -> Array:
        """Return d E[z_k] / d x_k (n_z, n_x[, *batch])."""
        return self.sensor.jacobian(x, k)

    @property
    def H(self) -> Callable[[int], Array]:
        """H (n_z, n) as a function of n; AttributeError if the sensor is nonlinear."""
        return self.sensor.H  # type: ignore[union-attr]

    @property
    def linear(self) -> bool:
        """Return True; AttributeError if the sensor is nonlinear."""
        return self.sensor.linear  # type: ignore[union-attr]
