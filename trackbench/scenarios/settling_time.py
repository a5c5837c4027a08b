"""Settling time after a maneuver, and the row from which on an error stays within a limit.

``settling_s`` of a target's legs and ``recovery_s`` of a fault count up to this row.
"""

from collections.abc import Mapping

import numpy as np

from trackbench.core.arrays import Array, Index, Mask
from trackbench.metrics import in_window


def settled_row(above: Mask) -> Index:
    """Return the row after the last True of each column, 0 if none is True.

    Parameters
    ----------
    above : array of bool (K, M)
        True where an error is above its limit.

    Returns
    -------
    array of int (M,)
        Row, which is K if the last one is True.
    """
    rows = np.arange(1, len(above) + 1)[:, None]
    return np.asarray(np.where(above, rows, 0).max(axis=0), dtype=np.intp)


def settling_metrics(
    error: Array,
    limit: float,
    stretches: Mapping[str, tuple[float, float]],
    times: Array,
    scored: Mask,
) -> dict[str, Array]:
    """Measure ``settling_s`` and ``not_settled`` in each stretch of time.

    A run has settled at the first scored step from which on the error is at most ``limit`` up to the
    stretch's end. Its time counts from the stretch's beginning.

    Parameters
    ----------
    error : array (K, M)
        Errors, NaN where they are unknown.
    limit : float
        Largest error of a run that has settled, in the unit of ``error``.
    stretches : mapping of str to tuple of float
        Begin and end of each stretch, s, by name.
    times : array (K,)
        Times of the steps, s.
    scored : array of bool (K,)
        True for the steps that are scored.

    Returns
    -------
    dict of array (M,)
        Time, s, and 1 for a run that has not settled, by the metric's name. The time of such a run is
        NaN. Both are NaN for a run with an unknown error in the stretch. A stretch without a scored step
        has no metrics.
    """
    metrics: dict[str, Array] = {}
    for name, (begin, end) in stretches.items():
        after = scored & (times >= begin) & (times <= end)
        if not after.any():
            continue  # shorter than the sampling time
        # First row from which on the error is within the limit; one after the last row if none is.
        row = settled_row(error[after] > limit)
        seconds = np.append(times[after] - begin, np.nan)[row]
        not_settled = (row == after.sum()).astype(float)
        unknown = np.isnan(error[after]).any(axis=0)
        metrics[in_window("settling_s", name)] = np.where(unknown, np.nan, seconds)
        metrics[in_window("not_settled", name)] = np.where(unknown, np.nan, not_settled)
    return metrics
