"""Questions on a clock that was set while it ran, as at the beginning of summer time."""

from datetime import UTC, datetime

import numpy as np

from trackbench.field_types import DataError
from trackbench.scenarios.recordings.rows_and_reading_context import (
    ReadingContext,
    Rows,
    usual_interval,
)
from trackbench.scenarios.recordings.yaml_values import in_option

_DAY = 86400.0  # s
_HOUR = 3600.0  # s
_SUNDAY = 6
_MONTHS_OF_SPRING = (3, 4, 9, 10)
"""in which clocks are set forward, north and south of the equator"""
_LATEST_HOUR = 4
"""to which clocks are set forward"""
_LONGEST_PAUSE = 200.0 * _DAY
"""s: beyond it a pause is rather a clock that was set"""
_MOST_INTERVALS = 1e6
"""usual intervals between rows, up to which a pause of any length is possible"""
_FEWEST_MEASURED = 5
"""rows beside which others may show that nothing was detected"""
_LONG_INTERVAL = 600.0  # s between rows, which hardly show that an hour is missing
_ROUNDING = 0.5  # s, of times that are written as whole seconds


def check_clock(context: ReadingContext, rows: Rows) -> None:
    """Raise DataError if the time rises so far that the clock rather was set while it ran.

    Its first dates are of 1970 or 1980, as an example, and the next ones of today. ``rows`` are those of
    one run and sensor.
    """
    times, first_rows_of_times = np.unique(rows.time, return_index=True)
    if context.counts_steps or len(times) < _FEWEST_MEASURED:
        return
    intervals = np.diff(times)
    longest = int(np.argmax(intervals))
    usual = usual_interval(times)
    if intervals[longest] <= max(_LONGEST_PAUSE, _MOST_INTERVALS * usual):
        return
    message = (
        f"time rises by {intervals[longest] / _DAY / 365.25:.3g} years, where rows usually are"
    )
    message += f" {usual:.6g} s apart: was the clock set only here?"
    count = int((rows.time <= times[longest]).sum())
    remedy = (
        f"Leave out or correct the rows before ({count}); or give both parts a number in a column,"
    )
    row = int(first_rows_of_times[longest + 1])
    raise DataError(context.place(rows, row, f"{message} {remedy} --set 'columns.run=ITS NAME'"))


def check_daylight_saving(context: ReadingContext, rows: Rows) -> None:
    """Raise DataError if local times lack an hour because clocks were set forward in spring.

    It is an hour of a Sunday night, and the rows before and after it have their usual interval.
    ``rows`` are those of one run and sensor, in order of time.
    """
    has_local_times = context.clock is not None and context.clock.kind == "date"
    if not has_local_times or len(rows.time) < _FEWEST_MEASURED:
        return
    usual = usual_interval(rows.time)
    if usual > _LONG_INTERVAL:
        return
    seconds = rows.time + context.first_date_us / 1e6
    intervals = np.diff(seconds)
    # Intervals vary by half a usual one, and written times are rounded by half a second.
    tolerance = 0.5 * usual + _ROUNDING
    for row in np.flatnonzero(np.abs(intervals - usual - _HOUR) < tolerance).tolist():
        before = datetime.fromtimestamp(float(seconds[row]), UTC)
        after = datetime.fromtimestamp(float(seconds[row + 1]), UTC)
        # From 1:59 to 3:00 all times with the hour 2 are left out.
        skips_hour = after.hour - before.hour == 2 and before.day == after.day
        in_season = before.month in _MONTHS_OF_SPRING and before.weekday() == _SUNDAY
        if not in_season or not skips_hour or after.hour > _LATEST_HOUR:
            continue
        column = in_option(context.naming.columns["time"])
        message = f"after {before:%H:%M:%S} comes {after:%H:%M:%S}, on a Sunday of {before:%B}:"
        message += " are these local times, and was the clock set forward?"
        remedy = "Write times in UTC, or with their zone (+01:00)"
        option = f"if this hour has passed without a row, say --set 'columns.time={column}'"
        raise DataError(context.place(rows, row + 1, f"{message} {remedy}; {option}"))
