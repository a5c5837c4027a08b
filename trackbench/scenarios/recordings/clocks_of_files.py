"""Clocks of files: their kinds, which of them share one time axis, and messages if they do not."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from trackbench.core.arrays import Array
from trackbench.errors import Answer
from trackbench.field_types import DataError
from trackbench.scenarios.recordings.naming_of_columns import NamingKeys
from trackbench.scenarios.recordings.parse_tables import Table
from trackbench.scenarios.recordings.quantities_from_columns import Columns
from trackbench.scenarios.recordings.recognize_column_names import words_of
from trackbench.scenarios.recordings.time_size_check import check_size

Kind: TypeAlias = Literal[
    "step", "number", "unix", "gps", "date", "date in utc", "date with a zone"
]
"""Kind of a clock: steps, times that begin anywhere, UNIX times, times of GPS, and dates.

A date without a zone is ``in utc`` if the name of its column says so.
"""
_ABSOLUTE = ("unix", "date in utc", "date with a zone")
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
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_END_OF_1900 = -2177452800.0
"""s since 1970: times of day without a date count from 1900, as strptime has it"""
_DAY = 86400.0


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
    lacks_date: bool = False
    """True if its times are times of day without a date"""

    @property
    def is_absolute(self) -> bool:
        """True if its times count from one moment, as UNIX times and dates with a zone do."""
        return self.kind in _ABSOLUTE

    @property
    def has_unit(self) -> bool:
        """True if the key ``units`` may have the unit of its times."""
        return self.kind not in _WITHOUT_UNIT

    @property
    def in_words(self) -> str:
        """Words for its times: dates, seconds, UNIX times in ms."""
        if self.lacks_date:
            return "times of day without a date"
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
            lacks_date=span[1] < _END_OF_1900,
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
    if first.lacks_date != other.lacks_date:
        return False
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


class Mismatch(NamedTuple):
    """Message on two clocks, and the key that it proposes."""

    message: str
    answer: Answer | None = None


def reason_against(first: FileClock, other: FileClock) -> Mismatch:
    """Return the message on two files whose clocks share no time axis, and what to write.

    ``first`` is the clock of the first file, and ``other`` that of the file in which the error is
    raised.
    """
    message = f"its column {other.column} has {other.in_words}, and that of {first.path}"
    message += f" {first.in_words}"
    kinds = {first.kind, other.kind}
    if first.lacks_date != other.lacks_date and kinds.isdisjoint(("number", "step")):
        without_date = first if first.lacks_date else other
        message += f": write the date before the times in column {without_date.column} of"
        return Mismatch(
            f"{message} {without_date.path}, or name its column, `columns: {{date: NAME}}`"
        )
    if "date" in kinds and kinds & {*_ABSOLUTE}:
        dates = first if first.kind == "date" else other
        message += f": which zone have the dates in {dates.column} of {dates.path}?"
        answer = Answer("zone", "UTC", dates.path)
        offset = 'or their offset from UTC, such as `zone: "+02:00"`'
        return Mismatch(f"{message} Say {answer.in_yaml}, {offset}", answer)
    if "gps" in kinds and kinds & {*_ABSOLUTE}:
        gps = first if first.kind == "gps" else other
        message += ": GPS is ahead of UTC by leap seconds, 18 s since 2017"
        if gps.counts_weeks:
            # Weeks of GPS cannot count from 1970.
            return Mismatch(f"{message}: write UNIX times into the file {gps.path}")
        answer = Answer("zone", "UTC", gps.path)
        message += ";"
        message += f" if {gps.column} of {gps.path} counts from 1970 in UTC, say {answer.in_yaml},"
        return Mismatch(f"{message} or else write UNIX times into the file", answer)
    if "number" in kinds and len(kinds) == 2:
        remedy = "use one kind; dates with a zone and UNIX times, seconds since 1970, go together"
        return Mismatch(f"{message}: {remedy}")
    return Mismatch(f"{message}: use one kind")


def reason_against_spans(first: FileClock, other: FileClock) -> Mismatch | None:
    """Return the message on UNIX times and dates more than a day apart; None if they are not.

    It is raised in the file of ``other``, which "its column" means.
    """
    if first.kind == other.kind or "unix" not in (first.kind, other.kind):
        return None
    if not (first.is_absolute and other.is_absolute):
        return None
    is_near = other.span[0] <= first.span[1] + _DAY and first.span[0] <= other.span[1] + _DAY
    if is_near:
        return None
    unix = first if first.kind == "unix" else other
    message = f"its column {other.column} has {other.in_words} {_span_in_words(other)}, and that of"
    message += f" {first.path} {first.in_words} {_span_in_words(first)}"
    remedy = f"correct the unit of {unix.column} (`units: {{time: ms}}`), or write dates if it"
    return Mismatch(f"{message}, more than a day apart: {remedy} does not count from 1970")


def _span_in_words(clock: FileClock) -> str:
    """Return words for the first and the last time of a clock that counts from 1970.

    They are as in "from 2024-05-14 09:31 to 2024-05-14 09:46".
    """
    first, last = (
        (_EPOCH + timedelta(seconds=time)).strftime("%Y-%m-%d %H:%M") for time in clock.span
    )
    return f"from {first} to {last}"


@dataclass(kw_only=True)
class SharedClock:
    """Clock that the files of a recording share: the first file decides what all times are."""

    clock: FileClock | None = None
    """clock of the first file, which decides what the times of all files are"""
    first_date_us: float = 0.0
    """first date, microseconds since 1970, from which seconds count; 0 without dates"""
    counts_steps: bool = False
    """True if times are numbers of steps, and no seconds"""
    dated: str = ""
    """type of the dates, as in `Table`; empty if times are no dates"""
    used_keys: set[str] = field(default_factory=set)
    """keys of units and zones of times that a file has used"""
    idle_keys: dict[str, DataError] = field(default_factory=dict)
    """keys of units and zones of times that a file cannot use, with the error to raise if none uses
    it"""
    keys: NamingKeys = field(default_factory=NamingKeys)
    """keys of the config that name the columns, for messages"""

    @property
    def time_unit(self) -> str:
        """Unit of the times."""
        return "steps" if self.counts_steps else "s"

    def timed(self, columns: Columns, table: Table, clock: str, parts: Sequence[str] = ()) -> Array:
        """Return the times (R,) of a table's rows in seconds, or the numbers of their steps.

        Dates are seconds since the first date of the first file. ``clock`` is the column of the times,
        and ``parts`` are the keys of further columns, such as ``subsecond``, that are added. The first
        file sets the clock of this context. Raises DataError if a file's clock shares no time axis with
        it.
        """
        # Step 1: find the type of this file's clock, and compare it with that of the first file.
        file_clock = clock_of_file(columns, table, clock, parts)
        if file_clock.has_unit:
            # `own` is the key of this file's own units, such as truth_naming, for the advice.
            check_size(columns, table, clock, own_key=self.keys.own)
        # The first file decides which clock all files have.
        if self.clock is None:
            self.clock = file_clock
            self.counts_steps = file_clock.kind == "step"
            self.dated = table.dated
            self.first_date_us = 0.0
            if table.dated:
                self.first_date_us = float(
                    microseconds_since_1970(columns, table, file_clock).min()
                )
        mistake = None
        if not have_one_axis(self.clock, file_clock):
            mistake = reason_against(self.clock, file_clock)
        elif self.clock.path != file_clock.path:
            # UNIX times and dates of two files must not be more than a day apart.
            mistake = reason_against_spans(self.clock, file_clock)
        if mistake is not None:
            raise columns.mistake(mistake.message, mistake.answer)
        self._note_keys(columns, file_clock)
        # Step 2: convert dates and numbers to seconds. Numbers of steps stay as they are.
        time = table.columns[clock]
        if parts and file_clock.kind == "step":
            message = f"{clock} has numbers of steps, to which `columns: {{{parts[0]}: ...}}` adds"
            message += " nothing"
            raise columns.mistake(f"{message}: leave it out")
        if file_clock.kind == "step":
            return time
        if table.dated or self.dated:
            # Dates, and UNIX times beside them, are compared in microseconds since 1970.
            seconds = (
                microseconds_since_1970(columns, table, file_clock) - self.first_date_us
            ) / 1e6
        else:
            seconds = time * columns.naming.scale("time")
        if parts:
            seconds = seconds + columns.stamp_parts(table, parts)
        return seconds

    def _note_keys(self, columns: Columns, clock: FileClock) -> None:
        """Record whether a file's clock uses the config's keys of a unit and a zone of times.

        Files may share these keys, and at least one of them must use each. `check_idle_keys` raises the
        error if none does.
        """
        unit = columns.naming.units.get("time")
        if unit is not None and clock.has_unit:
            self.used_keys.add(f"time: {unit}")
        elif unit is not None:
            message = f"{clock.column} has {clock.in_words}, which have no unit"
            mistake = columns.mistake(f"{message}: leave `time: {unit}` out of `units`")
            self.idle_keys.setdefault(f"time: {unit}", mistake)
        zone = columns.naming.zone
        # Dates without a zone use the key, and so do UNIX times: it may say that times which look like
        # those of GPS are in UTC.
        if zone and (clock.kind == "unix" or clock.lacks_zone):
            self.used_keys.add(f"zone: {zone}")
        elif zone:
            message = f"{clock.column} has {clock.in_words}, which need no zone"
            mistake = columns.mistake(f"{message}: leave `zone: {zone}` out")
            self.idle_keys.setdefault(f"zone: {zone}", mistake)

    def check_idle_keys(self) -> None:
        """Raise DataError for a key of a unit or a zone of times that none of the files has used."""
        for key, mistake in self.idle_keys.items():
            if key not in self.used_keys:
                raise mistake
