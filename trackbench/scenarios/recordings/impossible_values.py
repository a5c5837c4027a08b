"""Impossible values, such as a latitude beyond 90 deg, and advice on them."""

from math import inf, pi
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Index
from trackbench.errors import and_others
from trackbench.scenarios.recordings.unit_names_and_sizes import UNITS

_DEGREES = 180.0 / pi
LIMITS = {
    "latitude": (-90.0, 90.0, _DEGREES, "deg"),
    "longitude": (-180.0, 360.0, _DEGREES, "deg"),
    "course": (-360.0, 360.0, _DEGREES, "deg"),
    "range": (0.0, inf, 1.0, "m"),
    "speed": (0.0, inf, 1.0, "m/s"),
}
"""Least and largest value, the number of their units in one SI unit, and the unit's name."""
_COURSE_UNITS = ("deg/10", "deg/100", "degE5")
_PLACE_UNITS = ("degE7", "degE6", "semicircle", "mas", "deg/600000", "degE5")
_LARGE = 1e4
"""Numbers of a coordinate beyond are in a small unit: 1e4 of the largest one, degE5, are 0.1 deg."""


class Impossible(NamedTuple):
    """The first row with an impossible value, and the message on it."""

    row: int
    """index of the row among the values"""
    message: str


def impossible(quantity: str, values: Array, scale: float) -> Impossible | None:
    """Return the first value that the quantity cannot have, with a message; None if there is none.

    ``scale`` is the factor from the unit of the ``values`` (R,) to SI.
    """
    if quantity not in LIMITS:
        return None
    least, largest, per_si, unit = LIMITS[quantity]
    shown = values * scale * per_si
    # Rounding in the conversion to SI and back must not make 90 deg impossible.
    room = 1e-9 * largest if largest < inf else 0.0
    rows = np.flatnonzero((shown < least - room) | (shown > largest + room))
    if not len(rows):
        return None
    limits = f"within {least:g} and {largest:g}"
    if largest == inf:
        limits = f"at least {least:g}"
    first = f"{shown[rows[0]]:.9g} {unit} is impossible{and_others(len(rows))}"
    message = f"{first}; a {quantity} is {limits} {unit}"
    remedy = _remedy_for_impossible(quantity, values, rows)
    return Impossible(int(rows[0]), f"{message}: correct or empty the cells{remedy}")


def _remedy_for_impossible(quantity: str, values: Array, wrong: Index) -> str:
    """Return advice on impossible values: a unit in which all are possible, or a code for missing cells.

    It is the end of a message. ``values`` (R,) are those of the column, and ``wrong`` are the indices of
    the impossible ones.
    """
    finite = values[np.isfinite(values)]
    most_are_wrong = 2 * len(wrong) > len(finite)
    # The third field of the limits is the number of their units in one SI unit, of degrees in a radian.
    least, largest, _, usual_unit = LIMITS[quantity]
    if usual_unit == "deg" and most_are_wrong:
        if quantity == "latitude" and np.abs(finite).max() <= 180.0:
            return ", or exchange latitude and longitude"
        # NMEA writes degrees and minutes of a coordinate as one number: 4807.038 is 48 deg 7.038 min. It
        # writes a course in degrees alone.
        whole = not (finite % 1.0).any()
        minutes = np.abs(finite) % 100.0
        if not whole and quantity != "course" and (minutes < 60.0).all():
            degrees, rest = divmod(float(finite[0]), 100.0)  # the first number is the example
            message = (
                f"{finite[0]:.9g} looks like {degrees:g} deg {rest:.6g} min, as NMEA writes it"
            )
            return f"; {message}: write degrees and decimals"
        units: tuple[str, ...] = ()
        if quantity == "course":
            units = _COURSE_UNITS
        elif np.abs(finite).max() > _LARGE:
            units = _PLACE_UNITS
        fitting = [
            unit
            for unit in units
            if finite.min() * UNITS[unit] * _DEGREES >= least
            and finite.max() * UNITS[unit] * _DEGREES <= largest
        ]
        if fitting:
            keys = " or ".join(f"`units: {{{quantity}: {unit}}}`" for unit in fitting[:3])
            return f", or name their unit; say {keys}"
    if len(np.unique(values[wrong])) == 1 and not most_are_wrong:
        code = float(values[wrong[0]])
        return f", or name their unit; say `missing: [{code:.15g}]` for a missing cell"
    return ", or name their unit"
