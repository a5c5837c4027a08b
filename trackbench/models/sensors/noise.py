"""Measurement noise that is not Gaussian and that filters know: Student's t, mixtures, counts."""

from dataclasses import dataclass
from math import inf, pi
from typing import Literal

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.distributions import LOG_2PI
from trackbench.core.elementary import cos_sin, exp, expm1, log, log_gamma, logaddexp
from trackbench.core.random_streams import Streams
from trackbench.core.sums import total
from trackbench.field_types import InvalidKeyError, OpenShare, Positive

NoiseKind = Literal["student-t", "mixture", "poisson"]
_KEYS = {"student-t": ("df", "scale"), "mixture": ("outliers", "factor"), "poisson": ()}
_REQUIRED = {"student-t": ("df",), "mixture": ("outliers", "factor"), "poisson": ()}
_MAX_RATE = 1e6  # of a count, whose inversion takes some 20 sqrt(rate) steps
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
        """Raise InvalidKeyError for a key that the kind lacks or has not."""
        values = {"df": self.df, "outliers": self.outliers, "factor": self.factor}
        values["scale"] = None if self.scale == 1.0 else self.scale
        for key, value in values.items():
            if value is not None and key not in _KEYS[self.kind]:
                raise InvalidKeyError(f"is no key of `{self.kind}`", "noise", key)
            if value is None and key in _REQUIRED[self.kind]:
                raise InvalidKeyError(f"`{self.kind}` needs `{key}`", "noise")

    @property
    def variance(self) -> float:
        """Return the variance of a component of unit R; infinite for df <= 2."""
        if self.df is not None:
            return self.scale * self.scale * self.df / (self.df - 2.0) if self.df > 2.0 else inf
        share, factor = self._mixture
        return 1.0 + share * (factor * factor - 1.0)

    @property
    def _mixture(self) -> tuple[float, float]:
        """Return share and factor of the outliers."""
        assert self.outliers is not None
        assert self.factor is not None
        return self.outliers, self.factor

    def log_density(self, e: Array) -> Array:
        """Return the log-density of a component of unit R at e (...)."""
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
        # log Gamma((v+1)/2) - log Gamma(v/2) - log(pi v s^2)/2 - (v+1)/2 log(1 + e^2 / (v s^2))
        spread = df * self.scale * self.scale
        norm = log_gamma(0.5 * (df + 1.0)) - log_gamma(0.5 * df) - 0.5 * float(log(pi * spread))
        return norm - 0.5 * (df + 1.0) * log(1.0 + np.square(e) / spread)

    def draw(self, normal: Array, rng: Streams) -> Array:
        """Return variates of components of unit R (n_z, M), of normal ones or of uniforms."""
        if self.df is not None:
            # t = sqrt(v (u^(-2/v) - 1)) cos(2 pi w) of uniform u, w (Bailey 1994, eq. 2)
            u, w = rng.random((2, *normal.shape))
            radius = np.sqrt(self.df * expm1(-2.0 / self.df * log(u + _HALF_ULP)))
            return self.scale * radius * cos_sin(2.0 * pi * w)[0]
        share, factor = self._mixture
        is_outlier = rng.random(normal.shape) < share
        return np.where(is_outlier, factor * normal, normal)

    @property
    def information(self) -> float:
        """Return the Fisher information of a shift of a component of unit R."""
        if self.df is not None:
            return (self.df + 1.0) / (self.df + 3.0) / (self.scale * self.scale)
        share, factor = self._mixture
        # Integral of p'(e)^2 / p(e), by the trapezoidal rule over e = sinh(s) in both tails.
        widest, narrowest = max(factor, 1.0), min(factor, 1.0)
        s = np.linspace(-1.0, 1.0, _RADII) * float(log(80.0 * widest / narrowest))
        e = 0.5 * narrowest * (exp(s) - exp(-s))
        step = 0.5 * narrowest * (exp(s) + exp(-s)) * (s[1] - s[0])
        log_p = self.log_density(e)
        regular = exp(float(log(1.0 - share)) - 0.5 * LOG_2PI - 0.5 * e * e - log_p)
        # The score p'/p weighs both precisions by their posterior probabilities.
        score = -e * (regular + (1.0 - regular) / (factor * factor))
        return float(total(exp(log_p) * score * score * step))


def log_poisson(z: Array, rate: Array) -> Array:
    """Return the log-probability of counts z at a rate, -inf unless z is a whole number >= 0."""
    counts, index = np.unique(z, return_inverse=True)
    valid = (counts >= 0.0) & (counts == np.floor(counts))
    factorials = [log_gamma(n + 1.0) if ok else inf for n, ok in zip(counts, valid, strict=True)]
    log_factorial = np.array(factorials)[index].reshape(z.shape)
    # log p(z) = z log rate - rate - log z!; a rate of zero gives the count zero.
    with np.errstate(divide="ignore", invalid="ignore"):
        value = np.where(z == 0.0, 0.0, z * log(rate)) - rate - log_factorial
    return np.where(rate >= 0.0, value, -np.inf)


def draw_poisson(rate: Array, u: Array) -> Array:
    """Return counts of a rate (...) by inversion of uniforms (...); ValueError for no rate."""
    if not ((rate >= 0.0) & (rate <= _MAX_RATE)).all():
        wrong = rate[~((rate >= 0.0) & (rate <= _MAX_RATE))][0]
        raise ValueError(f"the rate of a count is {wrong:g}; it may be 0 to {_MAX_RATE:g}")
    # Step 1: begin nine standard deviations below the mean, beyond which lies 1e-17.
    reach = 9.0 * np.sqrt(rate)
    count = np.maximum(np.floor(rate - reach), 0.0)
    probability = exp(log_poisson(count, rate))
    below, last = probability.copy(), rate + reach + 40.0
    # Step 2: add probabilities until their sum exceeds u.
    while (further := (below <= u) & (count < last)).any():
        count = count + further
        probability = np.where(further, probability * rate / np.maximum(count, 1.0), probability)
        below = np.where(further, below + probability, below)
    return count
