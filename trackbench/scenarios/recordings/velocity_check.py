"""Check whether recorded velocities and positions of several sensors agree with each other."""

from collections.abc import Sequence

import numpy as np

from trackbench.core.arrays import Array
from trackbench.models.sensors.stacked import sensor_name
from trackbench.scenarios.recordings.guess_course_unit import is_nearer, median_cosine
from trackbench.scenarios.recordings.guess_errors import error_of_line
from trackbench.scenarios.recordings.guess_jumps import first_return
from trackbench.scenarios.recordings.guess_speed_unit import SPEED_UNITS
from trackbench.scenarios.recordings.quantities import PLACE, VELOCITY, plain_name
from trackbench.scenarios.recordings.rows import Rows, in_kilometers
from trackbench.scenarios.recordings.units import UNITS
from trackbench.scenarios.recordings.unscaled_rows import Displacements

_FEWEST = 10
"""displacements that show a velocity"""
_MOST_ROWS = 20_000
"""first rows by which velocities are compared with positions"""
_MOST_COMPARED = 2_000
"""evenly spaced rows by which the positions of two sensors are compared"""
_LARGEST_RATIO = 1.5
"""ratio of measured speeds to those of the positions up to which nothing is noted"""
_NEAR = 0.05
"""share by which a ratio may differ from a unit"""
_LEAST_COSINE = 0.5
"""median cosine of both directions below which they differ whatever explains it"""
_SURE_COSINE = 0.98
"""median cosine from which on another direction explains the velocities"""
_MOST_ZERO = 0.1
"""share of the displacements that may have a velocity of 0 at both ends"""
_CHANGES = {
    "if vx and vy are exchanged": ((0.0, 1.0), (1.0, 0.0)),
    "if vx has the other sign": ((-1.0, 0.0), (0.0, 1.0)),
    "if vy has the other sign": ((1.0, 0.0), (0.0, -1.0)),
    "in the opposite direction": ((-1.0, 0.0), (0.0, -1.0)),
    "if vx and vy are exchanged and vx has the other sign": ((0.0, -1.0), (1.0, 0.0)),
    "if vx and vy are exchanged and vy has the other sign": ((0.0, 1.0), (-1.0, 0.0)),
}
"""Changes of a velocity by a matrix."""
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


def velocity_note(whose: str, time: Array, positions: Array, velocities: Array) -> list[str]:
    """Return a text, in a list, if velocities contradict the movement of positions; else an empty list.

    ``time`` (R,), s, is in order, ``positions`` (2, R) are in m and ``velocities`` (2, R) in m/s, NaN
    where they are missing. ``whose`` are words for the velocities. Nothing is noted if the positions
    hardly move.
    """
    known = np.flatnonzero(np.isfinite(positions).all(axis=0) & np.isfinite(velocities).all(axis=0))
    known = known[:_MOST_ROWS]
    velocity = velocities[:, known]
    displacements = Displacements.of_rows(time[known], positions[:, known])
    if len(displacements.first_row) < _FEWEST or not np.isfinite(displacements.usual_speed):
        return []
    first = displacements.first_row
    last = displacements.last_row
    # Step 1: compare the speed of each displacement with the mean of the measured ones at its ends.
    moved = np.hypot(*displacements.vectors) / displacements.duration
    speed = np.hypot(*velocity)
    measured = 0.5 * (speed[first] + speed[last])
    is_moving = moved >= 0.5 * np.median(moved)
    share_of_zero = float((measured[is_moving] == 0.0).mean())
    if share_of_zero > _MOST_ZERO:
        message = f"{whose} are 0 in {100.0 * share_of_zero:.0f} % of the rows where positions move"
        return [f"{message}: empty these cells if nothing was measured"]
    is_moving &= measured > 0.0
    if is_moving.sum() < _FEWEST:
        return []
    ratio = float(np.median(measured[is_moving] / moved[is_moving]))
    if not 1.0 / _LARGEST_RATIO < ratio < _LARGEST_RATIO:
        message = f"{whose} are {float(f'{ratio:.2g}'):g} times as fast as the positions move"
        for unit in SPEED_UNITS:
            if unit != "m/s" and abs(ratio * UNITS[unit] - 1.0) < _NEAR:
                return [f"{message}: are they in {unit}? See `units`"]
        return [f"{message}: check their unit, and those of positions and times (`units`)"]
    # Step 2: compare the directions.
    cosine = median_cosine(velocity, displacements)
    cosines = {
        change: median_cosine(np.array(matrix) @ velocity, displacements)
        for change, matrix in _CHANGES.items()
    }
    best = max(cosines, key=lambda change: cosines[change])
    message = f"{whose} have other directions than the positions move in"
    if cosines[best] >= _SURE_COSINE and is_nearer(cosines[best], cosine):
        return [f"{message}; they agree {best}"]
    if cosine < _LEAST_COSINE:
        return [f"{message}: check their columns, units and signs"]
    return []


def note_on_truth(components: Sequence[str], truth: Array, times: Array) -> list[str]:
    """Return a text if the velocities of a truth (n_x, K, M) contradict its positions.

    ``components`` are those of its states, and ``times`` (K,) are in s. The first run with both decides.
    """
    names = {plain_name(name): row for row, name in enumerate(components)}
    if not names.keys() >= {*PLACE, *VELOCITY}:
        return []
    position = np.array([names[name] for name in PLACE])
    velocity = np.array([names[name] for name in VELOCITY])
    for run in range(truth.shape[2]):
        positions = truth[position, :, run]
        velocities = truth[velocity, :, run]
        if (np.isfinite(positions) & np.isfinite(velocities)).all(axis=0).sum() > _FEWEST:
            return velocity_note("velocities of the truth", times, positions, velocities)
    return []


