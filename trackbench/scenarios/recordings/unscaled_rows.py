"""Rows of a table whose units are unknown, and a candidate for these units."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.latitude_longitude import SEMI_MAJOR_AXIS
from trackbench.scenarios.recordings.unit_names_and_sizes import UNITS


class PossibleFormat(NamedTuple):
    """One of several possible formats of dates."""

    factor: float
    """factor on the times that were read by another format, such as 1/60 for min:s read as h:min"""
    penalty: float
    """how unlikely the format is"""


@dataclass(frozen=True, kw_only=True)
class UnscaledRows:
    """Rows of one target as they are written: the units of their numbers are unknown.

    A file measures a velocity, or a speed and perhaps a course, or none of them.
    """

    time: Array
    """times (R,), in seconds if they are dates"""
    is_dated: bool
    """True if times are dates or numbers of steps, which need no unit"""
    position: Array
    """longitude and latitude or x and y (2, R), or ranges (n, R); (0, R) without a position"""
    is_geodetic: bool
    """True if columns are named as longitude and latitude"""
    speed: Array | None = None
    """speeds (R,)"""
    course: Array | None = None
    """directions of movement (R,), clockwise from north"""
    velocity: Array | None = None
    """velocities (2, R) along x and y"""
    plain_column_names: frozenset[str] = frozenset()
    """names of all columns of the file, in small letters without marks"""
    least_decimals: int = 0
    """digits behind the decimal point, in the coordinate that has the fewest"""


def positions_in_meters(position: Array, unit: str, as_geodetic: bool) -> Array:
    """Return positions (n, R) in meters; the given ones are in ``unit``.

    If they are longitude and latitude (``as_geodetic``), they become meters east and north on a sphere,
    with the scale of the median latitude.
    """
    if not as_geodetic:
        return position * UNITS[unit]
    longitude, latitude = position * UNITS[unit]
    median_latitude = 0.0
    if np.isfinite(latitude).any():
        median_latitude = float(np.nanmedian(latitude))
    # Longitudes relative to the first one, within half a turn: 179 and -179 deg are 2 deg apart.
    first_longitude = 0.0
    known = longitude[np.isfinite(longitude)]
    if len(known):
        first_longitude = float(known[0])
    east = np.remainder(longitude - first_longitude + np.pi, 2.0 * np.pi) - np.pi
    return SEMI_MAJOR_AXIS * np.stack([east * np.cos(median_latitude), latitude])


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """One choice of units for a table; empty texts stand for quantities without a unit."""

    time_unit: str
    """unit of numbers; of dates their format, which is empty for the format already known"""
    position_unit: str
    as_geodetic: bool
    """True if positions are read as longitude and latitude"""
    speed_unit: str
    course_unit: str
    penalty: float
    """how unlikely the choice is: the least penalty is best"""
    usual_speed: float
    """median speed of the positions in these units, m/s"""
    speed_agrees: bool
    """True if a measured speed is that of the positions"""
    course_agrees: bool
    """True if a measured course, or velocity, has the direction in which the positions change"""
    seconds_per_unit: float = 1.0
    """factor from the times as they were read to seconds, such as 1/60 for min:s read as h:min"""

    @property
    def key(self) -> tuple[str, str]:
        """Units of time and position: of several candidates with these only the best one is kept."""
        return self.time_unit, self.position_unit

    @property
    def explanation(self) -> str:
        """Comment for the config that explains why these units were chosen."""
        if self.speed_agrees:
            return "times, positions and speeds agree"
        if np.isfinite(self.usual_speed):
            return f"the usual speed is {self.usual_speed:.2g} m/s"
        return "as large as its numbers are"
