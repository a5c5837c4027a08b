"""Guess of the unit of times: which epochs, intervals and rates are likely; no years with decimals."""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.guess_position_unit import largest_coordinates
from trackbench.scenarios.recordings.guess_table_sample import TableSample
from trackbench.scenarios.recordings.parse_dates import (
    YEARS,
)
from trackbench.scenarios.recordings.rows_and_reading_context import usual_interval
from trackbench.scenarios.recordings.unit_names_and_sizes import UNITS
from trackbench.scenarios.recordings.unscaled_rows import PossibleFormat, UnscaledRows

_PENALTY_OF_EXACT_FIT = 0.3
"""Penalty of min, h or d, which are rare units of time, if the numbers fit the unit exactly.

It is half of the margin of `likely_units`, so that such a unit remains possible beside s.
"""
_REGULAR = 0.8  # of the intervals are the usual one
_TODAY = (1.0e9, 2.1e9)
"""seconds since 1970 of the years 2001 to 2036"""
_OTHER_EPOCHS = (6e7, 6.5e8)
"""seconds that may be those since 2000, 2006 (BeiDou), 2010 and the like, or the ms of hours and days"""
_LEAST_DECIMALS_OF_YEARS = 5
_LONGEST_INTERVAL_IN_YEARS = 0.003
"""years, about a day: with a longer usual interval numbers near 2000 rather are seconds"""


class TimeUnit(NamedTuple):
    """Numbers that times in a unit have."""

    unit: str
    penalty: float
    """how unlikely the unit is before the numbers are considered"""
    largest: float
    """largest number of a clock that began at zero"""
    dates: tuple[tuple[float, float], ...] = ()
    """least and largest number of times that count from a date, such as 1970"""
    is_whole: bool = False
    """True if times in this unit usually are whole numbers"""


TIME_UNITS = (
    TimeUnit("s", 0.0, 4e7, ((6.5e8, 5e9),)),
    TimeUnit("ms", 0.0, 4e9, ((6.5e11, 5e12),), True),
    TimeUnit("us", 0.0, 4e12, ((6.5e14, 5e15),), True),
    TimeUnit("ns", 0.0, 4e15, ((6.5e17, 5e18),), True),
    # Ticks of Windows since 1601, and since the year 1.
    TimeUnit("100ns", 0.0, 0.0, ((1.2e17, 1.5e17), (6.25e17, 6.48e17)), True),
    # Days of spreadsheets, since the year 0, and Julian dates.
    TimeUnit("d", 0.0, 0.0, ((2e4, 8e4), (7e5, 8e5), (2.4e6, 2.5e6))),
    TimeUnit("d", 2.0, 4e3),
    TimeUnit("h", 2.0, 1e4),
    TimeUnit("min", 2.0, 1e6),
)


def time_units(
    unscaled: UnscaledRows,
    known_units: Mapping[str, str],
    possible_formats: Mapping[str, PossibleFormat],
) -> Iterator[tuple[str, float, float]]:
    """Yield each possible unit of the time, its factor to seconds, and its penalty.

    Dates have no unit: in its place stands their format, empty for the format by which they were read.
    ``known_units`` are units by quantity that need no guess. ``possible_formats`` are the formats of
    dates, if there are several.
    """
    if unscaled.is_dated:
        yield "", 1.0, possible_formats.get("", PossibleFormat(factor=1.0, penalty=0.0)).penalty
        for time_format, possible in possible_formats.items():
            if time_format:
                yield time_format, possible.factor, possible.penalty
        return
    if "time" in known_units:
        yield known_units["time"], UNITS[known_units["time"]], 0.0
        return
    # Step 1: properties of the numbers that speak for some units.
    finite = unscaled.time[np.isfinite(unscaled.time)]
    largest = float(np.abs(finite).max(initial=0.0))
    is_whole = not (finite % 1.0).any()
    whole_seconds = _whole_seconds_of_days(finite)
    # The largest time may count from 1970: it then is within the years 2001 to 2036.
    is_today = any(
        _TODAY[0] <= largest * UNITS[unit] <= _TODAY[1] for unit in ("s", "ms", "us", "ns")
    )
    intervals = np.diff(np.unique(finite))
    in_minutes = bool(len(intervals)) and not (intervals % 60.0).any()
    has_degrees = unscaled.is_geodetic and largest_coordinates(unscaled.position)[1] <= 90.0
    # Step 2: the penalty of each unit, the least one of a unit with several rows in `TIME_UNITS`. The
    # penalties add up, and those of two candidates are compared by the margin of `likely_units`, 0.6.
    # Numbers that fit a rare unit exactly outweigh all other signs: `_PENALTY_OF_EXACT_FIT` replaces the
    # sum.
    penalty_by_unit: dict[str, float] = {}
    for candidate in TIME_UNITS:
        penalty = candidate.penalty
        is_date = any(least <= largest <= most for least, most in candidate.dates)
        if not is_date and largest > candidate.largest:
            since_other_epoch = candidate.unit == "s" and largest >= _OTHER_EPOCHS[0]
            penalty += 0.5 if since_other_epoch and largest <= _OTHER_EPOCHS[1] else 3.0
        if candidate.is_whole and not is_whole:
            penalty += 1.0
        # Times since 1970 are likelier than a clock that has run so long in another unit.
        if not is_date and is_today:
            penalty += 1.5
        # Intervals of whole minutes, as in 0, 60 and 120, are rather seconds than ms.
        if candidate.unit == "ms" and is_whole and in_minutes:
            penalty += 0.5
        # Dates in days have fractions of days that are whole seconds; whole days are rare.
        if candidate.unit == "d" and is_date:
            if whole_seconds:
                penalty -= 1.0
            elif is_whole:
                penalty += 1.0
        # 0.01667 and 0.03333 are whole seconds in min; in s they may be 60 rows a second.
        if candidate.unit in ("min", "h") and _are_rounded_seconds(
            finite * UNITS[candidate.unit], finite
        ):
            penalty = _PENALTY_OF_EXACT_FIT
        # 0.00833 is 30 s in h; in min it may be half a second, which is less likely than h.
        elif candidate.unit == "min" and _are_rounded_seconds(finite * UNITS["h"], finite):
            penalty = 2.0 * _PENALTY_OF_EXACT_FIT
        # 0.041667 h is 150 s, and in d it is an hour.
        elif candidate.unit == "d" and not is_date and _may_be_days(finite):
            penalty = _PENALTY_OF_EXACT_FIT
        # 0, 1 and 2 may count minutes, hours or days, which alone have a penalty of their own here. It
        # is lowered, so that they win if degrees in so many s are the speed of a rocket: `likely_units`
        # adds the penalty of the speed.
        elif candidate.penalty and not is_date and is_whole and has_degrees:
            penalty -= 0.5
        penalty_by_unit[candidate.unit] = min(penalty, penalty_by_unit.get(candidate.unit, np.inf))
    for unit, penalty in penalty_by_unit.items():
        yield unit, UNITS[unit], penalty


