"""Note on a sensor of positions that lies far from the first one, with the likely cause."""

from collections.abc import Sequence

import numpy as np

from trackbench.core.arrays import Array
from trackbench.models.sensors.stacked import sensor_name
from trackbench.scenarios.recordings.errors_from_neighbors import error_of_line
from trackbench.scenarios.recordings.quantity_keys import PLACE, plain_name
from trackbench.scenarios.recordings.rows_and_reading_context import Rows, in_kilometers
from trackbench.scenarios.recordings.velocity_check import FEWEST_ROWS

_BEYOND = 10.0
"""standard deviations of the difference of two sensors' positions, from which on they disagree"""
_BEYOND_LINE = 5.0
"""the same in errors of a line between neighboring rows of the first sensor"""
_MOST_REMAINING = 0.2
"""of the median distance of two sensors that remains if a change explains it"""
_LONGEST_GAP = 2.5
"""usual intervals between two rows, up to which positions are interpolated"""
_DELAYS = 40
"""delays of either sign that are tried"""
_LONGEST_DELAY = 120.0
"""s"""
_CHANGED_AXES = {
    "if x and y of one of them are exchanged": ((0.0, 1.0), (1.0, 0.0)),
    "if x of one of them has the other sign": ((-1.0, 0.0), (0.0, 1.0)),
    "if y of one of them has the other sign": ((1.0, 0.0), (0.0, -1.0)),
}
"""Changes of a position by a matrix."""

_MOST_COMPARED = 2_000
"""evenly spaced rows by which the positions of two sensors are compared"""


def note_on_places(
    components: Sequence[Sequence[str]],
    sigmas: Sequence[float],
    rows: Sequence[Rows],
    names: Sequence[str],
) -> list[str]:
    """Return a text on each sensor of positions that lies far from the first one, with the likely cause.

    ``components`` and ``sigmas``, m, are those of each sensor, ``rows`` its rows in order of run and
    time, and ``names`` the sensors' names if they have any. Only the first run counts.
    """
    placing = []
    for number, each in enumerate(components):
        if tuple(map(plain_name, each)) == PLACE and len(rows[number].run):
            placing.append(number)
    if len(placing) < 2:
        return []
    texts = []
    first, *others = placing
    run = min(int(rows[number].run.min()) for number in placing)
    base = rows[first].at(np.flatnonzero(rows[first].run == run))
    # Standard deviation of a row of the first sensor from the line between its neighbors: positions
    # between its rows, which are interpolated, have about this error.
    error_x, error_y = (error_of_line(base.time, axis) for axis in base.values)
    error = float(np.hypot(error_x, error_y))
    for number in others:
        of_run = np.flatnonzero(rows[number].run == run)
        every = 1 + len(of_run) // _MOST_COMPARED
        other = rows[number].at(of_run[::every])
        sigma = float(np.hypot(sigmas[first], sigmas[number]))
        limit = max(_BEYOND * sigma, _BEYOND_LINE * error)
        distance = distance_from(base, other.time, other.values)
        if not (np.isfinite(sigma) and distance > limit):
            continue
        whose = f"{sensor_name(first, names)} and {sensor_name(number, names)}"
        text = f"positions of {whose} lie {in_kilometers(distance)} apart (median)"
        cause = _cause_of_distance(base, other, _MOST_REMAINING * distance)
        texts.append(f"{text}{cause or ': check their units, clocks and origins'}")
    return texts


def distance_from(base: Rows, time: Array, positions: Array) -> float:
    """Return the median distance of positions (2, R) from those of ``base`` at ``time`` (R,), m.

    The latter are interpolated between neighboring rows. The distance is NaN if there are too few rows.
    """
    known = np.flatnonzero(np.isfinite(base.values).all(axis=0))
    of_base = base.time[known]
    if len(of_base) < FEWEST_ROWS:
        return np.nan
    after = np.clip(np.searchsorted(of_base, time), 1, len(of_base) - 1)
    gap = of_base[after] - of_base[after - 1]
    is_inside = (time >= of_base[0]) & (time <= of_base[-1])
    is_inside &= gap <= _LONGEST_GAP * np.median(np.diff(of_base))
    is_inside &= np.isfinite(positions).all(axis=0)
    if is_inside.sum() < FEWEST_ROWS:
        return np.nan
    at_time = np.stack([np.interp(time, of_base, axis[known]) for axis in base.values])
    return float(np.median(np.hypot(*(positions - at_time)[:, is_inside])))


def _cause_of_distance(base: Rows, other: Rows, most: float) -> str:
    """Return the end of a note with the change by which two sensors' positions agree; empty without one.

    After the change their median distance must be at most ``most``, m.
    """
    remaining: dict[str, float] = {}
    for change, matrix in _CHANGED_AXES.items():
        changed = np.array(matrix) @ other.values
        remaining[change] = distance_from(base, other.time, changed)
    # A delay, by a coarse search and a fine one between the neighbors of the best.
    interval = float(np.median(np.diff(base.time)))
    span = max(_LONGEST_DELAY, 10.0 * interval)
    delays = np.linspace(-span, span, 2 * _DELAYS + 1)
    distances = [distance_from(base, other.time - delay, other.values) for delay in delays.tolist()]
    if np.isfinite(distances).any():
        best = int(np.nanargmin(distances))
        step = delays[1] - delays[0]
        delays = np.linspace(delays[best] - step, delays[best] + step, _DELAYS)
        distances = [
            distance_from(base, other.time - delay, other.values) for delay in delays.tolist()
        ]
        best = int(np.nanargmin(distances))
        delay = float(delays[best])
        direction = "behind" if delay > 0.0 else "ahead of"
        words = f"if the second is some {abs(delay):.2g} s {direction} the first"
        remaining[words] = distances[best]
    # A constant distance.
    at_base = np.stack([np.interp(other.time, base.time, axis) for axis in base.values])
    x, y = np.nanmedian(at_base - other.values, axis=1).tolist()
    moved = other.values + np.array([[x], [y]])
    remaining[f"if the second is moved by [{x:.3g}, {y:.3g}] m"] = distance_from(
        base, other.time, moved
    )
    fitting = {change: left for change, left in remaining.items() if left <= most}
    if not fitting:
        return ""
    return f"; they agree {min(fitting, key=lambda change: fitting[change])}"
