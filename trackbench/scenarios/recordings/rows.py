"""Rows of all files by sensor, and the properties that the files have in common."""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Index
from trackbench.core.latitude_longitude import SEMI_MAJOR_AXIS
from trackbench.errors import and_others
from trackbench.field_types import DataError, InvalidKeyError, Place
from trackbench.scenarios.recordings.clock_kinds import (
    FileClock,
    clock_of_file,
    have_one_axis,
    microseconds_since_1970,
    reason_against,
    reason_against_spans,
)
from trackbench.scenarios.recordings.column_mapping import FAR, Columns, Naming, NamingKeys
from trackbench.scenarios.recordings.column_names import NamedColumn
from trackbench.scenarios.recordings.csv_tables import Table, WholeNumbers
from trackbench.scenarios.recordings.quantities import plain_name
from trackbench.scenarios.recordings.units import UNITS

TICK = 1e-6
"""s: times that round to the same multiple of it are one time"""
_ANGLE_ROUNDING = 1e-6
"""rad: rounding of a written angle, such as one of a whole turn"""
_LATEST = 1e12
"""s: beyond are no times, and ticks would not fit into their numbers"""
_MOST_WORDS_SHOWN = 8
_NEAR_ORIGIN = 5e4
"""m: an origin within is not asked whether its numbers are exchanged"""
_STAMPS = ((12, "%Y%m%d%H%M"), (14, "%Y%m%d%H%M%S"), (17, "%Y%m%d%H%M%S%f"))
_EPOCHS = {"ms": 1e12, "us": 1e15, "ns": 1e18}


class Rows(NamedTuple):
    """R rows of one sensor, or of a truth or inputs, from all files."""

    run: WholeNumbers
    """number (R,) of each row's run"""
    time: Array
    """time (R,), s, or number of the step"""
    values: Array
    """values (n, R) of the n quantities, in SI, NaN where they are missing"""
    file: WholeNumbers
    """number (R,) of each row's file, for messages"""
    line: WholeNumbers
    """line (R,) in the file, for messages"""
    received: Array
    """time (R,) at which the row was received, by default its own"""

    def at(self, chosen: WholeNumbers) -> "Rows":
        """Return the rows with these indices, in their order."""
        return Rows(
            run=self.run[chosen],
            time=self.time[chosen],
            values=self.values[:, chosen],
            file=self.file[chosen],
            line=self.line[chosen],
            received=self.received[chosen],
        )

    @property
    def ticks(self) -> WholeNumbers:
        """Times (R,) as whole numbers of `TICK`, for comparison."""
        return np.rint(self.time / TICK).astype(np.int64)


