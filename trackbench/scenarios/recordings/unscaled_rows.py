"""Rows of a table whose units are unknown, and the displacements between them."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Index
from trackbench.core.latitude_longitude import SEMI_MAJOR_AXIS
from trackbench.scenarios.recordings.guess_errors import error_of_line
from trackbench.scenarios.recordings.unit_names_and_sizes import UNITS

MANY_STEPS = 20.0
"""Standard deviations of a position's error, from which on a displacement hardly shows this error."""


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


@dataclass(frozen=True)
class Displacements:
    """L displacements, each from one row to a later one."""

    first_row: Index
    """row (L,) in which each displacement begins"""
    last_row: Index
    """row (L,) in which it ends"""
    duration: Array
    """time (L,) between both rows, s"""
    vectors: Array
    """change (n, L) of the position, m"""
    usual_speed: float
    """median speed, m/s; NaN if nothing moved for sure"""
    sigma: float = 0.0
    """standard deviation of a position's error, m"""

    @classmethod
    def of_rows(cls, time: Array, meters: Array, many: float = MANY_STEPS) -> "Displacements":
        """Return displacements over so few rows that errors of the positions are just small beside them.

        ``time`` (R,) is in s, and ``meters`` (n, R) are the positions. The number of rows begins at 1,
        and is doubled until the median displacement is ``many`` standard deviations of a position's
        error. It is at most a quarter of all rows.
        """
        rows = np.array([], dtype=np.intp)
        if len(meters):
            rows = np.flatnonzero(np.isfinite(time) & np.isfinite(meters).all(axis=0))
        rows = rows[np.argsort(time[rows], kind="stable")]
        time = time[rows]
        meters = meters[:, rows]
        nothing = np.array([], dtype=np.intp)
        if len(rows) < 3:
            return cls(nothing, nothing, np.array([]), meters[:, :0], np.nan)
        sigma = float(np.hypot.reduce([error_of_line(time, axis) for axis in meters]))
        lag = 1
        while True:
            vectors = meters[:, lag:] - meters[:, :-lag]
            lengths = np.sqrt(np.square(vectors).sum(axis=0))
            if 2 * lag > max(1, len(rows) // 4) or np.median(lengths) > many * sigma:
                break
            lag *= 2
        duration = time[lag:] - time[:-lag]
        later = duration > 0.0
        speeds = lengths[later] / duration[later]
        # The long displacements must exceed the errors of positions, or nothing moves for sure.
        is_sure = later.any() and float(np.quantile(lengths, 0.9)) > 3.0 * sigma
        return cls(
            first_row=rows[:-lag][later],
            last_row=rows[lag:][later],
            duration=duration[later],
            vectors=vectors[:, later],
            usual_speed=float(np.median(speeds)) if is_sure else np.nan,
            sigma=sigma,
        )
