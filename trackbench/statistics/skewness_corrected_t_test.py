"""Tests and intervals of a number from the influence that each run has on it, also if these are skewed.

``influences`` (M,) are centered values whose mean has the number's error
(`sample_statistics.influence`); those that are NaN do not count. A sample without its far tail is both
too low and too sure of it, so that the number over its standard error, T, is neither symmetric nor has
it Student's M - 1 degrees of freedom.

- Skewness: Hall's cubic (1992, J. R. Statist. Soc. B 54, 221), ``g(T) = T + a T^2 / 3 + a^2 T^3 / 27 +
  a / 6`` with ``a`` the influences' skewness over ``sqrt(M)``, is symmetric to first order. It is
  monotone, so that it gives intervals, too.
- Kurtosis k: the estimated variance has a relative one of ``(k - 1) / M``, as a chi-square of
  ``2 M / (k - 1)`` degrees of freedom has (Satterthwaite 1946, Biometrics Bull. 2, 110); Student's t of
  g(T) has these, and M - 1 at most.

95 % intervals of means, variances, root mean squares, their ratios and differences, of a few hundred
values with a lognormal tail (sigma 1) cover 93 to 96 % by that, where plain Student's t covers 73 to
92 % (tests/statistics/test_coverage.py). A logarithmic scale and a bootstrap-t are no better. A
difference of variances has limits of its own (`limits_of_differences`).
"""

from math import copysign
from typing import NamedTuple, TypeVar

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.elementary import power
from trackbench.core.sums import total
from trackbench.statistics.student_t import deviations, normal_of_t, normals_of_t, t_of_normal


class Spread(NamedTuple):
    """Standard error, Hall's ``a``, degrees of freedom."""

    stderr: float
    skewness: float
    freedom: float

    def below(self, z: float) -> float:
        """Return the distance down to the hypothesis at z standard deviations."""
        return self.stderr * _inverse_of_hall(t_of_normal(z, self.freedom), self.skewness)

    def above(self, z: float) -> float:
        """Return the distance up to the hypothesis at z standard deviations."""
        return -self.below(-z)


@np.errstate(all="ignore")
def studentized(value: float, influences: Array, other: float = 0.0) -> float:
    """Return z of the hypothesis that a number is zero, corrected for skewness.

    Parameters
    ----------
    value
        number
    influences
        influences (M,) of the runs on the number, NaN for lost runs
    other
        standard error of what the number is compared with, which is normal and independent of the runs

    Returns
    -------
    float
        z; NaN for fewer than two runs, and for a number 0 whose standard error is 0
    """
    error = spread(influences, other)
    T = float(np.divide(value, error.stderr))
    if error.skewness != 0.0:
        T += _skewness_term(T, error.skewness)
    return normal_of_t(T, error.freedom)


@np.errstate(all="ignore")
def studentized_rows(values: Array, influences: Array) -> Array:
    """Return `studentized` of several numbers, with the same bits.

    T, a number over its standard error, is corrected for skewness by Hall's cubic g(T) (Hall 1992,
    J. R. Statist. Soc. B 54, 221; the docstring of this file has the formula).

    Parameters
    ----------
    values
        numbers (n,)
    influences
        influences (n, M) of the runs on each number, without NaN

    Returns
    -------
    array (n,)
        z. It is also NaN if a number's influences are all zero or not finite; `studentized` may return a
        z for such a number
    """
    M = influences.shape[1]
    # Step 1: the standard errors of the numbers.
    stderr = np.sqrt(total(np.square(influences)) / (M * (M - 1.0)))
    # `spread` adds the error of what a number is compared with: sqrt(stderr^2 + other^2). Here there is
    # no other error, but the square and the root round, so that equal bits need them.
    total_stderr = np.sqrt(stderr * stderr)
    # Step 2: Hall's a, the skewness over sqrt(M), and the degrees of freedom from the kurtosis. The
    # least kurtosis is 1, that of two values alone.
    unit = influences / (stderr * np.sqrt(M - 1.0))[:, None]  # so that the mean square is one
    squares = np.square(unit)
    a = total(squares * unit) / M / np.sqrt(M)
    kurtosis = total(np.square(squares)) / M
    freedom = np.minimum(M - 1.0, 2.0 * M / np.maximum(kurtosis - 1.0, 1e-9))
    # `spread` multiplies a by the third power of the runs' share of the error, and divides the degrees
    # of freedom by its fourth power. Here the share is 1 but for rounding. The powers are Python's,
    # which have other last bits than numpy's.
    shares = (stderr / total_stderr).tolist()
    a = a * np.array([share**3 for share in shares])
    freedom = freedom / np.array([share**4 for share in shares])
    # Step 3: g(T), and the normal z of Student's t.
    T = values / total_stderr
    T = np.where(a != 0.0, T + _skewness_term(T, a), T)
    z = np.copysign(normals_of_t(np.abs(T), freedom), T)
    is_known = (stderr > 0.0) & np.isfinite(freedom) & np.isfinite(T)
    return np.where(is_known, z, np.nan)