@dataclass
class ReadingContext:
    """Properties that the files of a recording share, collected while they are read one by one."""

    naming: Naming
    """names and units of columns, of the file which is read or whose rows are put in order"""
    origin: tuple[float, ...] | None = None
    """latitude and longitude, deg, perhaps height, m: the one in the config, else the first position of
    the chosen runs"""
    origin_key: tuple[str, ...] = ()
    """path of the origin's key in the config"""
    position_dependent: Collection[str] = ()
    """quantities that depend on the position, such as x and range"""
    in_space: bool = False
    """True if the target moves in space, so that heights count"""
    chosen: Collection[str] = ()
    """names of the chosen runs; empty if all are chosen"""
    own_origins: dict[str, tuple[float, ...]] = field(default_factory=dict)
    """origins of the runs that begin far from the first position, by their names"""
    located_runs: set[str] = field(default_factory=set)
    """names of the runs whose first position has been compared with the origin"""
    far_runs: list[str] = field(default_factory=list)
    """texts on the runs that have origins of their own, with their distances"""
    refuses_far_rows: bool = True
    """True if positions too far from their origin are an error"""
    unrotated_velocity_file: str = ""
    """first file with velocities and without positions"""
    first_position: str = ""
    """file and line of the first position if it is the origin; empty if the config has an origin"""
    largest_distance: float = 0.0
    """largest distance of a position from its origin, m"""
    geodetic_file: str = ""
    """first file with latitude and longitude"""
    planar_file: str = ""
    """first file with a column of a position-dependent quantity, and the name of this quantity"""
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
    has_delays: bool = False
    """True if a column has the times at which rows were received"""
    has_inputs: bool = False
    """True if rows may hold inputs alone, without a sensor"""
    keys: NamingKeys = field(default_factory=NamingKeys)
    """keys of the config that name the columns, for messages"""
    unread_time_parts: dict[str, NamedColumn] = field(default_factory=dict)
    """columns that look like further parts of the time and are not read, by `week` or `subsecond`"""
    unavailable: Counter[str] = field(default_factory=Counter)
    """number of cells with a code of "not available", by quantity and code"""
    runs: list[str] = field(default_factory=list)
    """names of the runs; a run's number is its place here"""
    files: list[str] = field(default_factory=list)
    """paths of the files; a file's number is its place here"""
    notices: list[str] = field(default_factory=list)
    """notes to the user"""

    @property
    def time_unit(self) -> str:
        """Unit of the times."""
        return "steps" if self.counts_steps else "s"

    def check_origin(self, origin: tuple[float, ...], *path: str) -> None:
        """Raise InvalidKeyError if an origin is needed and not given, or given and not needed.

        ``path`` is the path of its key in the config.
        """
        if origin and not self.geodetic_file:
            message = (
                "no file has latitude and longitude, which alone count from an origin; leave it out"
            )
            raise InvalidKeyError(message, *path)
        if self.geodetic_file and self.planar_file and not origin:
            message = (
                f"{self.geodetic_file} has latitude and longitude, and {self.planar_file}, which"
            )
            remedy = "counts from x = y = 0: say where that is, `origin: [latitude, longitude]`"
            raise InvalidKeyError(f"{message} {remedy}", *path)

    def place(self, rows: Rows, i: int, message: str) -> Place:
        """Return the place of row i in its file, with a message on a mistake there."""
        return Place(self.files[rows.file[i]], int(rows.line[i]), 1, message)

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
            _check_size(columns, table, clock, self.keys.own)
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

    def numbers_of(self, names: Sequence[str]) -> WholeNumbers:
        """Return the numbers (R,) of runs by their ``names``; a new name gets the next number."""
        self.runs = list(dict.fromkeys([*self.runs, *names]))
        known = {name: i for i, name in enumerate(self.runs)}
        return np.array([known[name] for name in names], dtype=np.int32)

    def numbers_of_known(self, names: Collection[str]) -> WholeNumbers:
        """Return the numbers of the runs with these names; names that no file has are left out."""
        return np.array([i for i, name in enumerate(self.runs) if name in names], dtype=np.int32)

    def note_distances(self) -> None:
        """Add notes on runs with an origin of their own, and on positions far from their origin."""
        if self.far_runs:
            shown = ", ".join(self.far_runs[:_MOST_WORDS_SHOWN])
            if len(self.far_runs) > _MOST_WORDS_SHOWN:
                shown += ", ..."
            message = f"runs that begin far from the first position that is read: {shown}"
            self.notices.append(f"{message}; x and y of each count from its own first position")
        distance = self.largest_distance
        if distance > FAR:
            # The tangent plane shortens a way away from the origin by the share 1 - cos(d / R).
            share = 1.0 - np.cos(distance / SEMI_MAJOR_AXIS)
            message = f"positions lie up to {in_kilometers(distance)} from the origin"
            reason = f"where the tangent plane shortens distances by {100.0 * share:.2g} %"
            self.notices.append(
                f"{message}, {reason}: an `origin` in their middle halves the distance"
            )
        if self.unrotated_velocity_file and self.origin is not None and distance > _NEAR_ORIGIN:
            # Meridians converge by (d / R) tan(phi) on a way to the east.
            slope = np.tan(np.deg2rad(min(abs(self.origin[0]), 89.0)))
            turn = np.rad2deg(distance / SEMI_MAJOR_AXIS * slope)
            message = (
                f"{self.unrotated_velocity_file} has velocities without latitude and longitude"
            )
            reason = f"north at the target differs from that of the origin by up to {turn:.2g} deg"
            self.notices.append(f"{message}, which are not rotated: {reason}")


def _check_size(columns: Columns, table: Table, clock: str, own_key: str) -> None:
    """Raise DataError for times of the column ``clock`` that are too large, with the likely unit.

    ``own_key`` is the config's key of the columns and units of this file alone, such as
    ``truth_naming``; it is empty for a file of measurements.
    """
    time = table.columns[clock]
    seconds = time * columns.naming.scale("time")
    late = np.flatnonzero(np.abs(seconds) > _LATEST)
    if len(late):
        row = late[0]
        more = and_others(len(late), "nor are")
        remedy = _remedy_for_large_time(time[row], own_key)
        message = f"{clock}: {seconds[row]:.3g} s is no time{more}; {remedy}"
        raise DataError(Place(columns.path, int(table.lines[row]), 1, message))


def _remedy_for_large_time(value: float, own_key: str) -> str:
    """Return the advice on a time that is too large for seconds: a format of dates, or another unit.

    ``own_key`` is the config's key of the columns and units of this file alone, such as
    ``truth_naming``; it is empty for a file of measurements.
    """
    digits = f"{value:.0f}"
    # A date has 12 digits or more: 202504031000 is 2025-04-03 10:00.
    for length, date_format in _STAMPS:
        month = int(digits[4:6] or 0)
        day = int(digits[6:8] or 0)
        is_date = 1 <= month <= 12 and 1 <= day <= 31
        if len(digits) == length and digits[:2] in ("19", "20") and is_date:
            return f'it looks like a date, say `time_format: "{date_format}"`'
    # The unit in which the number is a time since 1970, from 1985 to 2128: today is some 1.8e12 ms. If
    # there is none, it is ns, the smallest unit: 1e13 ns are 2.8 hours of a clock that began at zero.
    unit = "ns"
    for epoch_unit, size in _EPOCHS.items():
        if 0.5 * size <= abs(value) <= 5.0 * size:
            unit = epoch_unit
            break
    remedy = f"units: {{time: {unit}}}"
    if own_key:
        remedy = f"{own_key}: {{{remedy}}}"
    return f"say its unit (`{remedy}`)"


