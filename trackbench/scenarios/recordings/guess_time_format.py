"""Guess of the format in which a column has dates, or times of day with separators."""

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from datetime import UTC, datetime
from functools import partial
from itertools import pairwise
from typing import Literal

import numpy as np

from trackbench.core.arrays import Array
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.guess_record import (
    ColumnByQuantity,
    Guess,
    ReasonByKey,
    UnitByQuantity,
)
from trackbench.scenarios.recordings.guess_table_sample import TableSample
from trackbench.scenarios.recordings.guess_times_of_day_in_digits import (
    ClockFormat,
    clock_in_numbers,
    count_of_most_frequent,
    explain_format,
)
from trackbench.scenarios.recordings.guess_times_of_sample import times_of_sample
from trackbench.scenarios.recordings.naming_of_columns import Naming
from trackbench.scenarios.recordings.parse_dates import (
    KNOWN_FORMATS,
    STAMP_FORMATS,
    has_digits_of,
    instant,
    is_instant,
)
from trackbench.scenarios.recordings.parse_numbers import number, parse_cells
from trackbench.scenarios.recordings.recognize_column_names import words_of
from trackbench.scenarios.recordings.rows_and_reading_context import usual_interval
from trackbench.scenarios.recordings.unscaled_rows import PossibleFormat

_STAMP = re.compile(r"\d{12}|\d{14}([.,]\d+|\d{1,6})?")
_OTHER_STAMP = re.compile(r"\d{10}|\d{11}|\d{13}([.,]\d+)?")
"""Date with hours alone, such as 2024050309, or day of the year with a time, such as 2024123095959."""
_DAY_IN_DIGITS = re.compile(r"\d{7,8}")
_WORDS_OF_DATES = frozenset(
    ("date", "day", "datum", "fecha", "data", "dato", "jour", "yyyymmdd", "yyyyddd")
)
_FRACTION = re.compile(r"(\d+(?=[.,])|.*:\d+(?=[.,])|.*:.*:\d+(?=:))[.:,](\d{1,9})")
_MOST_FRAMES = 60
"""frames in a second"""
_STEADIER = 5.0  # times, as the ratio of largest and usual interval, so that an order is decided

_SECONDS = {"seconds", "sec", "secs", "second", "t", "tow", "itow", "gms", "sow", "sod"}
_TIMES_OF_DAY = {"utc", "clock", "gmt", "uhrzeit", "heure", "hora", "klokkeslett", "local", "cet"}
_ELAPSED = {"elapsed", "duration", "split", "lap", "laptime", "elapsedtime"}


