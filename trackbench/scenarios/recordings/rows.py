"""Rows of all files by sensor: run, time and values; base of the components that read data files."""

import hashlib
import json
import os
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, is_dataclass
from glob import escape, glob
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Index, Mask
from trackbench.core.conversions import SEMI_MAJOR_AXIS, Geodetic, east_north_up
from trackbench.errors import and_others, reason
from trackbench.field_types import DataError, InvalidKeyError, Place, require_regular_file
from trackbench.scenarios.recordings.clock_kinds import (
    FileClock,
    clock_of_file,
    have_one_axis,
    microseconds_since_1970,
    reason_against,
    reason_against_spans,
)
from trackbench.scenarios.recordings.column_mapping import (
    FAR,
    MOST_DISTANCE,
    Columns,
    Frame,
    Naming,
    NamingKeys,
)
from trackbench.scenarios.recordings.column_names import NamedColumn, rest_of_stamp
from trackbench.scenarios.recordings.csv_lines import plain_label
from trackbench.scenarios.recordings.csv_tables import Table, WholeNumbers
from trackbench.scenarios.recordings.interleaved_rows import check_label, possible_labels
from trackbench.scenarios.recordings.units import UNITS

TICK = 1e-6
"""s: times that are nearer to each other are one"""
_ANGLE_ROUNDING = 1e-6
"""rad: rounding of a written angle, such as one of a whole turn"""
_LATEST = 1e12
"""s: beyond are no times, and ticks would not fit into their numbers"""
_MOST_MISTAKES = 20
_MOST_WORDS_SHOWN = 8
_NEAR_ORIGIN = 5e4
"""m: an origin within is not asked whether its numbers are exchanged"""
_STAMPS = ((12, "%Y%m%d%H%M"), (14, "%Y%m%d%H%M%S"), (17, "%Y%m%d%H%M%S%f"))
_EPOCHS = {"ms": 1e12, "us": 1e15, "ns": 1e18}


class Rows(NamedTuple):
    """R rows of the files."""

    run: WholeNumbers
    """number (R,) of each row's run"""
    time: Array
    """time (R,), s, or number of the step"""
    values: Array
    """values (n, R)"""
    file: WholeNumbers
    """number (R,) of each row's file"""
    line: WholeNumbers
    """line (R,) in the file"""
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
        """Times as whole numbers of `TICK`, for comparison."""
        return np.rint(self.time / TICK).astype(np.int64)


