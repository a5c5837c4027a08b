"""Positions, errors and covariances of the plane along and across the line of sight of a sensor."""

import numpy as np

from trackbench.core import compiled, linalg
from trackbench.core.arrays import Array
from trackbench.core.elementary import cos_sin


def along_line_of_sight(azimuth: Array, px: Array, py: Array) -> tuple[Array, Array, Array]:
    """Compute the ranges of positions, and rotate them to coordinates along and across an azimuth.

    Parameters
    ----------
    azimuth : array (M,)
        Azimuth of each run, rad.
    px, py : array (M, N)
        Positions of the particles, m.

    Returns
    -------
    r, across, along : array (M, N)
        Range, and coordinates across and along the azimuth, m.
    """
    # along = c px + s py, across = c py - s px, range = sqrt(along^2 + across^2), in place.
    c, s = cos_sin(azimuth)
    # The C kernel takes doubles of equal shapes only.
    alike = px.dtype == py.dtype == np.float64 and px.shape == py.shape
    if compiled.kernels and alike and px.shape[:-1] == c.shape:
        r, across, along = np.empty((3, *px.shape))
        px = np.ascontiguousarray(px)
        py = np.ascontiguousarray(py)
        compiled.kernels.line_of_sight(c, s, px, py, r, across, along)
        return r, across, along
    c_of_run = c[:, None]
    s_of_run = s[:, None]
    along = c_of_run * px
    along += s_of_run * py
    across = c_of_run * py
    across -= s_of_run * px
    square = along * along
    square += across * across
    return np.sqrt(square, out=square), across, along


def errors_along_line_of_sight(error: Array, true_azimuth: Array) -> dict[str, Array]:
    """Rotate errors of a planar state by the true azimuth.

    Parameters
    ----------
    error : array (n, *batch)
        Errors of states whose components 0 and 2 are the position, m.
    true_azimuth : array (*batch)
        Azimuth of the true position, rad.

    Returns
    -------
    dict of array (1, *batch)
        ``radial``, the error along the line of sight, and ``cross``, the error across it, m.
    """
    c, s = cos_sin(true_azimuth)
    return {
        "radial": (c * error[0] + s * error[2])[None],
        "cross": (c * error[2] - s * error[0])[None],
    }


def squares_along_line_of_sight(P: Array, azimuth: Array) -> dict[str, Array]:
    """Return the mean squares of `errors_along_line_of_sight` of given covariances.

    Parameters
    ----------
    P : array (n, n, K)
        Covariances of states whose components 0 and 2 are the position, m^2.
    azimuth : array (K,)
        Azimuth of each state, rad.

    Returns
    -------
    dict of array (K,)
        Mean squares ``radial`` and ``cross``, m^2.
    """
    # U P U' with the rotation U = [c s; -s c]
    c, s = cos_sin(azimuth)
    U = np.stack([np.stack([c, s]), np.stack([-s, c])])
    along_across = linalg.sandwich(U, P[0:4:2, 0:4:2])
    return {"radial": along_across[0, 0], "cross": along_across[1, 1]}
