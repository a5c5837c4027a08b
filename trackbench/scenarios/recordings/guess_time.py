"""Guess of how a table writes its times: the form of dates, or the unit of numbers."""

import re
from collections.abc import Sequence
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.column_mapping import UNITS
from trackbench.scenarios.recordings.csv_tables import number, parsed
from trackbench.scenarios.recordings.dates import instant, is_instant
from trackbench.scenarios.recordings.rows import usual_interval

_DAY_FORMS = (
    "%d/%m/%Y|%m/%d/%Y|%d.%m.%Y|%d-%m-%Y|%m-%d-%Y|%Y/%m/%d|%Y.%m.%d|%Y%m%d|%d/%m/%y|%m/%d/%y|"
    "%d.%m.%y|%d-%b-%Y|%d-%b-%y|%d %b %Y|%b %d %Y|%b %d, %Y|%Y-%m-%d"
)
_TIME_FORMS = (
    "%H:%M:%S|%H:%M:%S.%f|%H:%M:%S,%f|%I:%M:%S %p|%I:%M:%S.%f %p|%H:%M|%I:%M %p|"
    "%H%M%S|%H%M%S.%f|%H:%M:%S:%f|%H.%M.%S"
)
_DAYS, _TIMES = _DAY_FORMS.split("|"), _TIME_FORMS.split("|")
_FORMS = [
    *_TIMES,
    *_DAYS,
    *map(" ".join, product(_DAYS, _TIMES)),
    *map("T".join, product(_DAYS, _TIMES[:3])),
]
_CLOCK = re.compile(r"([01]?\d|2[0-3])[0-5]\d([0-5]\d)(?:\.\d*)?")
_LEAST_SECONDS = 10
_STEADIER = 5.0  # times, as the ratio of largest and usual interval, so that an order is decided
_SIZES = ((1e17, "ns"), (1e14, "us"), (1e11, "ms"))
"""Numbers since 1970 from 1973 on, in units that make them so large."""
_SLOW, _FAST = 0.1, 2e4  # m/s: few targets are slower, none faster
_LONG = 50.0  # s: usual interval from which on a smaller unit may be meant


class DateForm(NamedTuple):
    """Form of dates as strptime has it, or nothing for ISO 8601 and numbers."""

    form: str = ""
    is_date: bool = False
    why: str = ""


def date_form(path: str, times: Sequence[str], dates: Sequence[str], line: int) -> DateForm:
    """Guess the form of a column of times, and of one of dates beside it.

    Raises DataError if day and month may stand in either order, with different times.
    """
    if not times:
        return DateForm()
    cells = [" ".join(pair) for pair in zip(dates, times, strict=True)] if dates else [*times]
    if not parsed(number, [cell.replace(",", ".") for cell in times])[1]:
        # Hours, minutes and seconds in one number, 235959.0, whose seconds take many values.
        clocks = [match for match in map(_CLOCK.fullmatch, times) if match]
        if len(clocks) < len(times) or len({match[2] for match in clocks}) < _LEAST_SECONDS:
            return DateForm()
    elif is_instant(cells[0]):
        return DateForm("", True)
    found = {}
    for form in _FORMS:
        if form.endswith("%f") and form[:-3] in found:
            continue  # no cell has digits behind its seconds
        values, mistakes = parsed(partial(instant, form=form), cells[:1])
        if not mistakes:
            values, mistakes = parsed(partial(instant, form=form), cells)
        if not mistakes:
            found[form] = values
    if not found:
        return DateForm("", True)
    # Of orders that give the same times the month is first beside a.m. and p.m. only.
    first, *others = sorted(
        found, key=lambda form: (_unsteady(found[form]), "%p" in form and form[:2] == "%d")
    )
    for other in others:
        if np.array_equal(found[other] - found[other][0], found[first] - found[first][0]):
            continue
        (falls, gap), (other_falls, other_gap) = map(_unsteady, (found[first], found[other]))
        if falls == other_falls and other_gap < _STEADIER * gap:
            what = f"{cells[0]!r} may be a day in either order: say which, "
            way = " or ".join(f"`--set 'time_format=\"{form}\"'`" for form in (first, other))
            raise DataError(Place(path, line, 1, what + way))
    why = "%d is the day, %m the month" if "%d" in first else "hours, minutes and seconds"
    return DateForm(first, True, f"guess: {why}")


def _unsteady(times: Array) -> tuple[bool, float]:
    """Test whether times fall, and the largest interval in usual ones."""
    apart = np.diff(np.unique(times))
    largest = float(apart.max(initial=0.0)) / usual_interval(times) if len(apart) else 1.0
    return bool((np.diff(times) < 0.0).any()), largest


def unit_by_size(times: Array) -> str | None:
    """Guess the unit of times since 1970 that are too large for seconds."""
    latest = float(np.nanmax(np.abs(times), initial=0.0))
    return next((unit for size, unit in _SIZES if latest > size), None)


def unit_by_speed(times: Array, speed: float) -> str | None:
    """Guess the unit of times that would give a usual speed, where seconds would not."""
    if speed > _FAST and times.min() > 2e4 and times.max() < 8e5:
        return "d"  # as spreadsheets count them
    if speed >= _SLOW or usual_interval(times) < _LONG or (times % 1.0).any():
        return None
    return next((unit for unit in ("ms", "us", "ns") if speed / UNITS[unit] >= _SLOW), None)
