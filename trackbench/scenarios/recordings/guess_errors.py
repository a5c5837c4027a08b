"""Errors and speeds that a recording shows, for a first try of filters."""

from collections.abc import Callable, Sequence

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.conversions import SEMI_MAJOR_AXIS
from trackbench.scenarios.recordings.column_mapping import UNITS, Naming
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
_LEAST_ROWS = 30
"""rows from which on they show a process noise"""
_LARGEST_ANIS = 1.5
"""mean squared innovation per component up to which the usual process noise serves"""
_LEAST_ANIS = 0.3
"""mean squared innovation per component below which the usual process noise is far too large"""
_NEAR_LIMIT = 0.75
"""share of the largest mean squared innovation at which a process noise is small enough"""
_LEAST_SHARE = 1e-6
"""least process noise that is tried, as a share of that of the speed"""
_DECADES = 4
"""powers of ten by which the process noise may be above the usual one"""
_PART = 500
"""rows of a part of a recording that is filtered by itself"""
_MOST_PARTS = 40
_FIRST_SCORED = 10
"""row of a part from which on its innovations count"""
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
    decimals: Callable[[str], int],
) -> tuple[float, ...]:
    """Return the standard deviations ``sigmas``, raised to at least the last digit of the numbers.

    ``decimals`` counts the digits behind the point of a column's numbers.
    """
    raised = []
    for name, sigma in zip(quantities, sigmas, strict=True):
        source = name
        meters_per_unit = 1.0
        if name not in naming.columns:
            # Without a column of its own the quantity is computed from latitude and longitude.
            source = {"x": "longitude", "y": "latitude"}.get(name, name)
            meters_per_unit = SEMI_MAJOR_AXIS
        digits = decimals(naming.columns[source])
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


def usual_process_noise(speed: float) -> float:
    """Return the process noise q by which the velocity wanders by 5 % of the usual speed in a second."""
    return float(f"{max(_process_noise_of_speed(speed), 1e-3):.1g}")


def _process_noise_of_speed(speed: float) -> float:
    """Return the variance of 5 % of a speed, m^2/s^2, in a second."""
    return 0.0025 * speed * speed


def joined_process_noise(noises: Sequence[float | None], speed: float) -> float:
    """Return the process noise for several sensors or files, each of which shows one of ``noises``.

    None stands for a sensor that shows none, and 0 for one that `usual_process_noise` of the ``speed``
    serves. Return 0 if the usual one serves all. A larger noise than the usual one is needed if one
    sensor shows it, and a smaller one only if all sensors do.
    """
    shown = [noise for noise in noises if noise is not None]
    if not shown:
        return 0.0
    largest = max(shown)
    if largest < usual_process_noise(speed) and 0.0 in shown:
        return 0.0
    return largest


def shown_process_noise(
    rows: Rows, kind: str, in_degrees: bool, sigmas: Sequence[float], speed: float
) -> float | None:
    """Return the process noise q by which a Kalman filter's squared innovations are about right.

    Return 0 if they are right with that of `usual_process_noise`, or with none, and None if the rows
    cannot show it. ``rows`` are complete and in order, ``sigmas`` are the standard deviations of the
    quantities of the sensor ``kind``, and ``speed`` is the usual speed, m/s. ``in_degrees`` is True if
    the angles of ``rows`` are in degrees.
    """
    if kind not in ("position", "range-azimuth") or not speed or len(rows.time) < _LEAST_ROWS:
        return None
    # Step 1: positions with their errors; rows far from the line between their neighbors are outliers.
    values = np.stack(_unwrapped_values(rows, kind, in_degrees))
    is_far = np.zeros(len(rows.time), dtype=np.bool_)
    for value in values:
        sizes = _distances_from_line(rows.time, value)
        is_far[1:-1] |= sizes > _FAR_SIGMAS * error_of_line(rows.time, value)
    sigma_x = max(sigmas)
    places = values
    covariances = np.zeros((2, 2, len(rows.time)))
    covariances[0, 0] = sigma_x * sigma_x
    covariances[1, 1] = sigma_x * sigma_x
    if kind == "range-azimuth":
        r, a = values
        places = np.stack([r * np.cos(a), r * np.sin(a)])
        along = np.stack([np.cos(a), np.sin(a)])
        across = np.stack([-np.sin(a), np.cos(a)])
        covariances = np.square(sigmas[0]) * along[:, None] * along
        covariances += np.square(sigmas[1] * r) * across[:, None] * across
    used = np.flatnonzero(~is_far)
    time = rows.time[used]
    places = places[:, used]
    covariances = covariances[..., used]
    # Step 2: the mean squared innovation falls as q rises; take the q at which it is 1.
    usual = usual_process_noise(speed)
    (usual_anis,) = _anis(time, places, covariances, 2.0 * speed, np.array([usual]))
    if usual_anis < _LEAST_ANIS:
        return _lowered_process_noise(time, places, covariances, speed)
    if not usual_anis > _LARGEST_ANIS:
        return 0.0
    noises = usual * np.logspace(0.0, _DECADES, 4 * _DECADES + 1)
    anis = _anis(time, places, covariances, 2.0 * speed, noises)
    if not anis[-1] < 1.0:
        return 0.0
    log_noise = np.interp(0.0, -np.log(anis), np.log(noises))
    return float(f"{np.exp(log_noise):.1g}")


