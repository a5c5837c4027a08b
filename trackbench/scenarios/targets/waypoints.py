"""A target that flies a smooth path through points."""

from dataclasses import dataclass

import numpy as np

from trackbench.core.arrays import Array
from trackbench.field_types import Finite, Positive
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
    speed: Positive | None = None
    """speed along the straight lines between the points, m/s, from time zero on"""

    def __post_init__(self) -> None:
        if (self.times is None) == (self.speed is None):
            raise ValueError("give one of times and speed")
        given = [self.x, self.y, *(a for a in (self.z, self.times) if a is not None)]
        if len({len(a) for a in given}) > 1 or len(self.x) < 2:
            raise ValueError("points have as many entries along each axis, and times; at least two")
        if (np.diff(self._times) <= 0.0).any():
            raise ValueError("the times of the points must increase, and no two points be the same")

    @property
    def axes(self) -> int:
        """Return axes of the space it moves in."""
        return 2 if self.z is None else 3

    def states(self, times: Array) -> Array:
        """Return states (n, K): the spline and its derivative."""
        return smooth_path(self._times, self._points, times)

    @property
    def _points(self) -> Array:
        return np.array([self.x, self.y] if self.z is None else [self.x, self.y, self.z])

    @property
    def _times(self) -> Array:
        if self.times is not None:
            return np.array(self.times)
        # t = length of the path so far over the speed
        steps = np.diff(self._points, axis=1)
        lengths = np.sqrt(np.square(steps).sum(axis=0))
        return np.concatenate([[0.0], np.cumsum(lengths) / self.speed])


def smooth_path(at: Array, points: Array, times: Array) -> Array:
    """Return states (2 axes, K) on Akima's spline through points (axes, P) at times ``at`` (P,)."""
    from scipy.interpolate import Akima1DInterpolator

    within = np.clip(times, at[0], at[-1])
    out = []
    for row in points:
        if len(at) == 2:
            # Two points: a straight line.
            slope = (row[1] - row[0]) / (at[1] - at[0])
            position, velocity = row[0] + slope * (within - at[0]), np.full_like(times, slope)
        else:
            # More points: Akima's spline and its derivative.
            spline = Akima1DInterpolator(at, row)
            position, velocity = spline(within), spline.derivative()(within)
        # Outside the points: straight on from the nearest end.
        out += [position + velocity * (times - within), velocity]
    return np.stack(out)
