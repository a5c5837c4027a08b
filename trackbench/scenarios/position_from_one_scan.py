"""Worst standard deviation of a position that is estimated from one scan."""

import numpy as np

from trackbench.core import linalg
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.linalg import largest_deviation
from trackbench.models.base import LocatingSensor
from trackbench.models.sensors.stacked import Sensors, rows_of, sensors_of


def position_sigma(sensor: Sensors, state: Array, k: int) -> float | None:
    """Return the largest standard deviation in any direction of a position estimated from one scan.

    It is that of the Cramer-Rao bound, the smallest covariance that an unbiased estimate can have. In
    space it is an upper bound of that deviation (`largest_deviation`).

    Parameters
    ----------
    sensor : Sensors
        Sensor, or all sensors as one.
    state : array (n_x,)
        True state: position and velocity along each axis, one after the other, m and m/s.
    k : int
        Step of the state.

    Returns
    -------
    float or None
        Standard deviation, m. None if one scan does not determine the position.
    """
    # Covariance of the position: inverse of its block of H' R^-1 H, that of a scan that detects the
    # target for certain. The caller has a state of positions and velocities alone, in which the
    # positions are the even rows.
    with np.errstate(divide="ignore", invalid="ignore"):  # at the sensor itself
        information = sensor.information(state, k, certain=True)
    position = information[0::2, 0::2]
    # A scalar state has no position.
    if len(information) < 2 or np.isnan(position).any() or linalg.is_singular(position):
        return None
    return largest_deviation(linalg.inverse(position))


def position_by_one_scan(sensor: Sensors, x: Array, k: int) -> Gaussian:
    """Return the true position of a state, as a scan would estimate it.

    The covariance is the Cramer-Rao bound of a scan that detects the target for certain: a start from
    scans has scans without a miss.

    Parameters
    ----------
    sensor : Sensors
        Sensor, or all sensors as one.
    x : array (n_x,)
        True state: position and velocity along each axis, one after the other, m and m/s, as
        `FromScans.check` has made sure.
    k : int
        Step of the state.

    Returns
    -------
    Gaussian
        Position (axes, 1), m, and covariance (axes, axes), m^2.
    """
    # Covariance of the position: inverse of its block of H' R^-1 H. Positions are the even rows.
    information = sensor.information(x, k, certain=True)[0::2, 0::2]
    return Gaussian(x[0::2, None], linalg.inverse(information))


def position_part(sensor: Sensors) -> tuple[LocatingSensor, slice] | None:
    """Return the first sensor that measures a position, and its rows of the stacked measurement.

    None if no sensor does.
    """
    for each, rows in zip(sensors_of(sensor), rows_of(sensor), strict=True):
        if isinstance(each, LocatingSensor):
            return each, rows
    return None