def _lowered_process_noise(time: Array, places: Array, covariances: Array, speed: float) -> float:
    """Return the process noise of a target that the usual one makes wander far more than it does.

    As q falls to nothing, the mean squared innovation rises to a limit, which is below 1 if the errors
    were guessed too large. The largest q at which it is near this limit is returned, as it leaves most
    room for maneuvers. ``places`` (2, R) have errors with ``covariances`` (2, 2, R).
    """
    usual = usual_process_noise(speed)
    least = _LEAST_SHARE * _process_noise_of_speed(speed)
    decades = int(np.ceil(np.log10(usual / least)))
    noises = np.geomspace(least, usual, 2 * decades + 1)
    anis = _anis(time, places, covariances, 2.0 * speed, noises)
    is_near = anis >= _NEAR_LIMIT * anis.max()
    return float(f"{noises[is_near].max():.1g}")


def _anis(
    time: Array, places: Array, covariances: Array, sigma_velocity: float, noises: Array
) -> Array:
    """Return the mean squared innovation per component of Kalman filters with process noises (Q,).

    The filters assume a constant velocity. ``places`` (2, R) have errors with ``covariances`` (2, 2, R).
    A long recording is cut into parts, which are filtered at once.
    """
    # Step 1: cut the rows into parts (B, L) of equal length, and take evenly spaced ones of very many.
    length = min(_PART, len(time))
    starts = np.arange(0, len(time) - length + 1, length)
    if len(starts) > _MOST_PARTS:
        starts = starts[np.linspace(0, len(starts) - 1, _MOST_PARTS).astype(np.intp)]
    rows = starts[:, None] + np.arange(length)
    # Axes are noise, part and then the components of a state px, py, vx, vy.
    shape = (len(noises), len(starts))
    mean = np.zeros((*shape, 4, 1))
    mean[..., :2, 0] = places[:, rows[:, 0]].T
    covariance = np.zeros((*shape, 4, 4))
    covariance[..., :2, :2] = np.moveaxis(covariances[..., rows[:, 0]], -1, 0)
    covariance[..., 2:, 2:] = np.square(sigma_velocity) * np.eye(2)
    total = np.zeros(len(noises))
    for k in range(1, length):
        # Step 2: predict, x = F x and P = F P F' + Q.
        interval = (time[rows[:, k]] - time[rows[:, k - 1]])[:, None, None]
        transition = np.zeros((len(starts), 4, 4))
        transition[:] = np.eye(4)
        transition[:, :2, 2:] = interval * np.eye(2)
        growth = np.zeros((len(starts), 4, 4))
        growth[:, :2, :2] = interval**3 / 3.0 * np.eye(2)
        growth[:, :2, 2:] = interval**2 / 2.0 * np.eye(2)
        growth[:, 2:, :2] = growth[:, :2, 2:]
        growth[:, 2:, 2:] = interval * np.eye(2)
        mean = transition @ mean
        covariance = transition @ covariance @ transition.swapaxes(-1, -2)
        covariance += noises[:, None, None, None] * growth
        # Step 3: update, S = P_xx + R, K = P H' S^-1, x = x + K e and P = P - K H P.
        of_place = np.moveaxis(covariances[..., rows[:, k]], -1, 0)
        inverse = np.linalg.inv(covariance[..., :2, :2] + of_place)
        innovation = places[:, rows[:, k]].T[..., None] - mean[..., :2, :]
        if k >= _FIRST_SCORED:
            squared = innovation.swapaxes(-1, -2) @ inverse @ innovation
            total += squared[..., 0, 0].sum(axis=1)
        gain = covariance[..., :2] @ inverse
        mean = mean + gain @ innovation
        covariance = covariance - gain @ covariance[..., :2, :]
    return total / (2.0 * len(starts) * (length - _FIRST_SCORED))


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
