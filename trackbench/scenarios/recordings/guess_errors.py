"""Errors and speeds that a recording shows, for a first try of filters."""

from collections.abc import Callable, Sequence

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.conversions import SEMI_MAJOR_AXIS
from trackbench.field_types import decimals
from trackbench.scenarios.recordings.column_mapping import UNITS, Naming
from trackbench.scenarios.recordings.csv_tables import number, parse_cells
from trackbench.scenarios.recordings.rows import Rows

SENSORS = {
    "landmark": ("range", "bearing"),
    "landmark-bearing": ("bearing",),
    "position": ("x", "y"),
    "range-azimuth": ("range", "azimuth"),
    "range": ("range",),
    "bearing": ("azimuth",),
}
"""Types of sensors that a table may hold, the most telling first, and what they measure.

A ``bearing`` counts from the heading of what moves, an ``azimuth`` from the axis x or from north.
"""
ANGLES = ("azimuth", "bearing")
_FAR_SIGMAS = 8.0
_ONE_SIGMA = 0.683  # of a normal law's values are within its standard deviation


def levels_of(rows: Rows, kind: str, in_degrees: bool) -> tuple[tuple[float, ...], float]:
    """Estimate the errors of a sensor's quantities and the usual speed, from complete rows in order.

    Return the standard deviations and the speed, m/s, which is 0 for a sensor that shows none. ``kind``
    is a key of `SENSORS`. ``in_degrees`` is True if angles are in degrees.
    """
    time = rows.time
    values = _unwrapped_values(rows, kind, in_degrees)
    sigmas = tuple(scatter(time, value) for value in values)
    if kind == "bearing" or kind.startswith("landmark"):
        return sigmas, 0.0
    if kind == "range-azimuth":
        r, a = values
        values = [r * np.cos(a), r * np.sin(a)]
    return sigmas, _speed(time, *values)


def _unwrapped_values(rows: Rows, kind: str, in_degrees: bool) -> list[Array]:
    """Return the values (R,) of each quantity of a sensor; angles are in radians and without jumps.

    ``kind`` is a key of `SENSORS`. ``in_degrees`` is True if the angles of ``rows`` are in degrees.
    """
    # Rows of the values below those of the sensor's quantities are measured velocities.
    values = [*rows.values[: len(SENSORS[kind])]]
    if SENSORS[kind][-1] in ANGLES:
        azimuth = values[-1]
        if in_degrees:
            azimuth = azimuth * UNITS["deg"]
        values[-1] = np.unwrap(azimuth)
    return values


def not_finer(
    sigmas: Sequence[float],
    quantities: Sequence[str],
    naming: Naming,
    cells: Callable[[str], list[str]],
) -> tuple[float, ...]:
    """Return the standard deviations ``sigmas``, raised to at least the last digit of the numbers.

    ``cells`` returns the cells of a column, which show the digits.
    """
    raised = []
    for name, sigma in zip(quantities, sigmas, strict=True):
        source = name
        meters_per_unit = 1.0
        if name not in naming.columns:
            # Without a column of its own the quantity is computed from latitude and longitude.
            source = {"x": "longitude", "y": "latitude"}.get(name, name)
            meters_per_unit = SEMI_MAJOR_AXIS
        texts = [cell.replace(",", ".") for cell in cells(naming.columns[source])]
        values, _ = parse_cells(number, texts)
        digits = max((decimals(texts[i]) for i in np.flatnonzero(np.isfinite(values))), default=0)
        step = 10.0**-digits * naming.scale(source) * meters_per_unit
        raised.append(max(sigma, float(f"{step:.1g}")))
    return tuple(raised)


def scatter(time: Array, value: Array) -> float:
    """Estimate the standard deviation of a value's errors, to one digit; 1 if no row shows an error."""
    sigma = error_of_line(time, value)
    # Values on a straight line have only rounding errors.
    if sigma > 1e-12 * np.nanmax(np.abs(value), initial=0.0):
        return float(f"{sigma:.1g}")
    return 1.0


def error_of_azimuth(rows: Rows, kind: str, in_degrees: bool) -> float:
    """Estimate the standard deviation of azimuths, rad, from complete rows in order.

    Return 0 for a sensor of another ``kind`` than those of `SENSORS` with an azimuth. ``in_degrees`` is
    True if the azimuths of ``rows`` are in degrees.
    """
    if SENSORS[kind][-1] != "azimuth":
        return 0.0
    return error_of_line(rows.time, _unwrapped_values(rows, kind, in_degrees)[-1])


def share_of_outliers(rows: Rows, kind: str, in_degrees: bool) -> float:
    """Return the share of complete rows, in order, that lie far from the line between their neighbors.

    Far is more than `_FAR_SIGMAS` standard deviations of the other rows. ``kind`` is a key of `SENSORS`,
    and ``in_degrees`` is True if the angles of ``rows`` are in degrees.
    """
    shares = [0.0]
    for value in _unwrapped_values(rows, kind, in_degrees):
        sizes = _distances_from_line(rows.time, value)
        sigma = error_of_line(rows.time, value)
        if sigma <= 1e-12 * np.nanmax(np.abs(value), initial=0.0):
            continue
        is_far = sizes > _FAR_SIGMAS * sigma
        # An outlier also moves the lines of both of its neighbors.
        is_peak = is_far.copy()
        is_peak[1:] &= ~(is_far[:-1] & (sizes[:-1] > sizes[1:]))
        is_peak[:-1] &= ~(is_far[1:] & (sizes[1:] > sizes[:-1]))
        shares.append(float(is_peak.mean()))
    return max(shares)


def error_of_line(time: Array, value: Array) -> float:
    """Estimate the standard deviation of errors of values (R,) from the line between neighbors.

    Each value is compared with the line through those before and after it in time.
    0 for fewer than three rows, or without intervals.
    """
    sizes = _distances_from_line(time, value)
    if not np.isfinite(sizes).any():
        return 0.0
    # 68.3 % of the scaled |e| are below sigma.
    return float(np.nanquantile(sizes, _ONE_SIGMA))


def _distances_from_line(time: Array, value: Array) -> Array:
    """Return the distances (R - 2,) of values from the lines between their neighbors.

    They are scaled to the standard deviation of one value; NaN without an interval.
    """
    wide = time[2:] - time[:-2]
    if len(value) < 3 or not (wide > 0.0).any():
        return np.full(max(len(value) - 2, 0), np.nan)
    share = (time[1:-1] - time[:-2]) / np.where(wide > 0.0, wide, np.nan)
    # e = z_1 - (1 - s) z_0 - s z_2 has the variance sigma^2 (1 + s^2 + (1 - s)^2).
    off = value[1:-1] - (1.0 - share) * value[:-2] - share * value[2:]
    size: Array = np.abs(off) / np.sqrt(1.0 + np.square(share) + np.square(1.0 - share))
    return size


def _speed(time: Array, *place: Array) -> float:
    """Estimate the usual speed, m/s, over ways that take a tenth of the recording.

    Errors of the positions, given axis by axis, matter less over such ways. A single row has 1 m/s.
    """
    lag = max(1, len(time) // 10)
    if len(time) <= lag:
        return 1.0
    distance = np.sqrt(np.sum([np.square(axis[lag:] - axis[:-lag]) for axis in place], axis=0))
    duration = time[lag:] - time[:-lag]
    return float(np.median(distance[duration > 0] / duration[duration > 0]))
