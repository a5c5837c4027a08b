"""Guess of the units of a table, and the questions on units that remain open."""

import json
import re
from collections.abc import Collection, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.guess_azimuths import check_bearings
from trackbench.scenarios.recordings.guess_position_unit import LENGTH_UNITS, orders_of_degrees
from trackbench.scenarios.recordings.guess_record import (
    ColumnByQuantity,
    ReasonByKey,
    SensorGuess,
    UnitByQuantity,
)
from trackbench.scenarios.recordings.guess_robot import UNITS_OF_ROBOT
from trackbench.scenarios.recordings.guess_signs_of_axes import (
    check_course,
    check_velocity,
)
from trackbench.scenarios.recordings.guess_table_sample import TableSample
from trackbench.scenarios.recordings.guess_times_of_day_in_digits import ClockFormat
from trackbench.scenarios.recordings.guess_unit_combinations import likely_units
from trackbench.scenarios.recordings.guess_usual_speed_and_acceleration import (
    is_usual_speed,
    usual_acceleration,
)
from trackbench.scenarios.recordings.guess_velocities import (
    NO_NUMBERS,
    explain_disagreement,
    with_north_first,
)
from trackbench.scenarios.recordings.guess_weeks_or_nanoseconds import with_weeks_or_nanoseconds
from trackbench.scenarios.recordings.hemispheres import HEMISPHERES
from trackbench.scenarios.recordings.missing_cells import no_fix
from trackbench.scenarios.recordings.naming_of_columns import Naming
from trackbench.scenarios.recordings.parse_dates import instant
from trackbench.scenarios.recordings.parse_numbers import parse_cells
from trackbench.scenarios.recordings.quantity_column_names import other_unit_of, words_of
from trackbench.scenarios.recordings.quantity_keys import (
    COURSE,
    GEODETIC,
    ODOMETRY,
    PLACE,
    VELOCITY,
    plain_name,
)
from trackbench.scenarios.recordings.rows_and_reading_context import (
    usual_interval,
    values_of_nearest_rows,
)
from trackbench.scenarios.recordings.unit_names_and_sizes import OTHER_TIME_UNITS, UNITS, usual_unit
from trackbench.scenarios.recordings.unscaled_rows import Candidate, PossibleFormat, UnscaledRows
from trackbench.scenarios.recordings.yaml_values import in_option

_TURN = 2.0 * np.pi
_LONG_INTERVAL = 600.0
"""s between rows, from which on a slow target is usual, as an animal with a position every hour"""
_FASTEST_IN_KM = 400.0
"""m/s that something may have whose positions are in km without saying so"""
_LARGEST_ACCELERATION = 35.0
"""m/s^2, 3.5 times that of gravity, beyond which no vehicle turns for a quarter of the time"""
_FAST = 50.0
"""m/s, from which on positions in m may rather be in cm or mm"""
_NAMES_IN_M = frozenset({"pose", "position", "odom", "odometry", "translation", "tx", "ty", "enu"})
"""Words in names of columns whose lengths are in m by convention."""
_INTERVALS_OF_MS = (10.0, 1000.0)
"""usual intervals of whole numbers that may be ms as well as s"""
_MOST_DECIMALS_OF_MM = 1
"""digits behind the point of positions that may be in mm"""
_MOST_TANGENTIAL = 20.0
"""ratio of the ways across and along the line of sight, beyond which azimuths may have another unit"""
_SECONDS = {"seconds", "sec", "secs", "second", "t", "tow", "itow", "gms", "sow", "sod"}
_TIMES_OF_DAY = {"utc", "clock", "gmt", "uhrzeit", "heure", "hora", "klokkeslett", "local", "cet"}
_ELAPSED = {"elapsed", "duration", "split", "lap", "laptime", "elapsedtime"}


