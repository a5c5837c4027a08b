"""Guess of the unit of positions: a length, or an angle of latitude and longitude."""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.scenarios.recordings.unit_names_and_sizes import UNITS
from trackbench.scenarios.recordings.unscaled_rows import UnscaledRows

WORDS_OF_AIS = ("mmsi", "sog", "cog", "imo", "sourcemmsi")
_RECEIVERS = (
    *("timeusec", "itow", "eph", "epv", "hacc", "vacc", "fixtype", "headmot", "satellitesused"),
    *("satellitesvisible", "timeutcusec", "late7", "lone7", "gpsraw", "hmsl"),
)
"""Names of columns of u-blox, MAVLink and PX4, whose positions are in 1e-7 deg."""
_SMALLEST_WHOLE = 1e4
"""Whole numbers below are degrees."""
LENGTH_UNITS = {"m": 0.0, "km": 1.0, "mm": 1.0, "cm": 1.0, "ft": 1.0, "mi": 1.0, "nmi": 1.0}


class AngleUnit(NamedTuple):
    """Unit of latitude and longitude."""

    unit: str
    penalty: float
    """how unlikely the unit is before the numbers are considered"""
    is_whole: bool
    """True if coordinates in this unit are whole numbers"""
    words: tuple[str, ...] = ()
    """names of columns that files with this unit have"""


GEODETIC_UNITS = (
    AngleUnit("deg", 0.0, False),
    AngleUnit("rad", 0.0, False),
    AngleUnit("degE7", 0.0, True, _RECEIVERS),
    AngleUnit("degE6", 0.1, True),
    AngleUnit("semicircle", 0.2, True, ("positionlat", "positionlong")),
    AngleUnit("mas", 0.3, True),
    AngleUnit("deg/600000", 0.4, True, WORDS_OF_AIS),
    AngleUnit("degE5", 0.5, True),
)
"""Penalties differ by less than the margin of `likely_units`.

No unit is sure without a word or a measured speed.
"""


def position_units(
    unscaled: UnscaledRows, known_units: Mapping[str, str]
) -> Iterator[tuple[str, bool, float]]:
    """Yield each possible unit of the position, whether it is read as latitude, and its penalty.

    The second value is True for longitude and latitude, and False for lengths. `likely_units` adds the
    penalty to those of times and speeds. A unit remains possible if its sum is less than 0.6 above the
    least one, so that a penalty of 1 decides unless others outweigh it, and 0.5 does not decide alone.
    ``known_units`` are units by quantity that need no guess.
    """
    if not unscaled.is_geodetic:
        is_ais = bool(unscaled.plain_column_names.intersection(WORDS_OF_AIS))
        known = known_units.get("x", known_units.get("range"))
        if known:
            yield known, False, 0.0
        else:
            yield from _length_units(unscaled, is_ais)
        if known is None and _may_be_degrees(unscaled):
            yield "deg", True, 0.0 if is_ais else 1.0
        return
    if "latitude" in known_units or "longitude" in known_units:
        yield known_units.get("latitude", known_units.get("longitude", "deg")), True, 0.0
        return
    longitude, latitude = largest_coordinates(unscaled.position)
    is_whole = not (unscaled.position[np.isfinite(unscaled.position)] % 1.0).any()
    is_large = max(longitude, latitude) >= _SMALLEST_WHOLE
    # Some units are usual beside columns with certain names, such as degE7 beside those of MAVLink.
    has_words = {
        candidate.unit: not unscaled.plain_column_names.isdisjoint(candidate.words)
        for candidate in GEODETIC_UNITS
    }
    any_words = any(has_words.values())
    fitting = []
    for candidate in GEODETIC_UNITS:
        in_degrees = UNITS[candidate.unit] / UNITS["deg"]
        # 91 and 181 deg are codes of AIS.
        if latitude * in_degrees > 91.001 or longitude * in_degrees > 360.001:
            continue
        # Large whole numbers are in a unit for whole numbers, all others are not.
        if candidate.is_whole != (is_whole and is_large):
            continue
        penalty = 0.0
        if not has_words[candidate.unit]:
            penalty = candidate.penalty
            if candidate.is_whole and any_words:  # the names are those of another unit
                penalty += 1.0
        # Six digits behind the point are 6 m in rad, five are 64 m: too coarse for most files.
        if candidate.unit == "rad" and unscaled.least_decimals <= 6:
            penalty += 0.5 if unscaled.least_decimals == 6 else 1.0
        fitting.append((candidate.unit, True, penalty))
    # Numbers that are impossible in every unit are reported when they are read, as degrees.
    yield from fitting or [("deg", True, 0.0)]


def _length_units(unscaled: UnscaledRows, is_ais: bool) -> Iterator[tuple[str, bool, float]]:
    """Yield each possible unit of lengths, False, which says that it is none of angles, and its penalty.

    The penalty is added to others by `likely_units`; a difference of 1 decides, as it is more than the
    margin of 0.6. ``is_ais`` is True if the names of the columns are those of AIS messages.
    """
    # Without a measured speed nothing shows that lengths are not in m.
    is_alone = unscaled.speed is None and unscaled.velocity is None
    for unit, unit_penalty in LENGTH_UNITS.items():
        if unit != "m" and is_alone:
            continue
        penalty = unit_penalty
        if is_ais and _may_be_degrees(unscaled):  # x and y of AIS rather are degrees
            penalty += 1.0
        yield unit, False, penalty


def largest_coordinates(position: Array) -> tuple[float, float]:
    """Return the largest absolute values of longitude and latitude, the two rows of positions (2, R)."""
    longitude, latitude = position
    largest_longitude = float(np.nanmax(np.abs(longitude), initial=0.0))
    largest_latitude = float(np.nanmax(np.abs(latitude), initial=0.0))
    return largest_longitude, largest_latitude


def _may_be_degrees(unscaled: UnscaledRows) -> bool:
    """Test whether x and y may be longitude and latitude, in a table that can show it.

    It can by a measured speed, or by the names of its columns if these are those of AIS.
    """
    has_speed = unscaled.speed is not None or unscaled.velocity is not None
    is_ais = bool(unscaled.plain_column_names.intersection(WORDS_OF_AIS))
    return (has_speed or is_ais) and ("longitude", "latitude") in orders_of_degrees(unscaled)


def orders_of_degrees(unscaled: UnscaledRows) -> list[tuple[str, str]]:
    """Return what x and y may be if they are in degrees: pairs of quantities, the usual order first.

    The list is empty if the positions do not have the size and the decimals of degrees.
    """
    # Degrees with less than four digits behind the point would be too coarse, beyond 10 m.
    if len(unscaled.position) != 2 or unscaled.least_decimals < 4:
        return []
    x, y = largest_coordinates(unscaled.position)
    # 181 and 91 deg are codes of AIS for a missing position.
    orders = []
    if x <= 181.0 and y <= 91.0:
        orders.append(("longitude", "latitude"))
    if x <= 91.0 and y <= 181.0:
        orders.append(("latitude", "longitude"))
    return orders
