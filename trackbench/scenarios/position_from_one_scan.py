"""Worst standard deviation of a position that is estimated from one scan."""

import numpy as np

from trackbench.core import linalg
from trackbench.core.arrays import Array
from trackbench.models.sensors.stacked import Sensors


def position_sigma(sensor: Sensors, state: Array, k: int) -> float | None:
    """Return the largest standard deviation, m, in any direction of a position estimated from one scan.

    It is that of the Cramer-Rao bound, the smallest covariance that an unbiased estimate can have. In
    space it is an upper bound of that deviation (`largest_deviation`). ``state`` (n_x,) is the true
    state at step k: position and velocity along each axis, one after the other. None if one scan does
    not determine the position.
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


def largest_deviation(cov: Array) -> float:
    """Return an upper bound of a covariance's (n, n) standard deviation in any direction.

    For n = 2 it is the largest standard deviation itself.
    """
    if len(cov) != 2:
        # The trace is the sum of the eigenvalues, so at least the largest.
        return float(np.sqrt(np.diagonal(cov).sum()))
    # The larger eigenvalue of [[a, b], [b, d]] is (a + d) / 2 + sqrt((a - d)^2 / 4 + b^2).
    half = 0.5 * (cov[0, 0] - cov[1, 1])
    spread = np.sqrt(half * half + cov[0, 1] * cov[0, 1])
    return float(np.sqrt(0.5 * (cov[0, 0] + cov[1, 1]) + spread))