Number = TypeVar("Number", float, Array)


def _skewness_term(T: Number, a: Number) -> Number:
    """Return ``g(T) - T = a / 6 + a T^2 / 3 + a^2 T^3 / 27``, Hall's correction for skewness."""
    return a * (1.0 / 6.0 + T * T / 3.0 + a * T * T * T / 27.0)


@np.errstate(all="ignore")
def interval_of(
    value: float, influences: Array, level: float = 0.95, other: float = 0.0
) -> tuple[float, float]:
    """Return the confidence interval of ``value``: all true values that `studentized` accepts.

    ``influences`` (M,) are those of the runs on the number. ``other`` is the standard error of what the
    number is compared with, independent of the runs.
    """
    error = spread(influences, other)
    z = deviations(level)
    return value - error.below(z), value + error.above(z)


def spread(influences: Array, other: float = 0.0) -> Spread:
    """Return standard error, skewness and degrees of freedom of the mean of influences.

    Parameters
    ----------
    influences
        influences (M,) of the runs on a number, centered: their mean is zero. A run without a value has
        NaN and does not count
    other
        normal and independent standard error, whose variance is added. It reduces the skewness and
        raises the degrees of freedom

    Returns
    -------
    Spread
        standard error, Hall's a and degrees of freedom; NaN for fewer than two runs
    """
    x = influences[~np.isnan(influences)]
    M = len(x)
    if M < 2:
        return Spread(np.nan, np.nan, np.nan)
    # Standard error sqrt(sum x^2 / (M (M - 1))); the other's variance is added.
    stderr = float(np.sqrt(total(np.square(x)) / (M * (M - 1.0))))
    whole = float(np.sqrt(stderr * stderr + other * other))
    if not stderr > 0.0:
        # All of the error, if there is any, is the other's, which is normal.
        freedom = M - 1.0
        if whole > 0.0:
            freedom = np.inf
        return Spread(whole, 0.0, freedom)
    unit = x / (stderr * np.sqrt(M - 1.0))  # so that the mean square is one
    squares = np.square(unit)
    share = stderr / whole
    if not share**4 > 0.0:  # the same but for rounding
        return Spread(whole, 0.0, np.inf)
    # Hall's a and Satterthwaite's degrees of freedom, from the third and fourth moment. A kurtosis of 1
    # is that of two values alone.
    kurtosis = float(total(np.square(squares))) / M
    a = float(total(squares * unit)) / M / np.sqrt(M) * share**3
    freedom = min(M - 1.0, 2.0 * M / max(kurtosis - 1.0, 1e-9))
    return Spread(stderr=whole, skewness=float(a), freedom=freedom / share**4)


def _inverse_of_hall(y: float, a: float) -> float:
    """Return the T for which Hall's cubic g(T) is y: ``(1 + a T / 3)^3 = 1 + a (y - a / 6)``.

    a is the influences' skewness over sqrt(M), and T a number over its standard error.
    """
    if abs(a) < 1e-6:
        return y  # its limit, without a division by zero
    # T = 3 / a ((1 + a (y - a / 6))^(1/3) - 1)
    cube = 1.0 + a * (y - a / 6.0)
    return 3.0 / a * (copysign(float(power(abs(cube), 1.0 / 3.0)), cube) - 1.0)
