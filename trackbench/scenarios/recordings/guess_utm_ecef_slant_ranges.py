"""Questions on coordinates in other forms: degrees and minutes apart, UTM, ECEF and slant ranges.

Each of these tables would be read without an error, and give wrong positions.
"""

import re
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.guess_table_sample import TableSample
from trackbench.scenarios.recordings.recognize_column_names import (
    columns_of,
    shown_names,
    unit_of,
    words_of,
)
from trackbench.scenarios.recordings.unit_names_and_sizes import UNITS
from trackbench.scenarios.recordings.yaml_values import in_option

_RADII = (6.33e6, 6.43e6)
"""m: least and largest distance from the center of the Earth near its surface"""
_HIGHEST = 1.5e4
"""m: heights of aircraft and mountains are below"""
_ZONE = re.compile(r"[1-9]\d?[C-X]?", re.IGNORECASE)
_ELEVATIONS = ("elevation", "elev", "el", "depression", "elevationangle", "depressionangle")
_LARGEST_SHARE = 0.005
"""of a range that its component in the plane may be shorter"""


def check_split_angles(sample: TableSample, columns: Mapping[str, str]) -> None:
    """Raise DataError for a latitude or longitude whose minutes are in a column of their own.

    Its degrees then are whole numbers, and a column with a similar name has numbers from 0 to 60.
    ``columns`` are the columns by quantity.
    """
    for quantity in ("latitude", "longitude"):
        column = columns.get(quantity)
        degrees = sample.numbers(column) if column else np.array([])
        degrees = degrees[np.isfinite(degrees)]
        # Numbers beyond a turn are in a small unit, such as 1e-7 deg.
        if not len(degrees) or (degrees % 1.0).any() or np.abs(degrees).max() > 360.0:
            continue
        parts = []
        for name in sample.names:
            # The name of the minutes, such as lat_min, is one of the latitude, too, as units do not
            # count.
            is_similar = quantity in columns_of([name]) and name not in columns.values()
            numbers = sample.numbers(name) if is_similar else np.array([])
            numbers = numbers[np.isfinite(numbers)]
            if len(numbers) and ((numbers >= 0.0) & (numbers < 60.0)).all():
                parts.append(name)
        if parts:
            message = (
                f"{column} has whole degrees, and {' and '.join(parts)} the rest of the {quantity}"
            )
            remedy = f"write one column of decimal degrees, {column} + {parts[0]} / 60"
            if len(parts) > 1:
                remedy += f" + {parts[1]} / 3600"
            raise DataError(Place(sample.path, sample.first_line, 1, f"{message}: {remedy}"))


def explain_ecef(names: Sequence[str]) -> str:
    """Return the message on columns that are named ECEF, and the advice; empty if there are none."""
    if not any("ecef" in "".join(words_of(name)) for name in names):
        return ""
    message = "coordinates from the center of the Earth (ECEF) are not read; there are"
    remedy = "convert them to latitude and longitude (EPSG:4978 to EPSG:4326)"
    return f"{message} {shown_names(names)}: {remedy}"


def check_earth_centered(
    sample: TableSample, columns: Mapping[str, str], units: Mapping[str, str]
) -> None:
    """Raise DataError if x and y, with a further column z, count from the center of the Earth.

    Their distance from the center is then the radius of the Earth. Each column with a letter z in its
    name is tried, as this radius hardly occurs by chance. ``columns`` and ``units`` are by quantity;
    without a unit m, km, cm and mm are tried.
    """
    if not columns.keys() >= {"x", "y"}:
        return
    x = sample.numbers(columns["x"])
    y = sample.numbers(columns["y"])
    scales = [UNITS[units["x"]]] if "x" in units else [1.0, 1e3, 1e-2, 1e-3]
    for name in sample.names:
        if name in columns.values() or "z" not in "".join(words_of(name)):
            continue
        z = sample.numbers(name)
        radius = np.sqrt(np.square(x) + np.square(y) + np.square(z))
        known = np.isfinite(radius)
        if known.sum() < 3:
            continue
        for scale in scales:
            median_radius = float(np.median(radius[known])) * scale
            # Northings of a map's grid may be as large; then z is a height.
            is_height = float(np.median(np.abs(z[known]))) * scale < _HIGHEST
            if _RADII[0] <= median_radius <= _RADII[1] and not is_height:
                names = f"{columns['x']}, {columns['y']} and {name}"
                message = (
                    f"{names} count from the center of the Earth, {median_radius / 1e3:.0f} km away"
                )
                remedy = "convert them to latitude and longitude (EPSG:4978 to EPSG:4326)"
                raise DataError(Place(sample.path, sample.first_line, 1, f"{message}: {remedy}"))


