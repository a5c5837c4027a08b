"""Guess of the key `same_time`: whether different rows of one second are spread over it."""

from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from trackbench.core.arrays import Array
from trackbench.field_types import DataError
from trackbench.scenarios.recordings.rows_and_reading_context import (
    ReadingContext,
    Rows,
    positions_of_rows,
)

_MOST_A_SECOND = 20
"""mean number of rows of a second, beyond which they may be those of many targets"""
_MOST_COMPARED = 1000
"""rows that show whether those of one time are several targets"""
_TIMES_APART = 3.0
"""ratio of the distance between rows of one time to that from the next time, of several targets"""
_SHARE_OF_DETECTIONS = 0.25
"""quantile of distances by which rows are compared, as more than half may be false detections"""
_DAY = 86400.0  # s


def guess_same_time(
    context: ReadingContext, rows: Rows, kind: str, in_degrees: bool
) -> Literal["spread"] | None:
    """Return "spread" for the key `same_time` if rows of one second differ and times are whole seconds.

    The times of these rows are then spread over the second. Return None otherwise. Raises DataError if
    these rows lie so far apart that they are those of several targets. ``kind`` is the type of the rows'
    sensor; ``in_degrees`` is True if its angles are in degrees.
    """
    # A row with the time of the row before, and other values.
    is_repeated = (np.diff(rows.ticks) == 0) & (np.diff(rows.values, axis=1) != 0.0).any(axis=0)
    if not is_repeated.any():
        return None
    positions = positions_of_rows(rows, kind, in_degrees)
    if positions is not None and lie_apart(
        rows.ticks[:_MOST_COMPARED], positions[:, :_MOST_COMPARED]
    ):
        message = "rows of one time are far apart, and near those of other times: are they several"
        message += " targets, or false detections?"
        remedy = "Give each target a number in a column, and say --set 'columns.run=ITS NAME'"
        option = "if they are one target, say --set same_time=spread, or mean or last"
        place = context.place(
            rows, int(np.flatnonzero(is_repeated)[0]) + 1, f"{message} {remedy}; {option}"
        )
        raise DataError(place)
    # Only times in whole seconds may lack a part of the second.
    different_seconds = len(np.unique(rows.time))
    if context.counts_steps or (rows.time % 1.0).any() or different_seconds < 2:
        return None
    if len(rows.time) > _MOST_A_SECOND * different_seconds:
        return None  # too many rows for one target
    if context.dated and not (rows.time % _DAY).any():
        return None  # dates without a time of day
    return "spread"


def lie_apart(ticks: NDArray[np.integer[Any]], positions: Array) -> bool:
    """Test whether positions (2, R) of one time lie much farther apart than from those of the next time.

    ``ticks`` (R,) are the times in whole units. Rows of one time are compared one after the other. The
    rows are as in the file: the next time is that of the next rows with a new time, even if it is
    earlier.
    """
    apart = []  # distances between successive rows of one time
    nearest = []  # distances from the nearest row of the next time
    # Take the times in the order in which they first occur.
    times, first = np.unique(ticks, return_index=True)
    groups = [positions[:, ticks == tick] for tick in times[np.argsort(first)]]
    for group, following in pairwise(groups):
        apart += np.hypot(*np.diff(group, axis=1)).tolist()
        differences = group[:, :, None] - following[:, None, :]
        nearest += np.hypot(*differences).min(axis=1).tolist()
    if not apart:
        return False
    # Most false detections are far from all rows of the next time, so that a median would be theirs.
    usual_apart = np.quantile(apart, _SHARE_OF_DETECTIONS)
    usual_nearest = np.quantile(nearest, _SHARE_OF_DETECTIONS)
    return bool(usual_apart > _TIMES_APART * usual_nearest)
