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
from trackbench.core.arrays import Array, Mask
from trackbench.statistics.estimates import MISSING, RunEstimate
from trackbench.statistics.jackknife import influence_of_ratio
from trackbench.statistics.sample_statistics import influence, mean

_FEWEST_RUNS = 6
"""Runs from which a ratio of variances has a standard error."""


@np.errstate(all="ignore")
def efficiency(floor: Array, distance: Array) -> RunEstimate:
    """Return the efficiency ``F / sqrt(F^2 + D^2)`` of a filter, with its standard error.

    F is the root mean square over the runs of ``floor`` (M,), the RMSE of the exact posterior mean in
    each run. D is that of ``distance`` (M,), the RMS difference of the filter from the exact mean. The
    influences on F^2 / (F^2 + D^2) are by the jackknife, and the root is by the delta method.
    """
    return _root_share(np.square(floor), np.square(floor) + np.square(distance))


def efficiency_over_runs(floor: Array, distance: Array, common: Mask | bool = True) -> RunEstimate:
    """Return the `efficiency` over the runs that neither the filter nor the reference lost.

    Parameters
    ----------
    floor
        RMSE (M,) of the exact posterior mean in each run, NaN in runs that the reference lost
    distance
        RMS difference (M,) of the filter from the exact mean, in the same unit, NaN in runs that the
        filter lost
    common
        mask (M,) of the runs that count; True means all

    Returns
    -------
    RunEstimate
        efficiency between 0 and 1, with influences (M,); NaN without a run
    """
    both = ~np.isnan(floor) & ~np.isnan(distance)
    used = both & common
    lost = int((~both).sum())  # by the filter or by the reference
    if not used.any():
        return MISSING._replace(lost=lost)
    ratio = efficiency(floor[used], distance[used])
    influences = np.full(len(both), np.nan)
    influences[used] = ratio.influences
    return ratio._replace(influences=influences, lost=lost)


@np.errstate(all="ignore")
def plain_efficiency(floor: Array, error: Array) -> RunEstimate:
    """Return ``F / E`` without the control variate: the RMSE of the exact mean over the filter's RMSE.

    ``floor`` and ``error`` are the RMSEs of the exact mean and of the filter in each run (M,).
    """
    return _root_share(np.square(floor), np.square(error))


def cross_share(floor: Array, error: Array, distance: Array) -> RunEstimate:
    """Return the cross term over the mean square error, which is zero on average for an exact mean.

    ``floor`` is the RMSE of the exact mean, ``error`` the filter's RMSE, and ``distance`` the RMS
    difference of both, each per run (M,).
    """
    # E^2 = F^2 + D^2 + cross term
    squares = np.square(error)
    cross_terms = squares - np.square(floor) - np.square(distance)
    share, influences = _ratio_of_means(cross_terms, squares)
    return _over_runs(share, influences)


def runs_saved(plain: RunEstimate, controlled: RunEstimate) -> RunEstimate:
    """Return how many times as many runs an estimate needs for the standard error of another one.

    Parameters
    ----------
    plain, controlled
        estimates of one efficiency, without and with the control variate

    Returns
    -------
    RunEstimate
        ratio of their variances. It is NaN for fewer than six runs: a ratio of variances of M normal
        values is Fisher's F of M - 1 and M - 1 degrees of freedom, which has a standard error only if M
        - 1 is more than four
    """
    if plain.influences is None or controlled.influences is None or plain.runs < _FEWEST_RUNS:
        return RunEstimate(np.nan, np.nan, None, plain.runs)
    # The variance of an estimate is in proportion to the mean of its squared influences.
    ratio, influences = _ratio_of_means(
        np.square(plain.influences), np.square(controlled.influences)
    )
    return _over_runs(ratio, influences)


@np.errstate(all="ignore")
def _root_share(numerator: Array, denominator: Array) -> RunEstimate:
    """Return the square root of the ratio of two means over the runs, from values (M,)."""
    ratio, influences = _ratio_of_means(numerator, denominator)
    # d sqrt(s) = ds / (2 sqrt(s))
    root = float(np.sqrt(ratio))
    return _over_runs(root, influences / (2.0 * root))


@np.errstate(all="ignore")
def _ratio_of_means(numerator: Array, denominator: Array) -> tuple[float, Array]:
    """Return the ratio of the means of two numbers (M,) over the runs, with influences (M,) on it."""
    a = float(sums.mean(numerator))
    b = float(sums.mean(denominator))
    influences = influence_of_ratio(
        a, b, influence("mean", numerator), influence("mean", denominator)
    )
    return float(np.divide(a, b)), influences


def _over_runs(value: float, influences: Array) -> RunEstimate:
    return RunEstimate(value, mean(influences).stderr, influences, len(influences))
