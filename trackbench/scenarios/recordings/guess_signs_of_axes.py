"""Questions on axes that are exchanged or mirrored, as velocities and courses show."""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.compare_courses_with_movement import (
    LEAST_COSINE,
    directions_of_courses,
    is_nearer,
    median_cosine,
)
from trackbench.scenarios.recordings.guess_record import ColumnByQuantity
from trackbench.scenarios.recordings.guess_table_sample import TableSample
from trackbench.scenarios.recordings.guess_unit_combinations import likely_units
from trackbench.scenarios.recordings.guess_usual_speed_and_acceleration import Displacements
from trackbench.scenarios.recordings.quantity_keys import COURSE, PLACE, VELOCITY
from trackbench.scenarios.recordings.recognize_column_names import words_of
from trackbench.scenarios.recordings.unscaled_rows import (
    Candidate,
    PossibleFormat,
    UnscaledRows,
    positions_in_meters,
)
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


def check_velocity(
    sample: TableSample,
    columns: ColumnByQuantity,
    unscaled: UnscaledRows,
    known_units: Mapping[str, str],
    possible_formats: Mapping[str, PossibleFormat],
) -> None:
    """Raise DataError if a measured velocity agrees with exchanged or mirrored positions.

    The caller has found that it disagrees with the positions as they are. ``known_units`` are units by
    quantity, ``possible_formats`` the possible formats of dates.
    """
    change = agreeing_reflection(unscaled, known_units, possible_formats)
    if change is not None:
        velocity = [name for name in (*COURSE, *VELOCITY) if name in columns]
        raise DataError(_question_on_axes(sample, columns, change, velocity))


def check_course(
    sample: TableSample,
    columns: ColumnByQuantity,
    unscaled: UnscaledRows,
    chosen: Candidate,
    course: Array,
) -> None:
    """Raise DataError if a course agrees only with exchanged or mirrored positions.

    The caller checks a course beside a speed by `check_velocity`, and only one without a speed here. A
    column named as a heading beside x and y is not checked: it may count from x. ``course`` (R,) is in
    rad clockwise from north, and the positions are those of the ``unscaled`` rows in the ``chosen``
    units.
    """
    if not _HEADINGS.isdisjoint(words_of(columns["course"])) and not unscaled.is_geodetic:
        return
    change = reflection_of_course(unscaled, chosen, course)
    if change is not None:
        raise DataError(_question_on_axes(sample, columns, change, ["course"]))


def _question_on_axes(
    sample: TableSample, columns: ColumnByQuantity, change: Reflection, velocity: list[str]
) -> Place:
    """Return the question which of positions and velocities are right.

    They agree only after the ``change`` of the positions. ``velocity`` are the measured quantities of
    the velocity, such as speed and course.
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
        remedy = f"say {options}"
        if names == PLACE:
            remedy = f"if {east} points north and {north} east, {remedy}"
    elif change.exchanged:
        message = f"{measured} {agree} with {first} and {second} only after a quarter turn"
        remedy = f"turn the axes, so that {names[0]} is positive to the east"
        remedy += f" and {names[1]} to the north"
    elif signs == (-1.0, -1.0):
        message = f"{measured} {agree} with {first} and {second} only in the opposite direction"
        remedy = "correct the signs, or turn the directions by 180 deg"
    else:
        is_east = change.sign_of_east < 0.0
        column = east if is_east else north
        message = f"{column} agrees with {measured} only with the opposite sign"
        direction = "west" if is_east else "south"
        remedy = f"write degrees to the {direction} as negative numbers"
        if names == PLACE:
            remedy = f"change its sign, so that it is positive to the {positive[not is_east]}"
    if names == PLACE:
        remedy += f"; if {measured} counted otherwise, convert them"
    message = (
        f"{message}: {remedy}, or leave {'it' if len(velocity) == 1 else 'the velocities'} out"
    )
    return Place(sample.path, sample.first_line, 1, f"{message}, {leave_out}")


def agreeing_reflection(
    unscaled: UnscaledRows,
    known_units: Mapping[str, str],
    possible_formats: Mapping[str, PossibleFormat],
) -> Reflection | None:
    """Return the change of positions with which a measured velocity agrees best; None without one.

    ``known_units`` are units by quantity, ``possible_formats`` the possible formats of dates.
    """
    penalties: dict[Reflection, float] = {}
    for change in REFLECTIONS:
        changed = replace(unscaled, position=_changed(unscaled.position, change))
        first = likely_units(changed, known_units, possible_formats)[0]
        if first.speed_agrees and first.course_agrees:
            penalties[change] = first.penalty
    if not penalties:
        return None
    return min(penalties, key=lambda change: penalties[change])


def reflection_of_course(
    unscaled: UnscaledRows, chosen: Candidate, course: Array
) -> Reflection | None:
    """Return the change of positions with which a course (R,), rad clockwise from north, agrees.

    None if the course agrees as the positions are, or with none of the changes. The positions are those
    of the ``unscaled`` rows in the ``chosen`` units.
    """
    time = unscaled.time * chosen.seconds_per_unit
    along = directions_of_courses(course)
    cosines: dict[Reflection, float] = {}
    unchanged = -1.0
    for change in (None, *REFLECTIONS):
        position = unscaled.position
        if change is not None:
            position = _changed(position, change)
        meters = positions_in_meters(position, chosen.position_unit, chosen.as_geodetic)
        cosine = median_cosine(along, Displacements.of_rows(time, meters))
        if change is None:
            unchanged = cosine
        else:
            cosines[change] = cosine
    best = max(cosines, key=lambda change: cosines[change])
    if cosines[best] < LEAST_COSINE or not is_nearer(cosines[best], unchanged):
        return None
    return best


def _changed(position: Array, change: Reflection) -> Array:
    """Return positions (2, R) with the ``change``: axes exchanged first, and then other signs."""
    east, north = position
    if change.exchanged:
        east, north = north, east
    return np.stack([change.sign_of_east * east, change.sign_of_north * north])
