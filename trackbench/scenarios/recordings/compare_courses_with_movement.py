"""Comparison of courses and velocities with the directions in which positions move."""

from collections.abc import Mapping, Sequence

import numpy as np

from trackbench.core.arrays import Array
from trackbench.scenarios.recordings.guess_record import ColumnByQuantity
from trackbench.scenarios.recordings.guess_table_sample import TableSample
from trackbench.scenarios.recordings.guess_usual_speed_and_acceleration import Displacements
from trackbench.scenarios.recordings.quantity_keys import GEODETIC, PLACE
from trackbench.scenarios.recordings.unit_names_and_sizes import UNITS
from trackbench.scenarios.recordings.unscaled_rows import UnscaledRows

LEAST_COSINE = 0.8
"""Least cosine between two directions that agree."""
_LEAST_ANGLE = 0.03  # rad between directions that differ for sure
COURSE_UNITS = ("deg", "rad", "deg/10", "deg/100", "degE5")
_LARGEST_COURSE = 511.001
"""deg, but for rounding: AIS writes 511 for a heading that is not available; larger numbers have another
unit"""
_CLEARLY_BETTER = 0.01
"""difference of two median cosines, by which a rarer unit must agree better"""


def best_course_unit(
    unscaled: UnscaledRows,
    known_units: Mapping[str, str],
    displacements: Displacements,
    speed_agrees: bool,
) -> tuple[str, bool]:
    """Return the unit in which the course agrees best with the displacements, and whether it agrees.

    The course is compared only if the measured speed agrees with that of the displacements
    (``speed_agrees``). A measured velocity has no course, so that the unit is empty, but its direction
    is compared, too.
    """
    if unscaled.velocity is not None:
        # If the direction agrees better with vx and vy exchanged, north stands before east.
        cosine = median_cosine(unscaled.velocity, displacements)
        exchanged = median_cosine(unscaled.velocity[::-1], displacements)
        return "", speed_agrees and cosine >= LEAST_COSINE and not is_nearer(exchanged, cosine)
    if unscaled.course is None or unscaled.speed is None or not speed_agrees:
        return known_units.get("course", ""), False
    largest = float(np.nanmax(np.abs(unscaled.course), initial=0.0))
    units: Sequence[str] = COURSE_UNITS
    if "course" in known_units:
        units = [known_units["course"]]
    elif (unscaled.course[np.isfinite(unscaled.course)] % 1.0).any():
        units = ("deg", "rad")  # the others are of whole numbers
    best = ""
    cosine = -1.0
    exchanged = -1.0
    for unit in units:
        course = unscaled.course * UNITS[unit]
        # Such a course is impossible, so that the unit is another one.
        if largest * UNITS[unit] > UNITS["deg"] * _LARGEST_COURSE:
            continue
        along = unscaled.speed * directions_of_courses(course)
        unit_cosine = median_cosine(along, displacements)
        # A later unit, which is rarer, must agree clearly better.
        if unit_cosine > cosine + _CLEARLY_BETTER:
            best = unit
            cosine = unit_cosine
            # A course that counts from x is one from north with both axes exchanged.
            exchanged = median_cosine(along[::-1], displacements)
    return best, cosine >= LEAST_COSINE and not is_nearer(exchanged, cosine)


def directions_of_courses(courses: Array) -> Array:
    """Return unit vectors (2, R) to the east and north of courses (R,), rad clockwise from north."""
    return np.stack([np.sin(courses), np.cos(courses)])


def is_nearer(cosine: float, other: float) -> bool:
    """Test whether directions with the median ``cosine`` agree clearly better than those with ``other``.

    Their usual angle is then less than half as large, as 1 - cos(a) is a^2 / 2.
    """
    return 1.0 - other > 4.0 * (1.0 - cosine) + _LEAST_ANGLE**2 / 2.0


def are_courses(numbers: Array, time: Array, positions: Array) -> bool:
    """Test whether numbers (R,) are the directions in which positions move, deg clockwise from north.

    ``time`` (R,) may be in any unit, and ``positions`` (2, R), east and north, in any unit of a length.
    """
    # A course may be one only beside positions in the plane, and not beside a range alone.
    if len(positions) != 2 or not ((numbers >= -180.0) & (numbers <= 360.0)).all():
        return False
    along = directions_of_courses(numbers * UNITS["deg"])
    return median_cosine(along, Displacements.of_rows(time, positions)) >= LEAST_COSINE


def median_cosine(velocity: Array, displacements: Displacements) -> float:
    """Return the median cosine of the angle between velocities (2, R) and the displacements.

    It is -1 if no row can be compared. The unit of the velocities does not matter.
    """
    # There are two components only of positions: there is one of a single range, and none of bearings.
    if len(displacements.vectors) != 2 or not len(displacements.first_row):
        return -1.0
    mean = 0.5 * (velocity[:, displacements.first_row] + velocity[:, displacements.last_row])
    sizes = np.hypot(*mean) * np.hypot(*displacements.vectors)
    valid = np.isfinite(sizes) & (sizes > 0.0)
    if not valid.any():
        return -1.0
    return float(np.median((mean * displacements.vectors).sum(axis=0)[valid] / sizes[valid]))


def holds_courses(sample: TableSample, columns: ColumnByQuantity, column: str) -> bool:
    """Test whether the numbers of a column are the directions, in degrees, in which positions move.

    The rows are taken to be equally spaced in time. ``columns`` are the columns by quantity.
    """
    names = PLACE if columns.keys() >= {*PLACE} else GEODETIC[1::-1]  # longitude, latitude
    if not columns.keys() >= {*names}:
        return False
    position = np.stack([sample.numbers(columns[name]) for name in names])
    numbers = sample.numbers(column)
    known = np.isfinite(position).all(axis=0) & np.isfinite(numbers)
    if names != PLACE:
        # Longitudes and latitudes become lengths in one unit.
        largest = float(np.abs(position[1, known]).max(initial=0.0))
        if largest > 90.0:
            return False  # they are no degrees
        latitude = float(np.median(position[1, known])) if known.any() else 0.0
        position[0] *= np.cos(latitude * UNITS["deg"])
    rows = np.flatnonzero(known)
    return are_courses(numbers[rows], rows.astype(float), position[:, rows])
