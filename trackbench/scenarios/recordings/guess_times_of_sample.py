"""Times of a table's sample, with the GPS weeks or nanoseconds that a further column adds."""

from functools import partial

import numpy as np

from trackbench.core.arrays import Array
from trackbench.scenarios.recordings.guess_record import (
    ColumnByQuantity,
    ReasonByKey,
    UnitByQuantity,
)
from trackbench.scenarios.recordings.guess_table_sample import TableSample
from trackbench.scenarios.recordings.guess_times_of_day_in_digits import ClockFormat
from trackbench.scenarios.recordings.parse_dates import instant
from trackbench.scenarios.recordings.parse_numbers import parse_cells
from trackbench.scenarios.recordings.recognize_column_names import words_of
from trackbench.scenarios.recordings.unit_names_and_sizes import UNITS
from trackbench.scenarios.recordings.weeks_or_nanoseconds import rest_of_stamp

_WEEK = 604800.0  # s
_TIME_OF_WEEK = {"tow", "itow", "gms", "sow", "gpst", "secondsofweek"}


def times_of_sample(
    sample: TableSample,
    columns: ColumnByQuantity,
    units: UnitByQuantity,
    reasons: ReasonByKey,
    clock_format: ClockFormat,
) -> tuple[Array, bool]:
    """Return the times (R,) of the sample, and whether they are dates or steps, which need no unit.

    Dates are in seconds since 1970, and other times in the unit of the file. The part of a second
    or the week that a further column has is added.
    """
    if "time" not in columns:
        return sample.numbers(columns["step"]), True
    cells = sample.cells(columns["time"])
    if clock_format.is_date:
        if "date" in columns and columns["time"] != columns["date"]:
            dates = sample.cells(columns["date"])
            cells = [f"{date} {time}" for date, time in zip(dates, cells, strict=True)]
        microseconds, _ = parse_cells(partial(instant, date_format=clock_format.date_format), cells)
        if np.isnan(microseconds).all():
            # The column of the times has whole dates, without those of the other column.
            microseconds, _ = parse_cells(instant, sample.cells(columns["time"]))
        seconds = microseconds / 1e6
    else:
        seconds = sample.numbers(columns["time"])
    return _with_weeks_or_nanoseconds(
        seconds,
        sample,
        columns,
        units,
        reasons,
        is_date=clock_format.is_date,
    ), clock_format.is_date


def _with_weeks_or_nanoseconds(
    time: Array,
    sample: TableSample,
    columns: ColumnByQuantity,
    units: UnitByQuantity,
    reasons: ReasonByKey,
    *,
    is_date: bool,
) -> Array:
    """Return the times (R,) plus the week, or the part of a second, that a further column has.

    This column, and any unit, is then added to the guessed ones. The times stay as they are if there
    is no such column, or if its numbers are no weeks or parts of a second.
    """
    clock = columns["time"]
    rest = rest_of_stamp(sample.names, clock, columns)
    unit = units.get("time")
    if "week" in rest and not is_date and np.isfinite(time).any():
        column = rest["week"].column
        weeks = sample.numbers(column)
        largest = float(np.nanmax(time))
        if unit is None and largest <= _WEEK:
            unit = "s"
        elif unit is None and largest <= 1e3 * _WEEK:
            unit = "ms"
        # The name of the column says that it is a time of the week, or the week number changes.
        is_known = not _TIME_OF_WEEK.isdisjoint(words_of(clock)) or np.ptp(weeks) > 0.0
        # GPS weeks count from 1980, and have four digits at most.
        is_week = np.isfinite(weeks).all() and not (weeks % 1.0).any() and weeks.max() < 1e4
        if unit is not None and is_known and is_week and largest * UNITS[unit] <= _WEEK:
            columns["week"] = column
            if unit != "s":
                units["time"] = unit
                reasons["time"] = "guess: a week has 604800 s"
            return time + weeks * _WEEK / UNITS[unit]
    if "subsecond" in rest:
        column, part_unit = rest["subsecond"]  # without a unit in its name it is in ns
        part = sample.numbers(column) * UNITS[part_unit or "ns"]
        # Times are whole seconds, the part is below a second, and separates rows of one second.
        whole = np.isfinite(time).all() and not (time % 1.0).any() and unit in (None, "s")
        is_part = np.isfinite(part).all() and ((part >= 0.0) & (part < 1.0)).all()
        if whole and is_part and len(np.unique(time + part)) > len(np.unique(time)):
            columns["subsecond"] = column
            if part_unit not in (None, "ns"):
                units["subsecond"] = str(part_unit)
            if not is_date:
                units["time"] = "s"
            reasons["subsecond"] = "guess: the part of a second"
            return time + part
    return time