def guess_clock_format(
    path: str,
    times: Sequence[str],
    dates: Sequence[str],
    lines: Sequence[int],
    words: Collection[str] = (),
    has_unit: bool = False,
) -> ClockFormat:
    """Guess the format of the cells of a column of times, and of a column of dates if there is one.

    ``times`` and ``dates`` are the cells of both columns; ``dates`` is empty without such a column.
    ``path`` and ``lines`` are the places of the cells, for an error. ``words`` are those of the name of
    the times' column. Numbers whose unit is known (``has_unit``) are no times of day. Raises
    DataError if day and month may be in either order, and the times then differ.
    """
    if not times:
        return ClockFormat()
    cells = list(times)
    if dates:
        cells = [f"{date} {time}" for date, time in zip(dates, times, strict=True)]
    _check_zeros(path, cells, lines)
    # Step 1: numbers may be seconds, times of day such as 0959, or long stamps such as 20250403095900.
    _, mistakes = parse_cells(number, [cell.replace(",", ".") for cell in times])
    is_clock = False
    if not mistakes:
        is_stamp = all(map(_STAMP.fullmatch, times))
        if not is_stamp and not has_unit and all(map(_OTHER_STAMP.fullmatch, times)):
            # UNIX times have 10 digits, and 13 in ms. Those of today begin with 17, and fit no format.
            is_stamp = bool(_fitting_formats(cells))
        if not is_stamp and not dates and not has_unit:
            is_stamp = _are_days(path, times, lines, words)
        if not is_stamp:
            if has_unit:
                return ClockFormat()
            clock_format = clock_in_numbers(times, words, has_dates=bool(dates))
            if clock_format.other_format == "month":
                message = (
                    f"is {times[0]} the month {times[0][:4]}-{times[0][4:]}? Then write dates,"
                )
                message += (
                    f" such as {times[0][:4]}-{times[0][4:]}-15; if these are times of day, say"
                )
                remedy = "--set 'time_format=\"%H%M%S\"', and of seconds --set units.time=s"
                raise DataError(Place(path, lines[0], 1, f"{message} {remedy}"))
            # Plain numbers, which have no format of dates, and times of day alone are settled now.
            if not clock_format.date_format or not dates:
                return clock_format
            is_clock = True
    elif is_instant(cells[0]):
        return ClockFormat(is_date=True)
    # Step 2: find the formats that fit all cells.
    times_by_format = _without_counts(path, cells, lines[0], _fitting_formats(cells), has_unit)
    if is_clock:
        times_by_format = {
            date_format: values
            for date_format, values in times_by_format.items()
            if date_format.endswith(clock_format.date_format)
        }
    if not times_by_format:
        # Dates of an unknown format are reported when the times are read.
        is_number = not dates and all(map(_is_number, times))
        return ClockFormat(is_date=not is_number)
    # 10:30 may be minutes and seconds, too; the usual speed decides later.
    other_format = ""
    if "%H:%M" in times_by_format and "%M:%S" in times_by_format:
        other_format = "%M:%S"
        times_by_format.pop(other_format)
    # Numbers of at most four digits are hours and minutes.
    for date_format in [
        date_format for date_format in times_by_format if date_format.endswith("%H%M")
    ]:
        times_by_format.pop(f"{date_format}%S", None)
    # Step 3: the best format comes first: times that never fall, then the most equal intervals. If two
    # orders of day and month are as good, the month is first only beside a.m. and p.m.
    first, *others = sorted(
        times_by_format,
        key=lambda date_format: (
            _falls_and_unevenness(times_by_format[date_format]),
            "%p" in date_format and date_format[:2] == "%d",
        ),
    )
    format_of_other_order = ""
    for date_format in others:
        if np.array_equal(
            times_by_format[date_format] - times_by_format[date_format][0],
            times_by_format[first] - times_by_format[first][0],
        ):
            # The same times since the first one: the order matters beside another file alone.
            if times_by_format[date_format][0] != times_by_format[first][0]:
                format_of_other_order = format_of_other_order or date_format
            continue
        falls, gap = _falls_and_unevenness(times_by_format[first])
        other_falls, other_gap = _falls_and_unevenness(times_by_format[date_format])
        if falls == other_falls and other_gap < _STEADIER * gap:
            message = f"{cells[0]!r} may be a day in either order: say which, "
            remedy = f"`--set 'time_format=\"{first}\"'` or `--set 'time_format=\"{date_format}\"'`"
            raise DataError(Place(path, lines[0], 1, message + remedy))
    if first.endswith(":%f"):
        _check_frames(path, cells, first, lines[0])
    reason = f"guess: {explain_format(first)}"
    return ClockFormat(
        date_format=first,
        is_date=True,
        reason=reason,
        other_format=other_format,
        format_of_other_order=format_of_other_order,
    )


def _are_days(
    path: str, times: Sequence[str], lines: Sequence[int], words: Collection[str]
) -> bool:
    """Test whether numbers of a column of times are dates without a time of day, such as 20240503.

    The name of the column, with these ``words``, says so, or the intervals of the dates are more equal
    than those of the numbers. Raises DataError if the numbers may be seconds as well as dates; ``path``
    and ``lines`` are the places of the ``times``.
    """
    if len(times) < 2 or not all(map(_DAY_IN_DIGITS.fullmatch, times)):
        return False
    times_by_format = _fitting_formats(times)
    if not times_by_format:
        return False
    if not _WORDS_OF_DATES.isdisjoint(words):
        return True
    likelier = _more_regular_meaning(times, times_by_format.values())
    if likelier != "either":
        return likelier == "dates"
    date_format, as_dates = next(iter(times_by_format.items()))
    day = datetime.fromtimestamp(float(as_dates[0]) / 1e6, UTC)
    message = (
        f"is {times[0]} the date {day:%Y-%m-%d}? Then say --set 'time_format=\"{date_format}\"'"
    )
    raise DataError(
        Place(path, lines[0], 1, f"{message}; if these are seconds, say --set units.time=s")
    )


