"""Questions on axes that are exchanged or mirrored, as velocities and courses show."""

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.column_names import words_of
from trackbench.scenarios.recordings.guess_record import ColumnByQuantity
from trackbench.scenarios.recordings.quantities import COURSE, GEODETIC, PLACE, VELOCITY
from trackbench.scenarios.recordings.table_sample import Sample
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
from trackbench.scenarios.recordings.yaml_values import in_option

_HEADINGS = frozenset(("heading", "hdg", "headmot", "direction", "bearing"))
"""Words of columns that may have the direction in which a vehicle points."""


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


def check_bearings(
    sample: Sample,
    columns: ColumnByQuantity,
    user_columns: Collection[str],
    numbers: Numbers,
    chosen: Candidate,
    angles: Array,
) -> None:
    """Raise DataError for a bearing beside a position if it is not the direction of movement.

    It may then be measured from there, as by a ship with a sonar. It is no question if the user named
    the columns of the position, among ``user_columns``. ``angles`` (R,) are the bearings, rad, and the
    positions are those of the ``numbers`` in the ``chosen`` units.
    """
    is_answered = not {*PLACE, *GEODETIC[:2]}.isdisjoint(user_columns)
    if is_answered or is_direction_of_movement(numbers, chosen, angles):
        return
    bearing = columns["azimuth"]
    names = PLACE if columns.keys() >= {*PLACE} else GEODETIC[:2]
    places = " and ".join(columns[name] for name in names)
    message = f"{bearing} is not the direction in which {places} move: was it measured from there?"
    way = f"Say --set 'columns.azimuth={in_option(bearing)}'"
    way += ", and give the sensor this path (`platform`)"
    options = [f"--set 'columns.{name}={in_option(columns[name])}'" for name in names]
    option = f"if positions were measured, say {' '.join(options)}"
    raise DataError(Place(sample.path, sample.line, 1, f"{message} {way}; {option}"))


def has_north_first(
    numbers: Numbers, known_units: Mapping[str, str], clocks: Mapping[str, tuple[float, float]]
) -> bool:
    """Test whether vx and vy are the movement's only if they are exchanged.

    Autopilots name the velocity to the north vx. Latitudes and longitudes leave no doubt of axes.
    ``clocks`` are possible forms of dates.
    """
    first = likely_units(numbers, known_units, clocks)[0]
    if (first.agrees and first.same_way) or numbers.velocity is None:
        return False
    exchanged = replace(numbers, velocity=numbers.velocity[::-1])
    other = likely_units(exchanged, known_units, clocks)[0]
    return other.agrees and other.same_way and agreeing_reflection(numbers, known_units) is None


def check_velocity(
    sample: Sample, columns: ColumnByQuantity, numbers: Numbers, known_units: Mapping[str, str]
) -> None:
    """Raise DataError if a speed and course agree with exchanged or mirrored positions alone."""
    change = agreeing_reflection(numbers, known_units)
    if change is not None:
        velocity = [name for name in (*COURSE, *VELOCITY) if name in columns]
        raise DataError(_question_on_axes(sample, columns, change, velocity))


def check_course(
    sample: Sample, columns: ColumnByQuantity, numbers: Numbers, chosen: Candidate, course: Array
) -> None:
    """Raise DataError if a course without a speed is the direction of changed positions alone.

    The heading of a vehicle is no course: it may count from x, and is not read without a speed.
    ``course`` (R,) is in rad, and the positions are those of the ``numbers`` in the ``chosen`` units.
    """
    if not _HEADINGS.isdisjoint(words_of(columns["course"])) and not numbers.is_angle:
        return
    change = reflection_of_course(numbers, chosen, course)
    if change is not None:
        raise DataError(_question_on_axes(sample, columns, change, ["course"]))


def _question_on_axes(
    sample: Sample, columns: ColumnByQuantity, change: Reflection, velocity: list[str]
) -> Place:
    """Ask which of positions and velocities are right, if they agree only after a change.

    ``velocity`` are the quantities of the velocity.
    """
    names = ("longitude", "latitude")
    positive = ("east", "north")
    if {*PLACE} <= columns.keys():
        names = PLACE
    east, north = (columns[name] for name in names)
    first, second = sorted((east, north), key=sample.names.index)
    measured = " and ".join(columns[name] for name in velocity)
    agree = "agrees" if len(velocity) == 1 else "agree"
    leave_out = " ".join(f"--set 'columns.{name}=\"\"'" for name in velocity)
    signs = (change.sign_of_east, change.sign_of_north)
    if change.exchanged and signs == (1.0, 1.0):
        message = f"{first} and {second} agree with {measured} only if they are exchanged"
        options = f"--set 'columns.{names[0]}={in_option(north)}'"
        options += f" --set 'columns.{names[1]}={in_option(east)}'"
        way = f"say {options}"
        if names == PLACE:
            way = f"if {east} points north and {north} east, {way}"
    elif change.exchanged:
        message = f"{measured} {agree} with {first} and {second} only after a quarter turn"
        way = f"turn the axes, so that {names[0]} is positive to the east"
        way += f" and {names[1]} to the north"
    elif signs == (-1.0, -1.0):
        message = f"{measured} {agree} with {first} and {second} only in the opposite direction"
        way = "correct the signs, or turn the directions by 180 deg"
    else:
        is_east = change.sign_of_east < 0.0
        column = east if is_east else north
        message = f"{column} agrees with {measured} only with the opposite sign"
        direction = "west" if is_east else "south"
        way = f"write degrees to the {direction} as negative numbers"
        if names == PLACE:
            way = f"change its sign, so that it is positive to the {positive[not is_east]}"
    if names == PLACE:
        way += f"; if {measured} counted otherwise, convert them"
    message = f"{message}: {way}, or leave {'it' if len(velocity) == 1 else 'the velocities'} out"
    return Place(sample.path, sample.line, 1, f"{message}, {leave_out}")


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
