"""Numbers that stand for missing cells, such as codes of AIS and -9999, and impossible values."""

import re
from collections import Counter
from math import inf, pi
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Index, Mask
from trackbench.errors import and_others
from trackbench.scenarios.recordings.units import UNITS

_DEGREES = 180.0 / pi
LIMITS = {
    "latitude": (-90.0, 90.0, _DEGREES, "deg"),
    "longitude": (-180.0, 360.0, _DEGREES, "deg"),
    "course": (-360.0, 360.0, _DEGREES, "deg"),
    "range": (0.0, inf, 1.0, "m"),
    "speed": (0.0, inf, 1.0, "m/s"),
}
"""Least and largest value, the number of their units in one SI unit, and the unit's name."""
_LEAST_CELLS = 5
"""Fewest cells of a column in which one can be far outside the others."""
_NINES = re.compile(r"9{3,}(\.9+)?")
_ENDS = (32767.0, 32768.0, 2147483647.0, 2147483648.0)
"""Sizes of the ends of the range of whole numbers of 16 and 32 bits."""
_CODES = {"latitude": 91.0, "longitude": 181.0, "course": 511.0}
"""Codes of AIS (ITU-R M.1371) that are impossible values in any table; a course may be a heading."""
_CODES_OF_AIS = {"speed": 102.3, "course": 360.0}
"""Codes of AIS that are possible values in other tables: an aircraft's 102.3 kn, a course due north."""
_RAW_AIS = ("deg/600000", "deg/10", "kn/10")
_NEAREST_TO_ZERO = 0.1 / _DEGREES
"""rad from 0 N 0 E that all positions must be, if those at 0, 0 are none"""
_COURSE_UNITS = ("deg/10", "deg/100", "degE5")
_PLACE_UNITS = ("degE7", "degE6", "semicircle", "mas", "deg/600000", "degE5")


class Impossible(NamedTuple):
    """The first row with an impossible value, and the message on it."""

    row: int
    """index of the row among the values"""
    message: str


def blank_codes(quantity: str, values: Array, of_ais: bool, scale: float) -> Counter[str]:
    """Replace codes for "not available" in ``values`` (R,) by NaN, in place; count the cells by code.

    These are the codes of AIS, and -1 for speeds and courses of phones if no others are negative.
    ``of_ais`` is True if the table has columns of AIS, which has further codes. ``scale`` is the factor
    from the unit of the values to SI. In raw fields of AIS, whose units are tenths of a degree or knot
    or 1/600000 deg, the codes have these units, too.
    """
    counts: Counter[str] = Counter()
    if quantity in ("speed", "course"):
        is_code = values == -1.0
        if is_code.any() and not (values[~is_code] < 0.0).any():
            counts[f"{quantity} -1"] = int(is_code.sum())
            values[is_code] = np.nan
    raw_unit = ""
    for unit in _RAW_AIS:
        if scale == UNITS[unit]:
            raw_unit = unit
            break
    # The codes are in knots and degrees.
    usual_unit = "kn" if raw_unit == "kn/10" else "deg"
    tables_of_codes = [_CODES]
    if of_ais:
        tables_of_codes.append(_CODES_OF_AIS)
    for codes in tables_of_codes:
        code = codes.get(quantity)
        if code is None:
            continue
        if raw_unit:
            code = float(np.rint(code * UNITS[usual_unit] / UNITS[raw_unit]))
        is_code = values == code
        half_turn = 180.0 * UNITS["deg"] / UNITS[raw_unit or "deg"]
        if quantity == "longitude" and (values[~is_code] > half_turn).any():
            continue  # of longitudes from 0 to 360 deg 181 is a value
        if is_code.any():
            counts[f"{quantity} {code:.9g}"] = int(is_code.sum())
            values[is_code] = np.nan
    return counts


def outlying(values: Array) -> dict[float, int]:
    """Return numbers far outside all others, such as -9999 for a missing cell, and how often they occur.

    A number is far if its distance to the nearest other is more than ten times the span of the others.
    For a number of nines alone, or the end of an integer type's range, a tenth of the span is enough.
    """
    # Take the least or the largest number away as long as it is far from all others.
    rest = values[np.isfinite(values)]
    outliers = {}
    while len(rest) >= _LEAST_CELLS:
        for end in (float(rest.min()), float(rest.max())):
            others = rest[rest != end]
            if len(others) < _LEAST_CELLS:
                continue
            low = float(others.min())
            high = float(others.max())
            is_usual_code = _NINES.fullmatch(f"{abs(end):.9g}") or abs(end) in _ENDS
            spans = 0.1 if is_usual_code else 10.0
            if max(low - end, end - high) > spans * (high - low) > 0.0:
                outliers[end] = len(rest) - len(others)
                rest = others
                break
        else:
            break  # neither end is far outside
    return outliers


def no_fix(latitude: Array, longitude: Array, scale: float) -> Mask:
    """Return a mask (R,) of the rows at latitude = longitude = 0, if all others are far from there.

    Receivers without a fix write these numbers. ``scale`` is the factor from the unit of both to
    radians.
    """
    is_zero = (latitude == 0.0) & (longitude == 0.0)
    distances = np.maximum(np.abs(latitude), np.abs(longitude))[~is_zero] * scale
    nearest = float(np.nanmin(distances, initial=inf))
    return is_zero & (_NEAREST_TO_ZERO < nearest < inf)


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
    least, largest, _, usual_unit = LIMITS[quantity]
    if usual_unit == "deg" and most_are_wrong:
        if quantity == "latitude" and np.abs(finite).max() <= 180.0:
            return ", or exchange latitude and longitude"
        # NMEA writes degrees and minutes as one number: 4807.038 is 48 deg 7.038 min.
        whole = not (finite % 1.0).any()
        minutes = np.abs(finite) % 100.0
        if not whole and quantity != "course" and (minutes < 60.0).all():
            degrees, rest = divmod(float(finite[0]), 100.0)
            message = (
                f"{finite[0]:.9g} looks like {degrees:g} deg {rest:.6g} min, as NMEA writes it"
            )
            return f"; {message}: write degrees and decimals"
        units: tuple[str, ...] = ()
        if quantity == "course":
            units = _COURSE_UNITS
        elif np.abs(finite).max() > 1e4:
            # Too large for degrees: whole numbers of a small unit.
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