def _check_zeros(path: str, cells: Sequence[str], lines: Sequence[int]) -> None:
    """Raise DataError if fractions of seconds lack the zeros behind the point: 12.50 before 12.100.

    The numbers behind the point then rise within each second, and the times fall. ``lines`` are those of
    the cells.
    """
    # Groups of a match: the time up to its whole seconds, and the digits behind them.
    parts = [_FRACTION.fullmatch(cell) for cell in cells]
    falling = None
    for row, (before, after) in enumerate(pairwise(parts), 1):
        if before is None or after is None or before[1] != after[1]:
            continue
        if int(after[2]) < int(before[2]):
            return  # not even the numbers behind the point rise
        if float(f"0.{after[2]}") < float(f"0.{before[2]}"):
            falling = falling or row
    if falling is not None:
        message = (
            f"{cells[falling]!r} comes after {cells[falling - 1]!r}: are there no zeros behind the"
        )
        remedy = (
            "point? Write all digits, such as 12.050 in place of 12.50, or sort the rows by time"
        )
        raise DataError(Place(path, lines[falling], 1, f"{message} {remedy}"))


def _check_frames(path: str, cells: Sequence[str], date_format: str, line: int) -> None:
    """Raise DataError if the last part of times such as 10:00:59:24 may be the number of a video frame.

    The ``cells`` fit ``date_format``. ``line`` is that of the first cell.
    """
    last_parts = [cell.rpartition(":")[2] for cell in cells]
    if all(len(part) <= 2 for part in last_parts) and max(map(int, last_parts)) < _MOST_FRAMES:
        message = f"{cells[0]!r} may end with the number of a frame"
        remedy = "write seconds with decimals, such as 10:00:59.96"
        option = f"if these are hundredths of a second, say --set 'time_format=\"{date_format}\"'"
        raise DataError(Place(path, line, 1, f"{message}: {remedy}; {option}"))


def _more_regular_meaning(
    cells: Sequence[str], times_as_dates: Iterable[Array]
) -> Literal["dates", "numbers", "either"]:
    """Return whether more intervals between ``cells`` are equal as dates or as plain numbers.

    ``times_as_dates`` are the times (R,), microseconds since 1970, by each format of dates that fits.
    """
    if len(cells) < 2:
        return "either"
    equal_as_dates = max(count_of_most_frequent(np.diff(times)) for times in times_as_dates)
    # The decimals of a second may stand after a comma.
    numbers = [float(cell.replace(",", ".")) for cell in cells]
    equal_as_numbers = count_of_most_frequent(np.diff(numbers))
    if equal_as_dates == equal_as_numbers:
        return "either"
    return "dates" if equal_as_dates > equal_as_numbers else "numbers"


def _is_number(cell: str) -> bool:
    return cell.replace(".", "", 1).isdigit()


def _fitting_formats(cells: Sequence[str]) -> dict[str, Array]:
    """Return the times (R,), microseconds since 1970, by each known format that fits all cells."""
    times_by_format: dict[str, Array] = {}
    for date_format in KNOWN_FORMATS:
        # Without its last three characters, such as .%f, it is the format of whole seconds.
        if date_format.endswith("%f") and date_format[:-3] in times_by_format:
            continue  # no cell has digits behind its seconds
        # Most formats do not fit the first cell, so that it is tried alone first.
        if not all(has_digits_of(date_format, cell) for cell in cells[:1]):
            continue
        values, mistakes = parse_cells(partial(instant, date_format=date_format), cells[:1])
        if not mistakes:
            values, mistakes = parse_cells(partial(instant, date_format=date_format), cells)
        if not mistakes and all(has_digits_of(date_format, cell) for cell in cells):
            times_by_format[date_format] = values
    return times_by_format


def _without_counts(
    path: str,
    cells: Sequence[str],
    line: int,
    times_by_format: Mapping[str, Array],
    has_unit: bool,
) -> dict[str, Array]:
    """Return the formats without those of dates in one number that rather is a count.

    A date such as 250403095900 may be a count of microseconds. The seconds of dates differ, unless all
    rows are at whole minutes, and the last two digits of a count of whole milliseconds are alike. Then
    the more equal intervals decide. A known unit (``has_unit``) is that of a count. ``times_by_format``
    are times (R,), microseconds since 1970. Raises DataError if the ``cells`` may be both; ``path`` and
    ``line`` are the place of the first one.
    """
    short = [
        date_format
        for date_format in STAMP_FORMATS
        if date_format.startswith(("%y", "%d%m%y", "%Y%j")) and date_format in times_by_format
    ]
    if not short or len({cell[-2:] for cell in cells}) > 1:
        return dict(times_by_format)
    others = {
        date_format: times
        for date_format, times in times_by_format.items()
        if date_format not in short
    }
    if others or has_unit:
        return others
    likelier = _more_regular_meaning(cells, times_by_format.values())
    if likelier == "dates":
        return dict(times_by_format)
    if likelier == "numbers":
        return {}
    day = datetime.fromtimestamp(float(times_by_format[short[0]][0]) / 1e6, UTC)
    message = f"is {cells[0]} the date {day:%Y-%m-%d %H:%M:%S}? Then say"
    message += f" --set 'time_format=\"{short[0]}\"'"
    remedy = "if it is a count of microseconds, say --set units.time=us (or ms, ns)"
    raise DataError(Place(path, line, 1, f"{message}; {remedy}"))


