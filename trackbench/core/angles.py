"""Angles, rad: differences within half a turn, and states that differ by whole turns.

A filter's angle may grow beyond a turn, and a recorded one jumps by a turn. Wherever two states are
compared, one of them is first shifted by whole turns to within half a turn of the other.
"""

from collections.abc import Sequence

import numpy as np

from trackbench.core.arrays import Array, with_axes_of
from trackbench.core.elementary import arctan2, cos_sin
from trackbench.core.particles import Particles
from trackbench.core.sums import dot

_TURN = 2.0 * np.pi


def wrap_angle(angle: Array) -> Array:
    """Wrap angles of any shape, rad, to (-pi, pi]."""
    # Return early if every angle is inside already.
    if angle.max(initial=0.0) < np.pi and angle.min(initial=0.0) > -np.pi:
        return angle
    return np.asarray(angle - _TURN * np.ceil(angle / _TURN - 0.5))


def near(x: Array, other: Array, rows: Sequence[int]) -> Array:
    """Shift the angles of states by whole turns to within half a turn of the angles of ``other``.

    Parameters
    ----------
    x : array (n, *batch)
        States.
    other : array (n, *batch)
        States that x is compared with. Its shape is broadcast against that of x.
    rows : sequence of int
        Rows of x and of ``other`` that are angles, rad. The other rows of x stay as they are.

    Returns
    -------
    array (n, *batch)
        Shifted states, a new array of the common shape of x and ``other``. ``x[i] - other[i]`` is in
        (-pi, pi] for each of the ``rows``, up to rounding. Without any, x itself is returned.
    """
    if not rows:
        return x
    out = np.array(np.broadcast_to(x, np.broadcast_shapes(x.shape, other.shape)))
    for i in rows:
        out[i] -= _TURN * np.ceil((out[i] - other[i]) / _TURN - 0.5)
    return out


def wrapped_difference(x: Array, other: Array, angles: Sequence[int]) -> Array:
    """Return ``x - other`` of states, with the differences of angles within half a turn of zero.

    Parameters
    ----------
    x, other : array (n, *batch)
        States, whose shapes are broadcast against each other.
    angles : sequence of int
        Rows of the states that are angles, rad.

    Returns
    -------
    array (n, *batch)
        Differences. Those of angles are in (-pi, pi], up to rounding.
    """
    return near(x, other, angles) - other


def mean_direction(x: Array, w: Array, mean: Array, rows: Sequence[int]) -> Array:
    """Replace the angles of a mean by the mean directions of weighted states.

    A direction is ``atan2(sum w sin a, sum w cos a)``, on the turn of ``mean``.

    Parameters
    ----------
    x : array (n, M, N)
        N states in each of M runs.
    w : array (M, N)
        Weights of the states.
    mean : array (n, M)
        Mean of each run. Its angles choose the turn of the directions.
    rows : sequence of int
        Rows of x and of ``mean`` that are angles, rad.

    Returns
    -------
    array (n, M)
        The mean with its angles replaced. Each is within half a turn of that in ``mean``. Without
        angles it is ``mean`` itself.
    """
    if not rows:
        return mean
    center = mean.copy()
    for i in rows:
        cos, sin = cos_sin(x[i])
        center[i] = arctan2(dot(w, sin), dot(w, cos))
    return near(center, mean, rows)


def particles_together(cloud: Particles, mean: Array, rows: Sequence[int]) -> Particles:
    """Shift the particles' angles to within half a turn of their mean direction (`mean_direction`).

    Parameters
    ----------
    cloud : Particles
        Particles x (n, M, N) with weights w (M, N).
    mean : array (n, M)
        Mean of each run. Its angles choose the turn of the mean directions.
    rows : sequence of int
        Rows of x that are angles, rad.

    Returns
    -------
    Particles
        Particles with shifted angles, and the weights of ``cloud``.
    """
    center = mean_direction(cloud.x, cloud.w, mean, rows)
    return Particles(near(cloud.x, with_axes_of(cloud.x, center), rows), cloud.w)


def bring_together(cloud: Particles, rows: Sequence[int]) -> Particles:
    """Shift the particles' angles to within half a turn of their mean direction.

    Compute the particles' mean and covariance after this step.

    Parameters
    ----------
    cloud : Particles
        Particles x (n, M, N) with weights w (M, N).
    rows : sequence of int
        Rows of x that are angles, rad.

    Returns
    -------
    Particles
        Particles with shifted angles, and the weights of ``cloud``. Without angles it is ``cloud``
        itself.
    """
    if not rows:
        return cloud
    return particles_together(cloud, cloud.mean, rows)
