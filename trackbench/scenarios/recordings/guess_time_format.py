"""Guess of the format in which a column has dates or times of day."""

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from datetime import UTC, datetime
from functools import partial
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.guess_table_sample import TableSample
from trackbench.scenarios.recordings.parse_dates import (
    KNOWN_FORMATS,
    STAMP_FORMATS,
    instant,
    is_instant,
    may_lack_zero,
)
from trackbench.scenarios.recordings.parse_numbers import number, parse_cells
from trackbench.scenarios.recordings.rows_and_reading_context import usual_interval

_NAMED_CLOCKS = {"hhmm": "%H%M", "hhmmss": "%H%M%S", "mmss": "%M%S"}
"""Words in the name of a column that say how its numbers are times."""
_DOTTED_CLOCK = re.compile(r"\d{1,2}[.,][0-5]\d")
_STAMP = re.compile(r"\d{12}|\d{14}([.,]\d+|\d{1,6})?")
_OTHER_STAMP = re.compile(r"\d{10}|\d{11}|\d{13}([.,]\d+)?")
"""Date with hours alone, such as 2024050309, or day of the year with a time, such as 2024123095959."""
_DAY_IN_DIGITS = re.compile(r"\d{7,8}")
_WORDS_OF_DATES = frozenset(
    ("date", "day", "datum", "fecha", "data", "dato", "jour", "yyyymmdd", "yyyyddd")
)
_DAY_OF_YEAR = re.compile(r"(?<![\d.,])\d{3}(?!\d)")
"""Day of the year between separators."""
_FRACTION = re.compile(r"(\d+(?=[.,])|.*:\d+(?=[.,])|.*:.*:\d+(?=:))[.:,](\d{1,9})")
_MOST_FRAMES = 60
"""frames in a second"""
_DIGITS_ALONE = re.compile(r"(%[YyjmdHMS])+(\.?%f)?")
_YEARS = (1950, 2100)
_LEAST_DECIMALS_OF_YEARS = 5
_LONGEST_INTERVAL_IN_YEARS = 0.003
"""years, about a day: with a longer usual interval numbers near 2000 rather are seconds"""
_LEAST_SECONDS = 10
_STEADIER = 5.0  # times, as the ratio of largest and usual interval, so that an order is decided

CLOCK_IN_DIGITS = re.compile(r"([01]?\d|2[0-3])[0-5]\d([0-5]\d)(?:\.\d*)?")


class ClockFormat(NamedTuple):
    """Guessed format of a column of times."""

    date_format: str = ""
    """format of dates for strptime; empty for ISO 8601 and for numbers"""
    is_date: bool = False
    """True if cells are read as dates or times of day, and not as numbers"""
    reason: str = ""
    """comment for the config that explains the format"""
    other_format: str = ""
    """another format that fits all cells: minutes and seconds in place of hours and minutes, "s" for
    numbers of seconds, or "month" for years with months"""
    format_of_other_order: str = ""
    """format with another order of day and month, and the same times since the first one"""


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
    reason = f"guess: {_explain_format(first)}"
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


