"""Notes on numbers far outside their column, and rows at 0 N 0 E without a fix."""

from collections.abc import Mapping
from math import inf, pi

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.errors import counted, counted_with_verb, form_for
from trackbench.scenarios.recordings.missing_cells import outlying
from trackbench.scenarios.recordings.naming_of_columns import Naming
from trackbench.scenarios.recordings.parse_tables import Table
from trackbench.scenarios.recordings.quantity_keys import QUATERNION, STAMP_PARTS

_NEAREST_TO_ZERO = 0.1 / (180.0 / pi)
"""rad from 0 N 0 E that all positions must be, if those at 0, 0 are none"""


def no_fix(latitude: Array, longitude: Array, scale: float) -> Mask:
    """Return a mask (R,) of the rows at latitude = longitude = 0, if all others are far from there.

    Receivers without a fix write these numbers. ``scale`` is the factor from the unit of both to
    radians.
    """
    is_zero = (latitude == 0.0) & (longitude == 0.0)
    distances = np.maximum(np.abs(latitude), np.abs(longitude))[~is_zero] * scale
    nearest = float(np.nanmin(distances, initial=inf))
    return is_zero & (_NEAREST_TO_ZERO < nearest < inf)


def rows_with_fix(table: Table, latitude: str, longitude: str, scale: float) -> tuple[Mask, str]:
    """Return a mask (R,) of the rows that are not at 0 N 0 E, and a note on the others; else empty.

    Receivers without a fix write these numbers. If other positions are near 0 N 0 E, all rows have a
    fix. ``latitude`` and ``longitude`` are columns. ``scale`` is the factor from their unit to radians.
    """
    has_no_fix = no_fix(table.columns[latitude], table.columns[longitude], scale)
    if not has_no_fix.any():
        return ~has_no_fix, ""
    number = int(has_no_fix.sum())
    message = f"{counted(number, 'row')} with {latitude} = {longitude} = 0"
    message += f" {form_for(number, 'has no fix and was', 'have no fix and were')} left out"
    return ~has_no_fix, message


def notes_on_outliers(
    path: str, table: Table, quantities: Mapping[str, str], naming: Naming
) -> list[str]:
    """Return a note on each number of these rows that is far outside the others of its column.

    ``quantities`` are those of the columns with numbers, by the column's name. ``path`` is the file.
    """
    notes = []
    for column, quantity in quantities.items():
        # An angle of 0.01 deg is near one of 359.99 deg, and a component of a quaternion is often 0.
        if quantity in ("course", "azimuth", *QUATERNION):
            continue
        if naming.has_no_missing_number(quantity):
            continue  # the user has answered the note
        values = table.columns[column]
        if quantity == "longitude":
            values = values[~_is_across_a_cut(values, naming.scale(quantity))]
        for value, n in outlying(values).items():
            cells = counted_with_verb(n, "cell", "is", "are")
            message = f"{cells} {value:.9g}, far outside the others: empty"
            message += f" {form_for(n, 'it', 'them')}"
            others = _other_column_with(table, value, column, quantities)
            answer = f"`missing: [{value:.15g}]`"
            if others:
                answer = f"`missing: {{{quantity}: [{value:.15g}]}}`"
            remedy = f", or say {answer}, if nothing was measured there"
            if others:
                remedy += f" (`missing: [{value:.15g}]` would also empty cells of {others})"
            notes.append(f"{path}: {column}: {message}{remedy}")
    return notes


def _other_column_with(
    table: Table, value: float, column: str, quantities: Mapping[str, str]
) -> str:
    """Return another column that has ``value`` as a usual number; empty if there is none."""
    for other, quantity in quantities.items():
        # Weeks and parts of a second belong to the time, and are no measured numbers.
        if other == column or quantity in STAMP_PARTS:
            continue
        values = table.columns[other]
        if (values == value).any() and value not in outlying(values):
            return other
    return ""


def _is_across_a_cut(values: Array, scale: float) -> Mask:
    """Return a mask (R,) of longitudes a whole turn away from the others, as 0.1 deg beside 359.9 deg.

    ``scale`` is their unit in radians.
    """
    turn = 2.0 * pi / scale
    finite = values[np.isfinite(values)]
    if not len(finite):
        return np.zeros(len(values), dtype=np.bool_)
    difference = values - np.median(finite)
    wrapped = difference - turn * np.rint(difference / turn)
    return np.abs(difference - wrapped) > 0.5 * turn
