"""Comparison of parts of a table's rows: whether they lie apart, jump or take turns."""

import numpy as np

from trackbench.core.arrays import Array, Index

_LONGEST_GAP = 2.5
"""usual intervals between two rows of a part within which the other part's rows are compared"""


def distances_from_other_line(time: Array, values: Array, first: Index, other: Index) -> Array:
    """Return the distances (n, B) of some rows from the line between neighboring rows of another part.

    Parts are rows of possibly different targets or sensors. ``first`` are the indices of the part whose
    rows the line joins, ``other`` those of the part whose B rows between them are compared. ``time``
    (R,) and ``values`` (n, R) are those of all rows. Only neighbors count that are at most
    `_LONGEST_GAP` usual intervals apart, so that the path hardly bends between them. The usual interval
    is the larger one of both parts' medians.
    """
    first_times = time[first]
    after = np.searchsorted(first_times, time[other], side="left")
    has_both_neighbors = (after > 0) & (after < len(first_times))
    rows = other[has_both_neighbors]
    after = after[has_both_neighbors]
    before = after - 1
    first_interval = float(np.median(np.diff(first_times)))
    usual_interval = max(first_interval, float(np.median(np.diff(time[other]))))
    share, interval = _shares(time[rows], first_times[before], first_times[after])
    line = (1.0 - share) * values[:, first[before]] + share * values[:, first[after]]
    is_short = interval <= _LONGEST_GAP * usual_interval
    return np.asarray(np.abs(values[:, rows] - line)[:, is_short])


def median_errors_of_lines(time: Array, values: Array) -> Array:
    """Return the usual size (n,) of the errors of each of n quantities, with ``values`` (n, R).

    It is the median distance of a row from the line between its neighbors. A distance has the errors of
    three rows in it, and is first divided so that it is as large as the error of one row. The median is
    thus about 0.67 standard deviations of an error; it is compared with other medians alone.
    """
    share, _ = _shares(time[1:-1], time[:-2], time[2:])
    differences = values[:, 1:-1] - (1.0 - share) * values[:, :-2] - share * values[:, 2:]
    # e = z_1 - (1 - s) z_0 - s z_2 has the variance sigma^2 (1 + s^2 + (1 - s)^2).
    sizes = np.abs(differences) / np.sqrt(1.0 + np.square(share) + np.square(1.0 - share))
    # Numbers that lie exactly on a line still have rounding errors.
    least = 1e-9 * np.abs(values).max() + 1e-12
    return np.maximum(np.median(sizes, axis=1), least)


def _shares(time: Array, before: Array, after: Array) -> tuple[Array, Array]:
    """Return the share (R,) of an interval that has passed at each time (R,), and its length (R,).

    The intervals last from ``before`` to ``after`` (R,). The share of an interval of length zero is a
    half.
    """
    length = after - before
    share = (time - before) / np.where(length > 0.0, length, 1.0)
    return np.where(length > 0.0, share, 0.5), length
