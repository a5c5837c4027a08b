"""Check whether recorded velocities agree with the movement of positions."""

from collections.abc import Sequence

import numpy as np

from trackbench.core.arrays import Array
from trackbench.scenarios.recordings.compare_courses_with_movement import is_nearer, median_cosine
from trackbench.scenarios.recordings.guess_speed_unit import SPEED_UNITS
from trackbench.scenarios.recordings.guess_usual_speed_and_acceleration import Displacements
from trackbench.scenarios.recordings.quantity_keys import PLACE, VELOCITY, plain_name
from trackbench.scenarios.recordings.rows_and_reading_context import Rows, values_of_nearest_rows
from trackbench.scenarios.recordings.unit_names_and_sizes import UNITS

FEWEST_ROWS = 10
"""displacements that show a velocity"""
MOST_ROWS = 20_000
"""first rows by which velocities are compared with positions"""
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


def velocity_note(
    whose: str,
    time: Array,
    positions: Array,
    velocities: Array,
    largest_ratio: float = _LARGEST_RATIO,
    least_cosine: float = _LEAST_COSINE,
) -> list[str]:
    """Return a text, in a list, if velocities contradict the movement of positions; else an empty list.

    ``time`` (R,) is in s, ``positions`` (2, R) are in m and ``velocities`` (2, R) in m/s, NaN where they
    are missing. ``whose`` are words for the velocities. They contradict if one of both speeds is
    ``largest_ratio`` times the other or more, or if the cosine between both directions is below
    ``least_cosine``. Nothing is noted if the positions hardly move.
    """
    known = np.flatnonzero(np.isfinite(positions).all(axis=0) & np.isfinite(velocities).all(axis=0))
    known = known[:MOST_ROWS]
    velocity = velocities[:, known]
    displacements = Displacements.of_rows(time[known], positions[:, known])
    if len(displacements.first_row) < FEWEST_ROWS or not np.isfinite(displacements.usual_speed):
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
    if is_moving.sum() < FEWEST_ROWS:
        return []
    ratio = float(np.median(measured[is_moving] / moved[is_moving]))
    if not 1.0 / largest_ratio < ratio < largest_ratio:
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
    if cosine < least_cosine:
        usual_angle = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
        message += f", usually by {usual_angle:.0f} deg"
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
        if (np.isfinite(positions) & np.isfinite(velocities)).all(axis=0).sum() > FEWEST_ROWS:
            return velocity_note("velocities of the truth", times, positions, velocities)
    return []


def note_on_measurements(components: Sequence[Sequence[str]], rows: Sequence[Rows]) -> list[str]:
    """Return a text if measured velocities contradict measured positions.

    Positions and velocities may have different times, such as those of messages of two types. Each
    position is compared with the velocity that is nearest in time. ``components`` are those of each
    sensor, and ``rows`` its rows in order of run and time. Only the first run counts.
    """
    of_kind: dict[tuple[str, ...], Rows] = {}
    for names, of_sensor in zip(components, rows, strict=True):
        plain = tuple(plain_name(name) for name in names)
        # The number of the first run is 0, as `chosen_runs` has numbered them anew.
        first_run = of_sensor.at(np.flatnonzero(of_sensor.run == of_sensor.run.min(initial=0)))
        of_kind.setdefault(plain, first_run)
    if PLACE not in of_kind or VELOCITY not in of_kind:
        return []
    place = of_kind[PLACE]
    velocity = of_kind[VELOCITY]
    known = np.flatnonzero(np.isfinite(place.values).all(axis=0))
    place = place.at(known[:MOST_ROWS])
    velocity = velocity.at(np.flatnonzero(velocity.time <= place.time.max(initial=-np.inf)))
    velocities = values_of_nearest_rows(place.time, velocity.time, velocity.values)
    return velocity_note("measured velocities", place.time, place.values, velocities)
