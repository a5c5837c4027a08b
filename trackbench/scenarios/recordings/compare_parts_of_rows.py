"""Comparison of parts of a table's rows: whether they lie apart, jump or take turns."""

from collections.abc import Mapping
from typing import Literal

import numpy as np

from trackbench.core.arrays import Array, Index, Mask

_LONGEST_GAP = 2.5
"""usual intervals between two rows of a part within which the other part's rows are compared"""

Split = Literal["apart", "errors", "one", "unknown"]
"""Parts are apart, have errors of different sizes, agree as one, or cannot be compared."""
_MOST_PARTS = 12
"""parts that are compared: the largest ones"""
MOST_COMPARED_ROWS = 20_000
_FEWEST = 8
"""rows of a part that can be compared with another part"""
_APART = 4.0
"""distance between parts, in distances of a row from the line between its neighbors of the same part"""
_ERRORS = 3.0
"""ratio of the sizes of two parts' errors"""
_JUMP = 20.0
"""jump from one part to the next, in usual steps"""
_LONGEST_INTERVAL = 5.0
"""usual intervals between the rows of a jump, at most"""
_REGULAR_CHANGES = 1.2
"""changes per row of the rarer parts, from which on parts alternate; strictly alternating ones have 2"""
_CHANGES_OF_MANY = 0.9
"""changes per row, from which on any number of parts alternate"""
_NEAR_INTERVAL = 0.2
"""deviation from the usual interval, as a share of it, of an interval that is nearly equal"""
_REGULAR_SHARE = 0.7
"""share of a part's intervals that are nearly equal, if its rows are regular"""


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


def split_by(codes: Index, time: Array, values: Array) -> Split:
    """Return how the parts differ into which codes (R,) split the rows of one run.

    The results are explained at `Split`. ``time`` (R,) and ``values`` (n, R) are those of the rows,
    which need not be sorted by time. An angle is among the values as a point of a circle.
    """
    # Step 1: order the rows by time, and take the largest parts.
    complete_rows = np.flatnonzero(np.isfinite(values).all(axis=0))[:MOST_COMPARED_ROWS]
    order = complete_rows[np.argsort(time[complete_rows], kind="stable")]
    time = time[order]
    values = values[:, order]
    codes = codes[order]
    all_codes, counts = np.unique(codes, return_counts=True)
    largest = all_codes[np.argsort(-counts, kind="stable")][:_MOST_PARTS]
    parts = [np.flatnonzero(codes == code) for code in largest.tolist()]
    parts = [part for part in parts if len(part) >= 3]  # a row and its two neighbors
    if len(parts) < 2:
        return "unknown"
    # Step 2: estimate the size of each part's errors, from the lines between its own neighbors.
    sizes = [median_errors_of_lines(time[part], values[:, part]) for part in parts]
    # Step 3: compare rows of each part with the line between neighboring rows of each other part. Count
    # the pairs of parts that are compared, lie apart, and have unequal errors.
    compared = 0
    apart = 0
    unequal = 0
    for i, first in enumerate(parts):
        for j, other in enumerate(parts):
            if i == j:
                continue
            distances = distances_from_other_line(time, values, first, other)
            if distances.shape[1] < min(_FEWEST, len(other) - 1):
                continue  # too few rows of the other part lie between rows of the first
            compared += 1
            usual_distance = np.median(distances, axis=1)
            noise = np.maximum(sizes[i], sizes[j])
            apart += bool((usual_distance > _APART * noise).any())
            # The other part is less accurate than the first one: its rows are far from the line of the
            # first, and from the lines between its own rows.
            larger = (usual_distance > _ERRORS * sizes[i]) & (sizes[j] > _ERRORS * sizes[i])
            unequal += bool(larger.any())
    if compared:
        if 2 * apart > compared:
            return "apart"
        if unequal:
            return "errors"
        return "one"
    # Step 4: no parts overlap in time. They lie apart if values jump where one part follows another.
    if _jumps(time, values, codes):
        return "apart"
    return "unknown"


