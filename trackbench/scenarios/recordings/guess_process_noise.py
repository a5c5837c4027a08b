"""Guess of the process noise by which a Kalman filter's squared innovations are about right."""

from collections.abc import Sequence

import numpy as np

from trackbench.core.arrays import Array
from trackbench.scenarios.recordings.errors_from_neighbors import (
    error_of_line,
    scaled_distances_from_neighbors,
)
from trackbench.scenarios.recordings.guess_errors_and_outliers import FAR_SIGMAS, unwrapped_values
from trackbench.scenarios.recordings.rows_and_reading_context import Rows

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


def usual_process_noise(speed: float) -> float:
    """Return the process noise q, m^2/s^3, by which the velocity changes by 5 % of a speed in a second.

    ``speed`` is the usual speed, m/s. q is rounded to a digit, and at least 0.001.
    """
    return float(f"{max(_process_noise_of_speed(speed), 1e-3):.1g}")


def _process_noise_of_speed(speed: float) -> float:
    """Return the variance of 5 % of a speed in a second, m^2/s^3, before it is rounded."""
    return 0.0025 * speed * speed


def joined_process_noise(noises: Sequence[float | None], speed: float) -> float:
    """Return the process noise for several sensors or files, each of which shows one of ``noises``.

    None stands for a sensor that shows none, and 0 for one that `usual_process_noise` of the ``speed``
    serves. Return 0 if the usual one serves all. A larger noise than the usual one is returned if one
    sensor shows it, and a smaller one only if all sensors that show any do.
    """
    shown = [noise for noise in noises if noise is not None]
    if not shown:
        return 0.0
    largest = max(shown)
    if largest < usual_process_noise(speed) and 0.0 in shown:
        return 0.0  # the usual noise serves one of them
    return largest


def shown_process_noise(
    rows: Rows, kind: str, in_degrees: bool, sigmas: Sequence[float], speed: float
) -> float | None:
    """Return the process noise q by which a Kalman filter's squared innovations are about right.

    Its unit is m^2/s^3. Return 0, which stands for that of `usual_process_noise`, if they are right with
    it, or if no process noise makes them right. Return None if the rows cannot show it. ``rows`` are
    complete and in order, ``sigmas`` are the standard deviations of the quantities of the sensor
    ``kind``, and ``speed`` is the usual speed, m/s. ``in_degrees`` is True if the angles of ``rows`` are
    in degrees.
    """
    if kind not in ("position", "range-azimuth") or not speed or len(rows.time) < _LEAST_ROWS:
        return None
    # Step 1: positions (2, R) with the covariances of their errors (2, 2, R). Rows far from the line
    # between their neighbors are outliers, and are left out.
    values = np.stack(unwrapped_values(rows, kind, in_degrees))
    is_far = np.zeros(len(rows.time), dtype=np.bool_)
    for quantity_values in values:
        distances = scaled_distances_from_neighbors(rows.time, quantity_values)
        is_far[1:-1] |= distances > FAR_SIGMAS * error_of_line(rows.time, quantity_values)
    sigma_x = max(sigmas)  # of a sensor of positions, in both axes
    positions = values
    covariances = np.zeros((2, 2, len(rows.time)))
    covariances[0, 0] = sigma_x * sigma_x
    covariances[1, 1] = sigma_x * sigma_x
    if kind == "range-azimuth":
        r, a = values
        positions = np.stack([r * np.cos(a), r * np.sin(a)])
        along = np.stack([np.cos(a), np.sin(a)])
        across = np.stack([-np.sin(a), np.cos(a)])
        covariances = np.square(sigmas[0]) * along[:, None] * along
        covariances += np.square(sigmas[1] * r) * across[:, None] * across
    rows_without_outliers = np.flatnonzero(~is_far)
    time = rows.time[rows_without_outliers]
    positions = positions[:, rows_without_outliers]
    covariances = covariances[..., rows_without_outliers]
    # Step 2: the mean squared innovation falls as q rises; take the q at which it is 1. The velocity of
    # the first state is unknown: its standard deviation is twice the usual speed.
    usual = usual_process_noise(speed)
    (usual_anis,) = _anis(time, positions, covariances, 2.0 * speed, np.array([usual]))
    if usual_anis < _LEAST_ANIS:
        return _lowered_process_noise(time, positions, covariances, speed)
    if not usual_anis > _LARGEST_ANIS:
        return 0.0
    noises = usual * np.logspace(0.0, _DECADES, 4 * _DECADES + 1)
    anis = _anis(time, positions, covariances, 2.0 * speed, noises)
    if not anis[-1] < 1.0:
        return 0.0  # no process noise explains such innovations
    log_noise = np.interp(0.0, -np.log(anis), np.log(noises))
    return float(f"{np.exp(log_noise):.1g}")


