"""Questions on axes that are exchanged or mirrored, as velocities and courses show."""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.scenarios.recordings.unit_candidates import (
    SAME_WAY,
    Candidate,
    Moves,
    Numbers,
    in_meters,
    is_nearer,
    likely_units,
    median_cosine,
)
from trackbench.scenarios.recordings.units import UNITS


class Reflection(NamedTuple):
    """Change of a plane's axes: they may be exchanged, and then have other signs."""

    exchanged: bool
    sign_of_east: float
    sign_of_north: float


REFLECTIONS = (
    Reflection(True, 1.0, 1.0),
    Reflection(False, -1.0, 1.0),
    Reflection(False, 1.0, -1.0),
    Reflection(False, -1.0, -1.0),
    Reflection(True, -1.0, 1.0),
    Reflection(True, 1.0, -1.0),
    Reflection(True, -1.0, -1.0),
)
"""The symmetries of a square but the identity, the likeliest mistakes first."""


def agreeing_reflection(numbers: Numbers, known_units: Mapping[str, str]) -> Reflection | None:
    """Return the change of positions with which a measured speed and course agree; None without one."""
    points: dict[Reflection, float] = {}
    for change in REFLECTIONS:
        first = likely_units(replace(numbers, place=_changed(numbers.place, change)), known_units)[
            0
        ]
        if first.agrees and first.same_way:
            points[change] = first.points
    if not points:
        return None
    return min(points, key=lambda change: points[change])


def reflection_of_course(numbers: Numbers, chosen: Candidate, course: Array) -> Reflection | None:
    """Return the change of positions with which a course (R,), rad clockwise from north, agrees.

    None if the course agrees as the positions are, or with none of the changes. The positions are those
    of the ``numbers`` in the ``chosen`` units.
    """
    seconds = UNITS.get(chosen.time, 1.0)
    along = np.stack([np.sin(course), np.cos(course)])
    cosines: dict[Reflection, float] = {}
    unchanged = -1.0
    for change in (None, *REFLECTIONS):
        place = numbers.place
        if change is not None:
            place = _changed(place, change)
        meters = in_meters(place, chosen.place, chosen.as_angle)
        cosine = median_cosine(along, Moves.of_rows(numbers.time * seconds, meters))
        if change is None:
            unchanged = cosine
        else:
            cosines[change] = cosine
    best = max(cosines, key=lambda change: cosines[change])
    if cosines[best] < SAME_WAY or not is_nearer(cosines[best], unchanged):
        return None
    return best


def _changed(place: Array, change: Reflection) -> Array:
    """Return positions (2, R) with their axes exchanged and their signs changed."""
    east, north = place
    if change.exchanged:
        east, north = north, east
    return np.stack([change.sign_of_east * east, change.sign_of_north * north])


def is_direction_of_movement(numbers: Numbers, chosen: Candidate, angles: Array) -> bool:
    """Test whether angles (R,), rad clockwise from north or anticlockwise from x, are the movement's.

    The positions are those of the ``numbers`` in the ``chosen`` units. True if nothing moves.
    """
    seconds = UNITS.get(chosen.time, 1.0)
    meters = in_meters(numbers.place, chosen.place, chosen.as_angle)
    moves = Moves.of_rows(numbers.time * seconds, meters)
    if not np.isfinite(moves.usual_speed):
        return True
    along = np.stack([np.sin(angles), np.cos(angles)])
    return max(median_cosine(along, moves), median_cosine(along[::-1], moves)) >= SAME_WAY
