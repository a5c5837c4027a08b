"""Efficiency of a filter against the exact posterior mean, with the cross term as a control variate.

The error of the exact mean ``m`` is orthogonal to all that is made of the measurements and of
independent noise: with the estimate ``e`` of a truth ``x``, ``E|e - x|^2 = E|m - x|^2 + E|e - m|^2``
(Anderson and Moore 1979, Optimal Filtering, section 2.3). The mean product of the two parts,
``2 (m - x).(e - m)``, is zero, so that its sample is a control variate with the known mean 0 and the
coefficient 1 (Hammersley and Handscomb 1964, Monte Carlo Methods, section 5.5). Without its noise,
only the distance to the exact mean varies, on the same measurements.
"""

from typing import NamedTuple

import numpy as np

from trackbench.core import sums
from trackbench.core.arrays import Array
from trackbench.statistics.over_runs import Estimate, influence, influence_of_ratio, mean

_FEWEST_RUNS = 6
"""Runs from which a ratio of variances has a standard error."""


class Jackknifed(NamedTuple):
    """A number over the runs, and each run's influence (M,) on it."""

    value: float
    influences: Array

    @property
    def estimate(self) -> Estimate:
        """Return the value and standard error."""
        return Estimate(self.value, mean(self.influences).stderr)


@np.errstate(all="ignore")
def efficiency(floor: Array, distance: Array) -> Jackknifed:
    """Return ``F / sqrt(F^2 + D^2)`` of the exact mean's RMSE and the distance to it in each run (M,).

    F and D are root mean squares over the runs. The ratio of squares leaves each run out in turn, the
    root is by the delta method.
    """
    return _root_share(np.square(floor), np.square(floor) + np.square(distance))


@np.errstate(all="ignore")
def plain_efficiency(floor: Array, error: Array) -> Jackknifed:
    """Return ``F / E``, the RMSE of the exact mean over the filter's (M,), uncontrolled."""
    return _root_share(np.square(floor), np.square(error))


def cross_share(floor: Array, error: Array, distance: Array) -> Jackknifed:
    """Return the cross term over the mean square error: zero but for noise if the reference is exact."""
    # E^2 = F^2 + D^2 + cross term
    squares = np.square(error)
    return _share(squares - np.square(floor) - np.square(distance), squares)


def runs_saved(plain: Jackknifed, controlled: Jackknifed) -> Jackknifed:
    """Return how many times as many runs the plain ratio needs for the same standard error.

    Missing for fewer than six runs: a ratio of variances of M normal values is Fisher's F of M - 1 and
    M - 1 degrees of freedom, which has a standard error only if M - 1 is more than four.
    """
    if len(plain.influences) < _FEWEST_RUNS:
        return Jackknifed(np.nan, np.full(len(plain.influences), np.nan))
    return _share(np.square(plain.influences), np.square(controlled.influences))


def _root_share(part: Array, whole: Array) -> Jackknifed:
    share, influences = _share(part, whole)
    # d sqrt(s) = ds / (2 sqrt(s))
    root = float(np.sqrt(share))
    return Jackknifed(root, influences / (2.0 * root))


@np.errstate(all="ignore")
def _share(part: Array, whole: Array) -> Jackknifed:
    a, b = float(sums.mean(part)), float(sums.mean(whole))
    of_a, of_b = influence("mean", part), influence("mean", whole)
    return Jackknifed(float(np.divide(a, b)), influence_of_ratio(a, b, of_a, of_b))