def _lowered_process_noise(
    time: Array, positions: Array, covariances: Array, speed: float
) -> float:
    """Return the process noise of a target whose velocity changes far less than the usual one allows.

    As the process noise q, m^2/s^3, falls to nothing, the mean squared innovation rises to a limit. The
    largest q is returned at which it is 1, or near its limit if this is lower, as it is if the errors
    were guessed too large. ``time`` (R,) is in s, ``positions`` (2, R) are in m and have errors with
    ``covariances`` (2, 2, R), and ``speed`` is the usual speed, m/s.
    """
    # Try values of q up to the usual one, two in a decade. The usual one is at least 0.001; the least
    # one is a share of that of the speed, which may be smaller for a slow target.
    usual = usual_process_noise(speed)
    least = _LEAST_SHARE * _process_noise_of_speed(speed)
    decades = int(np.ceil(np.log10(usual / least)))
    noises = np.geomspace(least, usual, 2 * decades + 1)
    # The standard deviation of the unknown first velocity is twice the usual speed.
    anis = _anis(time, positions, covariances, 2.0 * speed, noises)
    if not anis.max() > 0.0:
        return 0.0  # positions that never change show no process noise
    is_small_enough = anis >= min(1.0, _NEAR_LIMIT * anis.max())
    return float(f"{noises[is_small_enough].max():.1g}")


def _anis(
    time: Array, positions: Array, covariances: Array, sigma_velocity: float, noises: Array
) -> Array:
    """Return the mean normalized squared innovation (N,) of Kalman filters with N process noises.

    It is the NIS divided by the number of components, 2, and should be 1. The ``noises`` (N,) are the
    spectral densities q of a white acceleration, m^2/s^3: without it the velocity is constant.
    ``positions`` (2, R) have errors with ``covariances`` (2, 2, R). A long recording is cut into parts,
    which are filtered at once. ``sigma_velocity``, m/s, is the standard deviation of the unknown
    velocity at the beginning of a part.
    """
    # Step 1: cut the rows into parts (B, L) of equal length, and take evenly spaced ones of very many.
    length = min(_PART, len(time))
    starts = np.arange(0, len(time) - length + 1, length)
    if len(starts) > _MOST_PARTS:
        starts = starts[np.linspace(0, len(starts) - 1, _MOST_PARTS).astype(np.intp)]
    rows = starts[:, None] + np.arange(length)
    # The first position of each part begins its filter. Axes are noise, part, and then the components of
    # a state px, py, vx, vy.
    shape = (len(noises), len(starts))
    mean = np.zeros((*shape, 4, 1))
    mean[..., :2, 0] = positions[:, rows[:, 0]].T
    covariance = np.zeros((*shape, 4, 4))
    covariance[..., :2, :2] = np.moveaxis(covariances[..., rows[:, 0]], -1, 0)
    covariance[..., 2:, 2:] = np.square(sigma_velocity) * np.eye(2)
    total = np.zeros(len(noises))
    for k in range(1, length):
        # Step 2: predict, x = F x and P = F P F' + q G.
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
        measurement_covariance = np.moveaxis(covariances[..., rows[:, k]], -1, 0)
        inverse = np.linalg.inv(covariance[..., :2, :2] + measurement_covariance)
        innovation = positions[:, rows[:, k]].T[..., None] - mean[..., :2, :]
        # The first rows only serve to find the velocity.
        if k >= _FIRST_SCORED:
            squared = innovation.swapaxes(-1, -2) @ inverse @ innovation
            total += squared[..., 0, 0].sum(axis=1)
        gain = covariance[..., :2] @ inverse
        mean = mean + gain @ innovation
        covariance = covariance - gain @ covariance[..., :2, :]
    return total / (2.0 * len(starts) * (length - _FIRST_SCORED))