def check_named_units(
    sample: TableSample, columns: dict[str, str], units: dict[str, str], measured: set[str]
) -> None:
    """Raise DataError for each column with a unit that trackbench cannot convert, such as yards.

    The unit stands in the column's name or in a line of units. ``columns`` and the known ``units`` are
    by quantity. Only columns that are read count: those of the ``measured`` quantities, of velocities,
    of a robot's inputs and of times.
    """
    read = {*measured, *VELOCITY, *COURSE, *ODOMETRY, "time"}
    # Latitude and longitude are read only in a table without x and y.
    if not {*PLACE} <= columns.keys():
        read |= {*GEODETIC[:2]}
    mistakes = []
    for name, column in columns.items():
        if name not in read or name in units or column not in sample.names:
            continue
        # A unit with a factor, such as 0.1*m, is shown as it was written, 0.1 m.
        other = other_unit_of(column) or sample.other_unit(column)
        words = words_of(column)
        if name == "time" and len(words) > 1 and words[-1] in OTHER_TIME_UNITS:
            other = words[-1]
        if other is not None:
            message = f"{column}: the unit {other.replace('*', ' ')} is unknown here"
            unit = UNITS_OF_ROBOT[name][0] if name in ODOMETRY else usual_unit(name)
            example = f"--set units.{plain_name(name)}={unit}"
            remedy = f"write the numbers in a known unit, and say it, such as {example}"
            mistakes.append(Place(sample.path, 1, 1, f"{message}: {remedy}"))
    if mistakes:
        raise DataError(*mistakes)


