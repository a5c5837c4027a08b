"""Guess of the columns of times and dates, and questions on times in several columns."""

import re
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.guess_record import ColumnByQuantity, ReasonByKey
from trackbench.scenarios.recordings.guess_table_sample import TableSample
from trackbench.scenarios.recordings.guess_times_of_day_in_digits import (
    CLOCK_IN_DIGITS,
    clock_in_numbers,
)
from trackbench.scenarios.recordings.header_line import is_value
from trackbench.scenarios.recordings.parse_dates import instant
from trackbench.scenarios.recordings.parse_numbers import parse_cells
from trackbench.scenarios.recordings.recognize_column_names import (
    HOURS,
    MINUTES,
    SECONDS,
    WORDS_OF_QUANTITIES,
    shown_names,
    words_of,
)
from trackbench.scenarios.recordings.yaml_values import in_option

_DAY_ALONE = re.compile(
    r"\d{4}([-/.])\d{1,2}\1\d{1,2}|\d{1,2}([-/.])(?:\d{1,2}|[A-Za-z]{3,9})\2(?:\d{4}|\d{2})"
    r"|(?:19|20)\d\d(?:0[1-9]|1[0-2])(?:0[1-9]|[12]\d|3[01])"
)
_COLONS = re.compile(r"\d{1,2}:[0-5]\d(:[0-5]\d([.,]\d+)?)?( ?[AaPp]\.?[Mm]\.?)?")
_WORDS_OF_CLOCKS = frozenset(
    ("clock", "time", "utc", "gmt", "hhmmss", "tod", "uhrzeit", "heure", "hora")
)
_MOST_CLOCKS = 3
"""columns that a question names"""

_PARTS_OF_TIMES = frozenset(
    (
        *("year", "years", "yr", "yyyy", "month", "months", "mon", "day", "days", "dd"),
        *(*HOURS, *MINUTES, *SECONDS, "ss", "hundredths", "centiseconds", "centisec", "cs"),
        *("tenths", "millis", "milliseconds", "msec", "ms"),
    )
)
"""Names of columns that may each have a part of a time."""


def check_date_and_clock(
    sample: TableSample, columns: Mapping[str, str], user_columns: Collection[str]
) -> None:
    """Raise DataError if a date and a time of day, or the part of a day, stand in two columns.

    ``columns`` are the columns by quantity; that of the time may be missing. ``user_columns`` are the
    quantities whose columns the user named. If columns of a date and of a time are known, there is an
    error only for a time in numbers that fall where the date changes. Otherwise there is one if the
    only column of dates has no time of day, and another column may have it, unless the user named the
    column of the time.
    """
    time = columns.get("time", "")
    date = columns.get("date", "")
    # Case 1: both columns are known.
    if date and time:
        # Times of several runs or sensors may begin anew.
        if not columns.get("run") and not columns.get("sensor"):
            _check_numbers_beside_dates(sample, time, date)
        return
    # Case 2: a date without a time of day. Which column has the times of day, or else the part of a day
    # as a number? Such a number falls to zero with each new date, which the first error reports.
    if "time" in user_columns or "step" in columns:
        return
    dates = [time] if time else list(sample.names)
    dates = [name for name in dates if _is_day(sample.cells(name))]
    if len(dates) != 1:
        return
    clocks = [name for name in sample.names if name not in columns.values()]
    clocks = [name for name in clocks if _is_clock_of_day(sample.cells(name), words_of(name))]
    unit = ""
    if not clocks:
        clocks = [name for name in sample.names if _is_part_of_day(sample, name)]
        unit = " --set units.time=d"
        for name in clocks:
            _check_numbers_beside_dates(sample, name, dates[0])
    if not clocks:
        return
    message = f"{dates[0]} has no time of day: is it in {' or '.join(clocks[:_MOST_CLOCKS])}?"
    option = (
        f"--set 'columns.date={in_option(dates[0])}' --set 'columns.time={in_option(clocks[0])}'"
    )
    alone = f"--set 'columns.time={in_option(dates[0])}'"
    remedy = f"Say {option}{unit}; if {dates[0]} alone is the time, {alone}"
    raise DataError(Place(sample.path, 1, 1, f"{message} {remedy}"))


def _check_numbers_beside_dates(sample: TableSample, time: str, date: str) -> None:
    """Raise DataError if the numbers of the column ``time`` begin anew at each date in a column."""
    numbers = sample.numbers(time)
    if not len(numbers) or not np.isfinite(numbers).all():
        return
    days = sample.cells(date)
    falls = np.flatnonzero(np.diff(numbers) < 0.0) + 1
    # Numbers of a clock, such as 235959, are read with their date.
    clock_format = clock_in_numbers(sample.cells(time), words_of(time), has_dates=True)
    is_clock = bool(clock_format.date_format)
    if not len(falls) or is_clock:
        return
    if any(days[row] == days[row - 1] for row in falls.tolist()):
        return
    row = int(falls[0])
    message = (
        f"{time} falls from {numbers[row - 1]:.9g} to {numbers[row]:.9g} where {date} changes:"
    )
    message += " dates are read beside times such as 10:00:59 alone"
    remedy = "write both into one column, such as 2024-05-03 10:00:59; in a spreadsheet add day and"
    remedy += " part of the day as numbers, and say --set units.time=d"
    raise DataError(Place(sample.path, sample.lines[row], 1, f"{message}: {remedy}"))


def _is_day(cells: Sequence[str]) -> bool:
    """Test whether cells are dates without a time of day, such as 2024-05-03, 3.5.2024 and 20240503."""
    return bool(cells) and all(map(_DAY_ALONE.fullmatch, cells))


def _is_clock_of_day(cells: Sequence[str], words: Collection[str]) -> bool:
    """Test whether cells are times of day, and not all equal.

    They have colons, or are digits such as 095959 below a name with a word of times.
    """
    if len({*cells}) < 2:
        return False
    if all(map(_COLONS.fullmatch, cells)):
        return True
    return not _WORDS_OF_CLOCKS.isdisjoint(words) and all(map(CLOCK_IN_DIGITS.fullmatch, cells))


def _is_part_of_day(sample: TableSample, column: str) -> bool:
    """Test whether a column has numbers from 0 to 1, and a word of times in its name."""
    if {*_WORDS_OF_CLOCKS, "day", "fraction"}.isdisjoint(words_of(column)):
        return False
    numbers = sample.numbers(column)
    if len(numbers) < 2 or not np.isfinite(numbers).all():
        return False
    is_inside = bool(((numbers >= 0.0) & (numbers < 1.0)).all())
    return is_inside and len(np.unique(numbers)) > 1


def find_dates(sample: TableSample, columns: ColumnByQuantity, reasons: ReasonByKey) -> None:
    """Add the column of the time to ``columns``, in place, if exactly one column has dates in all cells.

    The reason is added to ``reasons``.
    """
    dated = []
    for name in sample.names:
        cells = sample.cells(name)
        # 2025-04-03 has digits with a separator; 20250403 may be a number.
        has_separators = all(re.search(r"\d\D+\d", cell) for cell in cells)
        _, no_dates = parse_cells(instant, cells)
        if cells and has_separators and not no_dates:
            dated.append(name)
    if len(dated) == 1:
        columns["time"] = dated[0]
        reasons["time_column"] = "guess: its cells are dates"


def day_column(sample: TableSample) -> str | None:
    """Return the column `day` for times without a date, if all its cells are dates; else None.

    These are dates in ISO 8601, such as 2024-05-03 or 20240503.
    """
    for name in sample.names:
        if name.lower() == "day" and not parse_cells(instant, sample.cells(name))[1]:
            return name
    return None


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
