"""Limits of the difference of two numbers, from the limits of both, and the test by these limits.

The errors of both numbers may be skewed and correlated. So a difference of two variances, or of two
shares of runs, is tested.
"""

from math import copysign, inf, sqrt
from typing import NamedTuple, Protocol

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.sums import total
from trackbench.statistics.skewness_corrected_t_test import spread
from trackbench.statistics.student_t import deviations

_FARTHEST = 1024.0
"""A z beyond which the search of `studentized_difference` ends with infinity."""
_CLOSE = 1e-10
"""Share of a z to which it is found."""


class Limits(Protocol):
    """Limits of a number."""

    def below(self, z: float) -> float:
        """Return the distance from the number down to its limit at z standard deviations."""

    def above(self, z: float) -> float:
        """Return the distance up to the upper limit."""


class Sides(NamedTuple):
    """Limits of a difference: both numbers' limits, and their correlation."""

    first: Limits
    second: Limits
    correlation: float = 0.0

    def below(self, z: float, other: float = 0.0) -> float:
        """Return the distance from the difference down to its limit.

        The difference ``first - second`` is least where the first number is low and the second high.

        Parameters
        ----------
        z
            standard deviations of the limit
        other
            independent normal standard error that the hypothesis has itself

        Returns
        -------
        float
            distance, not negative; infinite where a number has no limit
        """
        return self._together(self.first.below(z), self.second.above(z), z * other)

    def above(self, z: float, other: float = 0.0) -> float:
        """Return the distance up to the upper limit."""
        return self._together(self.first.above(z), self.second.below(z), z * other)

    def _together(self, a: float, b: float, other: float) -> float:
        """Return the distance of a difference from its limit, from the distances a and b of its numbers.

        ``other`` is the distance for the hypothesis's own error, which is independent of both.
        """
        if not a + b < inf:
            return inf
        # d^2 = a^2 + b^2 - 2 rho a b, plus the hypothesis' own variance
        square = a * a + b * b - 2.0 * self.correlation * a * b
        return sqrt(max(square, 0.0) + other * other)


def of_variances(first: Array, second: Array) -> Sides | None:
    """Return the limits of the difference of two variances; None if a standard error is zero.

    ``first`` and ``second`` are the influences (M,) of the runs on both variances, NaN for lost runs.
    """
    if not all((np.nan_to_num(x) != 0.0).any() for x in (first, second, first - second)):
        return None
    return Sides(spread(first), spread(second), correlation(first, second))


def correlation(a: Array, b: Array) -> float:
    """Return the correlation of two numbers.

    Parameters
    ----------
    a, b
        influences (M,) of the same runs on both numbers, NaN for lost runs

    Returns
    -------
    float
        correlation from -1 to 1; zero if one number is exact
    """
    common = ~np.isnan(a - b)
    a = a[common]
    b = b[common]
    # rho = sum a b / sqrt(sum a^2 sum b^2) over the common runs
    scale = sqrt(float(total(a * a)) * float(total(b * b)))
    if not scale > 0.0:
        return 0.0
    return float(total(a * b)) / scale


@np.errstate(all="ignore")
def studentized_difference(value: float, sides: Sides, other: float = 0.0) -> float:
    """Return z of the hypothesis of no difference: the deviations at which a limit is zero.

    Parameters
    ----------
    value
        difference
    sides
        its limits
    other
        standard error of what the difference is compared with, which is normal and independent of the
        runs

    Returns
    -------
    float
        z with the sign of the difference; infinite where no limit reaches zero
    """
    # No search is needed for no difference, and none is possible for an infinite one.
    if value == 0.0 or not abs(value) < inf:
        return value
    # The limit on the side of zero: its distance from the value grows with z, `reach(z, other)`.
    distance = abs(value)
    reach = sides.below if value > 0.0 else sides.above
    # Step 1: double z until the limit reaches zero.
    low = 0.0
    high = 1.0
    while reach(high, other) < distance:
        if high > _FARTHEST:
            return copysign(inf, value)
        low = high
        high = 2.0 * high
    # Step 2: bisect between the last two z.
    while high - low > _CLOSE * high:
        z = 0.5 * (low + high)
        if reach(z, other) < distance:
            low = z
        else:
            high = z
    return copysign(high, value)


@np.errstate(all="ignore")
def interval_of_difference(
    value: float, sides: Sides, level: float = 0.95, other: float = 0.0
) -> tuple[float, float]:
    """Return the confidence interval: all true differences that `studentized_difference` accepts.

    Parameters
    ----------
    value
        measured difference
    sides
        its limits
    level
        probability that the interval covers
    other
        standard error of what the difference is compared with

    Returns
    -------
    low, high : float
        ends of the interval
    """
    z = deviations(level)
    return value - sides.below(z, other), value + sides.above(z, other)
