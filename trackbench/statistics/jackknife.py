"""Jackknife: standard errors from batches left out, and influences of runs from runs left out."""

from collections.abc import Sequence

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.sums import mean, total


def jackknife_stderr(without: Sequence[Array]) -> Array:
    """Return the jackknife's standard error of a value: ``sqrt((B - 1) / B sum (b_i - mean b)^2)``.

    The source is Efron & Stein 1981.

    Parameters
    ----------
    without
        B values without one batch each, of any shape

    Returns
    -------
    array
        standard error, in the shape of a value; NaN if there are no batches
    """
    B = len(without)
    if not B:
        return np.array(np.nan)
    b = np.array(without)
    return np.sqrt((B - 1) / B * total(np.square(b - mean(b, 0)), 0))


def jackknife_influences(value: float, without: Array) -> Array:
    """Return centered influences from a number and its values without each run (jackknife).

    Parameters
    ----------
    value
        number of all runs
    without
        number (M,) without each run, NaN for lost runs

    Returns
    -------
    array (M,)
        influences with the mean 0, NaN for lost runs
    """
    known = ~np.isnan(without)
    # (M - 1) (value - value without run m)
    influences = (int(known.sum()) - 1.0) * (value - without)
    # Center them; the mean of no influence is NaN.
    average = np.nan
    if known.any():
        average = float(mean(influences[known]))
    return np.asarray(influences - average)


@np.errstate(all="ignore")
def influence_of_ratio(a: float, b: float, influences_a: Array, influences_b: Array) -> Array:
    """Return each run's influence on ``a / b`` from its influences on a and b.

    Each run is left out of a and b in turn (jackknife). The delta method would be wrong for a run that
    changes b so much that the ratio does not change in proportion.

    Parameters
    ----------
    a, b
        numbers of all runs
    influences_a, influences_b
        influences (M,) of the runs on both, NaN for lost runs

    Returns
    -------
    array (M,)
        influences on the ratio, NaN for runs that either number lacks
    """
    others = max(int((~np.isnan(influences_a + influences_b)).sum()) - 1, 1)
    ratio = float(np.divide(a, b))  # numpy's division: Python's raises an error for b = 0
    # Without run m, a is a - influences_a[m] / (M - 1), and b likewise.
    ratio_without = (a - influences_a / others) / (b - influences_b / others)
    return jackknife_influences(ratio, ratio_without)