def _jumps(time: Array, values: Array, codes: Index) -> bool:
    """Test whether the values (n, R) jump at more than half of the changes from one part to another.

    ``codes`` (R,) number each row's part. A jump exceeds `_JUMP` usual steps within a part, and its
    rows are at most `_LONGEST_INTERVAL` usual intervals apart, as a long gap explains a large step.
    """
    steps = np.abs(np.diff(values, axis=1))
    intervals = np.diff(time)
    is_change: Mask = np.diff(codes) != 0
    # If no two successive rows are of one part, no usual step is known, and any movement is a jump.
    usual_step = np.zeros(len(values))
    if (~is_change).any():
        usual_step = np.median(steps[:, ~is_change], axis=1)
    is_short = intervals <= _LONGEST_INTERVAL * np.median(intervals)
    is_large = (steps > _JUMP * np.maximum(usual_step, 1e-9)[:, None]).any(axis=0)
    is_jump = is_large & is_change & is_short
    return bool(is_jump.sum() > 0.5 * is_change.sum())


def are_far(codes: Index, time: Array, values: Array) -> bool:
    """Test whether a change from one part to another is many times as far as a step within a part.

    ``codes`` (R,) number the parts of rows with ``time`` (R,) and ``values`` (n, R).
    """
    order = np.argsort(time, kind="stable")
    codes = codes[order]
    ordered_values = values[:, order]
    steps = np.abs(np.diff(ordered_values, axis=1))
    changes = np.median(steps[:, np.diff(codes) != 0], axis=1)
    steps_within = []
    for code in np.unique(codes).tolist():
        steps_within.append(np.abs(np.diff(ordered_values[:, codes == code], axis=1)))
    usual_step = np.median(np.concatenate(steps_within, axis=1), axis=1)
    return bool((changes > _JUMP * usual_step).any())


def is_regular(codes: Index, time: Array) -> bool:
    """Test whether the parts alternate in time, each at nearly equal intervals.

    Rows of several sensors do so; rows of good and bad quality do not. ``codes`` (R,) number the parts.
    """
    order = np.argsort(time, kind="stable")
    codes = codes[order]
    time = time[order]
    counts = np.unique(codes, return_counts=True)[1]
    changes = int((np.diff(codes) != 0).sum())
    # Step 1: count the changes from part to part. Two parts that alternate row by row change twice per
    # row of the rarer one.
    fewest_changes = _REGULAR_CHANGES * (len(codes) - counts.max())
    # Of many parts nearly every row is a change.
    fewest_changes = min(fewest_changes, _CHANGES_OF_MANY * (len(codes) - 1))
    if changes < fewest_changes:
        return False
    # Step 2: most intervals of each part must be nearly the usual one of this part.
    for code in np.unique(codes).tolist():
        intervals = np.diff(time[codes == code])
        if len(intervals) < 2:
            return False
        usual = np.median(intervals)
        is_near = np.abs(intervals - usual) <= _NEAR_INTERVAL * usual
        if is_near.mean() < _REGULAR_SHARE:
            return False
    return True


def as_positions(values: Mapping[str, Array]) -> Array:
    """Return quantities (R,) by name as rows (n, R) that a straight line between neighbors fits.

    An angle becomes two rows, a point of a circle, as the angle itself jumps by a whole turn.
    """
    rows = []
    # The circle's radius is the first measured range, so that an azimuth gives positions; any other
    # angle is only multiplied by it, which adds no jump. The range stays a row of its own, too.
    radius: Array | float = 1.0
    ranges = [value for name, value in values.items() if name.endswith("range")]
    if ranges:
        radius = ranges[0]
    for name, value in values.items():
        plain = name.rpartition(".")[2]
        if plain in ("azimuth", "bearing", "heading", "course", "angle"):
            rows += [radius * np.cos(value), radius * np.sin(value)]
        elif np.isfinite(value).any():
            rows.append(value)
    if not rows:
        return np.empty((0, 0))
    return np.stack(rows)
