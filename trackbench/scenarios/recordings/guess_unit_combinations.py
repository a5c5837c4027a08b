"""Guess of the units of times, positions and speeds together, by which of them agree."""

import json
from collections.abc import Mapping
from itertools import product
from types import MappingProxyType

import numpy as np

from trackbench.field_types import Place
from trackbench.scenarios.recordings.compare_courses_with_movement import best_course_unit
from trackbench.scenarios.recordings.guess_position_unit import (
    NAMES_IN_M,
    options_of_degrees,
    position_units,
)
from trackbench.scenarios.recordings.guess_record import ColumnByQuantity, UnitByQuantity
from trackbench.scenarios.recordings.guess_speed_unit import speed_units
from trackbench.scenarios.recordings.guess_table_sample import TableSample
from trackbench.scenarios.recordings.guess_time_unit import penalty_of_interval, time_units
from trackbench.scenarios.recordings.guess_times_of_day_in_digits import ClockFormat
from trackbench.scenarios.recordings.guess_usual_speed_and_acceleration import (
    Displacements,
    penalty_of_speed,
)
from trackbench.scenarios.recordings.quantity_keys import PLACE
from trackbench.scenarios.recordings.recognize_column_names import words_of
from trackbench.scenarios.recordings.rows_and_reading_context import usual_interval
from trackbench.scenarios.recordings.unit_names_and_sizes import UNITS
from trackbench.scenarios.recordings.unscaled_rows import (
    Candidate,
    PossibleFormat,
    UnscaledRows,
    positions_in_meters,
)

_MARGIN = 0.6
"""Candidates whose penalty is less than this above the least one remain possible."""
_STANDSTILL = 0.5
"""m/s that something may seem to have whose measured speed is 0"""

_INTERVALS_OF_MS = (10.0, 1000.0)
"""usual intervals of whole numbers that may be ms as well as s"""
_MOST_DECIMALS_OF_MM = 1
"""digits behind the point of positions that may be in mm"""


def likely_units(
    unscaled: UnscaledRows,
    known_units: Mapping[str, str],
    possible_formats: Mapping[str, PossibleFormat] = MappingProxyType({}),
) -> list[Candidate]:
    """Return the likeliest choices of units, the best first.

    These are the choices whose penalty is near the least one. ``known_units`` are units by quantity that
    need no guess. ``possible_formats`` are the possible formats of dates, if there are several.
    """
    candidates: list[Candidate] = []
    # Step 1: combine each unit of the position with each of the time, and then with those of the speed.
    combinations = product(
        position_units(unscaled, known_units), time_units(unscaled, known_units, possible_formats)
    )
    for of_position, of_time in combinations:
        position_unit, as_geodetic, position_penalty = of_position
        time_unit, seconds_per_unit, time_penalty = of_time
        meters = positions_in_meters(unscaled.position, position_unit, as_geodetic)
        displacements = Displacements.of_rows(unscaled.time * seconds_per_unit, meters)
        penalty = position_penalty + time_penalty
        # A target whose measured speed is always 0 seems to move by the errors of its positions alone.
        # The usual speed is NaN if nothing moves for sure: then neither comparison below is true.
        stands_still = (
            unscaled.speed is not None
            and bool(np.isfinite(unscaled.speed).any())
            and not np.nan_to_num(unscaled.speed).any()
        )
        if not (stands_still and displacements.usual_speed < _STANDSTILL):
            penalty += penalty_of_speed(displacements.usual_speed, as_geodetic)
        if stands_still and displacements.usual_speed >= _STANDSTILL:
            penalty += 1.0  # in these units the positions move, which the measured speed denies
        penalty += penalty_of_interval(unscaled.time * seconds_per_unit, as_geodetic)
        for speed_unit, speed_penalty, speed_agrees in speed_units(
            unscaled, known_units, displacements, as_geodetic
        ):
            course_unit, course_agrees = best_course_unit(
                unscaled, known_units, displacements, speed_agrees
            )
            candidates.append(
                Candidate(
                    time_unit=time_unit,
                    position_unit=position_unit,
                    as_geodetic=as_geodetic,
                    speed_unit=speed_unit,
                    course_unit=course_unit,
                    penalty=penalty + speed_penalty,
                    usual_speed=displacements.usual_speed,
                    speed_agrees=speed_agrees,
                    course_agrees=course_agrees,
                    seconds_per_unit=seconds_per_unit,
                )
            )
    # Step 2: keep the best of each unit of time and position. Without a measured speed that agrees, a
    # length is in m or in the known unit.
    candidates.sort(key=lambda candidate: candidate.penalty)
    best: dict[tuple[str, str], Candidate] = {}
    for candidate in candidates:
        is_length = not candidate.as_geodetic and candidate.position_unit not in (
            "m",
            *known_units.values(),
        )
        if candidate.speed_agrees or not is_length:
            best.setdefault(candidate.key, candidate)
    # Step 3: drop the choices that are clearly less likely than the best one.
    ranked = list(best.values())
    limit = ranked[0].penalty + _MARGIN
    return [candidate for candidate in ranked if candidate.penalty < limit]


def may_be_thousandths(
    columns: ColumnByQuantity,
    chosen: Candidate,
    unscaled: UnscaledRows,
    known_units: UnitByQuantity,
) -> bool:
    """Test whether x, y and times may be in mm and ms as well as in the ``chosen`` m and s.

    A measured speed in m/s agrees with both. Times in ms are whole numbers, and in s they would be
    ten seconds or more apart. Positions in mm have one digit behind the point at most.
    ``known_units`` are units by quantity.
    """
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
        and words.isdisjoint(NAMES_IN_M)
    )


def questions_on_units(
    sample: TableSample,
    columns: ColumnByQuantity,
    clock_format: ClockFormat,
    candidates: list[Candidate],
    unscaled: UnscaledRows,
) -> list[Place]:
    """Return a question to the user: a line for each candidate, with the options that choose it.

    ``unscaled`` are the rows whose units are asked for.
    """
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
            time_format = candidate.time_unit or clock_format.date_format
            if time_format in UNITS:
                options.append(f"--set 'units.time={time_format}'")
            else:
                options.append(f"--set 'time_format={json.dumps(time_format)}'")
            units.append(f"{columns['time']} in {time_format}")
        if differ_in_position:
            names = ["latitude", "longitude"] if unscaled.is_geodetic else ["x", "y"]
            if candidate.as_geodetic and not unscaled.is_geodetic:
                options.append(options_of_degrees(columns, unscaled))
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
        questions.append(Place(sample.path, sample.first_line, 1, message))
    return questions
