"""Guess of the usual speed and acceleration of what moves, and which speeds are usual."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackbench.core.arrays import Array, Index
from trackbench.scenarios.recordings.errors_from_neighbors import error_of_line
from trackbench.scenarios.recordings.unscaled_rows import (
    Candidate,
    UnscaledRows,
    positions_in_meters,
)

MANY_STEPS = 20.0
"""Standard deviations of a position's error, from which on a displacement hardly shows this error."""

_USUAL_SPEEDS = ((0.05, 400.0, 0.0), (0.01, 3000.0, 1.0), (1e-3, 11200.0, 2.0))
"""Least and largest speed, m/s, and the penalty within; 4 beyond. 11.2 km/s leaves the Earth."""


def usual_speed(time: Array, *axes: Array) -> float:
    """Estimate the usual speed, m/s, as the median over stretches of a tenth of the rows.

    ``axes`` are the coordinates (R,) of the positions, m. Over such stretches their errors matter less
    than from row to row. The speed is 1 m/s for a single row.
    """
    lag = max(1, len(time) // 10)
    if len(time) <= lag:
        return 1.0
    distance = np.sqrt(np.sum([np.square(axis[lag:] - axis[:-lag]) for axis in axes], axis=0))
    duration = time[lag:] - time[:-lag]
    return float(np.median(distance[duration > 0] / duration[duration > 0]))


def joined_speed(speeds: Sequence[float]) -> float:
    """Return the usual speed for several files: that of the first one that shows one; else 1 m/s."""
    return next((speed for speed in speeds if speed), 1.0)


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


def usual_acceleration(unscaled: UnscaledRows, chosen: Candidate) -> float:
    """Return the upper quartile of the target's acceleration, m/s^2, less what errors may explain.

    It is 0 if nothing moves for sure, or if errors of the positions explain all of it. The positions are
    those of the ``unscaled`` rows in the ``chosen`` units. Displacements of three lengths are tried: at
    least 100, 400 and 1600 standard deviations of a position's error, unless a quarter of the rows has
    no such displacements. The largest acceleration is returned: errors of positions hide the
    acceleration of short displacements, and a path turns too often within long ones.
    """
    time = unscaled.time * chosen.seconds_per_unit
    meters = positions_in_meters(unscaled.position, chosen.position_unit, chosen.as_geodetic)
    largest = 0.0
    for times_as_long in (5.0, 20.0, 80.0):  # as those of `likely_units`
        displacements = Displacements.of_rows(time, meters, times_as_long * MANY_STEPS)
        if np.isfinite(displacements.usual_speed):
            # Displacements refer to rows by their indices in the table, whose number it takes.
            largest = max(largest, _sure_acceleration(displacements, rows=len(unscaled.time)))
    return largest


def _sure_acceleration(displacements: "Displacements", rows: int) -> float:
    """Return the upper quartile of the acceleration, m/s^2, less two standard deviations of its error.

    It is 0 if this is negative. ``displacements`` are those between some of the table's rows, whose
    number is ``rows``.
    """
    velocities = displacements.vectors / displacements.duration
    # Pairs of displacements: the second one begins in the row in which the first one ends.
    number_from_row = np.full(rows, -1)  # number of the displacement that begins in a row
    number_from_row[displacements.first_row] = np.arange(len(displacements.first_row))
    second = number_from_row[displacements.last_row]
    first = np.flatnonzero(second >= 0)
    second = second[first]
    if not len(second):
        return 0.0
    # a = (v_2 - v_1) / t, where t is the time between the middles of both displacements
    changes = np.hypot.reduce(velocities[:, second] - velocities[:, first])
    interval = 0.5 * (displacements.duration[second] + displacements.duration[first])
    # (z_2 - 2 z_1 + z_0) / t^2 has the standard deviation sqrt(6) sigma / t^2.
    error = np.sqrt(6.0) * displacements.sigma / float(np.median(interval)) ** 2
    return max(float(np.quantile(changes / interval, 0.75)) - 2.0 * error, 0.0)


def is_usual_speed(speed: float) -> bool:
    """Test whether most targets may have this usual speed, m/s: it is within 0.05 and 400 m/s."""
    least, largest, _ = _USUAL_SPEEDS[0]
    return least <= speed <= largest


def penalty_of_speed(speed: float, on_earth: bool) -> float:
    """Return the penalty of a usual speed, m/s, that few targets have.

    It is added to the other penalties of a choice of units. A choice remains possible if the sum is less
    than the margin of `likely_units`, 0.6, above that of the best one. If positions are x and y, not
    latitudes (``on_earth`` is False), slow targets such as cells, robots and pixels get 1 at most.
    """
    # Nothing moves, or not for sure (NaN), so that the speed speaks against no unit.
    if not np.isfinite(speed) or speed == 0.0:
        return 0.0
    penalty = 4.0  # of a speed beyond all usual ones
    for least, largest, penalty_within in _USUAL_SPEEDS:
        if least <= speed <= largest:
            penalty = penalty_within
            break
    if on_earth or speed > 1.0:
        return penalty
    return min(penalty, 1.0)
