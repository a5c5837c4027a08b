"""Check whether truth and measurements of a recording agree, or one is mirrored or turned."""

from collections.abc import Sequence

import numpy as np

from trackbench.core.arrays import Array, Index
from trackbench.models.sensors.base import Sensors, rows_of, sensors_of

_BEYOND = 10.0
"""standard deviations of a measurement's error from the truth"""
_MOST_BEYOND = 0.8
"""share of the measurements that may be that far from the truth, as outliers are"""
_AGREES = 0.2
"""of the median distance that remains if a mirror image or a turn explains it"""
_AZIMUTHS = ("azimuth", "bearing")
_FEWEST = 10
_MOST_STEPS = 200
_WAYS = {
    "mirrored at the diagonal x = y": ((0, 1), (1, 0)),
    "mirrored at the x axis": ((1, 0), (0, -1)),
    "mirrored at the y axis": ((-1, 0), (0, 1)),
    "mirrored at the diagonal x = -y": ((0, -1), (-1, 0)),
    "turned by 90 deg": ((0, -1), (1, 0)),
    "turned by 180 deg": ((-1, 0), (0, -1)),
    "turned by 270 deg": ((0, 1), (-1, 0)),
}
"""Changes of the truth's x and y: the symmetries of a square."""
_ANGLES = {
    "from north clockwise": (-1.0, 0.5 * np.pi),
    "from x clockwise": (-1.0, 0.0),
    "from north to west": (1.0, 0.5 * np.pi),
    "from the opposite direction": (1.0, np.pi),
}
"""Other ways to count an azimuth: the sign of the measured angle, and what is added to it."""


def contradictions(
    sensor: Sensors, components: Sequence[str], truth: Array, measurements: Array, steps: Index
) -> list[str]:
    """Describe each sensor whose measurements (n_z, K, M) contradict the truth (n_x, K, M).

    The text names the reflection, turn or other way to count angles with which both would agree, if
    there is one. ``components`` are those of the truth, ``steps`` the numbers of the K steps.
    """
    axes = _axes_of(components)
    if axes is None:
        return []
    # Step 1: a sample of the steps with a truth.
    row_of_x, _ = axes[0]
    known = np.flatnonzero(np.isfinite(truth[row_of_x]).any(axis=-1))
    chosen = known[np.linspace(0, len(known) - 1, min(len(known), _MOST_STEPS)).astype(int)]
    texts = []
    sensors = sensors_of(sensor)
    distances = _distances(sensor, truth, measurements, steps, chosen)
    # Step 2: sensors of which nearly every measurement is many standard deviations from the truth.
    suspects = []
    for number, sensor_rows in enumerate(rows_of(sensor)):
        sizes = _largest_distances(distances[sensor_rows])
        if len(sizes) >= _FEWEST and (sizes > _BEYOND).mean() > _MOST_BEYOND:
            suspects.append((number, sensor_rows, float(np.median(sizes))))
    if not suspects:
        return []
    # Step 3: the other way to count angles, or the reflection or turn, with which they agree.
    for number, sensor_rows, size in suspects:
        rows = range(len(sensor.components))[sensor_rows]
        # A component of several sensors has the sensor's number before its name: 2.azimuth.
        angles = [row for row in rows if sensor.components[row].rpartition(".")[2] in _AZIMUTHS]
        remaining = {}  # median distance by each way
        if angles:
            for way, (sign, offset) in _ANGLES.items():
                recounted = measurements.copy()
                recounted[angles] = sign * measurements[angles] + offset
                changed_distances = _distances(sensor, truth, recounted, steps, chosen)
                remaining[way] = _median_distance(changed_distances[sensor_rows])
        else:
            for way, matrix in _WAYS.items():
                changed = _transform(truth, axes, matrix)
                changed_distances = _distances(sensor, changed, measurements, steps, chosen)
                remaining[way] = _median_distance(changed_distances[sensor_rows])
        way = min(remaining, key=lambda name: remaining[name])
        name = f"sensor {number + 1}" if len(sensors) > 1 else "the sensor"
        what = f"the truth is beyond nearly every measurement of {name}"
        what += f" (median: {size:.0f} standard deviations)"
        if remaining[way] > _AGREES * size:
            texts.append(f"{what}: check the origin, the units, the clock and the sensor's sigma")
        elif angles:
            angle = sensor.components[angles[0]].rpartition(".")[2]
            hint = ""
            if way == "from north clockwise":
                hint = f": say `clockwise: [{angle}]`"
            texts.append(f"{what}; they agree if its {angle} counts {way}{hint}")
        else:
            hint = "are x and y exchanged, or an axis reversed?"
            texts.append(f"{what}; they agree if the truth is {way}: {hint}")
    return texts


def _axes_of(components: Sequence[str]) -> tuple[tuple[int, int], ...] | None:
    """Return the rows of x and y, and of their velocities, in a state; None if it has no position.

    The first pair is that of the position.
    """
    if not {"px", "x"} & {*components}:
        return None
    axes = []
    for x, y in (("px", "py"), ("x", "y"), ("vx", "vy")):
        if x in components and y in components:
            axes.append((components.index(x), components.index(y)))
    return tuple(axes) or None


def _transform(
    truth: Array, axes: tuple[tuple[int, int], ...], matrix: tuple[tuple[int, int], ...]
) -> Array:
    """Multiply each pair of axes of the truth (n_x, K, M) by a matrix (2, 2)."""
    (a, b), (c, d) = matrix
    changed = truth.copy()
    for i, j in axes:
        changed[i] = a * truth[i] + b * truth[j]
        changed[j] = c * truth[i] + d * truth[j]
    return changed


def _distances(
    sensor: Sensors, truth: Array, measurements: Array, steps: Index, chosen: Index
) -> Array:
    """Compute ``|z - h(x)| / sigma`` (n_z, N) of the chosen steps of all runs; NaN where unknown.

    The other arguments are those of `contradictions`.
    """
    distances = []
    with np.errstate(all="ignore"):
        for i in chosen.tolist():
            predicted = sensor.measurement(truth[:, i], int(steps[i]))
            error = sensor.innovation(measurements[:, i], predicted.mean)
            variance = np.einsum("ii...->i...", predicted.cov)
            if variance.ndim == 1:  # one for all runs
                variance = variance[:, None]
            distances.append(np.abs(error) / np.sqrt(variance))
    return np.concatenate(distances, axis=-1)


def _largest_distances(distances: Array) -> Array:
    """Return the largest known distance of each measurement, of distances (n, N) of its components."""
    largest = np.nanmax(np.where(np.isfinite(distances), distances, -1.0), axis=0)
    return np.asarray(largest[largest >= 0.0])


def _median_distance(distances: Array) -> float:
    """Return the median of each measurement's largest distance; infinite without any."""
    sizes = _largest_distances(distances)
    if not len(sizes):
        return np.inf
    return float(np.median(sizes))
