"""Guess of the units of times, positions and speeds together, by which of them agree."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from types import MappingProxyType

import numpy as np

from trackbench.scenarios.recordings.directions_of_movement import best_course_unit
from trackbench.scenarios.recordings.guess_position_unit import (
    position_units,
)
from trackbench.scenarios.recordings.guess_speed_unit import penalty_of_speed, speed_units
from trackbench.scenarios.recordings.guess_time_unit import penalty_of_interval, time_units
from trackbench.scenarios.recordings.unscaled_rows import (
    MANY_STEPS,
    Displacements,
    PossibleFormat,
    UnscaledRows,
    positions_in_meters,
)

_MARGIN = 0.6
"""Candidates whose penalty is less than this above the least one remain possible."""
_STANDSTILL = 0.5
"""m/s that something may seem to have whose measured speed is 0"""


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """One choice of units for a table; empty texts stand for quantities without a unit."""

    time_unit: str
    """unit of numbers; of dates their format, which is empty for the format already known"""
    position_unit: str
    as_geodetic: bool
    """True if positions are read as longitude and latitude"""
    speed_unit: str
    course_unit: str
    penalty: float
    """how unlikely the choice is: the least penalty is best"""
    usual_speed: float
    """median speed of the positions in these units, m/s"""
    speed_agrees: bool
    """True if a measured speed is that of the positions"""
    course_agrees: bool
    """True if a measured course, or velocity, has the direction in which the positions change"""
    seconds_per_unit: float = 1.0
    """factor from the times as they were read to seconds, such as 1/60 for min:s read as h:min"""

    @property
    def key(self) -> tuple[str, str]:
        """Units of time and position: of several candidates with these only the best one is kept."""
        return self.time_unit, self.position_unit


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


def usual_acceleration(unscaled: UnscaledRows, chosen: Candidate) -> float:
    """Return the upper quartile of the target's acceleration, m/s^2, less what errors may explain.

    It is 0 if nothing moves for sure, or if errors of the positions explain all of it. The positions are
    those of the ``unscaled`` rows in the ``chosen`` units. Displacements of three lengths are tried: at
    least 100, 400 and 1600 standard deviations of a position's error, unless a quarter of the rows has
    no such displacements. The largest acceleration is returned: errors of positions hide the
    acceleration of short displacements, and a path turns too often within long ones.
    """
    time = unscaled.time * chosen.seconds_per_unit
    meters = positions_in_meters(unscaled.position, chosen.position_unit, chosen.as_geodetic)
    largest = 0.0
    for times_as_long in (5.0, 20.0, 80.0):  # as those of `likely_units`
        displacements = Displacements.of_rows(time, meters, times_as_long * MANY_STEPS)
        if np.isfinite(displacements.usual_speed):
            # Displacements refer to rows by their indices in the table, whose number it takes.
            largest = max(largest, _sure_acceleration(displacements, rows=len(unscaled.time)))
    return largest


def _sure_acceleration(displacements: "Displacements", rows: int) -> float:
    """Return the upper quartile of the acceleration, m/s^2, less two standard deviations of its error.

    It is 0 if this is negative. ``displacements`` are those between some of the table's rows, whose
    number is ``rows``.
    """
    velocities = displacements.vectors / displacements.duration
    # Pairs of displacements: the second one begins in the row in which the first one ends.
    number_from_row = np.full(rows, -1)  # number of the displacement that begins in a row
    number_from_row[displacements.first_row] = np.arange(len(displacements.first_row))
    second = number_from_row[displacements.last_row]
    first = np.flatnonzero(second >= 0)
    second = second[first]
    if not len(second):
        return 0.0
    # a = (v_2 - v_1) / t, where t is the time between the middles of both displacements
    changes = np.hypot.reduce(velocities[:, second] - velocities[:, first])
    interval = 0.5 * (displacements.duration[second] + displacements.duration[first])
    # (z_2 - 2 z_1 + z_0) / t^2 has the standard deviation sqrt(6) sigma / t^2.
    error = np.sqrt(6.0) * displacements.sigma / float(np.median(interval)) ** 2
    return max(float(np.quantile(changes / interval, 0.75)) - 2.0 * error, 0.0)
