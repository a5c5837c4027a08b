"""Guess of the units of times, positions and speeds together, by which of them agree."""

from collections.abc import Mapping
from itertools import product
from types import MappingProxyType

import numpy as np

from trackbench.scenarios.recordings.directions_of_movement import best_course_unit
from trackbench.scenarios.recordings.guess_position_unit import (
    position_units,
)
from trackbench.scenarios.recordings.guess_speed_unit import speed_units
from trackbench.scenarios.recordings.guess_time_unit import penalty_of_interval, time_units
from trackbench.scenarios.recordings.guess_usual_speed_and_acceleration import (
    Displacements,
    penalty_of_speed,
)
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
