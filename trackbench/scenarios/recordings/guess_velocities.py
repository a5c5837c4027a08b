"""Agreement of velocities with positions: which component points north, and by what they disagree."""

from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np

from trackbench.scenarios.recordings.compare_courses_with_movement import (
    LEAST_COSINE,
    directions_of_courses,
)
from trackbench.scenarios.recordings.guess_record import (
    ColumnByQuantity,
    ReasonByKey,
    SensorGuess,
    UnitByQuantity,
)
from trackbench.scenarios.recordings.guess_signs_of_axes import agreeing_reflection
from trackbench.scenarios.recordings.guess_speed_unit import NEAR
from trackbench.scenarios.recordings.guess_table_sample import TableSample, numbers_of
from trackbench.scenarios.recordings.guess_unit_combinations import likely_units
from trackbench.scenarios.recordings.naming_of_columns import Naming
from trackbench.scenarios.recordings.quantity_keys import COURSE, GEODETIC, VELOCITY
from trackbench.scenarios.recordings.unit_names_and_sizes import UNITS
from trackbench.scenarios.recordings.unscaled_rows import (
    Candidate,
    PossibleFormat,
    UnscaledRows,
    positions_in_meters,
)
from trackbench.scenarios.recordings.velocity_check import velocity_note
from trackbench.scenarios.recordings.yaml_values import in_option

NO_NUMBERS = "they have no numbers"
"""reason against velocities of which no row is complete"""
_MIXED = "rows that lie apart are mixed, so that positions jump between them"
"""reason against velocities of rows that an empty name of runs or sensors mixes"""


def with_north_first(
    unscaled: UnscaledRows,
    known_units: UnitByQuantity,
    possible_formats: Mapping[str, PossibleFormat],
    columns: ColumnByQuantity,
    units: UnitByQuantity,
    reasons: ReasonByKey,
    user_columns: Collection[str],
) -> UnscaledRows:
    """Return the rows with vx and vy exchanged, if they agree with the positions only then.

    The ``columns`` of vx and vy, and their ``units``, are then exchanged in place, too, and the reason
    is added to ``reasons``. ``known_units`` are a copy of the units by quantity. A unit that only one of
    both has in its name is then that of both. ``possible_formats`` are the possible formats of dates.
    ``user_columns`` are the quantities whose columns the user named.
    """
    # A user who named the column of vx or vy has said which one it is.
    is_answered = not {*VELOCITY}.isdisjoint(user_columns)
    if is_answered or not _has_north_first(unscaled, known_units, possible_formats):
        return unscaled
    assert unscaled.velocity is not None
    columns["vx"], columns["vy"] = columns["vy"], columns["vx"]
    # `known_units` stay as they were before the exchange.
    for name, partner in (VELOCITY, VELOCITY[::-1]):
        if name in known_units:
            units[partner] = known_units[name]
    reasons["exchanged"] = f"{columns['vy']} points north, as the positions show"
    return replace(unscaled, velocity=unscaled.velocity[::-1])


def _has_north_first(
    unscaled: UnscaledRows,
    known_units: Mapping[str, str],
    possible_formats: Mapping[str, PossibleFormat],
) -> bool:
    """Test whether vx and vy agree with latitudes and longitudes only if they are exchanged.

    Autopilots name the velocity to the north vx, where trackbench expects the one to the east.
    ``known_units`` are units by quantity, ``possible_formats`` the possible formats of dates.
    """
    first = likely_units(unscaled, known_units, possible_formats)[0]
    if (first.speed_agrees and first.course_agrees) or unscaled.velocity is None:
        return False
    exchanged = replace(unscaled, velocity=unscaled.velocity[::-1])
    other = likely_units(exchanged, known_units, possible_formats)[0]
    if not (other.speed_agrees and other.course_agrees):
        return False
    # If the velocity agrees with mirrored positions in the same unit, their axes are wrong, and not
    # those of the velocity.
    units = {**known_units, **dict.fromkeys(GEODETIC[:2], other.position_unit)}
    return agreeing_reflection(unscaled, units, possible_formats) is None


def explain_disagreement(unscaled: UnscaledRows, chosen: Candidate, course_unit: str) -> str:
    """Explain by what a measured velocity disagrees with the positions in the ``chosen`` units.

    Without a known unit the speed counts in m/s. ``course_unit`` is the unit of a course.
    """
    velocity = unscaled.velocity
    if velocity is None:
        assert unscaled.speed is not None
        assert unscaled.course is not None
        course = unscaled.course * UNITS[course_unit]
        velocity = unscaled.speed * directions_of_courses(course)
    if not np.isfinite(velocity).all(axis=0).any():
        return NO_NUMBERS
    if not np.isfinite(chosen.usual_speed):
        return "the positions move too little beside their errors to show whether they agree"
    meters = positions_in_meters(unscaled.position, chosen.position_unit, chosen.as_geodetic)
    notes = velocity_note(
        "they",
        unscaled.time * chosen.seconds_per_unit,
        meters,
        velocity * UNITS[chosen.speed_unit or "m/s"],
        largest_ratio=1.0 + NEAR,
        least_cosine=LEAST_COSINE,
    )
    return notes[0] if notes else "they disagree with the positions"


def settle_velocity(
    sample: TableSample,
    columns: ColumnByQuantity,
    units: UnitByQuantity,
    reasons: ReasonByKey,
    with_missing: Naming,
    user_columns: Collection[str],
    course_unit: str,
    sensor: SensorGuess,
    unscaled: UnscaledRows,
    chosen: Candidate,
) -> None:
    """Remove the columns of a velocity that disagrees with the positions; add a note with the reason.

    The reason alone is added, too, for `blame_mixed_rows`. The columns remain if the user named one of
    them and the velocity has numbers. The positions of the ``sensor`` are those of the ``unscaled`` rows
    in the ``chosen`` units. ``course_unit`` is the unit of a course, ``user_columns`` are the quantities
    whose columns the user named, and ``with_missing`` has the numbers that stand for missing cells.
    """
    names = [name for name in (*COURSE, *VELOCITY) if name in columns]
    reason = explain_disagreement(unscaled, chosen, course_unit)
    reasons["disagreement"] = reason
    is_empty = reason == NO_NUMBERS
    if not is_empty and not {*names}.isdisjoint(user_columns):
        reasons["velocity"] = f"velocities are used, as you named them; but {reason}"
        return
    remedy = ""
    if not is_empty:
        options = (f"--set 'columns.{name}={in_option(columns[name])}'" for name in names)
        remedy = f"; to use them all the same: {' '.join(options)}"
    elif sensor.name and all(
        np.isfinite(numbers_of(sample, columns, with_missing, name)).any() for name in names
    ):
        reason += f" in rows whose {columns['sensor']} is {sensor.name}"
        remedy = "; if this column names no sensors: --set 'columns.sensor=\"\"'"
    for name in names:
        columns.pop(name)
        units.pop(name, None)
    reasons["velocity"] = f"velocities are left out: {reason}{remedy}"


def blame_mixed_rows(reasons: ReasonByKey) -> None:
    """Give mixed rows as the reason in the note on a velocity that disagrees with the positions.

    ``reasons`` are changed in place. A note on a velocity without numbers stays.
    """
    reason = reasons.get("disagreement", NO_NUMBERS)
    if reason != NO_NUMBERS:
        reasons["velocity"] = reasons["velocity"].replace(reason, _MIXED)
