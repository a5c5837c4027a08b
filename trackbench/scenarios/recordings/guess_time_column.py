"""Guess of the column of times, and questions on times whose parts have columns of their own."""

from collections.abc import Collection, Mapping

import numpy as np

from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.column_names import shown_names, words_of
from trackbench.scenarios.recordings.header_line import is_value
from trackbench.scenarios.recordings.table_sample import TableSample
from trackbench.scenarios.recordings.yaml_values import in_option

_PARTS_OF_TIMES = frozenset(
    (
        *("year", "years", "yr", "yyyy", "month", "months", "mon", "day", "days", "dd"),
        *("hour", "hours", "hr", "hrs", "hh", "h", "minute", "minutes", "min", "mins", "mm", "mi"),
        *("second", "seconds", "sec", "secs", "ss", "s", "hundredths", "centiseconds", "centisec"),
        *("cs", "tenths", "millis", "milliseconds", "msec", "ms"),
    )
)
"""Names of columns that may each have a part of a time."""
_HOURS = frozenset(("hour", "hours", "hr", "hrs", "hh", "h"))


def check_split_time(
    sample: TableSample, columns: Mapping[str, str], user_columns: Collection[str]
) -> None:
    """Raise DataError if the time is split over several columns, such as hour, min and sec.

    ``columns`` are the columns by quantity. There is no error if the user named the column of the time,
    so that ``user_columns``, the quantities of named columns, have it.
    """
    if "time" not in columns or "time" in user_columns:
        return
    time = columns["time"]
    # The column of the time is a part of it: by its name, or a date that is equal in many rows.
    is_part = "".join(words_of(time)) in _PARTS_OF_TIMES
    is_day = "date" in words_of(time) and 2 * len(sample.words(time)) <= len(sample)
    if not is_part and not is_day:
        return
    others = []
    for name in sample.names:
        parts = _PARTS_OF_TIMES if is_part else _HOURS
        is_other_part = name != time and "".join(words_of(name)) in parts
        if not is_other_part or name in columns.values():
            continue
        values = sample.numbers(name)
        values = values[np.isfinite(values)]
        # A part that stays the same leaves the intervals as they are. Hours of a date may have decimals.
        if len(np.unique(values)) > 1 and (is_day or (values == np.round(values)).all()):
            others.append(name)
    if others:
        message = f"the time seems to be split over the columns {', '.join([*others, time])}:"
        remedy = "write it into one column, as seconds or as hh:mm:ss, with the date if it changes"
        option = f"if {time} alone is the time, say --set 'columns.time={in_option(time)}'"
        raise DataError(Place(sample.path, 1, 1, f"{message} {remedy}; {option}"))


def explain_no_time(names: list[str]) -> str:
    """Return the message and the advice for a table in which no column looks like a time."""
    message = f"no column looks like a time or a step; there are {shown_names(names)}"
    if {"year", "month", "day"} <= {name.lower() for name in names}:
        return f"{message}: join the parts of dates into one column, 2025-04-03 10:00:00"
    remedy = (
        f"say which is one, `--set 'columns.time={names[0]}'` (or columns.step), or number the rows"
    )
    if any(map(is_value, names)):
        remedy += f", or name all {len(names)} if no line does, `--set 'format.names=[time, x, y]'`"
    return f"{message}: {remedy}"
