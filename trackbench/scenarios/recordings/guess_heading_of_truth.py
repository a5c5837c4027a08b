"""Guess of the heading of a robot's truth: its column or quaternion, its unit and its direction."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.compare_courses_with_movement import (
    LEAST_COSINE,
    is_nearer,
    median_cosine,
)
from trackbench.scenarios.recordings.csv_layout_and_rows import TextFormat
from trackbench.scenarios.recordings.guess_record import Guess
from trackbench.scenarios.recordings.guess_table_sample import TableSample
from trackbench.scenarios.recordings.guess_usual_speed_and_acceleration import Displacements
from trackbench.scenarios.recordings.naming_of_columns import Naming
from trackbench.scenarios.recordings.odometry_columns import heading_of
from trackbench.scenarios.recordings.parse_tables import header
from trackbench.scenarios.recordings.quantity_keys import PLACE, QUATERNION
from trackbench.scenarios.recordings.quaternions import (
    Quaternions,
    check_meaning_of_quaternions,
    quaternion_of,
)
from trackbench.scenarios.recordings.recognize_column_names import NamedColumn, shown_names, unit_of
from trackbench.scenarios.recordings.unit_names_and_sizes import DIMENSIONS, UNITS

HEADING_KEYS = ("heading", *QUATERNION)
"""keys of `columns` that only the truth of a robot has"""


def without_heading(path: str, user_naming: Naming) -> Naming:
    """Return the user's naming without the keys on a heading.

    Raises DataError if the file at ``path`` lacks the column that the user named, and for a unit that is
    none of angles.
    """
    unit = user_naming.units.get("heading")
    angles = DIMENSIONS["angle"]
    if unit is not None and unit not in angles:
        message = f"units.heading: {unit} is not one of {', '.join(angles)}"
        raise DataError(Place(path, 1, 1, message))
    names = header(path, user_naming.format)
    for key in HEADING_KEYS:
        column = user_naming.columns.get(key)
        if column and column not in names:
            message = f"no column {column}, which columns.{key} names"
            raise DataError(Place(path, 1, 1, f"{message}; there are {shown_names(names)}"))
    columns = {name: each for name, each in user_naming.columns.items() if name not in HEADING_KEYS}
    units = {name: unit for name, unit in user_naming.units.items() if name != "heading"}
    clockwise = user_naming.clockwise
    if clockwise is not None:
        clockwise = tuple(name for name in clockwise if name != "heading")
    return replace(user_naming, columns=columns, units=units, clockwise=clockwise)


def _heading_of_truth(names: Sequence[str], user_naming: Naming) -> NamedColumn | None:
    """Return the column of a robot's heading, with its unit if it is known; None without a column.

    The column and the unit that the user named come first, and otherwise the ``names`` of the columns
    say them.
    """
    heading = heading_of(names)
    column = user_naming.columns.get("heading")
    if column:
        heading = heading_of([column]) or NamedColumn(column=column, unit=unit_of(column, "course"))
    unit = user_naming.units.get("heading")
    if heading is not None and unit is not None:
        heading = heading._replace(unit=unit)
    return heading


class HeadingGuess(NamedTuple):
    """Keys of a truth's naming on its heading; all are empty if the truth has none."""

    columns: Mapping[str, str] = {}
    """its column, or those of a quaternion"""
    units: Mapping[str, str] = {}
    is_compass: bool = False
    """True if it counts clockwise from north"""


def guess_heading(path: str, table_guess: Guess, user_naming: Naming) -> HeadingGuess:
    """Guess the heading of a robot's truth: a column of it, or the four columns of a quaternion.

    ``table_guess`` is the guess at the table of the truth at ``path``. Keys that are set in
    ``user_naming`` are not guessed.
    """
    if user_naming.columns.get("heading") == "":
        return HeadingGuess(columns={"heading": ""})  # the user's answer that there is none
    sample = TableSample(path, table_guess.names, table_guess.naming.format or TextFormat())
    answers = {name: column for name, column in user_naming.columns.items() if name in QUATERNION}
    heading = _heading_of_truth(table_guess.names, user_naming)
    if heading is not None and not answers:
        numbers = sample.numbers(heading.column)
        reading = _reading_of_heading(sample, table_guess, numbers, heading.unit)
        return HeadingGuess(
            columns={"heading": heading.column},
            units={"heading": reading.unit},
            is_compass=reading.is_compass,
        )
    columns = {**quaternion_of(table_guess.names), **answers}
    missing = [name for name in QUATERNION if not columns.get(name)]
    if missing and answers:
        options = " ".join(f"--set columns.{name}=NAME" for name in missing)
        message = f"a quaternion has four columns: name the others, too, {options}"
        raise DataError(Place(path, 1, 1, message))
    if missing:
        return HeadingGuess()
    if "heading" in user_naming.units:
        message = "a heading from a quaternion has no unit: leave units.heading out"
        raise DataError(Place(path, 1, 1, message))
    x, y, z, w = (sample.numbers(columns[name]) for name in QUATERNION)
    quaternions = Quaternions(x=x, y=y, z=z, w=w)
    if not answers:
        check_meaning_of_quaternions(path, quaternions, columns)
    numbers = np.where(quaternions.is_unit, quaternions.heading, np.nan)
    reading = _reading_of_heading(sample, table_guess, numbers, "rad")
    return HeadingGuess(columns=columns, is_compass=reading.is_compass)


class _HeadingReading(NamedTuple):
    """Unit of a truth's headings, and whether they count clockwise from north."""

    unit: str
    is_compass: bool = False


def _reading_of_heading(
    sample: TableSample, table_guess: Guess, numbers: Array, known_unit: str | None
) -> _HeadingReading:
    """Return how the headings of the truth, the ``numbers`` (R,) of its ``sample``, are written.

    A vehicle moves in the direction of its heading, so that the positions decide. If they do not, the
    headings count from x, and, without a ``known_unit``, in deg if one is beyond 2 pi.
    """
    largest = float(np.nanmax(np.abs(numbers), initial=0.0))
    unit = known_unit or ("deg" if largest > 2.0 * np.pi else "rad")
    columns = table_guess.naming.columns
    if not columns.keys() >= {*PLACE}:
        return _HeadingReading(unit)
    position = np.stack([sample.numbers(columns[name]) for name in PLACE])
    known = np.flatnonzero(np.isfinite(position).all(axis=0) & np.isfinite(numbers))
    # Numbers of rows stand for their times, as only the directions of displacements are used. A
    # displacement from one run to the next is one of few.
    displacements = Displacements.of_rows(known.astype(float), position[:, known])
    # Median cosines between the movement and the direction by each reading, the usual ones first.
    cosines: dict[_HeadingReading, float] = {}
    for each_unit in dict.fromkeys((unit, "rad", "deg")):
        if known_unit and each_unit != unit:
            continue
        angle = numbers[known] * UNITS[each_unit]
        along = np.stack([np.cos(angle), np.sin(angle)])
        cosines[_HeadingReading(each_unit)] = median_cosine(along, displacements)
        compass = _HeadingReading(each_unit, is_compass=True)
        cosines[compass] = median_cosine(along[::-1], displacements)
    for reading, cosine in cosines.items():
        if all(not is_nearer(other, cosine) for other in cosines.values()):
            return reading if cosine >= LEAST_COSINE else _HeadingReading(unit)
    return _HeadingReading(unit)
