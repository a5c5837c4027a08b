"""Times at which rows were received, from the column `received`."""

import numpy as np

from trackbench.core.arrays import Array
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.parse_tables import Table
from trackbench.scenarios.recordings.quantities_from_columns import Columns
from trackbench.scenarios.recordings.rows_and_reading_context import TICK, ReadingContext

_FEWEST_RECEIVED = 5
"""rows whose times of arrival are compared with their own times"""
_LARGEST_RATIO = 50.0
"""ratio of the spans of both, from which on they have different units"""

_MOST_MISTAKES = 20


def read_received(
    context: ReadingContext, columns: Columns, table: Table, column: str, time: Array
) -> Array:
    """Return the times (R,), s or steps, at which rows were received, from a ``column`` of the table.

    Raises DataError for rows that were received before their own ``time`` (R,).
    """
    received = context.timed(columns, table, column)
    # Times of arrival go on as fast as those of the measurements, unless their unit is another one. If
    # it is a larger one, so that the ratio is small, most rows seem to arrive too early, as is reported
    # below.
    if len(time) >= _FEWEST_RECEIVED and np.ptp(time) > 0.0:
        ratio = float(np.ptp(received) / np.ptp(time))
        if ratio > _LARGEST_RATIO:
            message = f"{column}: its times are {ratio:.3g} times as far apart as those of the rows"
            raise columns.mistake(f"{message}: write both in one unit, such as seconds")
    early = np.flatnonzero(received < time - TICK)[:_MOST_MISTAKES].tolist()
    if early:
        mistakes = []
        for row in early:
            lead = f"{time[row] - received[row]:.9g} {context.time_unit}"
            message = f"{column}: received {lead} before its time"
            mistakes.append(Place(columns.path, int(table.lines[row]), 1, message))
        raise DataError(*mistakes)
    return received