def _whole_seconds_of_days(times: Array) -> bool:
    """Test whether times (R,), taken as days, have fractions of days that are whole seconds.

    Times in seconds with so many digits behind the point, taken as days, are no whole seconds.
    """
    # All times have at most three digits behind the point: too few to show whole seconds.
    if not len(times) or not (np.abs(times * 1e3 % 1.0 - 0.5) < 0.49).any():
        return False
    seconds = times * 86400.0
    # Nine digits behind the point are 1e-4 s, six are 0.09 s.
    return bool((np.abs(seconds - np.rint(seconds)) < 0.09).mean() > 0.95)


def _are_rounded_seconds(seconds: Array, written: Array) -> bool:
    """Test whether times (R,) in ``seconds`` are whole, but for the rounding of the ``written`` numbers.

    ``written`` are the same times in the unit of the file, such as hours. They must have three digits or
    more behind the point, and their rounding must be below 0.05 s: numbers with fewer digits, or a
    coarser rounding, would be whole seconds by chance.
    """
    # The least number of digits with which all numbers are written exactly.
    digits = next(
        (
            d
            for d in range(10)
            if not (np.abs(_difference_from_whole(written * 10.0**d)) > 1e-3).any()
        ),
        9,
    )
    if digits < 3 or not len(written):
        return False
    largest = np.abs(written).max()
    # Half of the last digit in s, and a tenth of it more.
    rounding = 0.55 * 10.0**-digits * float(seconds.max() / largest) if largest > 0.0 else 0.0
    return bool(
        0.0 < rounding < 0.05 and (np.abs(_difference_from_whole(seconds)) <= rounding).all()
    )


def _may_be_days(times: Array) -> bool:
    """Test whether times (R,) are whole seconds as hours, and multiples of ten minutes as days."""
    if not _are_rounded_seconds(times * UNITS["h"], times):
        return False
    # Distance in s from a multiple of ten minutes, which the rounding of the numbers explains if small.
    off_whole = 600.0 * _difference_from_whole(times * UNITS["d"] / 600.0)
    return bool((np.abs(off_whole) < 0.6).all())


def _difference_from_whole(values: Array) -> Array:
    """Return the differences of values from the nearest whole numbers."""
    return values - np.rint(values)


def penalty_of_interval(times: Array, is_gps: bool) -> float:
    """Return the penalty of the usual interval of times, s: whole seconds or a whole rate have none.

    It is added to the other penalties of a choice of units, and so has their scale: a choice remains
    possible if its sum is less than 0.6 above the least one. Thus 0.5 does not decide alone, 1 does, and
    2 or 3 also do against another penalty. If ``is_gps``, a high rate has a larger penalty, as receivers
    of GPS have fewer rows a second than other sensors. The caller takes latitudes and longitudes as
    those of GPS.
    """
    finite = np.sort(times[np.isfinite(times)])
    intervals = np.diff(finite)
    intervals = intervals[intervals > 0.0]
    if not len(intervals):
        return 0.0
    usual = usual_interval(finite)
    penalty = 0.0
    # More than 500 rows a second are rare; so are more than 67, or of GPS more than 25.
    if usual < 0.002:
        penalty += 3.0 if is_gps else 2.0
    elif usual < (0.039 if is_gps else 0.015):
        penalty += 1.0
    # Without a regular interval its length shows nothing more.
    if (np.abs(intervals - usual) > 0.02 * usual).mean() > 1.0 - _REGULAR:
        return penalty
    if usual >= 20.0:
        # Multiples of 30 s, and 20 s, are usual; 1000 s are not, and may be 1000 ms.
        if min(usual % 30.0, -usual % 30.0) <= 0.5 or abs(usual - 20.0) < 0.5:
            return penalty
        # Odd intervals are the rarer, the longer they are.
        return penalty + (1.0 if usual > 60.0 else 0.5)
    # Longer intervals are multiples of half a second, and shorter ones belong to a whole rate.
    if usual >= 1.0:
        return penalty + 0.5 * (min(usual % 0.5, -usual % 0.5) > 0.02 * usual)
    rate = 1.0 / usual
    return penalty + (abs(rate - np.rint(rate)) > 0.03 * rate)


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
    is_year = bool(len(times)) and bool(((times >= YEARS[0]) & (times < YEARS[1])).all())
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
