"""Positions and velocities along east, north and up of origins, from latitudes and longitudes."""

from collections.abc import Sequence
from math import pi
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Index, Mask
from trackbench.core.latitude_longitude import Geodetic, east_north_up, rotate_east_north_up


class Frame(NamedTuple):
    """Rows of a table whose positions count from one origin."""

    origin: tuple[float, ...]
    """latitude and longitude, deg, and perhaps height, m"""
    rows: Index
    """indices of the rows in the table"""

    @property
    def position(self) -> Geodetic:
        """Position of the origin, in rad and m."""
        latitude, longitude = self.origin[:2]
        height = self.origin[2] if len(self.origin) > 2 else 0.0
        return Geodetic(
            latitude=np.asarray(latitude * pi / 180.0),
            longitude=np.asarray(longitude * pi / 180.0),
            height=np.asarray(height),
        )


def positions_in_frames(positions: Geodetic, frames: Sequence[Frame]) -> Array:
    """Return positions (3, R), m, along east, north and up of each frame's origin; NaN if unknown."""
    enu = np.full((3, len(positions.latitude)), np.nan)
    for frame in frames:
        known, finite = _known_positions(positions, frame.rows)
        enu[:, frame.rows] = np.where(finite, east_north_up(known, frame.position), np.nan)
    return enu


def velocities_in_frames(velocities: Array, positions: Geodetic, frames: Sequence[Frame]) -> Array:
    """Return velocities (3, R) along east, north and up of each frame's origin.

    The given ones are along those of each row's own position, one of ``positions``. They stay as they
    are where it is unknown.
    """
    turned = velocities.copy()
    for frame in frames:
        known, finite = _known_positions(positions, frame.rows)
        local = turned[:, frame.rows]
        rotated = rotate_east_north_up(local, known, frame.position)
        turned[:, frame.rows] = np.where(finite, rotated, local)
    return turned


def _known_positions(positions: Geodetic, rows: Index) -> tuple[Geodetic, Mask]:
    """Return the positions (R,) of the R rows with these indices, and a mask (R,) of the known ones.

    Unknown positions are zero, and the caller does not use what it computes from them.
    """
    finite = np.isfinite(positions.latitude[rows])
    known = Geodetic(
        latitude=np.where(finite, positions.latitude[rows], 0.0),
        longitude=np.where(finite, positions.longitude[rows], 0.0),
        height=np.where(finite, positions.height[rows], 0.0),
    )
    return known, finite


def filled_positions(positions: Geodetic, runs: Index) -> Geodetic:
    """Return the positions, with that of the last known row of the same run where one is unknown.

    If no row before has a position, it is that of the next row with one. ``runs`` (R,) are the numbers
    of the rows' runs.
    """
    known = np.isfinite(positions.latitude)
    if known.all():
        return positions
    # Step 1: order the rows by run. Find the last known row up to each one, and the first one from it
    # on.
    order = np.argsort(runs, kind="stable")
    number = np.arange(len(order))
    is_known = known[order]
    before = np.maximum.accumulate(np.where(is_known, number, -1))
    after = np.minimum.accumulate(np.where(is_known, number, len(order))[::-1])[::-1]
    sorted_runs = runs[order]
    has_before = (before >= 0) & (sorted_runs[before] == sorted_runs)
    has_after = after < len(order)
    after = np.where(has_after, after, 0)
    has_after &= sorted_runs[after] == sorted_runs
    # Step 2: take the position from the row before, from the row after, or else the row's own, unknown
    # one.
    source = np.where(has_before, before, np.where(has_after, after, number))
    nearest = np.empty(len(order), dtype=np.intp)
    nearest[order] = order[source]
    return Geodetic(*(values[nearest] for values in positions))
