"""Truth and measurements of a recording that contradict each other: mirrored, turned, or elsewhere."""

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
    """Describe sensors whose measurements (n_z, K, M) are beyond the truth (n_x, K, M) at these steps.

    The text names the reflection or quarter turn with which they agree, or another way to count angles.
    """
    axes = _axes_of(components)
    if axes is None:
        return []
    # Step 1: a sample of the steps with a truth.
    known = np.flatnonzero(np.isfinite(truth[axes[0][0]]).any(axis=-1))
    chosen = known[np.linspace(0, len(known) - 1, min(len(known), _MOST_STEPS)).astype(int)]
    found = []
    parts = rows_of(sensor)
    sensors = sensors_of(sensor)
    as_it_is = _distances(sensor, truth, measurements, steps, chosen)
    # Step 2: sensors of which nearly every measurement is many standard deviations from the truth.
    suspects = []
    for number, part in enumerate(parts):
        largest = np.nanmax(np.where(np.isfinite(as_it_is[part]), as_it_is[part], -1.0), axis=0)
        sizes = largest[largest >= 0.0]
        if len(sizes) >= _FEWEST and (sizes > _BEYOND).mean() > _MOST_BEYOND:
            suspects.append((number, part, float(np.median(sizes))))
    if not suspects:
        return []
    # Step 3: the other way to count angles, or the reflection or turn, with which they agree.
    for number, part, size in suspects:
        rows = range(len(sensor.components))[part]
        angles = [row for row in rows if sensor.components[row].rpartition(".")[2] in _AZIMUTHS]
        rest = {}
        if angles:
            for way, (sign, more) in _ANGLES.items():
                counted = measurements.copy()
                counted[angles] = sign * measurements[angles] + more
                rest[way] = _median(_distances(sensor, truth, counted, steps, chosen)[part])
        else:
            for way, matrix in _WAYS.items():
                changed = _changed(truth, axes, matrix)
                rest[way] = _median(_distances(sensor, changed, measurements, steps, chosen)[part])
        way = min(rest, key=lambda name: rest[name])
        name = f"sensor {number + 1}" if len(sensors) > 1 else "the sensor"
        what = f"the truth is beyond nearly every measurement of {name}"
        what += f" (median: {size:.0f} standard deviations)"
        if rest[way] > _AGREES * size:
            found.append(f"{what}: check the origin, the units, the clock and the sensor's sigma")
        elif angles:
            angle = sensor.components[angles[0]].rpartition(".")[2]
            hint = f": say `clockwise: [{angle}]`" if way == next(iter(_ANGLES)) else ""
            found.append(f"{what}; they agree if its {angle} counts {way}{hint}")
        else:
            hint = "are x and y exchanged, or an axis reversed?"
            found.append(f"{what}; they agree if the truth is {way}: {hint}")
    return found


def _axes_of(components: Sequence[str]) -> tuple[tuple[int, int], ...] | None:
    """Find the rows of x and y among a state's components, and those of their velocities."""
    out = []
    for x, y in (("px", "py"), ("x", "y"), ("vx", "vy")):
        if x in components and y in components:
            out.append((components.index(x), components.index(y)))
    has_position = bool(out) and {"px", "x"} & {*components}
    return tuple(out) if has_position else None


def _changed(
    truth: Array, axes: tuple[tuple[int, int], ...], matrix: tuple[tuple[int, int], ...]
) -> Array:
    out = truth.copy()
    for i, j in axes:
        out[i] = matrix[0][0] * truth[i] + matrix[0][1] * truth[j]
        out[j] = matrix[1][0] * truth[i] + matrix[1][1] * truth[j]
    return out


def _distances(
    sensor: Sensors, truth: Array, measurements: Array, steps: Index, chosen: Index
) -> Array:
    """Compute ``|z - h(x)| / sigma`` (n_z, N) of the chosen steps of all runs; NaN where unknown."""
    out = []
    with np.errstate(all="ignore"):
        for i in chosen.tolist():
            predicted = sensor.measurement(truth[:, i], int(steps[i]))
            error = sensor.innovation(measurements[:, i], predicted.mean)
            variance = np.einsum("ii...->i...", predicted.cov)
            sigma = np.sqrt(variance if variance.ndim > 1 else variance[:, None])
            out.append(np.abs(error) / sigma)
    return np.concatenate(out, axis=-1)


def _median(distances: Array) -> float:
    """Return the median of each measurement's largest distance."""
    largest = np.nanmax(np.where(np.isfinite(distances), distances, -1.0), axis=0)
    sizes = largest[largest >= 0.0]
    return float(np.median(sizes)) if len(sizes) else np.inf