@dataclass
class Gathered:
    """Common properties of the files, collected while they are read.

    Times are numbers of steps (``stepped``), or seconds, of dates (``dated``) after the first of them
    (``since``, in microseconds since 1970). The ``clock`` of the first file says which. ``used_keys``
    are the keys of units and zones that a file's clock has used, and ``idle_keys`` have the mistake of
    a file that cannot use them.
    ``naming`` is that of the file which is read, or whose rows are put in order.
    ``has_delays``: a column has the times at which rows were received.
    ``unavailable`` counts cells with codes of "not available".
    ``rest`` names columns that look like further parts of the time, and are not read.
    ``has_inputs``: rows may hold inputs alone, without a sensor.
    ``keys`` are those of the config that name the columns.
    ``geodetic`` is the first file with latitude and longitude, and ``planar`` the first one with another
    quantity that depends on the position (``in_frame``). ``origin`` is given by the config's key
    ``origin_key``, or the first position of the ``chosen`` runs (default: of all); ``own_origins`` are
    those of ``far_runs``. ``not_rotated`` is a file of velocities without places. Heights count for a
    target ``in_space``.
    """

    naming: Naming
    origin: tuple[float, ...] | None = None
    origin_key: tuple[str, ...] = ()
    in_frame: Collection[str] = ()
    in_space: bool = False
    chosen: Collection[str] = ()
    own_origins: dict[str, tuple[float, ...]] = field(default_factory=dict)
    placed_runs: set[str] = field(default_factory=set)
    far_runs: list[str] = field(default_factory=list)
    refuses_far_rows: bool = True
    not_rotated: str = ""
    first_position: str = ""
    largest_distance: float = 0.0
    geodetic: str = ""
    planar: str = ""
    clock: FileClock | None = None
    since: float = 0.0
    stepped: bool = False
    dated: str = ""
    used_keys: set[str] = field(default_factory=set)
    idle_keys: dict[str, DataError] = field(default_factory=dict)
    has_delays: bool = False
    has_inputs: bool = False
    keys: NamingKeys = field(default_factory=NamingKeys)
    rest: dict[str, NamedColumn] = field(default_factory=dict)
    unavailable: Counter[str] = field(default_factory=Counter)
    runs: list[str] = field(default_factory=list)
    files: list[str] = field(default_factory=list)
    notices: list[str] = field(default_factory=list)

    @property
    def time_unit(self) -> str:
        """Unit of the times."""
        return "steps" if self.stepped else "s"

    def check_origin(self, origin: tuple[float, ...], *path: str) -> None:
        """Raise InvalidKeyError if an origin is needed and not given, or given and not needed.

        ``path`` is the path of its key in the config.
        """
        if origin and not self.geodetic:
            message = (
                "no file has latitude and longitude, which alone count from an origin; leave it out"
            )
            raise InvalidKeyError(message, *path)
        if self.geodetic and self.planar and not origin:
            message = (
                f"{self.geodetic} has latitude and longitude, and {self.planar}, which counts from"
            )
            way = "x = y = 0: say where that is, `origin: [latitude, longitude]`"
            raise InvalidKeyError(f"{message} {way}", *path)

    def place(self, rows: Rows, i: int, message: str) -> Place:
        """Return the place of row i in its file, with a message on a mistake there."""
        return Place(self.files[rows.file[i]], int(rows.line[i]), 1, message)

    def timed(self, columns: Columns, table: Table, clock: str, parts: Sequence[str] = ()) -> Array:
        """Return the times (R,) of a table's rows in seconds, or the numbers of their steps.

        ``clock`` is the column of the times; ``parts`` name further parts of a time that are added.
        Raises DataError if this file's clock and that of the first one share no time axis.
        """
        file_clock = clock_of_file(columns, table, clock, parts)
        if file_clock.has_unit:
            _check_size(columns, table, clock, self.keys.own)
        # The first file decides which clock all files have.
        if self.clock is None:
            self.clock = file_clock
            self.stepped = file_clock.kind == "step"
            self.dated = table.dated
            self.since = 0.0
            if table.dated:
                self.since = float(microseconds_since_1970(columns, table, file_clock).min())
        mistake = ""
        if not have_one_axis(self.clock, file_clock):
            mistake = reason_against(self.clock, file_clock)
        elif self.clock.path != file_clock.path:
            mistake = reason_against_spans(self.clock, file_clock)
        if mistake:
            raise columns.mistake(mistake)
        self._note_keys(columns, file_clock)
        # Seconds: dates after the first one, times by their unit; numbers of steps are returned as such.
        time = table.columns[clock]
        if parts and file_clock.kind == "step":
            message = f"{clock} has numbers of steps, to which `columns: {{{parts[0]}: ...}}` adds"
            message += " nothing"
            raise columns.mistake(f"{message}: leave it out")
        if file_clock.kind == "step":
            return time
        if table.dated or self.dated:
            # Dates, and UNIX times beside them, are compared in microseconds since 1970.
            seconds = (microseconds_since_1970(columns, table, file_clock) - self.since) / 1e6
        else:
            seconds = time * columns.naming.scale("time")
        if parts:
            seconds = seconds + columns.stamp_parts(table, parts)
        return seconds

    def _note_keys(self, columns: Columns, clock: FileClock) -> None:
        """Record whether a file's clock uses the keys of its unit and its zone.

        Files may share these keys, so that one of them has to use each.
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
        """Raise DataError for a key of the clocks that none of the files which share it has used."""
        for key, mistake in self.idle_keys.items():
            if key not in self.used_keys:
                raise mistake

    def numbers_of(self, names: Sequence[str]) -> WholeNumbers:
        """Return the number of each run; a name that is new gets the next number."""
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
            message = f"positions lie up to {_kilometers(distance)} from the origin"
            why = f"where the tangent plane shortens distances by {100.0 * share:.2g} %"
            self.notices.append(
                f"{message}, {why}: an `origin` in their middle halves the distance"
            )
        if self.not_rotated and self.origin is not None and distance > _NEAR_ORIGIN:
            # Meridians converge by (d / R) tan(phi) on a way to the east.
            slope = np.tan(np.deg2rad(min(abs(self.origin[0]), 89.0)))
            turn = np.rad2deg(distance / SEMI_MAJOR_AXIS * slope)
            message = f"{self.not_rotated} has velocities without latitude and longitude"
            why = f"north at the target differs from that of the origin by up to {turn:.2g} deg"
            self.notices.append(f"{message}, which are not rotated: {why}")


def _check_size(columns: Columns, table: Table, clock: str, own_key: str) -> None:
    """Raise DataError for times of the column ``clock`` that are too large, with the likely unit.

    ``own_key`` is that of the file's own naming in the config; empty for a file of measurements.
    """
    time = table.columns[clock]
    seconds = time * columns.naming.scale("time")
    late = np.flatnonzero(np.abs(seconds) > _LATEST)
    if len(late):
        row = late[0]
        more = and_others(len(late), "nor are")
        way = _way_to_read_time(time[row], own_key)
        message = f"{clock}: {seconds[row]:.3g} s is no time{more}; {way}"
        raise DataError(Place(columns.path, int(table.lines[row]), 1, message))


def _way_to_read_time(value: float, own_key: str) -> str:
    """Return the advice on a number that is too large for seconds: a form of dates, or another unit.

    ``own_key`` is that of the file's own naming in the config; empty for a file of measurements.
    """
    digits = f"{value:.0f}"
    # A date has 12 digits or more: 202504031000 is 2025-04-03 10:00.
    for length, form in _STAMPS:
        month = int(digits[4:6] or 0)
        day = int(digits[6:8] or 0)
        is_date = 1 <= month <= 12 and 1 <= day <= 31
        if len(digits) == length and digits[:2] in ("19", "20") and is_date:
            return f'it looks like a date, say `time_format: "{form}"`'
    # The unit in which it is a time since 1970, which now are some 1.8e12 ms.
    unit = "ns"
    for epoch_unit, size in _EPOCHS.items():
        if 0.5 * size <= abs(value) <= 5.0 * size:
            unit = epoch_unit
            break
    way = f"units: {{time: {unit}}}"
    if own_key:
        way = f"{own_key}: {{{way}}}"
    return f"say its unit (`{way}`)"


def usual_interval(times: Array) -> float:
    """Compute the upper median of the intervals between different times; 1 without intervals."""
    intervals = np.sort(np.diff(np.unique(times)))
    if not len(intervals):
        return 1.0
    return float(intervals[len(intervals) // 2])


def files_of(pattern: str) -> list[str]:
    """Return the file of this name, or all files that a pattern matches, in order of their names.

    Raises DataError if there is no match.
    """
    if not any(c in pattern for c in "*?[") or os.path.lexists(pattern):
        return [pattern]
    # Brackets in the name of an existing folder are part of the name, and no pattern.
    folder = str(next((parent for parent in Path(pattern).parents if parent.is_dir()), ""))
    paths = sorted(glob(escape(folder) + pattern.removeprefix(folder)))
    if not paths:
        raise DataError(Place(pattern, 1, 1, "no file has such a name"))
    return paths


def read_rows(
    gathered: Gathered,
    patterns: Sequence[str],
    sensors: Sequence[Sequence[str]],
    least: int | None = None,
    names: Sequence[str] = (),
    namings: Sequence[Naming] = (),
) -> list[Rows]:
    """Read the rows of each sensor from the files of the patterns.

    ``sensors`` has the quantities that each sensor measures. There is one pattern for all sensors, or
    one for each. A pattern may match several files, one for each run. A file must have at least
    ``least`` of the quantities, by default all. A column ``sensor`` has the sensors' ``names``, by
    default their numbers. ``namings`` has the columns and units of each pattern's files, by default
    those of ``gathered``. Raises DataError with the line of every mistake.
    """
    # Step 1: read one file for all sensors, or the files of each sensor's pattern.
    is_shared = len(patterns) == 1
    pieces: list[list[Rows]] = [[] for _ in sensors]
    for n, pattern in enumerate(patterns):
        if namings:
            gathered.naming = namings[n]
        first_sensor = 0 if is_shared else n
        of_pattern = slice(None) if is_shared else slice(n, n + 1)
        for number, path in enumerate(files_of(pattern)):
            rows_by_sensor = _read_file(
                gathered, path, sensors[of_pattern], least, str(number), names[of_pattern]
            )
            for m, rows in enumerate(rows_by_sensor, first_sensor):
                pieces[m].append(rows)
    if gathered.unavailable:
        codes = ", ".join(f"{code} ({n})" for code, n in sorted(gathered.unavailable.items()))
        message = 'cells hold a code for "not available" and count as missing'
        gathered.notices.append(f"{gathered.unavailable.total()} {message}: {codes}")
    # Step 2: join the files of one sensor after the other; the pieces are dropped, to save memory.
    joined = []
    while pieces:
        joined.append(_join_rows(pieces.pop(0)))
    return joined


def _join_rows(pieces: Sequence[Rows]) -> Rows:
    """Join the rows of several files."""
    if len(pieces) == 1:
        return pieces[0]
    return Rows(
        run=np.concatenate([rows.run for rows in pieces]),
        time=np.concatenate([rows.time for rows in pieces]),
        values=np.concatenate([rows.values for rows in pieces], axis=-1),
        file=np.concatenate([rows.file for rows in pieces]),
        line=np.concatenate([rows.line for rows in pieces]),
        received=np.concatenate([rows.received for rows in pieces]),
    )


def _read_file(
    gathered: Gathered,
    path: str,
    sensors: Sequence[Sequence[str]],
    least: int | None,
    name: str,
    names: Sequence[str],
) -> list[Rows]:
    """Read the rows of each sensor from one file.

    ``name`` is that of the file's run, if the file does not name runs itself. The other arguments are
    those of `read_rows`.
    """
    # Step 1: find the columns of the quantities, of time, run and sensor.
    wanted = list(chain.from_iterable(sensors))
    if least is None:
        least = len(wanted)
    columns = Columns(path, gathered.naming, wanted, least, gathered.in_space, gathered.keys)
    clock = columns.take("time", "time") or columns.take("step", "step")
    if clock is None:
        raise columns.missing_clock()
    if columns.column("date") != clock:
        columns.take("date", "date")
    parts = columns.take_stamp_parts()
    gathered.rest = gathered.rest or rest_of_stamp(columns.names, clock, parts)
    arrival = columns.take("received", columns.contents[clock])
    run = columns.take("run", "label")
    sensor_column = columns.take("sensor", "word" if gathered.has_inputs else "label")
    several = columns.take_unnamed_runs() if run is None else None
    labels = possible_labels(columns, [rest.column for rest in gathered.rest.values()])
    # Step 2: read them; times become seconds.
    table = columns.read()
    gathered.unavailable += columns.unavailable
    gathered.notices += columns.notices
    if several is not None and len(table.words[several]) > 1:
        message = f"column {several} has {len(table.words[several])} values, which would be one run"
        way = f'say `columns: {{run: {several}}}`, or `columns: {{run: ""}}` to mix them'
        raise columns.mistake(f"{message}: {way}")
    time = gathered.timed(columns, table, clock, parts)
    received = time
    if arrival is not None:
        gathered.has_delays = True
        received = _read_received(gathered, columns, table, arrival, time)
    if columns.is_geodetic:
        gathered.geodetic = gathered.geodetic or path
    elif columns.has_velocities_alone:
        gathered.not_rotated = gathered.not_rotated or path
    planar_quantity = columns.first_with_column(gathered.in_frame)
    if planar_quantity:
        gathered.planar = gathered.planar or f"{path} has {planar_quantity}"
    # Step 3: number the runs; a file without their names is one run.
    if run is None:
        runs = np.full(len(time), gathered.numbers_of([name])[0])
    else:
        runs = gathered.numbers_of(table.words[run])[table.columns[run].astype(np.intp)]
    # Step 4: select the rows of the chosen runs and of the sensors.
    is_read = np.ones(len(time), dtype=np.bool_)
    if gathered.chosen:
        is_read = np.isin(runs, gathered.numbers_of_known(gathered.chosen))
    rows_by_sensor: list[WholeNumbers | slice] = [slice(None)] * len(sensors)
    if sensor_column is not None and gathered.has_inputs:
        _check_rows_without_sensor(columns, table, sensor_column, wanted)
    if sensor_column is not None and (
        len(sensors) > 1 or len(table.words[sensor_column]) > 1 or names
    ):
        sensor_masks = [
            _find_sensor_rows(gathered, columns, table, sensor_column, m, len(sensors), names)
            for m in range(len(sensors))
        ]
        is_read &= np.any(sensor_masks, axis=0)
        rows_by_sensor = [np.flatnonzero(mask[is_read]) for mask in sensor_masks]
    if not is_read.all():
        table = table.at(np.flatnonzero(is_read))
        runs = runs[is_read]
        time = time[is_read]
        received = received[is_read]
    columns.note_outliers(table)
    gathered.notices += columns.far
    # Step 5: compute the quantities, in SI.
    places = None
    frames: list[Frame] = []
    if columns.is_geodetic:
        places, frames = _frames_of_runs(gathered, columns, table, runs)
    quantities = columns.quantities(table, places, frames, runs)
    for label in labels:
        for components, of_sensor in zip(sensors, rows_by_sensor, strict=True):
            measured = {name: quantities[name][of_sensor] for name in components}
            check_label(
                columns,
                table,
                label,
                quantities=measured,
                runs=runs[of_sensor],
                time=time[of_sensor],
                of_sensor=of_sensor,
            )
    files = np.full(len(time), len(gathered.files), dtype=np.int32)
    gathered.files.append(path)
    # Step 6: take the rows of each sensor.
    rows_of_sensors = []
    for components, of_sensor in zip(sensors, rows_by_sensor, strict=True):
        rows = Rows(
            run=runs,
            time=time,
            values=np.stack([quantities[name] for name in components]),
            file=files,
            line=table.lines,
            received=received,
        )
        if not isinstance(of_sensor, slice):
            rows = rows.at(of_sensor)
        rows_of_sensors.append(rows)
    return rows_of_sensors


def _frames_of_runs(
    gathered: Gathered, columns: Columns, table: Table, runs: WholeNumbers
) -> tuple[Geodetic, list[Frame]]:
    """Return the places of a table's rows, and frames: each an origin with the rows that count from it.

    Runs share one origin, the given one or the first position that is read. If no origin is given, a
    run that begins far from the first position has an origin of its own. ``runs`` (R,) are the numbers
    of the rows' runs. Raises an error for rows too far from their origin.
    """
    height = 0.0
    if gathered.origin is not None and len(gathered.origin) > 2:
        height = gathered.origin[2]
    places = columns.places(table, height)
    known = np.flatnonzero(np.isfinite(places.latitude))
    missing = columns.rows_without_height(table)
    if missing:
        message = f"{missing} rows of {columns.path} have no altitude, and so no position in space"
        gathered.notices.append(f"{message}: `axes: 2` takes their latitude and longitude alone")
    if not len(known):
        return places, []
    # Step 1: the common origin.
    if gathered.origin is None:
        gathered.origin = _origin_at(places, int(known[0]))
        gathered.first_position = f"{Path(columns.path).name}:{table.lines[known[0]]}"
    # The first position is recorded only if it serves as the origin.
    is_given = not gathered.first_position
    # Step 2: runs that begin far from it have an origin of their own, unless it is given.
    numbers, first = np.unique(runs[known], return_index=True)
    names = [gathered.runs[number] for number in numbers]
    if not is_given:
        begins = known[first]
        away = _distances(places, begins, gathered.origin)
        for name, row, distance in zip(names, begins.tolist(), away.tolist(), strict=True):
            if name not in gathered.placed_runs and distance > FAR:
                gathered.own_origins[name] = _origin_at(places, row)
                gathered.far_runs.append(f"{name} by {_kilometers(distance)}")
            gathered.placed_runs.add(name)
    # Step 3: the rows of each origin, and how far from it they lie.
    far_runs = [
        number for number, name in zip(numbers, names, strict=True) if name in gathered.own_origins
    ]
    shared = np.flatnonzero(~np.isin(runs, far_runs))
    frames = []
    if len(shared):
        frames.append(Frame(gathered.origin, shared))
    for number in far_runs:
        origin = gathered.own_origins[gathered.runs[number]]
        frames.append(Frame(origin, np.flatnonzero(runs == number)))
    for frame in frames:
        _check_distances(gathered, columns, table, places, frame)
    return places, frames


def _origin_at(places: Geodetic, row: int) -> tuple[float, ...]:
    """Return latitude and longitude, deg, and height of a row."""
    latitude = float(places.latitude[row]) * 180.0 / np.pi
    longitude = float(places.longitude[row]) * 180.0 / np.pi
    return latitude, longitude, float(places.height[row])


def _distances(places: Geodetic, rows: WholeNumbers, origin: tuple[float, ...]) -> Array:
    """Return the distances (R,) of the R rows with these indices from an origin, m, along the Earth."""
    # Both at the height 0; the place of the frame is the origin, once for each row.
    on_ground = Geodetic(places.latitude[rows], places.longitude[rows], np.zeros(len(rows)))
    origin_on_ground = Frame((*origin[:2], 0.0), np.asarray(rows, dtype=np.intp)).place
    chord = np.sqrt(np.square(east_north_up(on_ground, origin_on_ground)).sum(axis=0))
    # d = 2 R asin(c / 2 R) of a chord c
    radius = SEMI_MAJOR_AXIS
    return 2.0 * radius * np.arcsin(np.minimum(chord / (2.0 * radius), 1.0))


def _check_distances(
    gathered: Gathered, columns: Columns, table: Table, places: Geodetic, frame: Frame
) -> None:
    """Raise an error for rows too far from their origin, and note how far the farthest one is."""
    known = frame.rows[np.isfinite(places.latitude[frame.rows])]
    if not len(known):
        return
    away = _distances(places, known, frame.origin)
    # The first position is recorded only if it serves as the origin.
    is_given = not gathered.first_position
    limit = f"a plane serves for {MOST_DISTANCE / 1e3:.0f} km"
    if is_given and away[0] > _NEAR_ORIGIN:
        hint = _mistaken_origin(frame.origin, places, int(known[0]), float(away[0]))
        where = f"{Path(columns.path).name}:{table.lines[known[0]]}"
        message = f"lies {_kilometers(away[0])} from the first position ({where})"
        if hint or away[0] > MOST_DISTANCE:
            way = hint or f"{limit}: write latitude and longitude of a point near the positions"
            raise InvalidKeyError(f"{message}; {way}", *gathered.origin_key)
    too_far = np.flatnonzero(away > MOST_DISTANCE)
    if len(too_far) and gathered.refuses_far_rows:
        row = int(known[too_far[0]])
        origin = "the first position of its run, the origin"
        if is_given:
            origin = "`origin`"
        elif frame.origin == gathered.origin:
            origin = f"the first position ({gathered.first_position}), the origin"
        more = and_others(len(too_far))
        distance = _kilometers(away[too_far[0]])
        message = f"latitude and longitude: {distance} from {origin}{more}; {limit}"
        way = "correct or empty the cells, or give an `origin: [latitude, longitude]` in the middle"
        raise DataError(Place(columns.path, int(table.lines[row]), 1, f"{message}: {way}"))
    gathered.largest_distance = max(gathered.largest_distance, float(away.max()))


def _mistaken_origin(origin: tuple[float, ...], places: Geodetic, row: int, distance: float) -> str:
    """Explain which exchange or sign of an origin's numbers would bring it near a row; empty if none.

    ``distance``, m, is that of the origin from the place of the row.
    """
    latitude, longitude = origin[:2]
    changes = {
        "latitude and longitude exchanged": (longitude, latitude),
        "the other sign of the longitude": (latitude, -longitude),
        "the other sign of the latitude": (-latitude, longitude),
    }
    for message, (new_latitude, new_longitude) in changes.items():
        if abs(new_latitude) > 90.0:
            continue
        away = _distances(places, np.array([row]), (new_latitude, new_longitude))[0]
        if away < 0.1 * distance:
            changed = f"[{new_latitude:g}, {new_longitude:g}]"
            return f"with {message}, {changed}, it would be {_kilometers(away)} away: correct it"
    return ""


def _kilometers(meters: float) -> str:
    """Write a distance in m or km."""
    if meters < 1e3:
        return f"{meters:.0f} m"
    if meters < 1e6:
        return f"{meters / 1e3:.3g} km"
    return f"{meters / 1e3:.0f} km"


def _read_received(
    gathered: Gathered, columns: Columns, table: Table, column: str, time: Array
) -> Array:
    """Return the times (R,) at which rows were received, from a column.

    Raises DataError for rows that were received before their own ``time`` (R,).
    """
    received = gathered.timed(columns, table, column)
    early = np.flatnonzero(received < time - TICK)[:_MOST_MISTAKES].tolist()
    if early:
        mistakes = []
        for row in early:
            lead = f"{time[row] - received[row]:.9g} {gathered.time_unit}"
            message = f"{column}: received {lead} before its time"
            mistakes.append(Place(columns.path, int(table.lines[row]), 1, message))
        raise DataError(*mistakes)
    return received


def _find_sensor_rows(
    gathered: Gathered,
    columns: Columns,
    table: Table,
    column: str,
    m: int,
    number: int,
    names: Sequence[str],
) -> Mask:
    """Return which rows (R,) are those of sensor m, from 0, of ``number`` sensors.

    The ``column`` has the sensors' ``names``, or their numbers from 1 on if ``names`` is empty.
    """
    words = [word for word in table.words[column] if word]
    known = names or [str(i + 1) for i in range(number)]
    # The name 7 stands for the word 7.0, too, if the file lacks the word 7.
    free_words = [word for word in words if word not in known]
    known = [label if label in words else _word_of_label(label, free_words) for label in known]
    other_words = [word for word in words if word not in known]
    if other_words and not names:
        message = f"column {column} names {len(words)} sensors ({', '.join(words[:8])[:80]})"
        way = "name them in the order of `sensor`, such as `sensors: "
        way += f'[{", ".join(map(json.dumps, words[:8]))}]`; `columns: {{sensor: ""}}` mixes all'
        raise columns.mistake(f"{message}, and the config has {number}: {way}")
    absent = [name for name, word in zip(names, known, strict=False) if word not in words]
    if absent:
        message = f"column {column} has no {absent[0]!r}; there are {', '.join(words[:20])[:200]}"
        raise columns.mistake(message)
    # Rows of other sensors than those of the config are left out.
    if other_words and m == 0:  # noted once for all sensors
        codes = [table.words[column].index(word) for word in other_words]
        left_out = int(np.isin(table.columns[column], codes).sum())
        gathered.notices.append(
            f"{left_out} rows of {', '.join(other_words)[:80]} were left out (`sensors`)"
        )
    code = -1  # no row has this code
    if known[m] in words:
        code = table.words[column].index(known[m])
    return np.asarray(table.columns[column] == code)


def _word_of_label(label: str, words: Sequence[str]) -> str:
    """Return the only word of a whole number that equals the label; else the label itself."""
    equal = [word for word in words if plain_label(word) == plain_label(label)]
    return equal[0] if len(equal) == 1 else label


def _check_rows_without_sensor(
    columns: Columns, table: Table, column: str, quantities: Collection[str]
) -> None:
    """Raise DataError for a row that measures something and names no sensor in the ``column``."""
    if "" not in table.words[column]:
        return
    is_blank = table.columns[column] == table.words[column].index("")
    for name in quantities:
        source = columns.column(name)
        if source is None:
            continue
        rows = np.flatnonzero(is_blank & np.isfinite(table.columns[source]))
        if len(rows):
            message = f"{column}: is missing beside a value of {source}"
            raise DataError(Place(columns.path, int(table.lines[rows[0]]), 1, message))


def chosen_runs(
    gathered: Gathered,
    rows: list[Rows],
    chosen: Collection[str],
    within: tuple[str, ...] = ("runs",),
) -> list[Rows]:
    """Return the rows of the chosen runs (default: all), and number the runs anew in their order.

    This is the order in which they are chosen. If none are chosen, it is the order of their names if
    these are whole numbers, and otherwise the order in the files. ``within`` is the path of the key for
    an error.
    """
    names = list(chosen) or gathered.runs
    if not chosen and all(name.isascii() and name.isdigit() for name in names):
        names = sorted(names, key=int)
    known = set(gathered.runs)
    for i, name in enumerate(names):
        if name not in known:
            message = f"there is no run {name!r}; there are {', '.join(gathered.runs[:20])}"
            raise InvalidKeyError(message, *within, i)
    wanted = {name: i for i, name in enumerate(names)}
    # new_number[number in the files] = number among the chosen runs, -1 if not chosen
    new_number = np.array([wanted.get(name, -1) for name in gathered.runs], dtype=np.int32)
    gathered.runs = names
    chosen_rows = []
    while rows:  # rows are dropped one sensor after the other, to save memory
        of_sensor = rows.pop(0)
        of_sensor = of_sensor._replace(run=new_number[of_sensor.run])
        is_chosen = of_sensor.run >= 0
        if not is_chosen.all():
            of_sensor = of_sensor.at(np.flatnonzero(is_chosen))
        chosen_rows.append(of_sensor)
    return chosen_rows


def check_turns(gathered: Gathered, rows: Rows, angles: Mapping[str, int]) -> None:
    """Raise DataError for angles that are too large to be in radians.

    ``angles`` has the row of each angle among the values, by its name.
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
            message = f"{name}: {rows.values[i, wide[0]]:.9g} rad is beyond {turn}"
            more = and_others(len(wide))
            # A unit in which the numbers of all cells are possible.
            scale = gathered.naming.scale(name)
            largest = float(np.nanmax(sizes)) / scale
            others = [unit for unit in ("deg", "mrad") if UNITS[unit] != scale]
            fitting = [unit for unit in others if largest * UNITS[unit] <= limit]
            if not fitting and scale == 1.0:
                # A few cells are wrong in any unit. Of numbers beyond a turn degrees are the likeliest.
                fitting = ["deg"]
            way = ""
            if fitting == ["mrad"] and 360.0 < largest <= 400.0:
                way = "if a turn has 400 gon, write degrees, or "
            elif fitting == ["mrad"]:
                way = (
                    f"say `units: {{{name}: mrad}}`, or write degrees if a turn has 6400 mils, or "
                )
            elif fitting:
                way = f"say `units: {{{name}: {fitting[0]}}}`, or "
            message = f"{message}{more}: {way}correct the cells"
            raise DataError(gathered.place(rows, int(wide[0]), message))