def usual_interval(times: Array) -> float:
    """Return the median interval between different times (R,); 1 if there is only one time.

    Of an even number of intervals it is the larger one of the middle two.
    """
    intervals = np.sort(np.diff(np.unique(times)))
    if not len(intervals):
        return 1.0
    return float(intervals[len(intervals) // 2])


def in_kilometers(meters: float) -> str:
    """Return a distance as a text with its unit, m or km: 350 m, 12.3 km."""
    if meters < 1e3:
        return f"{meters:.0f} m"
    if meters < 1e6:
        return f"{meters / 1e3:.3g} km"
    return f"{meters / 1e3:.0f} km"


def chosen_runs(
    context: ReadingContext,
    rows: list[Rows],
    chosen: Collection[str],
    within: tuple[str, ...] = ("runs",),
) -> list[Rows]:
    """Return the rows of the chosen runs (default: all), and number the runs anew in their order.

    This is the order in which they are chosen. If none are chosen, it is the order of their names if
    these are whole numbers, and otherwise the order in the files. ``rows`` are those of each sensor; the
    list is emptied. The names in the context get the new order, too. ``within`` is the path of the
    config's key that chooses runs, for an error.
    """
    names = list(chosen) or context.runs
    if not chosen and all(name.isascii() and name.isdigit() for name in names):
        names = sorted(names, key=int)
    known = set(context.runs)
    for i, name in enumerate(names):
        if name not in known:
            message = f"there is no run {name!r}; there are {', '.join(context.runs[:20])}"
            raise InvalidKeyError(message, *within, i)
    wanted = {name: i for i, name in enumerate(names)}
    # new_number[number in the files] = number among the chosen runs, -1 if not chosen
    new_number = np.array([wanted.get(name, -1) for name in context.runs], dtype=np.int32)
    context.runs = names
    chosen_rows = []
    while rows:  # rows are dropped one sensor after the other, to save memory
        of_sensor = rows.pop(0)
        of_sensor = of_sensor._replace(run=new_number[of_sensor.run])
        is_chosen = of_sensor.run >= 0
        if not is_chosen.all():
            of_sensor = of_sensor.at(np.flatnonzero(is_chosen))
        chosen_rows.append(of_sensor)
    return chosen_rows


def check_turns(context: ReadingContext, rows: Rows, angles: Mapping[str, int]) -> None:
    """Raise DataError for angles that are too large to be in radians, with the likely unit.

    ``angles`` has, by the name of each angle, its number among the values of ``rows``, which are in rad.
    """
    for name, i in angles.items():
        limit = 2.0 * np.pi + _ANGLE_ROUNDING
        turn = "a whole turn"
        if name == "elevation":
            limit = 0.5 * np.pi + _ANGLE_ROUNDING
            turn = "a quarter turn"
        sizes = np.abs(rows.values[i])
        wide = np.flatnonzero(sizes > limit)
        if len(wide):
            scale = context.naming.scale(name)
            unit = context.naming.units.get(name) or context.naming.units.get(plain_name(name))
            number = rows.values[i, wide[0]] / scale
            message = f"{name}: {number:.9g} {unit or 'rad'} is beyond {turn}"
            more = and_others(len(wide))
            largest = float(np.nanmax(sizes)) / scale
            remedy = _remedy_for_large_angles(name, largest, limit, scale)
            message = f"{message}{more}: {remedy}correct the cells"
            raise DataError(context.place(rows, int(wide[0]), message))


def _remedy_for_large_angles(name: str, largest: float, limit: float, scale: float) -> str:
    """Return the advice on angles that are too large in the unit in which they were read.

    ``largest`` is the largest number of the file, ``limit`` the largest possible angle, rad, and
    ``scale`` that unit, rad.
    """
    # Units in which the numbers of all cells are possible. That of the config was wrong.
    fitting = []
    for unit in ("deg", "deg/10", "mrad", "deg/100"):
        if UNITS[unit] != scale and largest * UNITS[unit] <= limit:
            fitting.append(unit)
    if fitting[:1] == ["deg"]:
        return f"say `units: {{{name}: deg}}`, or "
    if 360.0 < largest <= 400.0:
        return "if a turn has 400 gon, write degrees, or "
    # Counts of a turn that no unit is.
    counts = [str(count) for count in (4096, 6400, 65536) if largest <= count]
    advice = ""
    if fitting:
        first, *others = fitting
        advice = f"say its unit, `units: {{{name}: {first}}}`"
        if others:
            advice += f" (or {', '.join(others)})"
        advice += ", or "
    if counts:
        *first_counts, last = counts
        words = f"{', '.join(first_counts)} or {last}" if first_counts else last
        advice += f"write degrees if a turn has {words} counts, or "
    return advice


def longest_first(names: list[str], sizes: Index) -> list[tuple[str, int]]:
    """Return the name and the number of rows of each run, the longest first.

    ``names`` are those of the runs, and ``sizes`` their numbers of rows.
    """
    return sorted(zip(names, sizes.tolist(), strict=True), key=lambda run: -run[1])