class UnitChoice:
    """Choice of the units of a table, whose columns are known."""

    def __init__(
        self,
        sample: TableSample,
        columns: ColumnByQuantity,
        units: UnitByQuantity,
        clock_format: ClockFormat,
        with_missing: Naming,
        reasons: ReasonByKey,
        user_columns: Collection[str],
    ) -> None:
        """Begin with the known ``units`` by quantity, to which the methods add units in place.

        They add a reason for each of them to ``reasons``, and change ``columns``, too. ``clock_format``
        is the format of dates, and ``with_missing`` has the numbers that stand for missing cells.
        ``user_columns`` are the quantities whose columns the user named.
        """
        self._user_columns = user_columns
        self._sample = sample
        self._clock_format = clock_format
        self._reasons = reasons
        self._columns = columns
        self._units = units
        self._with_missing = with_missing
        self._chosen_rows: Mask = np.array([], dtype=np.bool_)
        """rows of one target and sensor, by which units are chosen"""

    def choose_units(self, sensor: SensorGuess, has_velocity: bool) -> ClockFormat:
        """Add the likeliest units to the known ones; return the format of dates.

        ``sensor`` is the first sensor, and ``has_velocity`` is True if a velocity is measured beside its
        positions. The columns of a velocity that disagrees with the positions are removed, unless the
        user named them. Raises DataError with a line for each candidate if several are about as likely
        as the best one.
        """
        # Step 1: rank the candidates by which times, positions and speeds agree.
        unscaled = self._unscaled_rows(sensor)
        # Formats of strptime, the guessed one as an empty text, and "s" if times may be numbers of
        # seconds. The `time_unit` of a candidate is one of them, or else the unit of numbers.
        possible_formats: dict[str, PossibleFormat] = {}
        if self._clock_format.other_format:
            possible_formats = self._possible_formats()
        known_units = self._known_units(sensor)
        # Only beside latitudes and longitudes is it known which axis points north.
        if unscaled.is_geodetic and unscaled.velocity is not None:
            unscaled = with_north_first(
                unscaled,
                known_units,
                possible_formats,
                columns=self._columns,
                units=self._units,
                reasons=self._reasons,
                user_columns=self._user_columns,
            )
        # The others have a penalty within the margin of `likely_units` from that of the first.
        first, *others = likely_units(unscaled, known_units, possible_formats)
        if not others and self._may_be_thousandths(first, unscaled, known_units):
            others = [replace(first, time_unit="ms", position_unit="mm")]
        self._check_axes(sensor, unscaled, first, known_units, possible_formats, has_velocity)
        # Step 2: report what remains open.
        questions = []
        if others:
            questions = self._questions_on_units([first, *others], unscaled)
        # The answer to one question on lengths settles their unit, whichever candidate is right.
        for candidate in (first, *others):
            question = self._question_on_length(candidate, unscaled, known_units, bool(others))
            if question is not None:
                questions.append(question)
                break
        if questions:
            raise DataError(*questions)
        # Step 3: write the best candidate into columns and units.
        self._write_units(first, unscaled)
        if has_velocity and not first.course_agrees:
            self._settle_velocity(sensor, unscaled, first)
        # Step 4: return the chosen one of two formats of dates. If it is the guessed one, which is empty
        # here, the clock's format stays as it is.
        if first.time_unit in possible_formats and first.time_unit:
            if first.time_unit == "s":
                return ClockFormat()  # the times are numbers of seconds
            self._reasons["time_format"] = f"guess: {self._explain_choice(first)}"
            return self._clock_format._replace(date_format=first.time_unit)
        return self._clock_format

    def _settle_velocity(
        self, sensor: SensorGuess, unscaled: UnscaledRows, chosen: Candidate
    ) -> None:
        """Remove the columns of a velocity that disagrees with the positions; add the reason.

        They remain if the user named one of them and the velocity has numbers. The positions of the
        ``sensor`` are those of the ``unscaled`` rows in the ``chosen`` units.
        """
        columns = self._columns
        names = [name for name in (*COURSE, *VELOCITY) if name in columns]
        course_unit = "deg"
        if unscaled.course is not None:
            course_unit = self._unit_of_angles("course", unscaled.course)
        reason = explain_disagreement(unscaled, chosen, course_unit)
        is_empty = reason == NO_NUMBERS
        if not is_empty and not {*names}.isdisjoint(self._user_columns):
            self._reasons["velocity"] = f"velocities are used, as you named them; but {reason}"
            return
        remedy = ""
        if not is_empty:
            options = (f"--set 'columns.{name}={in_option(columns[name])}'" for name in names)
            remedy = f"; to use them all the same: {' '.join(options)}"
        elif sensor.name and all(np.isfinite(self._numbers_of(name)).any() for name in names):
            reason += f" in rows whose {columns['sensor']} is {sensor.name}"
            remedy = "; if this column names no sensors: --set 'columns.sensor=\"\"'"
        for name in names:
            columns.pop(name)
            self._units.pop(name, None)
        self._reasons["velocity"] = f"velocities are left out: {reason}{remedy}"

    def _may_be_thousandths(
        self, chosen: Candidate, unscaled: UnscaledRows, known_units: UnitByQuantity
    ) -> bool:
        """Test whether x, y and times may be in mm and ms as well as in the ``chosen`` m and s.

        A measured speed in m/s agrees with both. Times in ms are whole numbers, and in s they would be
        ten seconds or more apart. Positions in mm have one digit behind the point at most.
        ``known_units`` are units by quantity.
        """
        columns = self._columns
        names = [name for name in PLACE if name in columns]
        if unscaled.is_geodetic or unscaled.is_dated or len(names) < len(PLACE):
            return False
        if not {*PLACE, "time"}.isdisjoint(known_units):
            return False
        if not (chosen.speed_agrees and chosen.time_unit == "s" and chosen.position_unit == "m"):
            return False
        words = {word for name in names for word in words_of(columns[name])}
        times = unscaled.time[np.isfinite(unscaled.time)]
        is_whole = not (times % 1.0).any()
        least, largest = _INTERVALS_OF_MS
        return (
            is_whole
            and least <= usual_interval(times) <= largest
            and unscaled.least_decimals <= _MOST_DECIMALS_OF_MM
            and words.isdisjoint(_NAMES_IN_M)
        )

    def _check_axes(
        self,
        sensor: SensorGuess,
        unscaled: UnscaledRows,
        chosen: Candidate,
        known_units: UnitByQuantity,
        possible_formats: Mapping[str, PossibleFormat],
        has_velocity: bool,
    ) -> None:
        """Raise DataError if bearings, velocities or courses contradict the positions' axes.

        The positions are those of the ``unscaled`` rows in the ``chosen`` units. ``known_units`` are
        units by quantity, ``possible_formats`` the possible formats of dates. ``has_velocity`` is True
        if the sensor also measures a velocity.
        """
        columns = self._columns
        is_position = sensor.quantities == PLACE
        # Beside a speed the column may be a course, which is compared with the positions elsewhere.
        if is_position and "azimuth" in columns and "speed" not in columns:
            angles = self._numbers_of("azimuth")[self._chosen_rows]
            # In a table of several sensors the azimuth may be that of another one.
            if np.isfinite(angles).any():
                angles = angles * UNITS[self._unit_of_angles("azimuth", angles)]
                check_bearings(self._sample, columns, self._user_columns, unscaled, chosen, angles)
        if has_velocity and not (chosen.speed_agrees and chosen.course_agrees):
            check_velocity(self._sample, columns, unscaled, known_units, possible_formats)
        if is_position and unscaled.course is not None and unscaled.speed is None:
            course = unscaled.course * UNITS[self._unit_of_angles("course", unscaled.course)]
            check_course(self._sample, columns, unscaled, chosen, course)

    def check_azimuths(self, sensors: list[SensorGuess]) -> None:
        """Raise DataError if azimuths without a unit may be in radians as well as in degrees.

        Numbers within 2 pi are taken for radians, and the unit is added. But if the target then moves
        nearly always across the line of sight, they may rather be degrees. Nothing is added for any
        other table than that of a single radar, for numbers beyond 2 pi, and for fewer than three rows
        with both numbers: a unit that is missing in the end stands for radians.
        """
        is_radar = [sensor.kind for sensor in sensors] == ["range-azimuth"]
        if not is_radar or "azimuth" in self._units:
            return
        azimuth = self._numbers_of("azimuth")
        ranges = self._numbers_of("range")
        known = np.flatnonzero(np.isfinite(azimuth) & np.isfinite(ranges))
        azimuth = azimuth[known]
        # Numbers beyond 2 pi are degrees, which is added when all rows have been read.
        if len(known) < 3 or (np.abs(azimuth) > _TURN).any():
            return
        ranges = ranges[known]
        across = np.median(np.abs(np.diff(azimuth)) * ranges[1:])
        along = np.median(np.abs(np.diff(ranges)))
        if across > _MOST_TANGENTIAL * along:
            message = (
                f"{self._columns['azimuth']}: no unit is named, and its numbers may be degrees"
            )
            remedy = "say --set units.azimuth=deg or --set units.azimuth=rad"
            raise DataError(Place(self._sample.path, 1, 1, f"{message} or radians: {remedy}"))
        self._units["azimuth"] = "rad"
        self._reasons["azimuth"] = "guess: there is no angle beyond 2 pi"

    def _question_on_length(
        self,
        chosen: Candidate,
        unscaled: UnscaledRows,
        known_units: UnitByQuantity,
        has_others: bool,
    ) -> Place | None:
        """Return the question for the unit of lengths if none is named; None if there is nothing to ask.

        It is asked if the speed in m would be unusual, or if another unit is as likely as m. The second
        reason does not count beside other questions on units (``has_others``). ``chosen`` is a likely
        choice of units for the ``unscaled`` rows, and ``known_units`` are units by quantity. The range
        of a table with one range alone gets the unit m if its speed is usual in m, or unknown, and no
        other unit is as likely.
        """
        names = [name for name in ("x", "y", "range", "1.range") if name in self._columns]
        is_named = not {"x", "range"}.isdisjoint(known_units)
        # No unit of lengths is open if the measured speed agrees with that of the positions in the
        # chosen one.
        if (
            chosen.as_geodetic
            or unscaled.is_geodetic
            or not names
            or is_named
            or chosen.speed_agrees
        ):
            return None
        speed = chosen.usual_speed  # m/s, if the lengths are in m
        other_units: list[str] = []
        if is_usual_speed(speed) and not has_others:
            other_units = self._other_lengths(chosen, unscaled)
        if not np.isfinite(speed) or (is_usual_speed(speed) and not other_units):
            # The config must have a unit of a range; x and y are in m without one.
            if names == ["range"]:
                self._units["range"] = "m"
                self._reasons["range"] = f"guess: no unit is named; {self._explain_choice(chosen)}"
            return None
        options_of_degrees = ""
        if names == ["x", "y"]:
            options_of_degrees = self._options_of_degrees(unscaled)
        # A target that is measured once an hour may well be slow.
        interval = usual_interval(unscaled.time[np.isfinite(unscaled.time)])
        if interval * chosen.seconds_per_unit >= _LONG_INTERVAL and not options_of_degrees:
            return None
        # Azimuths beyond 360 are neither degrees nor radians, and so show no speed.
        largest_azimuth = 0.0
        if "azimuth" in self._columns and "azimuth" not in self._units:
            largest_azimuth = float(np.nanmax(np.abs(self._numbers_of("azimuth")), initial=0.0))
        if largest_azimuth > 360.0:
            return None
        fitting = [unit for unit in LENGTH_UNITS if is_usual_speed(speed * UNITS[unit])]
        fitting = other_units or fitting
        if not fitting and not options_of_degrees:
            return None
        units = [*fitting, "m"]
        options = " ".join(f"--set units.{name}={units[0]}" for name in names)
        columns = ", ".join(self._columns[name] for name in names)
        message = f"{columns}: no unit is named, and in m the usual speed would be {speed:.2g} m/s"
        if other_units:
            message += f", in {units[0]} {speed * UNITS[units[0]]:.2g} m/s"
        remedy = f"say {options}"
        if units[1:]:
            remedy += f", or with another unit: {', '.join(units[1:])}"
        if options_of_degrees:
            remedy += f"; or in degrees, {options_of_degrees}"
        return Place(self._sample.path, self._sample.first_line, 1, f"{message}: {remedy}")

    def _options_of_degrees(self, unscaled: UnscaledRows) -> str:
        """Return the options by which x and y are degrees, in each possible order; empty without one."""
        columns = [in_option(self._columns[name]) for name in PLACE]
        texts = []
        for quantities in orders_of_degrees(unscaled):
            options = [
                f"--set 'columns.{quantity}={column}'"
                for quantity, column in zip(quantities, columns, strict=True)
            ]
            texts.append(" ".join(options))
        return f", or if {columns[0]} is the latitude, ".join(texts)

    def _other_lengths(self, chosen: Candidate, unscaled: UnscaledRows) -> list[str]:
        """Return the units that lengths without a named unit may have as well as m.

        The list is empty for most tables. A target that is slow in m may be fast in km, unless it would
        then turn as no vehicle can. A target that is fast in m and turns so is rather slow, in mm or cm.
        Columns with names of ROS and of motion capture are in m. The positions are those of the
        ``unscaled`` rows in the ``chosen`` units.
        """
        speed = chosen.usual_speed
        words = {word for name in PLACE for word in words_of(self._columns.get(name, ""))}
        # Numbers of steps are no seconds, so that no speed is in m/s. `is_dated` marks times that need
        # no unit: dates, and numbers of steps, for which there is no column of a time.
        counts_steps = unscaled.is_dated and "time" not in self._columns
        if not np.isfinite(speed) or counts_steps:
            return []
        acceleration = usual_acceleration(unscaled, chosen)
        turns_slowly = acceleration * 1e3 <= _LARGEST_ACCELERATION
        if speed <= _FASTEST_IN_KM * 1e-3 and turns_slowly and words.isdisjoint(_NAMES_IN_M):
            return [unit for unit in ("km", "nmi", "mi") if is_usual_speed(speed * UNITS[unit])]
        if acceleration > _LARGEST_ACCELERATION and speed >= _FAST:
            return [unit for unit in ("mm", "cm") if is_usual_speed(speed * UNITS[unit])]
        return []

    def _unscaled_rows(self, sensor: SensorGuess) -> UnscaledRows:
        """Return the rows of one sensor and of its longest run, whose units `likely_units` chooses.

        The mask (R,) of these rows in the sample is stored as `_chosen_rows`, by which `_check_axes`
        selects the numbers of further columns.
        """
        # Step 1: select the rows of the sensor, and of them those of the longest run.
        sample = self._sample
        columns = self._columns
        rows = np.ones(len(sample), dtype=np.bool_)
        if sensor.name and columns.get("sensor"):
            rows &= np.array([cell == sensor.name for cell in sample.cells(columns["sensor"])])
        if columns.get("run"):
            runs = np.array(sample.cells(columns["run"]))
            labels, sizes = np.unique(runs[rows], return_counts=True)
            rows &= runs == labels[sizes.argmax()]
        self._chosen_rows = rows
        # Step 2: read the times, and the positions as they are written.
        time, is_dated = self._times()
        is_geodetic = False
        azimuth = None
        if sensor.kind == "range-azimuth":
            azimuth = self._azimuths()
            position = self._numbers_of("range") * np.stack([np.cos(azimuth), np.sin(azimuth)])
            quantities = ["range"]
        elif sensor.kind in ("bearing", "odometry") or sensor.kind.startswith("landmark"):
            position = np.empty((0, len(rows)))
            quantities = []
        elif sensor.kind == "range":
            quantities = list(sensor.quantities)
            position = np.stack([self._numbers_of(name) for name in quantities])
        else:
            is_geodetic = not {"x", "y"} <= columns.keys()
            quantities = ["longitude", "latitude"] if is_geodetic else ["x", "y"]
            position = np.stack([self._numbers_of(name) for name in quantities])
            # Their unit is unknown as yet. Rows at exactly 0 N 0 E have no fix if all others, read as
            # degrees, are far from there.
            if is_geodetic:
                position[:, no_fix(position[1], position[0], UNITS["deg"])] = np.nan
        # Step 3: read the speeds, and take only the chosen rows. Rows without a speed get that of the
        # row which is nearest in time, as rows of positions and of velocities may alternate.
        speed = None
        if "speed" in columns:
            speed = self._nearest_numbers_of("speed", time, rows)
        course = None
        if "course" in columns:
            course = self._nearest_numbers_of("course", time, rows)
        velocity = None
        if columns.keys() >= {*VELOCITY}:
            velocity = np.stack([self._nearest_numbers_of(name, time, rows) for name in VELOCITY])
        # The names of all columns show formats of messages, such as AIS, which have units of their own.
        plain_names = frozenset("".join(words_of(name)) for name in sample.names)
        decimals = [self._sample.decimals(columns[name]) for name in quantities]
        return UnscaledRows(
            time=time[rows],
            is_dated=is_dated,
            position=position[:, rows],
            is_geodetic=is_geodetic,
            speed=speed,
            course=course,
            velocity=velocity,
            plain_column_names=plain_names,
            least_decimals=min(decimals, default=0),
        )

    def _numbers_of(self, name: str) -> Array:
        """Parse the numbers (R,) of the quantity ``name``, NaN where they are missing.

        Coordinates have the signs of their hemispheres.
        """
        values = self._sample.numbers(self._columns[name])
        values[np.isin(values, self._with_missing.missing_numbers(name))] = np.nan
        key, _, negative = HEMISPHERES.get(name, ("", (), ()))
        if self._columns.get(key):
            words = self._sample.cells(self._columns[key])
            is_negative = np.array([word.lower() in negative for word in words], dtype=np.bool_)
            values[is_negative] = -np.abs(values[is_negative])
        return values

    def _nearest_numbers_of(self, name: str, time: Array, rows: Mask) -> Array:
        """Return the numbers of a quantity at chosen ``rows``, a mask (R,), of times ``time`` (R,).

        A row without a number gets that of the chosen row which is nearest in time, if it is near.
        """
        numbers = self._numbers_of(name)[rows]
        (nearest,) = values_of_nearest_rows(time[rows], time[rows], numbers[np.newaxis])
        return np.where(np.isfinite(numbers), numbers, nearest)

    def _azimuths(self) -> Array:
        """Return the azimuths (R,) in radians."""
        azimuth = self._numbers_of("azimuth")
        return azimuth * UNITS[self._unit_of_angles("azimuth", azimuth)]

    def _unit_of_angles(self, name: str, angles: Array) -> str:
        """Return the unit of the angles (R,) of the quantity ``name``.

        If none is known, it is degrees if any number is beyond 2 pi, and otherwise radians.
        """
        if name in self._units:
            return self._units[name]
        if (np.abs(angles) > _TURN).any():
            return "deg"
        return "rad"

    def _times(self) -> tuple[Array, bool]:
        """Return the times (R,) of the sample, and whether they are dates or steps, which need no unit.

        Dates are in seconds since 1970, and other times in the unit of the file. The part of a second
        or the week that a further column has is added.
        """
        columns = self._columns
        sample = self._sample
        if "time" not in columns:
            return sample.numbers(columns["step"]), True
        cells = sample.cells(columns["time"])
        if self._clock_format.is_date:
            if "date" in columns and columns["time"] != columns["date"]:
                dates = sample.cells(columns["date"])
                cells = [f"{date} {time}" for date, time in zip(dates, cells, strict=True)]
            microseconds, _ = parse_cells(
                partial(instant, date_format=self._clock_format.date_format), cells
            )
            if np.isnan(microseconds).all():
                # The column of the times has whole dates, without those of the other column.
                microseconds, _ = parse_cells(instant, sample.cells(columns["time"]))
            seconds = microseconds / 1e6
        else:
            seconds = sample.numbers(columns["time"])
        return with_weeks_or_nanoseconds(
            seconds,
            self._sample,
            self._columns,
            self._units,
            self._reasons,
            is_date=self._clock_format.is_date,
        ), self._clock_format.is_date

    def _possible_formats(self) -> dict[str, PossibleFormat]:
        """Return both possible formats of ambiguous times; the key of the guessed one is empty.

        Times such as 10:30 or 1030 are hours and minutes (the guessed format), or minutes and seconds.
        Numbers such as 1201 may also be seconds (the format "s"). `likely_units` adds the penalty of a
        format to others, such as that of an unusual interval, which is 1. The least sum wins, and less
        than 0.6 between two sums leaves a question to the user.
        """
        cells = self._sample.cells(self._columns["time"])
        words = words_of(self._columns["time"])
        is_elapsed = not _ELAPSED.isdisjoint(words)
        if self._clock_format.other_format == "s":
            is_seconds = is_elapsed or not _SECONDS.isdisjoint(words)
            is_time_of_day = not _TIMES_OF_DAY.isdisjoint(words)
            as_clock, _ = self._times()
            as_numbers = self._sample.numbers(self._columns["time"])
            factor = usual_interval(as_numbers) / usual_interval(as_clock)
            # The name of the column decides if it says what the times are: this is a penalty of 1 on the
            # other format. Without it the 100 s between 100, 200 and 300, which are unusual, would cost
            # seconds 1. The 0.5 for the clock reduces this difference to 0.5, and the user is asked.
            return {
                "": PossibleFormat(factor=1.0, penalty=0.5 + is_seconds),
                "s": PossibleFormat(factor=factor, penalty=1.0 * is_time_of_day),
            }
        # Times that begin at zero, as 00:12 and 0012, rather count minutes and seconds.
        from_zero = bool(cells) and re.match(r"0+[:.,]|0*\d\d?$", cells[0]) is not None
        penalty_of_hours = 1.0 * is_elapsed + 0.5 * from_zero
        penalty_of_minutes = 0.0 if is_elapsed or from_zero else 1.0
        return {
            "": PossibleFormat(factor=1.0, penalty=penalty_of_hours),
            self._clock_format.other_format: PossibleFormat(
                factor=1.0 / 60.0, penalty=penalty_of_minutes
            ),
        }

    def _known_units(self, sensor: SensorGuess) -> dict[str, str]:
        """Return the known units by quantity.

        A sensor of several columns of ranges, such as 1.range and 2.range, gets the unit of one of them
        as that of ``range``, too.
        """
        known = dict(self._units)
        if sensor.kind == "range":
            for name in sensor.quantities:
                if name in known:
                    known["range"] = known[name]
        return known

    def _write_units(self, chosen: Candidate, unscaled: UnscaledRows) -> None:
        """Add the ``chosen`` units of quantities that have none yet, with the reasons, in place.

        They were chosen by the ``unscaled`` rows. If x and y turn out to be longitude and latitude,
        their columns become those of these quantities.

        A unit that the config has by default is left out, but for two, which are written with the reason
        beside them: deg if x and y turn out to be angles, and m/s if the speed agrees with the positions
        in this unit.
        """
        columns = self._columns
        units = self._units
        reasons = self._reasons
        reason = f"guess: {self._explain_choice(chosen)}"
        # A format of dates in place of the unit is no unit, and s is the default.
        if (
            "time" in columns
            and "time" not in units
            and chosen.time_unit in UNITS
            and chosen.time_unit != "s"
        ):
            units["time"] = chosen.time_unit
            reasons["time"] = reason
        if chosen.as_geodetic and not unscaled.is_geodetic:
            columns["longitude"] = columns.pop("x")
            columns["latitude"] = columns.pop("y")
            reasons["degrees"] = "guess: x and y are a longitude and a latitude"
            units["longitude"] = units["latitude"] = chosen.position_unit
            reasons["longitude"] = reasons["latitude"] = reason
        elif unscaled.is_geodetic:
            for name in GEODETIC[:2]:  # latitude and longitude
                if name not in units and chosen.position_unit != "deg":
                    units[name] = chosen.position_unit
                    reasons[name] = reason
        elif chosen.position_unit != "m":
            for name in ("x", "y", "range"):
                if name in columns and name not in units:
                    units[name] = chosen.position_unit
                    reasons[name] = reason
        names = VELOCITY if unscaled.velocity is not None else ("speed",)
        for name in names:
            if name in columns and name not in units and chosen.speed_unit and chosen.speed_agrees:
                units[name] = chosen.speed_unit
                reasons[name] = "guess: agrees with the positions"
        if "course" in columns and "course" not in units and chosen.course_unit not in ("", "deg"):
            units["course"] = chosen.course_unit
            reasons["course"] = "guess: the direction of the positions"

    def _explain_choice(self, chosen: Candidate) -> str:
        """Return the comment for the config that explains why these units were chosen."""
        if chosen.speed_agrees:
            return "times, positions and speeds agree"
        if np.isfinite(chosen.usual_speed):
            return f"the usual speed is {chosen.usual_speed:.2g} m/s"
        return "as large as its numbers are"

    def _questions_on_units(
        self, candidates: list[Candidate], unscaled: UnscaledRows
    ) -> list[Place]:
        """Return a question to the user: a line for each candidate, with the options that choose it.

        ``unscaled`` are the rows whose units are asked for.
        """
        columns = self._columns
        first = candidates[0]
        questions = []
        differ_in_time = any(candidate.time_unit != first.time_unit for candidate in candidates)
        differ_in_position = any(
            candidate.position_unit != first.position_unit for candidate in candidates
        )
        for candidate in candidates:
            options = []
            units = []
            # In place of a unit of times there may be a format of dates, empty for the guessed one.
            if differ_in_time:
                clock_format = candidate.time_unit or self._clock_format.date_format
                if clock_format in UNITS:
                    options.append(f"--set 'units.time={clock_format}'")
                else:
                    options.append(f"--set 'time_format={json.dumps(clock_format)}'")
                units.append(f"{columns['time']} in {clock_format}")
            if differ_in_position:
                names = ["latitude", "longitude"] if unscaled.is_geodetic else ["x", "y"]
                if candidate.as_geodetic and not unscaled.is_geodetic:
                    options.append(self._options_of_degrees(unscaled))
                else:
                    for name in names:
                        if name in columns:
                            options.append(f"--set units.{name}={candidate.position_unit}")
                shown = ", ".join(columns[name] for name in names if name in columns)
                units.append(f"{shown} in {candidate.position_unit}")
            message = f"the units may be {' and '.join(units)}"
            if np.isfinite(candidate.usual_speed):
                message += f", with a usual speed of {candidate.usual_speed:.2g} m/s"
            message += f": say {' '.join(options)}"
            questions.append(Place(self._sample.path, self._sample.first_line, 1, message))
        return questions