def check_zones(
    sample: TableSample, columns: Mapping[str, str], user_columns: Collection[str]
) -> None:
    """Raise DataError if x and y are those of several zones of UTM, which have no plane in common.

    A column then names the zones. ``columns`` are the columns by quantity. There is no error if the user
    named the column of the runs, so that ``user_columns`` has ``run``.
    """
    if not columns.keys() >= {"x", "y"} or "run" in user_columns:
        return
    for name in sample.names:
        zones = sample.words(name)
        if "zone" not in words_of(name) or len(zones) < 2:
            continue
        # Without a name or a letter of UTM a zone may be an area, such as a part of a town.
        is_utm = "utm" in words_of(name) or {*words_of(columns["x"])} & {"east", "easting"}
        has_letters = all(zone[-1:].isalpha() for zone in zones)
        if all(map(_ZONE.fullmatch, zones)) and (is_utm or has_letters):
            message = (
                f"{name} has {', '.join(zones[:4])}: each zone counts from a meridian of its own"
            )
            remedy = "convert all rows to one zone or to latitude and longitude"
            option = f"--set 'columns.run={in_option(name)}' makes each zone a run"
            # The second zone is the one that cannot stand beside the first.
            line = sample.line_of(name, zones[1:2])
            raise DataError(Place(sample.path, line, 1, f"{message}; {remedy}; {option}"))


def check_slant_ranges(
    sample: TableSample,
    columns: Mapping[str, str],
    units: Mapping[str, str],
    user_columns: Collection[str],
) -> None:
    """Raise DataError if elevations show that ranges are longer than distances in the plane.

    ``columns`` and ``units`` are by quantity. There is no error if the user named the column of the
    range, so that ``user_columns`` has ``range``.
    """
    if not columns.keys() >= {"range", "azimuth"} or "range" in user_columns:
        return
    for name in sample.names:
        # The name without units, or its first word, must be one of elevations.
        words = [word for word in words_of(name) if word not in UNITS]
        if "".join(words) not in _ELEVATIONS and not {*words[:1]} & {*_ELEVATIONS}:
            continue
        elevation = np.abs(sample.numbers(name))
        elevation = elevation[np.isfinite(elevation)]
        if not len(elevation):
            continue
        unit = unit_of(name, "elevation") or sample.unit(name, "elevation")
        if unit is None and elevation.max() > 0.5 * np.pi:
            unit = "deg"
        unit = unit or units.get("azimuth", "deg")
        # r cos(elevation) is the distance in the plane.
        # It is no distance beyond 90 deg, where the share is 1 or more.
        share = 1.0 - float(np.cos(np.median(elevation) * UNITS[unit]))
        if not _LARGEST_SHARE < share < 1.0:
            continue
        column = in_option(columns["range"])
        message = (
            f"{name} usually is {np.median(elevation):.3g} {unit}, so that a slant range is longer"
        )
        message += f" by {100.0 * share:.2g} % than the distance in the plane"
        remedy = f"write {columns['range']} * cos({name}) into a column, or use the sensor"
        remedy += " range-azimuth-elevation"
        option = f"if ranges are along the ground, say --set 'columns.range={column}'"
        raise DataError(Place(sample.path, sample.first_line, 1, f"{message}: {remedy}; {option}"))
