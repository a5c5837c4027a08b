"""Guess of the units of a table, and the questions on units that remain open."""

import json
import re
from collections.abc import Collection, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.column_mapping import Naming
from trackbench.scenarios.recordings.column_names import other_unit_of, rest_of_stamp, words_of
from trackbench.scenarios.recordings.csv_tables import parse_cells
from trackbench.scenarios.recordings.dates import instant
from trackbench.scenarios.recordings.guess_axes import (
    check_bearings,
    check_course,
    check_velocity,
    has_north_first,
)
from trackbench.scenarios.recordings.guess_record import (
    ColumnByQuantity,
    ReasonByKey,
    SensorGuess,
    UnitByQuantity,
)
from trackbench.scenarios.recordings.guess_robot import UNITS_OF_ROBOT
from trackbench.scenarios.recordings.guess_time import DateForm
from trackbench.scenarios.recordings.missing_cells import no_fix
from trackbench.scenarios.recordings.quantities import COURSE, GEODETIC, ODOMETRY, PLACE, VELOCITY
from trackbench.scenarios.recordings.rows import usual_interval
from trackbench.scenarios.recordings.table_sample import Sample
from trackbench.scenarios.recordings.unit_candidates import (
    LENGTH_UNITS,
    Candidate,
    Numbers,
    is_usual_speed,
    likely_units,
    look_like_degrees,
    usual_acceleration,
)
from trackbench.scenarios.recordings.units import UNITS, usual_unit
from trackbench.scenarios.recordings.yaml_values import in_option

_TURN = 2.0 * np.pi
_LONG_INTERVAL = 600.0  # s
_FASTEST_IN_KM = 400.0
"""m/s that something may have whose positions are in km without saying so"""
_LARGEST_ACCELERATION = 35.0
"""m/s^2, 3.5 times that of gravity, beyond which no vehicle turns for a quarter of the time"""
_FAST = 50.0
"""m/s, from which on positions in m may rather be in cm or mm"""
_NAMES_IN_M = frozenset({"pose", "position", "odom", "odometry", "translation", "tx", "ty", "enu"})
"""Words in names of columns whose lengths are in m by convention."""
_MOST_TANGENTIAL = 20.0
"""ratio of the ways across and along the line of sight, beyond which azimuths may have another unit"""
_WEEK = 604800.0  # s
_TIME_OF_WEEK = {"tow", "itow", "gms", "sow", "gpst", "secondsofweek"}
_SECONDS = {"seconds", "sec", "secs", "second", "t", "tow", "itow", "gms", "sow", "sod"}
_TIMES_OF_DAY = {"utc", "clock", "gmt", "uhrzeit", "heure", "hora", "klokkeslett", "local", "cet"}
_ELAPSED = {"elapsed", "duration", "split", "lap", "laptime", "elapsedtime"}


def check_named_units(
    sample: Sample, columns: dict[str, str], units: dict[str, str], measured: set[str]
) -> None:
    """Raise DataError for each column with a unit that no recording may have.

    The unit stands in the column's name or in a line of units. ``columns`` and ``units`` are by
    quantity. Only columns that are read count: those of the ``measured`` quantities, of velocities, of
    a robot's inputs and of times.
    """
    read = {*measured, *VELOCITY, *COURSE, *ODOMETRY, "time"}
    if not {*PLACE} <= columns.keys():
        read |= {*GEODETIC[:2]}
    mistakes = []
    for name, column in columns.items():
        if name not in read or name in units or column not in sample.names:
            continue
        other = other_unit_of(column) or sample.other_unit(column)
        if other is not None:
            message = f"{column}: the unit {other.replace('*', ' ')} is unknown here"
            unit = UNITS_OF_ROBOT[name][0] if name in ODOMETRY else usual_unit(name)
            example = f"--set units.{name}={unit}"
            way = f"write the numbers in a known unit, and say it, such as {example}"
            mistakes.append(Place(sample.path, 1, 1, f"{message}: {way}"))
    if mistakes:
        raise DataError(*mistakes)


