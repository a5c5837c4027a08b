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
    """Wrap angles to (-pi, pi]."""
    # Return early if every angle is inside already.
    if angle.max(initial=0.0) < np.pi and angle.min(initial=0.0) > -np.pi:
        return angle
    return np.asarray(angle - _TURN * np.ceil(angle / _TURN - 0.5))


def near(x: Array, other: Array, rows: Sequence[int]) -> Array:
    """Shift the angles of states x (n, *batch) by whole turns to within half a turn of ``other``.

    The angles are the ``rows`` of x and of ``other`` (n, *batch). The other rows of x stay as they are.
    """
    if not rows:
        return x
    out = np.array(np.broadcast_to(x, np.broadcast_shapes(x.shape, other.shape)))
    for i in rows:
        out[i] -= _TURN * np.ceil((out[i] - other[i]) / _TURN - 0.5)
    return out


def wrapped_difference(x: Array, other: Array, angles: Sequence[int]) -> Array:
    """Return ``x - other`` of states (n, *batch), the rows ``angles`` within half a turn of zero."""
    return near(x, other, angles) - other


def mean_direction(x: Array, w: Array, mean: Array, rows: Sequence[int]) -> Array:
    """Return ``mean`` (n, M) with its angles replaced by the mean directions of states x (n, M, N).

    The angles are the ``rows`` of x. A direction is ``atan2(sum w sin a, sum w cos a)`` with the weights
    w (M, N), on the turn of ``mean``.
    """
    if not rows:
        return mean
    center = mean.copy()
    for i in rows:
        cos, sin = cos_sin(x[i])
        center[i] = arctan2(dot(w, sin), dot(w, cos))
    return near(center, mean, rows)


def particles_together(cloud: Particles, mean: Array, rows: Sequence[int]) -> Particles:
    """Shift the particles' angles to within half a turn of their mean direction (`mean_direction`)."""
    center = mean_direction(cloud.x, cloud.w, mean, rows)
    return Particles(near(cloud.x, with_axes_of(cloud.x, center), rows), cloud.w)


def bring_together(cloud: Particles, rows: Sequence[int]) -> Particles:
    """Shift the particles' angles, the ``rows`` of x, to within half a turn of their mean direction.

    Compute the particles' mean and covariance after this step. Without angles the particles stay as they
    are.
    """
    if not rows:
        return cloud
    return particles_together(cloud, cloud.mean, rows)
