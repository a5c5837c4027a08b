"""Guess of times of day in numbers without separators, such as 95959 for 09:59:59."""

import re
from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array

_NAMED_CLOCKS = {"hhmm": "%H%M", "hhmmss": "%H%M%S", "mmss": "%M%S"}
"""Words in the name of a column that say how its numbers are times."""
_DOTTED_CLOCK = re.compile(r"\d{1,2}[.,][0-5]\d")
_LEAST_SECONDS = 10
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
    reason = f"guess: {explain_format(date_format)}"
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
    equal_as_clock = count_of_most_frequent(intervals_as_clock)
    equal_as_numbers = count_of_most_frequent(intervals_as_numbers)
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
    if len(times) < 4 or count_of_most_frequent(np.diff(clock)) <= count_of_most_frequent(
        np.diff(numbers)
    ):
        return ClockFormat()
    mark = times[0][-3]  # the point or comma before the last two digits
    hours = f"%H{mark}%M"
    minutes = f"%M{mark}%S"
    if numbers.max() >= 24.0:
        return ClockFormat(
            date_format=minutes, is_date=True, reason=f"guess: {explain_format(minutes)}"
        )
    reason = f"guess: {explain_format(hours)}"
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


def count_of_most_frequent(intervals: Array) -> int:
    """Return how many intervals (R,), rounded to a thousandth, have the most frequent value."""
    return int(np.unique(np.round(intervals, 3), return_counts=True)[1].max())


def explain_format(date_format: str) -> str:
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
