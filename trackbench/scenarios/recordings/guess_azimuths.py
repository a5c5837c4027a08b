"""Guess of the direction from which measured azimuths count, and the question if it is open."""

from collections.abc import Collection
from dataclasses import replace
from typing import Literal

import numpy as np

from trackbench.core.arrays import Array
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.compare_courses_with_movement import (
    LEAST_COSINE,
    directions_of_courses,
    median_cosine,
)
from trackbench.scenarios.recordings.guess_record import (
    ColumnByQuantity,
    Guess,
    ReasonByKey,
    SensorGuess,
    Track,
    UnitByQuantity,
)
from trackbench.scenarios.recordings.guess_sensors import ANGLES
from trackbench.scenarios.recordings.guess_table_sample import TableSample, numbers_of
from trackbench.scenarios.recordings.guess_usual_speed_and_acceleration import Displacements
from trackbench.scenarios.recordings.naming_of_columns import Naming
from trackbench.scenarios.recordings.quantity_keys import GEODETIC, PLACE
from trackbench.scenarios.recordings.recognize_column_names import words_of
from trackbench.scenarios.recordings.rows_and_reading_context import Rows
from trackbench.scenarios.recordings.unscaled_rows import (
    Candidate,
    UnscaledRows,
    positions_in_meters,
)
from trackbench.scenarios.recordings.yaml_values import in_option

Convention = Literal["named", "compass", "polar", "open"]
"""Azimuths count clockwise from north as the column's name says (named) or as numbers beyond 180 deg do
(compass), from x to y as polar coordinates do, or either way (open)."""
_NORTH = frozenset(("north", "true", "compass", "magnetic", "mag", "clockwise", "cw", "acp"))
_POLAR = frozenset(("theta", "phi", "angle"))
_FEWEST = 5
"""rows of a radar that are compared with other positions"""
_NEARER = 0.3
"""ratio of the distances from other positions of the right convention and of the wrong one"""

_MOST_TANGENTIAL = 20.0
"""ratio of the ways across and along the line of sight, beyond which azimuths may have another unit"""


def azimuths_of(
    quantities_by_sensor: list[tuple[str, ...]], rows_by_sensor: list[Rows]
) -> list[Array]:
    """Return the angles (R,) of each sensor that measures one, in the unit of the rows.

    An azimuth or bearing is the last quantity of its sensor. Sensors without one are left out.
    """
    azimuths = []
    for names, rows in zip(quantities_by_sensor, rows_by_sensor, strict=True):
        if names[-1] in ANGLES:
            azimuths.append(rows.values[-1])
    return azimuths


def settle_azimuths(guess: Guess, angles: list[Array], is_answered: bool) -> Guess:
    """Return the guess with the direction from which azimuths count, or with the question if it is open.

    ``angles`` (R,) are those of each sensor that measures one, rad. ``is_answered`` is True if the user
    has set the key ``clockwise``. The reason is added to those of the guess in place.
    """
    naming = guess.naming
    column = naming.columns.get("azimuth")
    if not angles or column is None or naming.clockwise:
        return guess
    if is_answered:
        guess.reasons["anticlockwise"] = "azimuths count from x to y"
        return guess
    convention = convention_of(column, naming.units.get("azimuth", ""), angles)
    # A name such as azimuth_true is sure; of other columns the positions of another sensor decide first.
    if guess.positions is not None and convention != "named":
        settled = with_azimuths_by_positions(
            guess, guess.positions, "the other sensor's positions show"
        )
        if settled is not None:
            return settled
    if convention == "polar":
        guess.reasons["anticlockwise"] = (
            "guess: azimuths count from x to y; of radars from north say `clockwise: [azimuth]`"
        )
        return guess
    if convention == "open":
        questions = [Place(guess.path, 1, 1, line) for line in question_on_azimuths(column)]
        return replace(guess, questions=questions)
    guess.reasons["clockwise"] = (
        "guess: from 0 to 360 deg, as of radars; leave it out if it counts from x to y"
    )
    if convention == "named":
        guess.reasons["clockwise"] = "as the column's name says: from north"
    return replace(guess, naming=replace(naming, clockwise=("azimuth",)))


