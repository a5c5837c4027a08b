"""Point estimates over runs with their standard errors.

Every function takes values per run (M,), lost runs already left out, and returns (value, stderr). With
fewer than two runs the standard error is NaN.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array

# A collapsed cloud has an infinite NEES: its mean says so, its standard error is NaN.
_quietly = np.errstate(all="ignore")


class Estimate(NamedTuple):
    """A number and its standard error."""

    value: float
    stderr: float


@_quietly
def mean(x: Array) -> Estimate:
    """Sample mean, ``s / sqrt(M)``."""
    return Estimate(_mean(x), _sd(x) / np.sqrt(max(len(x), 1)))


@_quietly
def variance(x: Array) -> Estimate:
    """Unbiased variance; its variance is ``(m4 - s^4 (M - 3) / (M - 1)) / M`` (Cramer 1946, 27.4)."""
    M = len(x)
    if M < 2:
        return Estimate(np.nan, np.nan)
    s2 = x.var(ddof=1)  # a numpy scalar: its square overflows to infinity, not to an exception
    if M < 4:
        return Estimate(float(s2), np.nan)
    m4 = ((x - x.mean()) ** 4).mean()
    spread = np.maximum(m4 - s2**2 * (M - 3) / (M - 1), 0.0)
    return Estimate(float(s2), float(np.sqrt(spread / M)))


@_quietly
def rms(x: Array) -> Estimate:
    """Root mean square (eq. 15 of the hdepf paper for per-run RMSEs); delta method."""
    squares = mean(np.square(x))
    value = float(np.sqrt(squares.value))
    return Estimate(value, squares.stderr / (2.0 * value) if value > 0 else 0.0)


@_quietly
def median(x: Array) -> Estimate:
    """Median; standard error from the binomial interval of its rank (+-1 standard deviation)."""
    M = len(x)
    if M < 2:
        return Estimate(_mean(x), np.nan)
    ranked = np.sort(x)
    low = max(int(np.floor(0.5 * M - 0.5 * np.sqrt(M))), 0)
    high = min(int(np.ceil(0.5 * M + 0.5 * np.sqrt(M))), M - 1)
    return Estimate(float(np.median(x)), float(ranked[high] - ranked[low]) / 2.0)


STATISTICS: dict[str, Callable[[Array], Estimate]] = {
    "mean": mean,
    "variance": variance,
    "rms": rms,
    "median": median,
}


@_quietly
def relative_gain(a: Array, b: Array) -> Estimate:
    """``1 - rms(a) / rms(b)`` of two filters on common runs, paired; delta method on the ratio."""
    A, B = np.square(a), np.square(b)
    mean_a, mean_b = _mean(A), _mean(B)
    ratio = np.sqrt(mean_a / mean_b)
    # d ratio = ratio / 2 (dA / mean A - dB / mean B)
    influence = 0.5 * ratio * (A / mean_a - B / mean_b)
    return Estimate(float(1.0 - ratio), _sd(influence) / np.sqrt(max(len(a), 1)))


@_quietly
def mean_from_sums(total: float, squares: float, count: float) -> Estimate:
    """Mean and standard error from a sum, a sum of squares and a number of values."""
    if count < 1:
        return Estimate(np.nan, np.nan)
    value = total / count
    if count < 2:
        return Estimate(value, np.nan)
    spread = max(squares - count * value**2, 0.0) / (count - 1)
    return Estimate(value, float(np.sqrt(spread / count)))


def root(estimate: Estimate) -> Estimate:
    """Square root of an estimate; delta method."""
    value = float(np.sqrt(estimate.value))
    return Estimate(value, estimate.stderr / (2.0 * value) if value > 0 else estimate.stderr)


def _mean(x: Array) -> float:
    return float(x.mean()) if len(x) else np.nan


def _sd(x: Array) -> float:
    return float(x.std(ddof=1)) if len(x) > 1 else np.nan
