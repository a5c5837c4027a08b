"""Check of angles beyond a whole turn, with advice on their likely unit."""

from collections.abc import Mapping

import numpy as np

from trackbench.errors import and_others
from trackbench.field_types import DataError
from trackbench.scenarios.recordings.quantity_keys import plain_name
from trackbench.scenarios.recordings.recognize_column_names import columns_of
from trackbench.scenarios.recordings.rows_and_reading_context import ReadingContext, Rows
from trackbench.scenarios.recordings.unit_names_and_sizes import UNITS

_ANGLE_ROUNDING = 1e-6
"""rad: rounding of a written angle, such as one of a whole turn"""


def check_turns(context: ReadingContext, rows: Rows, angles: Mapping[str, int]) -> None:
    """Raise DataError for angles that are too large to be in radians, with the likely unit.

    ``angles`` has, by the name of each angle, its number among the values of ``rows``, which are in rad.
    """
    for name, i in angles.items():
        limit = 2.0 * np.pi + _ANGLE_ROUNDING
        turn = "a whole turn"
        if name == "elevation":
            limit = 0.5 * np.pi + _ANGLE_ROUNDING
            turn = "a quarter turn"
        sizes = np.abs(rows.values[i])
        wide = np.flatnonzero(sizes > limit)
        if len(wide):
            scale = context.naming.scale(name)
            unit = context.naming.units.get(name) or context.naming.units.get(plain_name(name))
            number = rows.values[i, wide[0]] / scale  # as it stands in the file
            message = f"{name}: {number:.9g} {unit or 'rad'} is beyond {turn}"
            more = and_others(len(wide))
            largest = float(np.nanmax(sizes)) / scale
            remedy = _remedy_for_large_angles(name, largest, limit, scale)
            if _is_exchanged_with_range(context, rows, name, i, scale):
                remedy = f"are the columns of range and {name} exchanged? If not, {remedy}"
            message = f"{message}{more}: {remedy}correct the cells"
            raise DataError(context.place(rows, int(wide[0]), message))


def _is_exchanged_with_range(
    context: ReadingContext, rows: Rows, name: str, number: int, scale: float
) -> bool:
    """Test whether the values ``number`` of ``rows``, angles that are too large, may be ranges.

    The ranges, which are the values before them, are then possible angles in the unit of the angles,
    ``scale``, rad. The names of the columns must show it, that of the angle ``name`` among them, or
    numbers with decimals that are too large for milliradians: smaller units have whole numbers.
    """
    columns = context.naming.columns
    if number != 1 or not columns.keys() >= {"range", name}:
        return False
    ranges = rows.values[0] / context.naming.scale("range")
    angles = rows.values[number] / scale
    known = np.isfinite(ranges) & np.isfinite(angles)
    # Ranges are positive.
    limit = (2.0 * np.pi + _ANGLE_ROUNDING) / scale  # a whole turn in the file
    if not known.any() or (np.abs(ranges[known]) > limit).any() or (angles[known] < 0.0).any():
        return False
    is_named_range = "range" in columns_of([columns[name]])
    is_named_angle = bool({"azimuth", "bearing"} & columns_of([columns["range"]]).keys())
    if is_named_range or is_named_angle:
        return True
    has_decimals = bool((angles[known] % 1.0 > 0.0).any())
    return has_decimals and float(angles[known].max()) * UNITS["mrad"] > 2.0 * np.pi


def _remedy_for_large_angles(name: str, largest: float, limit: float, scale: float) -> str:
    """Return the advice on angles that are too large in the unit in which they were read.

    It is the beginning of a sentence, which ends with ", or " or is empty, and to which the caller adds
    "correct the cells". ``name`` is that of the angle, ``largest`` the largest number of the file,
    ``limit`` the largest possible angle, rad, and ``scale`` the unit in which it was read, rad.
    """
    # Other units in which the numbers of all cells are possible.
    fitting = []
    for unit in ("deg", "deg/10", "mrad", "deg/100", "acp"):
        if UNITS[unit] != scale and largest * UNITS[unit] <= limit:
            fitting.append(unit)
    # Degrees are by far the likeliest of these units.
    if fitting[:1] == ["deg"]:
        return f"say `units: {{{name}: deg}}`, or "
    if 360.0 < largest <= 400.0:
        return "if a turn has 400 gon, write degrees, or "
    # A turn may also be divided into so many counts, which are no unit of trackbench.
    counts = [str(count) for count in (6400, 16384, 65536) if largest <= count]
    advice = ""
    if fitting:
        first, *others = fitting
        advice = f"say its unit, `units: {{{name}: {first}}}`"
        if others:
            advice += f" (or {', '.join(others)})"
        advice += ", or "
    if counts:
        *first_counts, last = counts
        words = f"{', '.join(first_counts)} or {last}" if first_counts else last
        advice += f"write degrees if a turn has {words} counts, or "
    return advice
