"""Win rate: the share of the runs in which the metric of a filter is better than that of another one."""

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.metrics import Better
from trackbench.statistics.estimates import RunEstimate, estimate_share


def win_rate(
    a: Array, b: Array, better: Better, is_lost: Mask | None, common: Mask | bool = True
) -> RunEstimate:
    """Estimate the share of the runs with both values in which the first filter wins, as in `won_runs`.

    Parameters
    ----------
    a, b
        metric (M,) of both filters in each run, NaN where a run has none
    better
        better direction, as a metric's definition has it: ``lower``, ``higher``, ``zero`` or ``one``
    is_lost
        mask (M,) of the runs that the first filter lost; None if they are unknown
    common
        mask (M,) of the runs that count; True means all

    Returns
    -------
    RunEstimate
        `Share` with influences (M,)
    """
    return estimate_share(won_runs(a, b, better), is_lost, common)


def won_runs(a: Array, b: Array, better: Better) -> Array:
    """Return 1 for each run that the first filter wins, 0 for any other.

    Larger is better for a score. Nearer is better for a metric that is best at zero or at one. For any
    other metric the smaller value counts as better.

    Parameters
    ----------
    a, b
        metric (M,) of both filters in each run, NaN where a run has none
    better
        better direction, as a metric's definition has it: ``lower``, ``higher``, ``zero`` or ``one``

    Returns
    -------
    array (M,)
        1 or 0, NaN without both values
    """
    match better:
        case "higher":
            is_better = a > b
        case "zero":
            is_better = np.abs(a) < np.abs(b)
        case "one":
            is_better = np.abs(a - 1.0) < np.abs(b - 1.0)
        case _:
            is_better = a < b
    wins: Array = np.where(np.isnan(a) | np.isnan(b), np.nan, is_better)
    return wins
