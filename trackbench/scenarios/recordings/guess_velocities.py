"""Guess which of two columns of a velocity points east, and which north."""

from collections.abc import Collection, Mapping
from dataclasses import replace

from trackbench.scenarios.recordings.combinations_of_units import likely_units
from trackbench.scenarios.recordings.guess_record import (
    ColumnByQuantity,
    ReasonByKey,
    UnitByQuantity,
)
from trackbench.scenarios.recordings.guess_signs_of_axes import agreeing_reflection
from trackbench.scenarios.recordings.quantities import VELOCITY
from trackbench.scenarios.recordings.unscaled_rows import PossibleFormat, UnscaledRows


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
    # If the velocity agrees with mirrored positions, their axes are wrong, and not those of the
    # velocity.
    return (
        other.speed_agrees
        and other.course_agrees
        and agreeing_reflection(unscaled, known_units, possible_formats) is None
    )
