"""Target `waypoints`: a smooth path through points."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from trackbench.core.arrays import Array
from trackbench.field_types import Finite, Positive, Unit
from trackbench.registry import register
from trackbench.scenarios.targets.base import Flown


@register("targets", "waypoints")
@dataclass(frozen=True, kw_only=True)
class Waypoints(Flown):
    """A smooth path through points, in the plane or in space: Akima's spline along each axis.

    Before the first and after the last point the target flies straight on.
    """

    x: tuple[Finite, ...]
    """m"""
    y: tuple[Finite, ...]
    """m"""
    z: tuple[Finite, ...] | None = None
    """heights, m; default: the target moves in the plane"""
    times: tuple[Finite, ...] | None = None
    """when the points are reached, s; give these or a speed"""
    speed: Annotated[Positive | None, Unit("m/s")] = None
    """speed along the straight lines between the points, m/s, from time zero on"""

    def __post_init__(self) -> None:
        if (self.times is None) == (self.speed is None):
            raise ValueError("give one of times and speed")
        columns = [self.x, self.y]
        if self.z is not None:
            columns.append(self.z)
        if self.times is not None:
            columns.append(self.times)
        lengths = {len(column) for column in columns}
        if len(lengths) > 1 or len(self.x) < 2:
            raise ValueError("points have as many entries along each axis, and times; at least two")
        if (np.diff(self._times) <= 0.0).any():
            raise ValueError("the times of the points must increase, and no two points be the same")

    @property
    def axes(self) -> int:
        """Axes of the space it moves in."""
        return 2 if self.z is None else 3

    def states(self, times: Array) -> Array:
        """Return states (n, K): the spline and its derivative."""
        return smooth_path(self._times, self._points, times)

    @property
    def _points(self) -> Array:
        """Points (axes, P), m."""
        if self.z is None:
            return np.array([self.x, self.y])
        return np.array([self.x, self.y, self.z])

    @property
    def _times(self) -> Array:
        """Times (P,) of the points, s."""
        if self.times is not None:
            return np.array(self.times)
        # t = length of the path so far over the speed
        steps = np.diff(self._points, axis=1)
        lengths = np.sqrt(np.square(steps).sum(axis=0))
        return np.concatenate([[0.0], np.cumsum(lengths) / self.speed])


def smooth_path(point_times: Array, points: Array, times: Array) -> Array:
    """Interpolate points by Akima's spline along each axis.

    Outside the points the path goes straight on from the nearest end.

    Parameters
    ----------
    point_times : array (P,)
        Times at which the points are reached, s, ascending.
    points : array (axes, P)
        Points, m.
    times : array (K,)
        Times of the states, s.

    Returns
    -------
    array (2 axes, K)
        Position and velocity along each axis, m and m/s.
    """
    from scipy.interpolate import Akima1DInterpolator

    first = point_times[0]
    last = point_times[-1]
    within = np.clip(times, first, last)
    rows = []
    for coordinates in points:
        if len(point_times) == 2:
            # Two points: a straight line.
            slope = (coordinates[1] - coordinates[0]) / (last - first)
            position = coordinates[0] + slope * (within - first)
            velocity = np.full_like(times, slope)
        else:
            # More points: Akima's spline and its derivative.
            spline = Akima1DInterpolator(point_times, coordinates)
            position = spline(within)
            velocity = spline.derivative()(within)
        # Outside the points: straight on from the nearest end.
        rows += [position + velocity * (times - within), velocity]
    return np.stack(rows)