def with_azimuths_by_positions(guess: Guess, positions: Track, reason: str) -> Guess | None:
    """Return the guess with azimuths that count as other positions show; None if these do not decide.

    ``positions`` are those of another sensor, another file or the truth, as ``reason`` says. The
    question from where azimuths count, the only one that a guess can have, is then answered.
    """
    if guess.radar is None:
        return None
    is_clockwise = is_clockwise_by_positions(guess.radar, positions)
    if is_clockwise is None:
        return None
    # `guess_files.settled` takes a reason for the key `clockwise` that begins with "as" for a sure one.
    # That for azimuths from x to y, for which there is no key, is only a comment in the config.
    reasons = {name: text for name, text in guess.reasons.items() if name != "clockwise"}
    if is_clockwise:
        reasons["clockwise"] = f"as {reason}"
    else:
        reasons["anticlockwise"] = f"azimuths count from x to y, as {reason}"
    clockwise = ("azimuth",) if is_clockwise else ()
    naming = replace(guess.naming, clockwise=clockwise)
    return replace(guess, naming=naming, reasons=reasons, questions=[])


def convention_of(column: str, unit: str, angles: list[Array]) -> Convention:
    """Return from where the azimuths of a column count, by its name, its unit and its numbers.

    The results are explained at `Convention`. ``unit`` is empty if none is known. ``angles`` (R,) are
    those of each sensor, in rad.
    """
    words = {*words_of(column)}
    if words & _NORTH:
        return "named"
    finite = np.concatenate([a[np.isfinite(a)] for a in angles])
    # From 0 to 360 deg, with some beyond 180 deg.
    is_compass = len(finite) > 0 and (finite >= 0.0).all() and finite.max() > np.pi
    # Radars and compasses write degrees; radians, or angles without a unit, named theta or phi are
    # rather polar coordinates as in mathematics. Anything else may count either way.
    if unit.startswith("deg") and is_compass:
        return "compass"
    if not unit.startswith("deg") and words & _POLAR:
        return "polar"
    return "open"


def is_clockwise_by_positions(radar: Track, positions: Track) -> bool | None:
    """Return whether a radar's azimuths count clockwise from north, as other positions show.

    Return None if they do not decide, and False if azimuths count from x to y. The ``positions`` have x
    to the east and y to the north. They may count from another point than the radar, so that only the
    shapes of both paths are compared.
    """
    # The times of dates, and other times, have no common origin.
    if radar.is_dated != positions.is_dated:
        return None
    order = np.argsort(positions.time, kind="stable")
    time = positions.time[order]
    known = (radar.time >= time[0]) & (radar.time <= time[-1])
    if known.sum() < _FEWEST:
        return None
    path = np.stack([np.interp(radar.time[known], time, axis[order]) for axis in positions.values])
    ranges, azimuths = radar.values[:, known]
    # Azimuths that count clockwise from north give the same positions with x and y exchanged.
    anticlockwise = ranges * np.stack([np.cos(azimuths), np.sin(azimuths)])
    clockwise = anticlockwise[::-1]
    distance_anticlockwise = _distance_of_shapes(anticlockwise, path)
    distance_clockwise = _distance_of_shapes(clockwise, path)
    if distance_anticlockwise < _NEARER * distance_clockwise:
        return False
    if distance_clockwise < _NEARER * distance_anticlockwise:
        return True
    return None


def _distance_of_shapes(measured: Array, path: Array) -> float:
    """Return the median distance of measured positions (2, R) from a path (2, R), without their offset.

    The offset is the median difference: it is the place of one origin relative to the other.
    """
    differences = measured - path
    differences = differences - np.median(differences, axis=1, keepdims=True)
    return float(np.median(np.hypot(*differences)))


def question_on_azimuths(column: str) -> list[str]:
    """Return the question from where the azimuths in a column count, as two lines with the answers."""
    return [
        f"{column}: do these angles count clockwise from north, as those of radars and compasses? "
        "Say --set 'clockwise=[azimuth]'",
        "or do they count from x to y, anticlockwise from east? Say --set 'clockwise=[]'",
    ]