def _falls_and_unevenness(times: Array) -> tuple[bool, float]:
    """Return whether times (R,) fall anywhere, and the ratio of their largest to their usual interval.

    The lesser result belongs to the likelier times.
    """
    falls = bool((np.diff(times) < 0.0).any())
    intervals = np.diff(np.unique(times))
    if not len(intervals):
        return falls, 1.0
    return falls, float(intervals.max(initial=0.0)) / usual_interval(times)


def possible_formats_of_times(
    sample: TableSample,
    columns: ColumnByQuantity,
    units: UnitByQuantity,
    reasons: ReasonByKey,
    clock_format: ClockFormat,
) -> dict[str, PossibleFormat]:
    """Return both possible formats of ambiguous times; the key of the guessed one is empty.

    Times such as 10:30 or 1030 are hours and minutes (the guessed format), or minutes and seconds.
    Numbers such as 1201 may also be seconds (the format "s"). `likely_units` adds the penalty of a
    format to others, such as that of an unusual interval, which is 1. The least sum wins, and less
    than 0.6 between two sums leaves a question to the user.
    """
    cells = sample.cells(columns["time"])
    words = words_of(columns["time"])
    is_elapsed = not _ELAPSED.isdisjoint(words)
    if clock_format.other_format == "s":
        is_seconds = is_elapsed or not _SECONDS.isdisjoint(words)
        is_time_of_day = not _TIMES_OF_DAY.isdisjoint(words)
        as_clock, _ = times_of_sample(sample, columns, units, reasons, clock_format)
        as_numbers = sample.numbers(columns["time"])
        factor = usual_interval(as_numbers) / usual_interval(as_clock)
        # The name of the column decides if it says what the times are: this is a penalty of 1 on the
        # other format. Without it the 100 s between 100, 200 and 300, which are unusual, would cost
        # seconds 1. The 0.5 for the clock reduces this difference to 0.5, and the user is asked.
        return {
            "": PossibleFormat(factor=1.0, penalty=0.5 + is_seconds),
            "s": PossibleFormat(factor=factor, penalty=1.0 * is_time_of_day),
        }
    # Times that begin at zero, as 00:12 and 0012, rather count minutes and seconds.
    from_zero = bool(cells) and re.match(r"0+[:.,]|0*\d\d?$", cells[0]) is not None
    penalty_of_hours = 1.0 * is_elapsed + 0.5 * from_zero
    penalty_of_minutes = 0.0 if is_elapsed or from_zero else 1.0
    return {
        "": PossibleFormat(factor=1.0, penalty=penalty_of_hours),
        clock_format.other_format: PossibleFormat(factor=1.0 / 60.0, penalty=penalty_of_minutes),
    }


def check_order_of_days(path: str, guess: Guess, others: Sequence[Naming]) -> None:
    """Raise DataError if day and month may be in either order, and another file does not show which.

    `Guess.format_of_other_order` is set only if both orders give the same times since the first row, as
    of dates within one day. They then matter beside other files alone. ``path`` is the file of
    ``guess``, and ``others`` have the formats of the other files.
    """
    date_format = guess.naming.time_format
    order = _order_of_days(date_format)
    if not guess.format_of_other_order or all(
        _order_of_days(o.time_format) == order for o in others
    ):
        return
    message = "dates may be a day in either order, which matters beside the other file: say which, "
    remedy = f"`--set 'time_format=\"{date_format}\"'` or "
    remedy += f"`--set 'time_format=\"{guess.format_of_other_order}\"'`"
    raise DataError(Place(path, 1, 1, message + remedy))


def _order_of_days(date_format: str) -> str:
    """Return the letters of day, month and year in a format of dates: dmy of %d/%m/%y."""
    return "".join(re.findall("%([dmy])", date_format.replace("%Y", "%y")))
