"""Guess of the unit of positions: a length, or an angle of latitude and longitude."""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.field_types import Place
from trackbench.scenarios.recordings.guess_record import (
    ColumnByQuantity,
    ReasonByKey,
    UnitByQuantity,
)
from trackbench.scenarios.recordings.guess_table_sample import TableSample, numbers_of
from trackbench.scenarios.recordings.guess_usual_speed_and_acceleration import (
    is_usual_speed,
    usual_acceleration,
)
from trackbench.scenarios.recordings.naming_of_columns import Naming
from trackbench.scenarios.recordings.quantity_keys import PLACE
from trackbench.scenarios.recordings.recognize_column_names import words_of
from trackbench.scenarios.recordings.rows_and_reading_context import usual_interval
from trackbench.scenarios.recordings.unit_names_and_sizes import UNITS
from trackbench.scenarios.recordings.unscaled_rows import Candidate, UnscaledRows
from trackbench.scenarios.recordings.yaml_values import in_option

WORDS_OF_AIS = ("mmsi", "sog", "cog", "imo", "sourcemmsi")
_RECEIVERS = (
    *("timeusec", "itow", "eph", "epv", "hacc", "vacc", "fixtype", "headmot", "satellitesused"),
    *("satellitesvisible", "timeutcusec", "late7", "lone7", "gpsraw", "hmsl"),
)
"""Names of columns of u-blox, MAVLink and PX4, whose positions are in 1e-7 deg."""
_SMALLEST_WHOLE = 1e4
"""Whole numbers below are degrees."""
LENGTH_UNITS = {"m": 0.0, "km": 1.0, "mm": 1.0, "cm": 1.0, "ft": 1.0, "mi": 1.0, "nmi": 1.0}

_LONG_INTERVAL = 600.0
"""s between rows, from which on a slow target is usual, as an animal with a position every hour"""
_FASTEST_IN_KM = 400.0
"""m/s that something may have whose positions are in km without saying so"""
_LARGEST_ACCELERATION = 35.0
"""m/s^2, 3.5 times that of gravity, beyond which no vehicle turns for a quarter of the time"""
_FAST = 50.0
"""m/s, from which on positions in m may rather be in cm or mm"""

NAMES_IN_M = frozenset({"pose", "position", "odom", "odometry", "translation", "tx", "ty", "enu"})
"""Words in names of columns whose lengths are in m by convention."""


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


def options_of_degrees(columns: ColumnByQuantity, unscaled: UnscaledRows) -> str:
    """Return the options by which x and y are degrees, in each possible order; empty without one."""
    x_and_y = [in_option(columns[name]) for name in PLACE]
    texts = []
    for quantities in orders_of_degrees(unscaled):
        options = [
            f"--set 'columns.{quantity}={column}'"
            for quantity, column in zip(quantities, x_and_y, strict=True)
        ]
        texts.append(" ".join(options))
    return f", or if {x_and_y[0]} is the latitude, ".join(texts)


def _other_lengths(
    columns: ColumnByQuantity, chosen: Candidate, unscaled: UnscaledRows
) -> list[str]:
    """Return the units that lengths without a named unit may have as well as m.

    The list is empty for most tables. A target that is slow in m may be fast in km, unless it would
    then turn as no vehicle can. A target that is fast in m and turns so is rather slow, in mm or cm.
    Columns with names of ROS and of motion capture are in m. The positions are those of the
    ``unscaled`` rows in the ``chosen`` units.
    """
    speed = chosen.usual_speed
    words = {word for name in PLACE for word in words_of(columns.get(name, ""))}
    # Numbers of steps are no seconds, so that no speed is in m/s. `is_dated` marks times that need
    # no unit: dates, and numbers of steps, for which there is no column of a time.
    counts_steps = unscaled.is_dated and "time" not in columns
    if not np.isfinite(speed) or counts_steps:
        return []
    acceleration = usual_acceleration(unscaled, chosen)
    turns_slowly = acceleration * 1e3 <= _LARGEST_ACCELERATION
    if speed <= _FASTEST_IN_KM * 1e-3 and turns_slowly and words.isdisjoint(NAMES_IN_M):
        return [unit for unit in ("km", "nmi", "mi") if is_usual_speed(speed * UNITS[unit])]
    if acceleration > _LARGEST_ACCELERATION and speed >= _FAST:
        return [unit for unit in ("mm", "cm") if is_usual_speed(speed * UNITS[unit])]
    return []


def question_on_length(
    sample: TableSample,
    columns: ColumnByQuantity,
    units: UnitByQuantity,
    reasons: ReasonByKey,
    with_missing: Naming,
    chosen: Candidate,
    unscaled: UnscaledRows,
    known_units: UnitByQuantity,
    has_others: bool,
) -> Place | None:
    """Return the question for the unit of lengths if none is named; None if there is nothing to ask.

    It is asked if the speed in m would be unusual, or if another unit is as likely as m. The second
    reason does not count beside other questions on units (``has_others``). ``chosen`` is a likely
    choice of units for the ``unscaled`` rows, and ``known_units`` are units by quantity. The range
    of a table with one range alone gets the unit m if its speed is usual in m, or unknown, and no
    other unit is as likely.
    """
    names = [name for name in ("x", "y", "range", "1.range") if name in columns]
    is_named = not {"x", "range"}.isdisjoint(known_units)
    # No unit of lengths is open if the measured speed agrees with that of the positions in the
    # chosen one.
    if chosen.as_geodetic or unscaled.is_geodetic or not names or is_named or chosen.speed_agrees:
        return None
    speed = chosen.usual_speed  # m/s, if the lengths are in m
    other_units: list[str] = []
    if is_usual_speed(speed) and not has_others:
        other_units = _other_lengths(columns, chosen, unscaled)
    if not np.isfinite(speed) or (is_usual_speed(speed) and not other_units):
        # The config must have a unit of a range; x and y are in m without one.
        if names == ["range"]:
            units["range"] = "m"
            reasons["range"] = f"guess: no unit is named; {chosen.explanation}"
        return None
    degrees = ""
    if names == ["x", "y"]:
        degrees = options_of_degrees(columns, unscaled)
    # A target that is measured once an hour may well be slow.
    interval = usual_interval(unscaled.time[np.isfinite(unscaled.time)])
    if interval * chosen.seconds_per_unit >= _LONG_INTERVAL and not degrees:
        return None
    # Azimuths beyond 360 are neither degrees nor radians, and so show no speed.
    largest_azimuth = 0.0
    if "azimuth" in columns and "azimuth" not in units:
        largest_azimuth = float(
            np.nanmax(np.abs(numbers_of(sample, columns, with_missing, "azimuth")), initial=0.0)
        )
    if largest_azimuth > 360.0:
        return None
    fitting = [unit for unit in LENGTH_UNITS if is_usual_speed(speed * UNITS[unit])]
    fitting = other_units or fitting
    if not fitting and not degrees:
        return None
    offered = [*fitting, "m"]
    options = " ".join(f"--set units.{name}={offered[0]}" for name in names)
    shown = ", ".join(columns[name] for name in names)
    message = f"{shown}: no unit is named, and in m the usual speed would be {speed:.2g} m/s"
    if other_units:
        message += f", in {offered[0]} {speed * UNITS[offered[0]]:.2g} m/s"
    remedy = f"say {options}"
    if offered[1:]:
        remedy += f", or with another unit: {', '.join(offered[1:])}"
    if degrees:
        remedy += f"; or in degrees, {degrees}"
    return Place(sample.path, sample.first_line, 1, f"{message}: {remedy}")
