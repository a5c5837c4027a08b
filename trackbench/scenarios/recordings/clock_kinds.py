"""Kinds of clocks that files have, and which of them share one time axis."""

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from trackbench.core.arrays import Array
from trackbench.scenarios.recordings.column_names import words_of
from trackbench.scenarios.recordings.convert_columns import Columns
from trackbench.scenarios.recordings.csv_tables import Table

Kind: TypeAlias = Literal[
    "step", "number", "unix", "gps", "date", "date in utc", "date with a zone"
]
"""Kind of a clock: steps, times that begin anywhere, UNIX times, times of GPS, and dates.

A date without a zone is ``in utc`` if the name of its column says so.
"""
ABSOLUTE = ("unix", "date in utc", "date with a zone")
"""Kinds that count from one moment, and so share a time axis."""
_WITHOUT_UNIT = ("step", "date", "date in utc", "date with a zone")
_WORDS_OF_STEPS_AND_DATES: dict[Kind, str] = {
    "step": "numbers of steps",
    "date": "dates",
    "date in utc": "dates",
    "date with a zone": "dates with a zone",
}
_UTC = frozenset(("utc", "gmt", "zulu"))
"""Words in the name of a column whose dates need no zone of their own."""
_UNIX = frozenset(("unix", "posix", "epoch", "unixtime", "epochtime", "utc"))
_GPS = frozenset(("gps", "gpst", "gpstime", "gnss", "tai", "tow", "gpstow", "itow"))
_YEARS_OF_UNIX = (631152000.0, 4102444800.0)
"""s since 1970, from 1990 to 2100: numbers within may be UNIX times"""
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


class FileClock(NamedTuple):
    """Clock of a file."""

    path: str
    """path of the file"""
    column: str
    """column of the times"""
    kind: Kind
    unit: str
    """unit of its numbers; empty for steps and dates"""
    span: tuple[float, float]
    """first and last time, s or steps; those of UNIX times and dates count from 1970"""
    lacks_zone: bool = False
    """True if its dates have no zone of their own"""
    counts_weeks: bool = False
    """True if a column has the GPS weeks of its times"""

    @property
    def is_absolute(self) -> bool:
        """True if its times count from one moment, as UNIX times and dates with a zone do."""
        return self.kind in ABSOLUTE

    @property
    def has_unit(self) -> bool:
        """True if the key ``units`` may have the unit of its times."""
        return self.kind not in _WITHOUT_UNIT

    @property
    def in_words(self) -> str:
        """Words for its times: dates, seconds, UNIX times in ms."""
        # Steps and dates of any kind have no unit.
        if self.kind in _WORDS_OF_STEPS_AND_DATES:
            return _WORDS_OF_STEPS_AND_DATES[self.kind]
        if self.kind == "number":
            return "seconds" if self.unit == "s" else f"times in {self.unit}"
        name = {"unix": "UNIX times", "gps": "times of GPS"}[self.kind]
        return f"{name} in {self.unit}"


def clock_of_file(columns: Columns, table: Table, column: str, parts: Sequence[str]) -> FileClock:
    """Return the clock of a file, whose times are in a ``column`` of its ``table``.

    ``columns`` are those of the file, and ``parts`` the keys of further columns that are added to the
    time. Numbers are taken for UNIX times if they then are within the years 1990 to 2100.
    """
    naming = columns.naming
    time = table.columns[column]
    words = frozenset(words_of(column))
    unit = naming.units.get("time", "s")
    # The column was found by the key `step`, and not by `time`.
    if columns.contents[column] == "step" and not table.dated:
        return FileClock(column=column, path=columns.path, kind="step", unit="", span=_span(time))
    if table.dated:
        kind: Kind = "date"
        if table.dated == "date with a zone" or naming.zone:
            kind = "date with a zone"
        elif not _UTC.isdisjoint(words):
            kind = "date in utc"
        span = _span(microseconds_of_dates(columns, table, time) / 1e6)
        return FileClock(
            column=column,
            path=columns.path,
            kind=kind,
            unit="",
            span=span,
            lacks_zone=table.dated == "date",
        )
    span = _span(time * naming.scale("time"))
    kind = "number"
    first, last = _YEARS_OF_UNIX
    if "week" in parts:
        kind = "gps"
    elif first <= span[0] and span[1] <= last:
        kind = "unix"
        # Times of GPS are ahead of UTC by its leap seconds.
        if not _GPS.isdisjoint(words) and _UNIX.isdisjoint(words) and not naming.is_in_utc:
            kind = "gps"
    return FileClock(
        column=column,
        path=columns.path,
        kind=kind,
        unit=unit,
        span=span,
        counts_weeks="week" in parts,
    )


def _span(time: Array) -> tuple[float, float]:
    """Return the earliest and the latest of the times (R,)."""
    return float(time.min()), float(time.max())


def microseconds_of_dates(columns: Columns, table: Table, dates: Array) -> Array:
    """Return dates (R,), microseconds since 1970, in UTC: those without a zone have that of the config.

    Without a zone in the config they stay as they are.
    """
    # "date" stands for dates without a zone; those "with a zone" were converted when they were read.
    if table.dated == "date" and columns.naming.zone:
        return dates - 1e6 * columns.naming.offset  # offset of the config's zone from UTC, s
    return dates


def have_one_axis(first: FileClock, other: FileClock) -> bool:
    """Test whether two files' clocks share a time axis, so that their times can be compared.

    Numbers, which may count from any moment, can be compared with UNIX times and with times of GPS.
    """
    if first.is_absolute and other.is_absolute:
        return True
    kinds = {first.kind, other.kind}
    if kinds <= {"number", "unix", "gps"}:
        return kinds != {"unix", "gps"}
    # Dates without a zone are taken for those of the zone UTC that another file names.
    return len(kinds) == 1 or kinds == {"date", "date in utc"}


def microseconds_since_1970(columns: Columns, table: Table, clock: FileClock) -> Array:
    """Return UNIX times or dates (R,) as microseconds since 1970, exact for whole microseconds."""
    time = table.columns[clock.column]
    if table.dated:
        return microseconds_of_dates(columns, table, time)
    factor = columns.naming.scale("time") * 1e6
    if factor >= 0.5:  # a whole number, but for rounding, unless the unit is ns or 100 ns
        factor = float(np.rint(factor))
    return time * factor