def check_bearings(
    sample: TableSample,
    columns: ColumnByQuantity,
    user_columns: Collection[str],
    unscaled: UnscaledRows,
    chosen: Candidate,
    angles: Array,
) -> None:
    """Raise DataError for a bearing beside a position if it is not the direction of movement.

    It may then be the bearing of a target, measured from this position, as by a ship with a sonar. There
    is no error if the user named the columns of the position, which are then among ``user_columns``.
    ``angles`` (R,) are the bearings, rad, and the positions are those of the ``unscaled`` rows in the
    ``chosen`` units.
    """
    is_answered = not {*PLACE, *GEODETIC[:2]}.isdisjoint(user_columns)
    if is_answered or is_direction_of_movement(unscaled, chosen, angles):
        return
    bearing = columns["azimuth"]
    names = PLACE if columns.keys() >= {*PLACE} else GEODETIC[:2]
    places = " and ".join(columns[name] for name in names)
    message = f"{bearing} is not the direction in which {places} move: was it measured from there?"
    remedy = f"Say --set 'columns.azimuth={in_option(bearing)}'"
    remedy += ", and give the sensor this path (`platform`)"
    options = [f"--set 'columns.{name}={in_option(columns[name])}'" for name in names]
    option = f"if positions were measured, say {' '.join(options)}"
    raise DataError(Place(sample.path, sample.first_line, 1, f"{message} {remedy}; {option}"))


def is_direction_of_movement(unscaled: UnscaledRows, chosen: Candidate, angles: Array) -> bool:
    """Test whether angles (R,), rad, are the directions in which the positions move.

    The angles may count clockwise from north, or anticlockwise from x. The positions are those of the
    ``unscaled`` rows in the ``chosen`` units. True if nothing moves.
    """
    time = unscaled.time * chosen.seconds_per_unit
    meters = positions_in_meters(unscaled.position, chosen.position_unit, chosen.as_geodetic)
    displacements = Displacements.of_rows(time, meters)
    if not np.isfinite(displacements.usual_speed):
        return True
    # East and north of angles clockwise from north; exchanged, x and y of angles anticlockwise from x.
    along = directions_of_courses(angles)
    return (
        max(median_cosine(along, displacements), median_cosine(along[::-1], displacements))
        >= LEAST_COSINE
    )


def check_unit_of_azimuths(
    sample: TableSample,
    columns: ColumnByQuantity,
    units: UnitByQuantity,
    reasons: ReasonByKey,
    with_missing: Naming,
    sensors: list[SensorGuess],
) -> None:
    """Raise DataError if azimuths without a unit may be in radians as well as in degrees.

    Numbers within 2 pi are taken for radians, and the unit is added. But if the target then moves
    nearly always across the line of sight, they may rather be degrees. Nothing is added for any
    other table than that of a single radar, for numbers beyond 2 pi, and for fewer than three rows
    with both numbers: a unit that is missing in the end stands for radians.
    """
    is_radar = [sensor.kind for sensor in sensors] == ["range-azimuth"]
    if not is_radar or "azimuth" in units:
        return
    azimuth = numbers_of(sample, columns, with_missing, "azimuth")
    ranges = numbers_of(sample, columns, with_missing, "range")
    known = np.flatnonzero(np.isfinite(azimuth) & np.isfinite(ranges))
    azimuth = azimuth[known]
    # Numbers beyond 2 pi are degrees, which is added when all rows have been read.
    if len(known) < 3 or (np.abs(azimuth) > 2.0 * np.pi).any():
        return
    ranges = ranges[known]
    across = np.median(np.abs(np.diff(azimuth)) * ranges[1:])
    along = np.median(np.abs(np.diff(ranges)))
    if across > _MOST_TANGENTIAL * along:
        message = f"{columns['azimuth']}: no unit is named, and its numbers may be degrees"
        remedy = "say --set units.azimuth=deg or --set units.azimuth=rad"
        raise DataError(Place(sample.path, 1, 1, f"{message} or radians: {remedy}"))
    units["azimuth"] = "rad"
    reasons["azimuth"] = "guess: there is no angle beyond 2 pi"
