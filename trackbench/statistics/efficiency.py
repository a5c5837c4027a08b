"""Efficiency of a filter against the exact posterior mean, with the cross term as a control variate.

The error of the exact mean ``m`` is orthogonal to all that is made of the measurements and of
independent noise: with the estimate ``e`` of a truth ``x``, ``E|e - x|^2 = E|m - x|^2 + E|e - m|^2``
(Anderson and Moore 1979, Optimal Filtering, section 2.3). The mean product of the two parts,
``2 (m - x).(e - m)``, is zero, so that its sample is a control variate with the known mean 0 and the
coefficient 1 (Hammersley and Handscomb 1964, Monte Carlo Methods, section 5.5). Without its noise,
only the distance to the exact mean varies, on the same measurements.
"""

import numpy as np

from trackbench.core import sums
from trackbench.core.arrays import Array
from trackbench.statistics.estimates import RunEstimate
from trackbench.statistics.over_runs import influence, influence_of_ratio, mean

_FEWEST_RUNS = 6
"""Runs from which a ratio of variances has a standard error."""


@np.errstate(all="ignore")
def efficiency(floor: Array, distance: Array) -> RunEstimate:
    """Return ``F / sqrt(F^2 + D^2)`` of the exact mean's RMSE and the distance to it in each run (M,).

    F and D are root mean squares over the runs. The ratio of squares leaves each run out in turn, the
    root is by the delta method.
    """
    return _root_share(np.square(floor), np.square(floor) + np.square(distance))


@np.errstate(all="ignore")
def plain_efficiency(floor: Array, error: Array) -> RunEstimate:
    """Return ``F / E``, the RMSE of the exact mean over the filter's (M,), uncontrolled."""
    return _root_share(np.square(floor), np.square(error))


def cross_share(floor: Array, error: Array, distance: Array) -> RunEstimate:
    """Return the cross term over the mean square error: zero but for noise if the reference is exact."""
    # E^2 = F^2 + D^2 + cross term
    squares = np.square(error)
    return _over_runs(*_share(squares - np.square(floor) - np.square(distance), squares))


def runs_saved(plain: RunEstimate, controlled: RunEstimate) -> RunEstimate:
    """Return how many times as many runs the plain ratio needs for the same standard error.

    Missing for fewer than six runs: a ratio of variances of M normal values is Fisher's F of M - 1 and
    M - 1 degrees of freedom, which has a standard error only if M - 1 is more than four.
    """
    if plain.influences is None or controlled.influences is None or plain.runs < _FEWEST_RUNS:
        return RunEstimate(np.nan, np.nan, None, plain.runs)
    return _over_runs(*_share(np.square(plain.influences), np.square(controlled.influences)))


@np.errstate(all="ignore")
def _root_share(numerator: Array, denominator: Array) -> RunEstimate:
    """Return the square root of the ratio of two means over the runs, from values (M,)."""
    share, influences = _share(numerator, denominator)
    # d sqrt(s) = ds / (2 sqrt(s))
    root = float(np.sqrt(share))
    return _over_runs(root, influences / (2.0 * root))


@np.errstate(all="ignore")
def _share(numerator: Array, denominator: Array) -> tuple[float, Array]:
    """Return the ratio of two means over the runs, with the influences (M,) on it."""
    a = float(sums.mean(numerator))
    b = float(sums.mean(denominator))
    influences = influence_of_ratio(
        a, b, influence("mean", numerator), influence("mean", denominator)
    )
    return float(np.divide(a, b)), influences


def _over_runs(value: float, influences: Array) -> RunEstimate:
    return RunEstimate(value, mean(influences).stderr, influences, len(influences))