class FromFiles:
    """Base of the frozen dataclasses (``eq=False``) whose numbers are read from files."""

    @property
    def patterns(self) -> tuple[str, ...]:
        """All files, as the config names them."""
        raise NotImplementedError

    @property
    def contents(self) -> dict[str, str]:
        """Digest of all files, by each of their names."""
        return dict.fromkeys(self.patterns, self.__dict__["_content"])

    @contextmanager
    def reading(self) -> Iterator[None]:
        """Store a digest of the files that are read within.

        Raises DataError if they change meanwhile.
        """
        before = self._stamps()
        yield
        # Digest the files, then check that none has changed since before the reading.
        digest = hashlib.sha256()
        for path in before:
            with require_regular_file(path).open("rb") as file:
                digest.update(hashlib.file_digest(file, "sha256").digest())
        if self._stamps() != before:
            raise DataError(Place(self.patterns[0], 1, 1, "was changed while it was read"))
        object.__setattr__(self, "_content", digest.hexdigest())

    def _stamps(self) -> dict[str, tuple[int, int]]:
        """Return the size and time of every file."""
        stamps = {}
        for path in chain.from_iterable(map(files_of, self.patterns)):
            try:
                status = require_regular_file(path).stat()
            except OSError as error:
                raise DataError(Place(path, 1, 1, reason(error))) from None
            stamps[path] = (status.st_size, status.st_mtime_ns)
        return stamps

    @property
    def _key(self) -> tuple[Any, ...]:
        assert is_dataclass(self)
        keys = tuple(self._named(getattr(self, field.name)) for field in fields(self) if field.init)
        return (type(self), keys, self.__dict__["_content"])

    def _named(self, value: Any) -> str:
        """Return a key's value as a word, by which objects are compared; every file is one word.

        Files are compared by their content, which `_key` adds.
        """
        if isinstance(value, tuple) and value:
            return ",".join(map(self._named, value))
        if isinstance(value, str) and value in self.patterns:
            return "file"
        return repr(value)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, FromFiles) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)


def longest_first(names: list[str], sizes: Index) -> list[tuple[str, int]]:
    """Return the name and the number of rows of each run, the longest first."""
    return sorted(zip(names, sizes.tolist(), strict=True), key=lambda run: -run[1])
