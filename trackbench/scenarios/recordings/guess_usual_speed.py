"""Guess of the usual speed of what moves, from which sigma_velocity is taken."""

from collections.abc import Sequence

import numpy as np

from trackbench.core.arrays import Array


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
