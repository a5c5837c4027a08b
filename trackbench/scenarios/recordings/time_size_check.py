"""Check of times that are too large for seconds, with advice on their likely unit."""

import numpy as np

from trackbench.errors import and_others
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.parse_tables import Table
from trackbench.scenarios.recordings.quantities_from_columns import Columns

_LATEST = 1e12
"""s: beyond are no times, and ticks would not fit into their numbers"""
_STAMPS = ((12, "%Y%m%d%H%M"), (14, "%Y%m%d%H%M%S"), (17, "%Y%m%d%H%M%S%f"))
_EPOCHS = {"ms": 1e12, "us": 1e15, "ns": 1e18}


def check_size(columns: Columns, table: Table, clock: str, own_key: str) -> None:
    """Raise DataError for times of the column ``clock`` that are too large, with the likely unit.

    ``own_key`` is the config's key of the columns and units of this file alone, such as
    ``truth_naming``; it is empty for a file of measurements.
    """
    time = table.columns[clock]
    seconds = time * columns.naming.scale("time")
    late = np.flatnonzero(np.abs(seconds) > _LATEST)
    if len(late):
        row = late[0]
        more = and_others(len(late), "nor are")
        remedy = _remedy_for_large_time(time[row], own_key)
        message = f"{clock}: {seconds[row]:.3g} s is no time{more}; {remedy}"
        raise DataError(Place(columns.path, int(table.lines[row]), 1, message))


def _remedy_for_large_time(value: float, own_key: str) -> str:
    """Return the advice on a time that is too large for seconds: a format of dates, or another unit.

    ``own_key`` is the config's key of the columns and units of this file alone, such as
    ``truth_naming``; it is empty for a file of measurements.
    """
    digits = f"{value:.0f}"
    # A date has 12 digits or more: 202504031000 is 2025-04-03 10:00.
    for length, date_format in _STAMPS:
        month = int(digits[4:6] or 0)
        day = int(digits[6:8] or 0)
        is_date = 1 <= month <= 12 and 1 <= day <= 31
        if len(digits) == length and digits[:2] in ("19", "20") and is_date:
            return f'it looks like a date, say `time_format: "{date_format}"`'
    # The unit in which the number is a time since 1970, from 1985 to 2128: today is some 1.8e12 ms. If
    # there is none, it is ns, the smallest unit: 1e13 ns are 2.8 hours of a clock that began at zero.
    unit = "ns"
    for epoch_unit, size in _EPOCHS.items():
        if 0.5 * size <= abs(value) <= 5.0 * size:
            unit = epoch_unit
            break
    remedy = f"units: {{time: {unit}}}"
    if own_key:
        remedy = f"{own_key}: {{{remedy}}}"
    return f"say its unit (`{remedy}`)"
