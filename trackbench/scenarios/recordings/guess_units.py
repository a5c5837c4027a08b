"""Choice of the units of a table: the rows that show them, the order of the guesses, the result."""

from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.guess_azimuths import check_bearings
from trackbench.scenarios.recordings.guess_position_unit import question_on_length
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
from trackbench.scenarios.recordings.guess_table_sample import TableSample, numbers_of
from trackbench.scenarios.recordings.guess_time_format import possible_formats_of_times
from trackbench.scenarios.recordings.guess_times_of_day_in_digits import ClockFormat
from trackbench.scenarios.recordings.guess_times_of_sample import times_of_sample
from trackbench.scenarios.recordings.guess_unit_combinations import (
    likely_units,
    may_be_thousandths,
    questions_on_units,
)
from trackbench.scenarios.recordings.guess_velocities import (
    settle_velocity,
    with_north_first,
)
from trackbench.scenarios.recordings.naming_of_columns import Naming
from trackbench.scenarios.recordings.outliers_and_no_fix import no_fix
from trackbench.scenarios.recordings.quantity_keys import (
    COURSE,
    GEODETIC,
    ODOMETRY,
    PLACE,
    VELOCITY,
    plain_name,
)
from trackbench.scenarios.recordings.recognize_column_names import other_unit_of, words_of
from trackbench.scenarios.recordings.rows_and_reading_context import (
    values_of_nearest_rows,
)
from trackbench.scenarios.recordings.unit_names_and_sizes import OTHER_TIME_UNITS, UNITS, usual_unit
from trackbench.scenarios.recordings.unscaled_rows import Candidate, PossibleFormat, UnscaledRows

_TURN = 2.0 * np.pi


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
            possible_formats = possible_formats_of_times(
                self._sample, self._columns, self._units, self._reasons, self._clock_format
            )
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
        if not others and may_be_thousandths(self._columns, first, unscaled, known_units):
            others = [replace(first, time_unit="ms", position_unit="mm")]
        self._check_axes(sensor, unscaled, first, known_units, possible_formats, has_velocity)
        # Step 2: report what remains open.
        questions = []
        if others:
            questions = questions_on_units(
                self._sample, self._columns, self._clock_format, [first, *others], unscaled
            )
        # The answer to one question on lengths settles their unit, whichever candidate is right.
        for candidate in (first, *others):
            question = question_on_length(
                self._sample,
                self._columns,
                self._units,
                self._reasons,
                self._with_missing,
                candidate,
                unscaled,
                known_units,
                bool(others),
            )
            if question is not None:
                questions.append(question)
                break
        if questions:
            raise DataError(*questions)
        # Step 3: write the best candidate into columns and units.
        self._write_units(first, unscaled)
        if has_velocity and not first.course_agrees:
            course_unit = "deg"
            if unscaled.course is not None:
                course_unit = self._unit_of_angles("course", unscaled.course)
            settle_velocity(
                self._sample,
                self._columns,
                self._units,
                self._reasons,
                self._with_missing,
                self._user_columns,
                course_unit,
                sensor,
                unscaled,
                first,
            )
        # Step 4: return the chosen one of two formats of dates. If it is the guessed one, which is empty
        # here, the clock's format stays as it is.
        if first.time_unit in possible_formats and first.time_unit:
            if first.time_unit == "s":
                return ClockFormat()  # the times are numbers of seconds
            self._reasons["time_format"] = f"guess: {first.explanation}"
            return self._clock_format._replace(date_format=first.time_unit)
        return self._clock_format

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
        time, is_dated = times_of_sample(
            sample, columns, self._units, self._reasons, self._clock_format
        )
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
        """Parse the numbers (R,) of the quantity ``name``, NaN where they are missing."""
        return numbers_of(self._sample, self._columns, self._with_missing, name)

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
        reason = f"guess: {chosen.explanation}"
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