def check_decimal_years(
    sample: TableSample, columns: Mapping[str, str], units: Mapping[str, str]
) -> None:
    """Raise DataError if the times are years with decimals, such as 2024.33701.

    As seconds they would have intervals of microseconds. ``columns`` and the known ``units`` are by
    quantity; there is no error if the unit of the times is known.
    """
    if "time" not in columns or "time" in units:
        return
    times = sample.numbers(columns["time"])
    is_year = bool(len(times)) and bool(((times >= _YEARS[0]) & (times < _YEARS[1])).all())
    if not is_year or sample.decimals(columns["time"]) < _LEAST_DECIMALS_OF_YEARS:
        return
    if usual_interval(times) > _LONGEST_INTERVAL_IN_YEARS:
        return
    column = columns["time"]
    message = f"{column}: is {sample.cells(column)[0]} a year with decimals?"
    remedy = "Then write dates, such as 2024-05-03 10:00:59; if these are seconds, say"
    raise DataError(
        Place(sample.path, sample.first_line, 1, f"{message} {remedy} --set units.time=s")
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


def clock_in_numbers(times: Sequence[str], words: Collection[str], has_dates: bool) -> ClockFormat:
    """Return the format of times of day in one number, such as 959, 95959 or 95959.5; else an empty one.

    It is empty if the numbers rather are seconds. If they may as well be read otherwise, it has an
    ``other_format``: "%M%S" in place of "%H%M", "s" for seconds, or "month" for years with months. The
    caller decides by the speed, or asks the user. Zeros before the number may be missing. ``words`` are
    those of the column's name; ``has_dates`` is True if the dates are in a column of their own.
    """
    # Step 1: read the numbers as clocks of 4 or 6 digits, if all of them are possible ones.
    if all(map(_DOTTED_CLOCK.fullmatch, times)):
        return _clock_with_points(times)
    cells = [cell.replace(",", ".") for cell in times]
    wholes = [cell.partition(".")[0] for cell in cells]
    if not all(re.fullmatch(r"\d{1,6}", whole) for whole in wholes):
        return ClockFormat()
    has_fractions = any("." in cell for cell in cells)
    named = next((date_format for word, date_format in _NAMED_CLOCKS.items() if word in words), "")
    digits = 4 if max(map(len, wholes)) <= 4 else 6
    if named:
        digits = 2 * named.count("%")  # two of each part, such as %H
    numbers = np.array([float(cell) for cell in cells])
    seconds = _seconds_of_clock(numbers, digits)
    if seconds is None or len(cells) < 2:
        return ClockFormat()
    if not named and not has_fractions and not has_dates and _are_months(wholes):
        return ClockFormat(other_format="month")
    date_format = "%H%M%S.%f" if has_fractions else "%H%M%S"
    other_format = ""
    if digits == 4:
        date_format = "%H%M"
        # The first two digits of 3058 can only be minutes.
        if numbers.max() >= 2400.0 or has_fractions:
            date_format = "%M%S.%f" if has_fractions else "%M%S"
            seconds = seconds / 60.0  # they were read as hours and minutes
        elif _has_several_hours(numbers):
            other_format = "%M%S"
    # Step 2: the name of the column may decide.
    reason = f"guess: {_explain_format(date_format)}"
    if named:
        if date_format.startswith(named):
            return ClockFormat(date_format=date_format, is_date=True, reason=reason)
        return ClockFormat()
    clock_format = ClockFormat(
        date_format=date_format, is_date=True, reason=reason, other_format=other_format
    )
    if has_dates and date_format.startswith("%H"):
        return clock_format._replace(other_format="")
    # Step 3: otherwise the numbers decide between a clock and seconds. Numbers of one width that begin
    # with a zero, such as 0959, are no seconds.
    is_padded = min(map(len, wholes)) == digits and wholes[0].startswith("0")
    intervals_as_clock = np.diff(seconds) % 86400.0
    intervals_as_numbers = np.diff(numbers)
    if np.allclose(intervals_as_clock, intervals_as_numbers, atol=1e-6):
        # Within a minute both are the same times, but for the time of the first.
        return clock_format if is_padded else ClockFormat()
    if is_padded:
        return clock_format
    if digits == 6 and not has_fractions and _takes_many_seconds(times):
        return clock_format
    # The right reading has more equal intervals.
    equal_as_clock = _count_of_most_frequent(intervals_as_clock)
    equal_as_numbers = _count_of_most_frequent(intervals_as_numbers)
    if len(intervals_as_clock) >= 3 and equal_as_clock > equal_as_numbers:
        return clock_format
    # Within an hour 1201 and 1202 may be minutes or seconds, as 1100 and 1200 may be hours or seconds.
    # Numbers of fewer digits, such as 5 and 10, are seconds since the start of the recording.
    is_whole = date_format in ("%H%M", "%H%M%S") and min(map(len, wholes)) >= digits - 1
    if is_whole and equal_as_clock == equal_as_numbers:
        return clock_format._replace(other_format="s")
    return ClockFormat()


def _clock_with_points(times: Sequence[str]) -> ClockFormat:
    """Return the format of times such as 9.58, 9.59 and 10.00, which are no decimals; else an empty one.

    More of their intervals must be equal as hours and minutes, or minutes and seconds, than as decimals.
    The format of hours and minutes has that of minutes and seconds as its ``other_format``, which is
    also possible. `ClockFormat.is_date` says for both that cells are read by a format of dates, and not
    as numbers.
    """
    parts = [re.split("[.,]", cell) for cell in times]
    numbers = np.array([float(f"{whole}.{rest}") for whole, rest in parts])
    clock = np.array([60.0 * float(whole) + float(rest) for whole, rest in parts])
    if len(times) < 4 or _count_of_most_frequent(np.diff(clock)) <= _count_of_most_frequent(
        np.diff(numbers)
    ):
        return ClockFormat()
    mark = times[0][-3]  # the point or comma before the last two digits
    hours = f"%H{mark}%M"
    minutes = f"%M{mark}%S"
    if numbers.max() >= 24.0:
        return ClockFormat(
            date_format=minutes, is_date=True, reason=f"guess: {_explain_format(minutes)}"
        )
    reason = f"guess: {_explain_format(hours)}"
    return ClockFormat(date_format=hours, is_date=True, reason=reason, other_format=minutes)


def _seconds_of_clock(numbers: Array, digits: int) -> Array | None:
    """Return times of day in one number, such as 95959, as seconds (R,); None if one is impossible.

    ``digits`` is 4 for hours and minutes, or 6 for hours, minutes and seconds. The hours of 4 digits may
    be as many as 59, as the caller may take them for minutes, and the minutes for seconds.
    """
    # Pairs of digits, the last one first.
    parts = [numbers // size % 100.0 for size in (1.0, 100.0, 10_000.0)[: digits // 2]]
    parts[0] = numbers % 100.0  # with the fraction of the last part
    largest = parts[-1].max()
    if any(part.max() >= 60.0 for part in parts) or (digits == 6 and largest >= 24.0):
        return None
    seconds = np.zeros(len(numbers))
    for power, part in enumerate(parts):
        seconds += part * 60.0**power
    return seconds * (60.0 if digits == 4 else 1.0)


def _are_months(cells: Sequence[str]) -> bool:
    """Test whether whole numbers are years with months, such as 202405, and count every month."""
    if not all(re.fullmatch(r"(19|20)\d\d(0[1-9]|1[0-2])", cell) for cell in cells):
        return False
    months = np.array([12 * int(cell[:4]) + int(cell[4:]) for cell in cells])
    return len(months) > 12 and bool((np.diff(months) == 1).all())


def _has_several_hours(numbers: Array) -> bool:
    """Test whether times in one number of four digits, such as 0959, have different first two digits."""
    return bool(np.ptp(numbers // 100.0) > 0.0)


def _takes_many_seconds(times: Sequence[str]) -> bool:
    """Test whether all cells are possible times, such as 235959, with many different seconds.

    Numbers of seconds would hardly have last digits that are all below 60.
    """
    clocks = [match for match in map(CLOCK_IN_DIGITS.fullmatch, times) if match]
    return len(clocks) == len(times) and len({match[2] for match in clocks}) >= _LEAST_SECONDS


def _count_of_most_frequent(intervals: Array) -> int:
    """Return how many intervals (R,), rounded to a thousandth, have the most frequent value."""
    return int(np.unique(np.round(intervals, 3), return_counts=True)[1].max())


def _more_regular_meaning(
    cells: Sequence[str], times_as_dates: Iterable[Array]
) -> Literal["dates", "numbers", "either"]:
    """Return whether more intervals between ``cells`` are equal as dates or as plain numbers.

    ``times_as_dates`` are the times (R,), microseconds since 1970, by each format of dates that fits.
    """
    if len(cells) < 2:
        return "either"
    equal_as_dates = max(_count_of_most_frequent(np.diff(times)) for times in times_as_dates)
    # The decimals of a second may stand after a comma.
    numbers = [float(cell.replace(",", ".")) for cell in cells]
    equal_as_numbers = _count_of_most_frequent(np.diff(numbers))
    if equal_as_dates == equal_as_numbers:
        return "either"
    return "dates" if equal_as_dates > equal_as_numbers else "numbers"


def _is_number(cell: str) -> bool:
    return cell.replace(".", "", 1).isdigit()


def _explain_format(date_format: str) -> str:
    """Describe a format of dates, such as %H:%M, for a comment in the config."""
    if "%d" in date_format:
        return "%d is the day, %m the month"
    if "%j" in date_format:
        return "%j is the day of the year"
    if date_format.startswith("%M"):
        return "minutes and seconds"
    if date_format.startswith("%H") and date_format.endswith("%M"):
        return "hours and minutes"
    return "hours, minutes and seconds"


def _fitting_formats(cells: Sequence[str]) -> dict[str, Array]:
    """Return the times (R,), microseconds since 1970, by each known format that fits all cells."""
    times_by_format: dict[str, Array] = {}
    for date_format in KNOWN_FORMATS:
        # Without its last three characters, such as .%f, it is the format of whole seconds.
        if date_format.endswith("%f") and date_format[:-3] in times_by_format:
            continue  # no cell has digits behind its seconds
        # Most formats do not fit the first cell, so that it is tried alone first.
        if not all(_has_digits_of(date_format, cell) for cell in cells[:1]):
            continue
        values, mistakes = parse_cells(partial(instant, date_format=date_format), cells[:1])
        if not mistakes:
            values, mistakes = parse_cells(partial(instant, date_format=date_format), cells)
        if not mistakes and all(_has_digits_of(date_format, cell) for cell in cells):
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


def _has_digits_of(date_format: str, cell: str) -> bool:
    """Test whether the parts of a cell that are digits alone have as many digits as the format.

    Without this test strptime reads 090324 by "%Y%m%d" as the 4th of February 903, and the month of
    2024-05 by "%Y-%j" as a day.
    """
    if "%j" in date_format and not _DIGITS_ALONE.fullmatch(date_format.partition(" ")[0]):
        return _DAY_OF_YEAR.search(cell) is not None
    for format_part, cell_part in zip(date_format.split(" "), cell.split(" "), strict=False):
        if not _DIGITS_ALONE.fullmatch(format_part) or len(format_part) == 2:
            continue  # a part with separators, such as %H:%M, or one number of any length, such as %Y
        digits = len(re.match(r"\d*", cell_part)[0])  # type: ignore[index]
        wanted = format_part.count("%Y") * 4 + format_part.count("%j") * 3
        wanted += 2 * len(re.findall("%[ymdHMS]", format_part))
        least = wanted
        most = wanted
        if format_part.startswith("%H"):
            least = 1  # 93000 is 9:30:00, and 5 is 0:00:05
        elif may_lack_zero(format_part):
            least = wanted - 1  # 30524 is the 3rd of May 2024
        elif format_part.endswith("S%f"):  # one to six digits of a second without a point
            least = wanted + 1
            most = wanted + 6
        if not least <= digits <= most:
            return False
        if "%Y" in format_part:
            # Each number before the year has two digits, but for a zero that the first one may lack: the
            # year of 3052024 by %d%m%Y begins after three digits.
            place = re.sub("%Y.*", "", format_part).count("%") * 2
            place -= wanted - digits if least < wanted else 0
            if not _YEARS[0] <= int(cell_part[place : place + 4]) <= _YEARS[1]:
                return False
    return True


def _falls_and_unevenness(times: Array) -> tuple[bool, float]:
    """Return whether times (R,) fall anywhere, and the ratio of their largest to their usual interval.

    The lesser result belongs to the likelier times.
    """
    falls = bool((np.diff(times) < 0.0).any())
    intervals = np.diff(np.unique(times))
    if not len(intervals):
        return falls, 1.0
    return falls, float(intervals.max(initial=0.0)) / usual_interval(times)
