"""Guess of the column of times, and questions on times whose parts have columns of their own."""

from collections.abc import Collection, Mapping

import numpy as np

from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.guess_table_sample import TableSample
from trackbench.scenarios.recordings.header_line import is_value
from trackbench.scenarios.recordings.parse_dates import instant
from trackbench.scenarios.recordings.parse_numbers import parse_cells
from trackbench.scenarios.recordings.quantity_column_names import (
    HOURS,
    MINUTES,
    SECONDS,
    WORDS_OF_QUANTITIES,
    shown_names,
    words_of,
)
from trackbench.scenarios.recordings.yaml_values import in_option

_PARTS_OF_TIMES = frozenset(
    (
        *("year", "years", "yr", "yyyy", "month", "months", "mon", "day", "days", "dd"),
        *(*HOURS, *MINUTES, *SECONDS, "ss", "hundredths", "centiseconds", "centisec", "cs"),
        *("tenths", "millis", "milliseconds", "msec", "ms"),
    )
)
"""Names of columns that may each have a part of a time."""


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
        parts = _PARTS_OF_TIMES if is_part else HOURS
        is_other_part = name != time and "".join(words_of(name)) in parts
        if not is_other_part or name in columns.values():
            continue
        if _changes(sample, name, may_have_decimals=is_day):
            others.append(name)
    if others:
        message = f"the time seems to be split over the columns {', '.join([*others, time])}:"
        remedy = "write it into one column, as seconds or as hh:mm:ss, with the date if it changes"
        option = f"if {time} alone is the time, say --set 'columns.time={in_option(time)}'"
        raise DataError(Place(sample.path, 1, 1, f"{message} {remedy}; {option}"))


def _is_part_of_time(sample: TableSample, name: str) -> bool:
    """Test whether a column has a part of a time, such as minutes, that is not equal in all rows."""
    is_part = "".join(words_of(name)) in _PARTS_OF_TIMES
    return is_part and _changes(sample, name, may_have_decimals=True)


def _changes(sample: TableSample, name: str, *, may_have_decimals: bool) -> bool:
    """Test whether a part of a time has different numbers.

    A part that stays the same leaves the intervals as they are. Hours of a date may have decimals.
    """
    values = sample.numbers(name)
    values = values[np.isfinite(values)]
    return len(np.unique(values)) > 1 and (
        may_have_decimals or bool((values == np.round(values)).all())
    )


def explain_no_time(sample: TableSample) -> str:
    """Return the message and the advice for a table in which no column looks like a time."""
    names = sample.names
    message = f"no column looks like a time or a step; there are {shown_names(names)}"
    parts = [name for name in names if _is_part_of_time(sample, name)]
    if len(parts) > 1:
        message = f"the time seems to be split over the columns {', '.join(parts)}"
        return f"{message}: write it into one column, as seconds or as hh:mm:ss"
    if {"year", "month", "day"} <= {name.lower() for name in names}:
        return f"{message}: join the parts of dates into one column, 2025-04-03 10:00:00"
    remedy = (
        f"say which is one, `--set 'columns.time={in_option(_likeliest_time(sample))}'`"
        " (or columns.step), or number the rows"
    )
    if any(map(is_value, names)):
        all_names = (
            f"name all {len(names)} if no line does, `--set 'format.names=[time, x, y, ...]'`"
        )
        remedy = f"{all_names}, or {remedy}"
    return f"{message}: {remedy}"


def _likeliest_time(sample: TableSample) -> str:
    """Return the column that is a time by a word of its name, its dates or its rising numbers.

    If there is none, it is the first column whose name is no value, or else the first of all.
    """
    names = [name for name in sample.names if not is_value(name)]
    known = {*WORDS_OF_QUANTITIES["time"].split(), *WORDS_OF_QUANTITIES["date"].split()}
    for name in names:
        if not known.isdisjoint(words_of(name)) and any(sample.cells(name)):
            return name
    for name in names:
        cells = sample.cells(name)
        if cells and not parse_cells(instant, cells)[1]:
            return name
    for name in names:
        numbers = sample.numbers(name)
        if len(numbers) > 1 and (np.diff(numbers) >= 0.0).all() and numbers[-1] > numbers[0]:
            return name
    return names[0] if names else sample.names[0]
