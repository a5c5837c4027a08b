"""Weeks, or nanoseconds and other parts of a second, that a further column adds to the time."""

from math import inf

import numpy as np

from trackbench.core.arrays import Array
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.parse_tables import Table
from trackbench.scenarios.recordings.quantity_keys import STAMP_PARTS
from trackbench.scenarios.recordings.unit_names_and_sizes import UNITS


def seconds_of_part(path: str, table: Table, name: str, column: str, unit: str | None) -> Array:
    """Return the seconds (R,) that a ``column`` of the table at ``path`` adds to the time.

    ``name`` is its key, ``week`` or ``subsecond``, and ``unit`` its unit; None for weeks or nanoseconds.
    Raises DataError for a missing value, and for a subsecond that is not within 0 and 1 s.
    """
    scale = STAMP_PARTS[name]  # s, of a week or a nanosecond
    if unit is not None:
        scale = UNITS[unit]
    seconds: Array = table.columns[column] * scale
    is_valid = seconds < inf  # False for NaN
    if name == "subsecond":
        is_valid = (seconds >= 0.0) & (seconds < 1.0)
    wrong = np.flatnonzero(~is_valid)
    if len(wrong):
        value = table.columns[column][wrong[0]]
        message = f"{column}: {value:.9g} is no part of a second; say its unit"
        message += f" (`units: {{{name}: us}}`)"
        if np.isnan(value):
            message = f"{column}: is missing, and is a part of the time"
        raise DataError(Place(path, int(table.lines[wrong[0]]), 1, message))
    return seconds