class UnitChoice:
    """Choice of the units of a table, whose columns are known."""

    def __init__(
        self,
        sample: Sample,
        columns: ColumnByQuantity,
        units: UnitByQuantity,
        clock: DateForm,
        with_missing: Naming,
        why: ReasonByKey,
        user_columns: Collection[str],
    ) -> None:
        """Begin with the known ``units``, to which the methods add, with reasons in ``why``.

        ``clock`` is the form of dates, ``with_missing`` has the numbers that stand for missing cells.
        """
        self._user_columns = user_columns
        self._sample = sample
        self._clock = clock
        self._why = why
        self._columns = columns
        self._units = units
        self._with_missing = with_missing
        self._chosen_rows: Mask = np.array([], dtype=np.bool_)
        """rows of one target and sensor, by which units are chosen"""

    def choose_units(self, sensor: SensorGuess, has_velocity: bool) -> DateForm:
        """Add the likeliest units to the known ones; return the form of dates.

        ``sensor`` is the first sensor. The columns of a velocity that disagrees with the positions are
        removed. Raises DataError with a line for each candidate if several are equally likely.
        """
        numbers = self._numbers(sensor)
        clocks: dict[str, tuple[float, float]] = {}
        if self._clock.other:
            clocks = self._clocks()
        known_units = self._known_units(sensor)
        if numbers.is_angle and numbers.velocity is not None:
            numbers = self._with_north_first(numbers, known_units, clocks)
        first, *others = likely_units(numbers, known_units, clocks)
        self._check_axes(sensor, numbers, first, known_units, has_velocity)
        questions = []
        if others:
            questions = self._questions([first, *others], numbers)
        for candidate in (first, *others):
            question = self._question_on_length(candidate, numbers, known_units, bool(others))
            if question is not None:
                questions.append(question)
                break
        if questions:
            raise DataError(*questions)
        self._write(first, numbers)
        if has_velocity and not first.same_way:
            for name in {*VELOCITY, *COURSE} & self._columns.keys():
                self._columns.pop(name)
                self._units.pop(name, None)
            reason = "they disagree with the positions"
            velocity = () if numbers.velocity is None else numbers.velocity
            measured = [numbers.speed, numbers.course, *velocity]
            if any(values is not None and not np.isfinite(values).any() for values in measured):
                reason = "they have no numbers"
            self._why["velocity"] = f"velocities are left out: {reason}"
        # The chosen one of two forms of dates; it is empty for the form that the clock has already.
        if first.time in clocks and first.time:
            if first.time == "s":
                return DateForm()
            self._why["time_format"] = f"guess: {self._reason(first)}"
            return self._clock._replace(form=first.time)
        return self._clock

    def _with_north_first(
        self,
        numbers: Numbers,
        known_units: UnitByQuantity,
        clocks: Mapping[str, tuple[float, float]],
    ) -> Numbers:
        """Return the numbers with vx and vy exchanged, if only then they are the movement's.

        The columns of vx and vy, and their units, are then exchanged, too. ``clocks`` are possible forms
        of dates.
        """
        is_answered = not {*VELOCITY}.isdisjoint(self._user_columns)
        if is_answered or not has_north_first(numbers, known_units, clocks):
            return numbers
        assert numbers.velocity is not None
        columns = self._columns
        columns["vx"], columns["vy"] = columns["vy"], columns["vx"]
        for name, partner in (VELOCITY, VELOCITY[::-1]):
            if name in known_units:
                self._units[partner] = known_units[name]
        self._why["exchanged"] = f"{columns['vy']} points north, as the positions show"
        return replace(numbers, velocity=numbers.velocity[::-1])

    def _check_axes(
        self,
        sensor: SensorGuess,
        numbers: Numbers,
        chosen: Candidate,
        known_units: UnitByQuantity,
        has_velocity: bool,
    ) -> None:
        """Raise DataError if bearings, velocities or courses contradict the positions' axes.

        The positions are those of the ``numbers`` in the ``chosen`` units. ``has_velocity`` is True if
        the sensor also measures a velocity.
        """
        columns = self._columns
        is_position = sensor.quantities == PLACE
        if is_position and "azimuth" in columns and "speed" not in columns:
            angles = self._values("azimuth")[self._chosen_rows]
            # The rows of this sensor may have no azimuth, which is then another sensor's.
            if np.isfinite(angles).any():
                angles = angles * UNITS[self._unit_of_angles("azimuth", angles)]
                check_bearings(self._sample, columns, self._user_columns, numbers, chosen, angles)
        if has_velocity and not (chosen.agrees and chosen.same_way):
            check_velocity(self._sample, columns, numbers, known_units)
        if is_position and numbers.course is not None and numbers.speed is None:
            course = numbers.course * UNITS[self._unit_of_angles("course", numbers.course)]
            check_course(self._sample, columns, numbers, chosen, course)

    def check_azimuths(self, sensors: list[SensorGuess]) -> None:
        """Raise DataError if azimuths without a unit may be in radians as well as in degrees.

        Numbers within a turn are taken for radians. Then a target that moves nearly always across the
        line of sight may rather have azimuths in degrees.
        """
        is_radar = [sensor.kind for sensor in sensors] == ["range-azimuth"]
        if not is_radar or "azimuth" in self._units:
            return
        azimuth = self._values("azimuth")
        ranges = self._values("range")
        known = np.flatnonzero(np.isfinite(azimuth) & np.isfinite(ranges))
        azimuth = azimuth[known]
        if len(known) < 3 or (np.abs(azimuth) > _TURN).any():
            return
        ranges = ranges[known]
        across = np.median(np.abs(np.diff(azimuth)) * ranges[1:])
        along = np.median(np.abs(np.diff(ranges)))
        if across > _MOST_TANGENTIAL * along:
            message = (
                f"{self._columns['azimuth']}: no unit is named, and its numbers may be degrees"
            )
            way = "say --set units.azimuth=deg or --set units.azimuth=rad"
            raise DataError(Place(self._sample.path, 1, 1, f"{message} or radians: {way}"))
        self._units["azimuth"] = "rad"
        self._why["azimuth"] = "guess: there is no angle beyond 2 pi"

    def _question_on_length(
        self,
        chosen: Candidate,
        numbers: Numbers,
        known_units: UnitByQuantity,
        has_others: bool,
    ) -> Place | None:
        """Ask for the unit of lengths if none is named, and in meters the speed would be unusual.

        It is also asked if another unit is as likely, unless there are other choices of units to ask for
        (``has_others``). ``chosen`` is a likely choice of units for the ``numbers``. None if there is
        nothing to ask; a range without a unit then gets the unit m.
        """
        names = [name for name in ("x", "y", "range", "1.range") if name in self._columns]
        is_named = not {"x", "range"}.isdisjoint(known_units)
        if chosen.as_angle or numbers.is_angle or not names or is_named or chosen.agrees:
            return None
        speed = chosen.usual_speed
        other_units: list[str] = []
        if is_usual_speed(speed) and not has_others:
            other_units = self._other_lengths(chosen, numbers)
        if not np.isfinite(speed) or (is_usual_speed(speed) and not other_units):
            # The config must have a unit of a range; x and y are in m without one.
            if names == ["range"]:
                self._units["range"] = "m"
                self._why["range"] = f"guess: no unit is named; {self._reason(chosen)}"
            return None
        # What is measured once an hour may well be slow; and azimuths of unknown unit tell no speed.
        seconds = 1.0 if numbers.dated else UNITS[chosen.time or "s"]
        if usual_interval(numbers.time[np.isfinite(numbers.time)]) * seconds >= _LONG_INTERVAL:
            return None
        largest_azimuth = 0.0
        if "azimuth" in self._columns and "azimuth" not in self._units:
            largest_azimuth = float(np.nanmax(np.abs(self._values("azimuth")), initial=0.0))
        if largest_azimuth > 360.0:
            return None
        fitting = [unit for unit in LENGTH_UNITS if is_usual_speed(speed * UNITS[unit])]
        fitting = other_units or fitting
        if not fitting:
            return None
        units = [*fitting, "m"]
        options = " ".join(f"--set units.{name}={units[0]}" for name in names)
        columns = ", ".join(self._columns[name] for name in names)
        message = f"{columns}: no unit is named, and in m the usual speed would be {speed:.2g} m/s"
        if other_units:
            message += f", in {units[0]} {speed * UNITS[units[0]]:.2g} m/s"
        way = f"say {options}, or with another unit: {', '.join(units[1:])}"
        if names == ["x", "y"] and look_like_degrees(numbers):
            x, y = (in_option(self._columns[name]) for name in names)
            way += f"; or in degrees, --set 'columns.longitude={x}' --set 'columns.latitude={y}'"
        return Place(self._sample.path, self._sample.line, 1, f"{message}: {way}")

    def _other_lengths(self, chosen: Candidate, numbers: Numbers) -> list[str]:
        """Return units that lengths without a named unit may have as well as m; empty for most tables.

        Something slow in m may be something fast in km, unless it turns as nothing fast can. Something
        fast that turns so in m is rather slow, in mm or cm. Names of ROS and of motion capture are in m.
        """
        speed = chosen.usual_speed
        words = {word for name in PLACE for word in words_of(self._columns.get(name, ""))}
        if not np.isfinite(speed) or (numbers.dated and "time" not in self._columns):
            return []
        acceleration = usual_acceleration(numbers, chosen)
        turns_slowly = acceleration * 1e3 <= _LARGEST_ACCELERATION
        if speed <= _FASTEST_IN_KM * 1e-3 and turns_slowly and words.isdisjoint(_NAMES_IN_M):
            return [unit for unit in ("km", "nmi", "mi") if is_usual_speed(speed * UNITS[unit])]
        if acceleration > _LARGEST_ACCELERATION and speed >= _FAST:
            return [unit for unit in ("mm", "cm") if is_usual_speed(speed * UNITS[unit])]
        return []

    def _numbers(self, sensor: SensorGuess) -> Numbers:
        """Return the numbers of the rows of one target and sensor, as `likely_units` compares them.

        The words in the names of all columns tell formats, such as AIS, and units.
        """
        # Step 1: choose the rows of the sensor, and those of the longest run.
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
        is_angle = False
        azimuth = None
        if sensor.kind == "range-azimuth":
            azimuth = self._azimuths()
            place = self._values("range") * np.stack([np.cos(azimuth), np.sin(azimuth)])
            named = ["range"]
        elif sensor.kind in ("bearing", "odometry") or sensor.kind.startswith("landmark"):
            place = np.empty((0, len(rows)))
            named = []
        elif sensor.kind == "range":
            named = list(sensor.quantities)
            place = np.stack([self._values(name) for name in named])
        else:
            is_angle = not {"x", "y"} <= columns.keys()
            named = ["longitude", "latitude"] if is_angle else ["x", "y"]
            place = np.stack([self._values(name) for name in named])
            if is_angle:
                place[:, no_fix(place[1], place[0], UNITS["deg"])] = np.nan
        # Step 3: read the speeds, and take only the chosen rows.
        speed = None
        if "speed" in columns:
            speed = self._values("speed")[rows]
        course = None
        if "course" in columns:
            course = self._values("course")[rows]
        velocity = None
        if columns.keys() >= {*VELOCITY}:
            velocity = np.stack([self._values(name)[rows] for name in VELOCITY])
        marks = frozenset("".join(words_of(name)) for name in sample.names)
        digits = [self._sample.decimals(columns[name]) for name in named]
        return Numbers(
            time=time[rows],
            dated=is_dated,
            place=place[:, rows],
            is_angle=is_angle,
            speed=speed,
            course=course,
            velocity=velocity,
            words=marks,
            least_digits=min(digits, default=0),
        )

    def _values(self, name: str) -> Array:
        """Parse a quantity's numbers, NaN where they are missing."""
        values = self._sample.numbers(self._columns[name])
        values[np.isin(values, self._with_missing.missing_numbers(name))] = np.nan
        return values

    def _azimuths(self) -> Array:
        """Return the azimuths (R,) in radians."""
        azimuth = self._values("azimuth")
        return azimuth * UNITS[self._unit_of_angles("azimuth", azimuth)]

    def _unit_of_angles(self, name: str, angles: Array) -> str:
        """Return the unit of a quantity's angles.

        If none is known, numbers beyond a turn are in degrees, and others in radians.
        """
        if name in self._units:
            return self._units[name]
        if (np.abs(angles) > _TURN).any():
            return "deg"
        return "rad"

    def _times(self) -> tuple[Array, bool]:
        """Return the times (R,) of the sample, and whether they need no unit.

        Dates are in seconds, and further parts of a time are added. Numbers of steps need no unit,
        either.
        """
        columns = self._columns
        sample = self._sample
        if "time" not in columns:
            return sample.numbers(columns["step"]), True
        cells = sample.cells(columns["time"])
        if self._clock.is_date:
            if "date" in columns and columns["time"] != columns["date"]:
                dates = sample.cells(columns["date"])
                cells = [f"{date} {time}" for date, time in zip(dates, cells, strict=True)]
            microseconds, _ = parse_cells(partial(instant, form=self._clock.form), cells)
            if np.isnan(microseconds).all():
                # The times are dates without those of the other column.
                microseconds, _ = parse_cells(instant, sample.cells(columns["time"]))
            seconds = microseconds / 1e6
        else:
            seconds = sample.numbers(columns["time"])
        return self._with_stamp_parts(seconds), self._clock.is_date

    def _with_stamp_parts(self, time: Array) -> Array:
        """Return the times (R,) with the week or the part of a second that a further column has.

        The column is added to the guessed ones.
        """
        columns = self._columns
        units = self._units
        clock = columns["time"]
        rest = rest_of_stamp(self._sample.names, clock, columns)
        unit = units.get("time")
        if "week" in rest and not self._clock.is_date and np.isfinite(time).any():
            column = rest["week"].column
            weeks = self._sample.numbers(column)
            largest = float(np.nanmax(time))
            if unit is None and largest <= _WEEK:
                unit = "s"
            elif unit is None and largest <= 1e3 * _WEEK:
                unit = "ms"
            # The clock's name says that it is a time of the week, or several weeks show it.
            is_known = not _TIME_OF_WEEK.isdisjoint(words_of(clock)) or np.ptp(weeks) > 0.0
            is_week = np.isfinite(weeks).all() and not (weeks % 1.0).any() and weeks.max() < 1e4
            if unit is not None and is_known and is_week and largest * UNITS[unit] <= _WEEK:
                columns["week"] = column
                if unit != "s":
                    units["time"] = unit
                    self._why["time"] = "guess: a week has 604800 s"
                return time + weeks * _WEEK / UNITS[unit]
        if "subsecond" in rest:
            column, part_unit = rest["subsecond"]
            part = self._sample.numbers(column) * UNITS[part_unit or "ns"]
            whole = np.isfinite(time).all() and not (time % 1.0).any() and unit in (None, "s")
            is_part = np.isfinite(part).all() and ((part >= 0.0) & (part < 1.0)).all()
            if whole and is_part and len(np.unique(time + part)) > len(np.unique(time)):
                columns["subsecond"] = column
                if part_unit not in (None, "ns"):
                    units["subsecond"] = str(part_unit)
                if not self._clock.is_date:
                    units["time"] = "s"
                self._why["subsecond"] = "guess: the part of a second"
                return time + part
        return time

    def _clocks(self) -> dict[str, tuple[float, float]]:
        """Return both possible forms of times, each with its factor and the points against it.

        Times such as 10:30 or 1030 are hours and minutes (the empty key), or minutes and seconds.
        Numbers from 1201 to 1259 may also be seconds.
        """
        cells = self._sample.cells(self._columns["time"])
        words = words_of(self._columns["time"])
        is_elapsed = not _ELAPSED.isdisjoint(words)
        if self._clock.other == "s":
            is_seconds = is_elapsed or not _SECONDS.isdisjoint(words)
            is_time_of_day = not _TIMES_OF_DAY.isdisjoint(words)
            as_clock, _ = self._times()
            as_numbers = self._sample.numbers(self._columns["time"])
            factor = usual_interval(as_numbers) / usual_interval(as_clock)
            # Of 100, 200 and 300 the interval of 100 s is unusual, and does not decide alone.
            return {"": (1.0, 0.5 + is_seconds), "s": (factor, 1.0 * is_time_of_day)}
        # 00:12 and 0012
        from_zero = bool(cells) and re.match(r"0+[:.,]|0*\d\d?$", cells[0]) is not None
        hours = 1.0 * is_elapsed + 0.5 * from_zero
        minutes = 0.0 if is_elapsed or from_zero else 1.0
        return {"": (1.0, hours), self._clock.other: (1.0 / 60.0, minutes)}

    def _known_units(self, sensor: SensorGuess) -> dict[str, str]:
        """Return the known units by quantity, with that of several columns of ranges as ``range``."""
        known = dict(self._units)
        if sensor.kind == "range":
            for name in sensor.quantities:
                if name in known:
                    known["range"] = known[name]
        return known

    def _write(self, chosen: Candidate, numbers: Numbers) -> None:
        """Add the chosen units to the columns that have none yet, with the reasons.

        ``numbers`` are those that were compared to choose them.
        """
        columns = self._columns
        units = self._units
        why = self._why
        reason = f"guess: {self._reason(chosen)}"
        if (
            "time" in columns
            and "time" not in units
            and chosen.time in UNITS
            and chosen.time != "s"
        ):
            units["time"] = chosen.time
            why["time"] = reason
        if chosen.as_angle and not numbers.is_angle:
            columns["longitude"] = columns.pop("x")
            columns["latitude"] = columns.pop("y")
            why["x"] = "x and y are a longitude and a latitude"
            units["longitude"] = units["latitude"] = chosen.place
            why["longitude"] = why["latitude"] = reason
        elif numbers.is_angle:
            for name in GEODETIC[:2]:
                if name not in units and chosen.place != "deg":
                    units[name] = chosen.place
                    why[name] = reason
        elif chosen.place != "m":
            for name in ("x", "y", "range"):
                if name in columns and name not in units:
                    units[name] = chosen.place
                    why[name] = reason
        names = VELOCITY if numbers.velocity is not None else ("speed",)
        for name in names:
            if name in columns and name not in units and chosen.speed and chosen.agrees:
                units[name] = chosen.speed
                why[name] = "guess: agrees with the positions"
        if "course" in columns and "course" not in units and chosen.course not in ("", "deg"):
            units["course"] = chosen.course
            why["course"] = "guess: the direction of the positions"

    def _reason(self, chosen: Candidate) -> str:
        """Explain in a comment of the config why these units were chosen."""
        if chosen.agrees:
            return "times, positions and speeds agree"
        if np.isfinite(chosen.usual_speed):
            return f"the usual speed is {chosen.usual_speed:.2g} m/s"
        return "as large as its numbers are"

    def _questions(self, candidates: list[Candidate], numbers: Numbers) -> list[Place]:
        """Return a question to the user: a line for each candidate, with the options that choose it."""
        columns = self._columns
        first = candidates[0]
        questions = []
        differ_in_time = any(candidate.time != first.time for candidate in candidates)
        differ_in_place = any(candidate.place != first.place for candidate in candidates)
        for candidate in candidates:
            options = []
            units = []
            if differ_in_time:
                clock = candidate.time or self._clock.form
                if clock in UNITS:
                    options.append(f"--set 'units.time={clock}'")
                else:
                    options.append(f"--set 'time_format={json.dumps(clock)}'")
                units.append(f"{columns['time']} in {clock}")
            if differ_in_place:
                names = ["latitude", "longitude"] if numbers.is_angle else ["x", "y"]
                if candidate.as_angle and not numbers.is_angle:
                    options.append(f"--set 'columns.longitude={columns['x']}'")
                    options.append(f"--set 'columns.latitude={columns['y']}'")
                else:
                    for name in names:
                        if name in columns:
                            options.append(f"--set units.{name}={candidate.place}")
                shown = ", ".join(columns[name] for name in names if name in columns)
                units.append(f"{shown} in {candidate.place}")
            message = f"the units may be {' and '.join(units)}"
            if np.isfinite(candidate.usual_speed):
                message += f", with a usual speed of {candidate.usual_speed:.2g} m/s"
            message += f": say {' '.join(options)}"
            questions.append(Place(self._sample.path, self._sample.line, 1, message))
        return questions
