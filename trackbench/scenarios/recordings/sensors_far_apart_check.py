"""Notes on sensors that contradict the positions of another one, with the likely cause."""

from collections.abc import Mapping, Sequence

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.models.base import LocatingSensor
from trackbench.models.sensors.stacked import Sensors, rows_of, sensor_name, sensors_of
from trackbench.scenarios.recordings.errors_from_neighbors import error_of_line
from trackbench.scenarios.recordings.quantity_keys import PLACE, plain_name
from trackbench.scenarios.recordings.rows_and_reading_context import Rows, in_kilometers
from trackbench.scenarios.recordings.truth_check import (
    contradictions,
    located_positions,
)
from trackbench.scenarios.recordings.truth_check_delays import StepClock
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


def note_on_sensors(
    sensor: Sensors,
    components: Sequence[str],
    measurements: Array,
    clock: StepClock,
    names: Sequence[str],
    clockwise: Sequence[bool],
    in_one_file: bool,
    scales: Sequence[Mapping[str, float]],
    geodetic: Sequence[bool],
) -> list[str]:
    """Return a text on each sensor whose measurements contradict the positions of another one.

    The first sensor of positions, or else the first radar, takes the place of a truth, between whose
    rows positions are interpolated. Further sensors of positions are compared by `note_on_places`.
    ``sensor`` has all sensors of the scenario, with ``measurements`` (n_z, K, M) at the K steps of
    ``clock``, and ``components`` are those of the state. ``names`` are the sensors' names if they have
    any, ``clockwise`` says of each whether its angles are read as clockwise ones, ``scales`` are the
    units of its quantities, in SI, and ``geodetic`` says whether its file has latitudes. ``in_one_file``
    is True if all sensors have one clock.
    """
    sensors = sensors_of(sensor)
    positions = [row for row, name in enumerate(components) if plain_name(name) in PLACE]
    # Step 1: choose the sensor whose positions take the place of a truth.
    placing = []
    locating = []
    for number, each in enumerate(sensors):
        if tuple(map(plain_name, each.components)) == PLACE:
            placing.append(number)
        if isinstance(each, LocatingSensor) and each.axes == len(PLACE) == len(positions):
            locating.append(number)
    chosen = [number for number in locating if number in placing] or locating
    if len(sensors) < 2 or not chosen:
        return []
    first = chosen[0]
    of_sensor = sensors[first]
    assert isinstance(of_sensor, LocatingSensor)
    rows = rows_of(sensor)
    z = measurements[rows[first]]
    measured = np.flatnonzero(np.isfinite(z).all(axis=0).any(axis=-1))
    if len(measured) < FEWEST_ROWS:
        return []
    # Step 2: interpolate its positions, and estimate their errors.
    located = located_positions(of_sensor, z[:, measured], clock.steps[measured])
    truth = np.full((len(components), *z.shape[1:]), np.nan)
    errors = []
    for run in range(z.shape[2]):
        known = np.isfinite(located[:, :, run]).all(axis=0)
        time = clock.times[measured][known]
        if len(time) < FEWEST_ROWS:
            continue
        is_inside = _is_between_near_rows(time, clock.times)
        for row, axis in zip(positions, located[:, known, run], strict=True):
            truth[row, is_inside, run] = np.interp(clock.times[is_inside], time, axis)
        # Between its rows, which a line connects, positions have about the error of a row from the line
        # between its neighbors. It contains the maneuvers of the target.
        error_x, error_y = (error_of_line(time, axis) for axis in located[:, known, run])
        errors.append(float(np.hypot(error_x, error_y)))
    if not errors:
        return []
    cov = of_sensor.located(z[:, measured[len(measured) // 2]], int(clock.steps[measured[0]])).cov
    variance = float(np.nanmedian(np.einsum("ii...->...", cov)))
    error = max(*errors, float(np.sqrt(variance)))
    # Step 3: compare the other sensors with them, as with a truth.
    others = measurements.copy()
    for number in {first, *placing}:
        others[rows[number]] = np.nan
    return contradictions(
        sensor,
        components,
        truth,
        others,
        clock,
        names=names,
        in_one_file=in_one_file,
        clockwise=clockwise,
        scales=scales,
        is_geodetic=geodetic[first],
        reference=f"the positions of {sensor_name(first, names)}",
        position_error=error if np.isfinite(error) else 0.0,
    )


def _is_between_near_rows(of_rows: Array, times: Array) -> Mask:
    """Return a mask (R,) of the ``times`` (R,) between rows at times ``of_rows`` that are near enough.

    Positions are interpolated there.
    """
    after = np.clip(np.searchsorted(of_rows, times), 1, len(of_rows) - 1)
    gap = of_rows[after] - of_rows[after - 1]
    is_inside: Mask = (times >= of_rows[0]) & (times <= of_rows[-1])
    is_inside &= gap <= _LONGEST_GAP * np.median(np.diff(of_rows))
    return is_inside


def distance_from(base: Rows, time: Array, positions: Array) -> float:
    """Return the median distance of positions (2, R) from those of ``base`` at ``time`` (R,), m.

    The latter are interpolated between neighboring rows. The distance is NaN if there are too few rows.
    """
    known = np.flatnonzero(np.isfinite(base.values).all(axis=0))
    of_base = base.time[known]
    if len(of_base) < FEWEST_ROWS:
        return np.nan
    is_inside = _is_between_near_rows(of_base, time)
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
