"""Jumps of place that no motion explains: the rows before and after may be those of two targets."""

from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.scenarios.recordings.guess_errors import error_of_line

_FEWEST = 5
"""rows before and after a jump; fewer may be outliers"""
_MOST_JUMPS = 10
"""more are those of a table of mixed rows, which are asked about otherwise"""
_FASTER = 2.5
"""times as fast as ever before and after, that a jump must be"""
_SIGMAS = 20.0
"""standard deviations of a position, that a jump must be long"""
_FASTEST_AT_REST = 60.0
"""m/s that something may have had in a pause, if it hardly moves before and after"""


class Jump(NamedTuple):
    """Jump between two neighboring rows of one run."""

    row: int
    """the row after the jump"""
    distance: float
    duration: float
    times_as_fast: float
    """ratio of its speed to the largest one before and after"""


def unexplained_jump(time: Array, places: Array) -> Jump | None:
    """Return the first jump of a run that no motion explains; None without one.

    ``time`` (R,) is in order, ``places`` (2, R) are in meters. The rows before and after a jump must go
    on where it ends, so that outliers are none, and the jump must need a speed that is several times the
    largest one of these rows over ways that last as long as the jump, or as long as there are rows.
    """
    distances = np.hypot(*np.diff(places, axis=1))
    durations = np.diff(time)
    moving = durations > 0.0
    if moving.sum() < 2 * _FEWEST:
        return None
    sigma = float(np.hypot(error_of_line(time, places[0]), error_of_line(time, places[1])))
    usual_interval = float(np.median(durations[moving]))
    # Step 1: candidates are many times as long as the usual way from row to row.
    usual = float(np.median(distances[moving]))
    candidates = np.flatnonzero(distances > np.maximum(10.0 * usual, _SIGMAS * sigma))
    if not 0 < len(candidates) <= _MOST_JUMPS:
        return None
    # Step 2: compare each with the rows on both sides, up to the next candidate.
    bounds = np.concatenate([[-1], candidates, [len(distances)]])
    for number, candidate in enumerate(candidates.tolist(), 1):
        parts = [
            slice(int(bounds[number - 1]) + 1, candidate + 1),
            slice(candidate + 1, int(bounds[number + 1]) + 1),
        ]
        if any(part.stop - part.start < _FEWEST for part in parts):
            continue
        duration = max(float(durations[candidate]), usual_interval)
        speeds = [_largest_speed(time[part], places[:, part], duration) for part in parts]
        largest = max(speeds)
        # What hardly moves shows no speed but that of its errors.
        span = min(duration, max(float(np.ptp(time[part])) for part in parts))
        if largest * span < _SIGMAS * sigma:
            largest = max(largest, _FASTEST_AT_REST / _FASTER)
        needed = (distances[candidate] - _SIGMAS * sigma) / duration
        if needed > _FASTER * largest:
            speed = float(distances[candidate]) / duration
            return Jump(
                row=candidate + 1,
                distance=float(distances[candidate]),
                duration=duration,
                times_as_fast=speed / max(*speeds, 1e-9),
            )
    return None


def _largest_speed(time: Array, places: Array, duration: float) -> float:
    """Return the largest speed over ways that last at least ``duration``, or a third of the rows."""
    lasting = min(duration, float(time[-1] - time[0]) / 3.0)
    first = np.arange(len(time))
    last = np.searchsorted(time, time + lasting, side="left")
    # A way has at least one interval, and ends within the part.
    last = np.maximum(last, first + 1)
    inside = last < len(time)
    first = first[inside]
    last = last[inside]
    lengths = time[last] - time[first]
    known = lengths > 0.0
    if not known.any():
        return 0.0
    ways = np.hypot(*(places[:, last] - places[:, first]))
    return float((ways[known] / lengths[known]).max())
