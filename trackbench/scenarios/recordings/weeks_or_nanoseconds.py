"""Weeks, or nanoseconds and other parts of a second, that a further column adds to the time."""

from collections.abc import Collection, Iterable, Mapping
from math import inf

import numpy as np

from trackbench.core.arrays import Array
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.parse_tables import Table
from trackbench.scenarios.recordings.quantity_keys import STAMP_PARTS
from trackbench.scenarios.recordings.recognize_column_names import FILLERS, NamedColumn, words_of
from trackbench.scenarios.recordings.unit_names_and_sizes import UNIT_WORDS, UNITS

_SUBSECONDS: dict[str, str] = {
    **dict.fromkeys(("nanosec", "nanosecs", "nsec", "nsecs", "nanos", "ns"), "ns"),
    **dict.fromkeys(("nanosecond", "nanoseconds"), "ns"),
    **dict.fromkeys(("usec", "usecs", "microsec", "microsecs", "micros", "us"), "us"),
    **dict.fromkeys(("microsecond", "microseconds"), "us"),
    **dict.fromkeys(("ms", "msec", "msecs", "millis", "millisecond", "milliseconds"), "ms"),
}
"""Last words of columns that may hold the part of a time within its second."""
_WEEKS = (
    *("week", "gpsweek", "gwk", "wn", "wnc", "gpswn", "weekno", "weeknum", "weeknumber"),
    *("gpsweekno", "gpsweeknum", "gpsweeknumber"),
)


def _seconds_of_part(path: str, table: Table, name: str, column: str, unit: str | None) -> Array:
    """Return the seconds (R,) that a ``column`` of the table at ``path`` adds to the time.

    ``name`` is its key, ``week`` or ``subsecond``, and ``unit`` its unit; None for weeks or nanoseconds.
    Raises DataError for a missing value, and for a subsecond that is not within 0 and 1 s.
    """
    scale = STAMP_PARTS[name]  # s, of a week or a nanosecond
    if unit is not None:
        scale = UNITS[unit]
    seconds: Array = table.columns[column] * scale
    is_valid = seconds < inf  # False for NaN
    if name == "subsecond":
        is_valid = (seconds >= 0.0) & (seconds < 1.0)
    wrong = np.flatnonzero(~is_valid)
    if len(wrong):
        value = table.columns[column][wrong[0]]
        message = f"{column}: {value:.9g} is no part of a second; say its unit"
        message += f" (`units: {{{name}: us}}`)"
        if np.isnan(value):
            message = f"{column}: is missing, and is a part of the time"
        raise DataError(Place(path, int(table.lines[wrong[0]]), 1, message))
    return seconds


def seconds_of_parts(
    path: str, table: Table, columns: Mapping[str, str], units: Mapping[str, str]
) -> Array | float:
    """Return the seconds (R,) that further columns add to the time; 0 without such columns.

    ``columns`` and ``units`` are by key, ``week`` or ``subsecond``. Raises DataError for a missing value
    and for a subsecond that is not within 0 and 1 s.
    """
    added: Array | float = 0.0
    for name, column in columns.items():
        added = added + _seconds_of_part(path, table, name, column, units.get(name))
    return added


def rest_of_stamp(
    names: Iterable[str], clock: str, known: Collection[str] = ()
) -> dict[str, NamedColumn]:
    """Return columns that look like further parts of the time in the column ``clock``, by key.

    The keys are ``week``, the GPS week, and ``subsecond``, such as nanoseconds; those in ``known`` are
    left out. Only the numbers in the columns can show whether they are such parts.
    """
    before = _words_before_unit(clock)
    rest: dict[str, NamedColumn] = {}
    for name in names:
        words = words_of(name)
        if name == clock or not words:
            continue
        if "week" not in known and "".join(_without_fillers(words)) in _WEEKS:
            rest.setdefault("week", NamedColumn(column=name, unit=None))
        unit = _SUBSECONDS.get(words[-1])
        # The name must be that of the clock but for the last word, as header.stamp.nanosec is beside
        # header.stamp.sec, or that word alone.
        if unit and "subsecond" not in known and words[:-1] in ([], before, words_of(clock)):
            rest.setdefault("subsecond", NamedColumn(column=name, unit=unit))
    return rest


def _words_before_unit(name: str) -> list[str]:
    """Return the words of a column's name without a unit at its end."""
    words = words_of(name)
    if words and words[-1] in UNIT_WORDS:
        return words[:-1]
    return words


def _without_fillers(words: list[str]) -> list[str]:
    """Return the words without those that may stand beside any quantity, such as gps.

    The first word stays.
    """
    fillers = FILLERS.split()
    return [word for word in words if word not in fillers or word == words[0]]