def note_on_measurements(components: Sequence[Sequence[str]], rows: Sequence[Rows]) -> list[str]:
    """Return a text if measured velocities contradict measured positions of the same times.

    ``components`` are those of each sensor, and ``rows`` its rows in order of run and time. Only the
    first run counts.
    """
    of_kind: dict[tuple[str, ...], Rows] = {}
    for names, of_sensor in zip(components, rows, strict=True):
        plain = tuple(plain_name(name) for name in names)
        first_run = of_sensor.at(np.flatnonzero(of_sensor.run == of_sensor.run.min(initial=0)))
        of_kind.setdefault(plain, first_run)
    if PLACE not in of_kind or VELOCITY not in of_kind:
        return []
    place = of_kind[PLACE]
    velocity = of_kind[VELOCITY]
    _, of_place, of_velocity = np.intersect1d(place.ticks, velocity.ticks, return_indices=True)
    return velocity_note(
        "measured velocities",
        place.time[of_place],
        place.values[:, of_place],
        velocity.values[:, of_velocity],
    )


def note_on_returns(
    components: Sequence[Sequence[str]], rows: Sequence[Rows], names: Sequence[str]
) -> list[str]:
    """Return a text on each sensor whose positions jump to and fro, as those of several targets do.

    ``components`` are those of each sensor, ``rows`` its rows in order of run and time, and ``names``
    the sensors' names if they have any. Only the first rows of the first run count.
    """
    texts = []
    for number, (each, of_sensor) in enumerate(zip(components, rows, strict=True)):
        if tuple(map(plain_name, each)) != PLACE or not len(of_sensor.run):
            continue
        of_run = np.flatnonzero(of_sensor.run == of_sensor.run.min())[:_MOST_ROWS]
        positions = of_sensor.values[:, of_run]
        positions = positions[:, np.isfinite(positions).all(axis=0)]
        if first_return(positions) is None:
            continue
        whose = f" of {sensor_name(number, names)}" if len(components) > 1 else ""
        text = f"positions{whose} lie far from those of the row before and near earlier ones, again and"
        text += (
            " again: are they several targets? A column that names them is `columns: {run: NAME}`"
        )
        texts.append(text)
    return texts


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
    error_x, error_y = (error_of_line(base.time, axis) for axis in base.values)
    error = float(np.hypot(error_x, error_y))
    for number in others:
        of_run = np.flatnonzero(rows[number].run == run)
        every = 1 + len(of_run) // _MOST_COMPARED
        other = rows[number].at(of_run[::every])
        sigma = float(np.hypot(sigmas[first], sigmas[number]))
        limit = max(_BEYOND * sigma, _BEYOND_LINE * error)
        distance = _distance(base, other.time, other.values)
        if not (np.isfinite(sigma) and distance > limit):
            continue
        whose = f"{sensor_name(first, names)} and {sensor_name(number, names)}"
        text = f"positions of {whose} lie {in_kilometers(distance)} apart (median)"
        cause = _cause_of_distance(base, other, _MOST_REMAINING * distance)
        texts.append(f"{text}{cause or ': check their units, clocks and origins'}")
    return texts


def _distance(base: Rows, time: Array, positions: Array) -> float:
    """Return the median distance of positions (2, R) from those of ``base`` at ``time`` (R,), m.

    The latter are interpolated between neighboring rows. The distance is NaN if there are too few rows.
    """
    known = np.flatnonzero(np.isfinite(base.values).all(axis=0))
    of_base = base.time[known]
    if len(of_base) < _FEWEST:
        return np.nan
    after = np.clip(np.searchsorted(of_base, time), 1, len(of_base) - 1)
    gap = of_base[after] - of_base[after - 1]
    is_inside = (time >= of_base[0]) & (time <= of_base[-1])
    is_inside &= gap <= _LONGEST_GAP * np.median(np.diff(of_base))
    is_inside &= np.isfinite(positions).all(axis=0)
    if is_inside.sum() < _FEWEST:
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
        remaining[change] = _distance(base, other.time, changed)
    # A delay, by a coarse search and a fine one between the neighbors of the best.
    interval = float(np.median(np.diff(base.time)))
    span = max(_LONGEST_DELAY, 10.0 * interval)
    delays = np.linspace(-span, span, 2 * _DELAYS + 1)
    distances = [_distance(base, other.time - delay, other.values) for delay in delays.tolist()]
    if np.isfinite(distances).any():
        best = int(np.nanargmin(distances))
        step = delays[1] - delays[0]
        delays = np.linspace(delays[best] - step, delays[best] + step, _DELAYS)
        distances = [_distance(base, other.time - delay, other.values) for delay in delays.tolist()]
        best = int(np.nanargmin(distances))
        delay = float(delays[best])
        direction = "behind" if delay > 0.0 else "ahead of"
        words = f"if the second is some {abs(delay):.2g} s {direction} the first"
        remaining[words] = distances[best]
    # A constant distance.
    at_base = np.stack([np.interp(other.time, base.time, axis) for axis in base.values])
    x, y = np.nanmedian(at_base - other.values, axis=1).tolist()
    moved = other.values + np.array([[x], [y]])
    remaining[f"if the second is moved by [{x:.3g}, {y:.3g}] m"] = _distance(
        base, other.time, moved
    )
    fitting = {change: left for change, left in remaining.items() if left <= most}
    if not fitting:
        return ""
    return f"; they agree {min(fitting, key=lambda change: fitting[change])}"
