"""Possible values of recorded quantities, and the codes that stand for "not available"."""

import re
from collections import Counter
from collections.abc import Sequence
from math import inf, pi
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array

_DEGREES = 180.0 / pi
_LIMITS = {
    "latitude": (-90.0, 90.0, _DEGREES, "deg"),
    "longitude": (-180.0, 180.0, _DEGREES, "deg"),
    "course": (-360.0, 360.0, _DEGREES, "deg"),
    "range": (0.0, inf, 1.0, "m"),
}
"""Least and largest value, in a unit of which SI has so many."""
_CODES = {"latitude": 91.0, "longitude": 181.0, "course": 511.0}
"""Codes of AIS (ITU-R M.1371) that are impossible values in any table; a course may be a heading."""
_CODES_OF_AIS = {"speed": 102.3, "course": 360.0}
"""Codes of AIS that are possible values in other tables: an aircraft's 102.3 kn, a course due north."""


class Impossible(NamedTuple):
    """The first row with an impossible value, and what to say of it."""

    row: int
    what: str


def is_ais(names: Sequence[str]) -> bool:
    """Return whether a table's columns are called as those of AIS: MMSI, SOG or COG."""
    return any(re.split("[^a-z]", name.lower())[0] in ("mmsi", "sog", "cog") for name in names)


def blank_codes(quantity: str, values: Array, of_ais: bool) -> Counter[str]:
    """Replace "not available" codes by NaN in place, and count the cells of each code."""
    counts: Counter[str] = Counter()
    for codes in (_CODES, _CODES_OF_AIS) if of_ais else (_CODES,):
        code = codes.get(quantity)
        coded = values == code
        if code is not None and coded.any():
            counts[f"{quantity} {code:g}"] = int(coded.sum())
            values[coded] = np.nan
    return counts


def impossible(quantity: str, values: Array) -> Impossible | None:
    """Find values, in SI, that the quantity cannot have."""
    if quantity not in _LIMITS:
        return None
    least, largest, per_si, unit = _LIMITS[quantity]
    shown = values * per_si
    # Rounding in the conversion to SI and back must not make 90 deg too many.
    room = 1e-9 * largest if largest < inf else 0.0
    rows = np.flatnonzero((shown < least - room) | (shown > largest + room))
    if not len(rows):
        return None
    limits = f"at least {least:g}" if largest == inf else f"within {least:g} and {largest:g}"
    more = f", as are {len(rows) - 1} more" if len(rows) > 1 else ""
    what = f"{shown[rows[0]]:.9g} {unit} is impossible{more}; a {quantity} is {limits} {unit}"
    return Impossible(int(rows[0]), f"{what}: correct the cells, empty them, or name their unit")
