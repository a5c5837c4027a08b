"""Words, codes of AIS and numbers such as -9999 that stand for missing cells."""

import re
from collections import Counter

import numpy as np

from trackbench.core.arrays import Array
from trackbench.errors import counted_with_verb, form_for
from trackbench.scenarios.recordings.unit_names_and_sizes import UNITS

NINES = re.compile(r"9{3,}(\.9+|\.25)?")
"""Numbers of nines alone, and 999.25, which logs of wells have."""
_CODES = {"latitude": 91.0, "longitude": 181.0, "course": 511.0}
"""Codes of AIS (ITU-R M.1371) that are impossible values in any table; a course may be a heading."""
_CODES_OF_AIS = {"speed": 102.3, "course": 360.0}
"""Codes of AIS that are possible values in other tables: an aircraft's 102.3 kn, a course due north."""
_FINEST_STEP = 0.2
"""kn or deg: numbers that are rounded to larger steps show no converted code"""
_MOST_DIGITS = 9
"""digits behind the point with which values are compared"""

MISSING_WORDS = frozenset(
    (
        *("", "nan", "na", "n/a", "#n/a", "null", "none", "nil", "<na>", "n.a.", "?"),
        *("missing", ".", "#num!", "#div/0!", "#value!", "#ref!"),
        *("-nan", "+nan", "nan(ind)", "-nan(ind)", "1.#qnan", "1.#ind", "-1.#ind", "-1.#qnan"),
    )
)
"""Cells, in small letters, that stand for a missing number, besides dashes and stars alone."""
DASHES = re.compile(r"[-–—]+|[*.]{2,}")
_LEAST_CELLS = 5
"""Fewest cells of a column in which one can be far outside the others."""
_ENDS = (32767.0, 32768.0, 2147483647.0, 2147483648.0)
"""Sizes of the ends of the range of whole numbers of 16 and 32 bits."""


def blank_codes(quantity: str, values: Array, of_ais: bool, scale: float) -> Counter[str]:
    """Replace codes for "not available" in ``values`` (R,) by NaN, in place; count the cells by code.

    These are the codes of AIS, and -1 for speeds and courses of phones if no others are negative.
    ``of_ais`` is True if the table has columns of AIS, which has further codes. ``scale`` is the factor
    from the unit of the values to SI. The codes are in knots and degrees: they are converted to this
    unit, and rounded as the values are. In a larger unit, such as m/s, a code that was not converted is
    beyond all values, and is replaced, too.
    """
    counts: Counter[str] = Counter()
    if quantity in ("speed", "course"):
        is_code = values == -1.0
        if is_code.any() and not (values[~is_code] < 0.0).any():
            counts[f"{quantity} -1"] = int(is_code.sum())
            values[is_code] = np.nan
    unit_of_code = UNITS["kn" if quantity == "speed" else "deg"]
    tables_of_codes = [_CODES]
    if of_ais:
        tables_of_codes.append(_CODES_OF_AIS)
    for codes in tables_of_codes:
        code = codes.get(quantity)
        if code is None:
            continue
        numbers = []
        if scale >= unit_of_code:
            numbers.append(code)
        if scale != unit_of_code:
            digits = _digits_behind_point(values)
            # Coarser roundings are those of other values, too: 189 km/h may be 102.1 kn.
            if 10.0**-digits * scale <= _FINEST_STEP * unit_of_code:
                numbers.append(float(np.round(code * unit_of_code / scale, digits)))
        for number in numbers:
            is_code = values == number
            half_turn = np.pi / scale
            if quantity == "longitude" and (values[~is_code] > half_turn).any():
                continue  # of longitudes from 0 to 360 deg 181 is a value
            if is_code.any():
                counts[f"{quantity} {number:.9g}"] = int(is_code.sum())
                values[is_code] = np.nan
    return counts


def _digits_behind_point(values: Array) -> int:
    """Return the number of digits behind the point that ``values`` (R,) have, at most nine."""
    finite = values[np.isfinite(values)]
    digits = 0
    while digits < _MOST_DIGITS and not np.array_equal(np.round(finite, digits), finite):
        digits += 1
    return digits


def note_on_codes(counts: Counter[str]) -> str:
    """Return the note on the cells that `blank_codes` replaced, with their number by code."""
    codes = ", ".join(f"{code} ({n})" for code, n in sorted(counts.items()))
    number = counts.total()
    message = counted_with_verb(number, "cell", "holds", "hold")
    message += ' a code for "not available" and'
    return f"{message} {form_for(number, 'counts', 'count')} as missing: {codes}"


def outlying(values: Array) -> dict[float, int]:
    """Return numbers far outside all others, such as -9999 for a missing cell, and how often they occur.

    A number is far if its distance to the nearest other is more than ten times the span of the others.
    For a number of nines alone, or the end of an integer type's range, a tenth of the span is enough.
    Beside others that are all equal no number is far, as they have no span.
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
            is_usual_code = NINES.fullmatch(f"{abs(end):.9g}") or abs(end) in _ENDS
            spans = 0.1 if is_usual_code else 10.0
            if max(low - end, end - high) > spans * (high - low) > 0.0:
                outliers[end] = len(rest) - len(others)
                rest = others
                break
        else:
            break  # neither end is far outside
    return outliers
