"""Sensors at a place: their base, with position or platform and angles that wrap; bearing; range."""

from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Annotated, ClassVar

import numpy as np

from trackbench.core import compiled
from trackbench.core.angles import wrap_angle
from trackbench.core.arrays import Array, with_trailing
from trackbench.core.distributions import Gaussian
from trackbench.core.elementary import arctan2, cos_sin
from trackbench.core.read_only import fixed
from trackbench.field_types import Finite, Natural, Positive, Unit
from trackbench.models.sensors.base import SensorBase
from trackbench.registry import register


@dataclass(frozen=True, kw_only=True)
class Platform:
    """Path of a moving sensor: straight between waypoints, at rest before and after them."""

    steps: tuple[Natural, ...]
    """numbers of the steps at which the waypoints are reached, in order"""
    x: tuple[Finite, ...]
    """m"""
    y: tuple[Finite, ...]
    """m"""

    def __post_init__(self) -> None:
        if not len(self.steps) == len(self.x) == len(self.y) > 0:
            raise ValueError("steps, x and y must have the same number of entries, at least one")
        if any(b <= a for a, b in pairwise(self.steps)):
            raise ValueError("the steps of the waypoints must increase")

    def place(self, k: int) -> tuple[float, float]:
        """Return the platform's position at step k, m, by linear interpolation."""
        n = bisect_right(self.steps, k)
        if n in (0, len(self.steps)):
            # Before the first or after the last waypoint: at rest.
            end = min(n, len(self.steps) - 1)
            return self.x[end], self.y[end]
        # Between two waypoints: interpolate.
        share = (k - self.steps[n - 1]) / (self.steps[n] - self.steps[n - 1])
        px = self.x[n - 1] + share * (self.x[n] - self.x[n - 1])
        py = self.y[n - 1] + share * (self.y[n] - self.y[n - 1])
        return px, py


@dataclass(frozen=True, kw_only=True)
class AngularSensor(SensorBase):
    """Base of the sensors that measure from a position of their own."""

    at: tuple[Finite, ...] = ()
    """position of the sensor, m; default: the origin"""
    platform: Platform | None = None
    """path of a moving sensor, instead of a position"""

    angles: ClassVar[tuple[int, ...]]
    """indices of the components that are angles"""
    any_state: ClassVar[bool] = False
    axes: ClassVar[int] = 2
    """number of axes of the space"""
    standing: ClassVar[str] = ""
    """the sensor in words, if it cannot move"""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.at and len(self.at) != self.axes:
            raise ValueError(f"at has {len(self.at)} numbers for {self.axes} axes")
        if self.at and self.platform is not None:
            raise ValueError("a sensor has a position `at` or a `platform`; remove one of them")
        # `standing` has the sensor's name in words if its class allows no platform; else it is empty.
        if self.platform is not None and self.standing:
            raise ValueError(f"{self.standing} cannot move; remove `platform`")

    @property
    def at_origin(self) -> bool:
        """True if the sensor stands at the origin of the state's coordinates."""
        return self.platform is None and not any(self.at)

    def relative_position(self, x: Array, k: int) -> list[Array]:
        """Return the positions of states x (n, *batch) less the sensor's: (*batch) for each axis."""
        positions = [x[2 * i] for i in range(self.axes)]
        if self.at_origin:
            return positions
        return [p - place for p, place in zip(positions, self.place(k), strict=True)]

    def absolute_position(self, position: Array, k: int) -> Array:
        """Return positions (axes, M) relative to the sensor plus the sensor's position at step k."""
        if self.at_origin:
            return position
        return position + with_trailing(np.array(self.place(k)), 1)

    def place(self, k: int) -> tuple[float, ...]:
        """Return the position at step k, m; empty at the origin."""
        return self.platform.place(k) if self.platform is not None else self.at

    def innovation(self, z: Array, z_pred: Array) -> Array:
        """Compute ``z - z_pred`` (n_z, *batch) with angles wrapped to (-pi, pi]."""
        nu = z - z_pred
        for i in self.angles:  # rows of the measurement
            nu[i] = wrap_angle(nu[i])
        return nu


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


def distance(px: Array, py: Array) -> Array:
    """Compute ``sqrt(px^2 + py^2)``."""
    square = px * px
    square += py * py
    return np.sqrt(square, out=square)


@register("sensors", "bearing")
@dataclass(frozen=True, kw_only=True)
class Bearing(AngularSensor):
    """Direction alone, ``a = atan2(py, px) + w_a``; the range becomes observable by movement."""

    sigma_mrad: Annotated[Positive, Unit("mrad")]
    """standard deviation of the bearing, mrad"""

    components: ClassVar[tuple[str, ...]] = ("azimuth",)
    angles: ClassVar[tuple[int, ...]] = (0,)

    @cached_property
    def R(self) -> Array:
        """Noise covariance (1, 1), rad^2."""
        return fixed(np.array([[1e-6 * self.sigma_mrad * self.sigma_mrad]]))

    def measurement(self, x: Array, k: int) -> Gaussian:
        """Return N(azimuth, R) for x (n, *batch)."""
        px, py = self.relative_position(x, k)
        return Gaussian(arctan2(py, px)[None], self.R)

    def jacobian(self, x: Array, k: int) -> Array:
        """Return d(azimuth)/dx (1, n, *batch)."""
        px, py = self.relative_position(x, k)
        # da/dpx = -py / r^2, da/dpy = px / r^2
        square = px * px + py * py
        H = np.zeros((1, *x.shape))
        H[0, 0] = -py / square
        H[0, 2] = px / square
        return H


@register("sensors", "range")
@dataclass(frozen=True, kw_only=True)
class Range(AngularSensor):
    """Distance to a known place alone, ``r = sqrt(px^2 + py^2) + w_r``: a beacon or an anchor."""

    sigma: Annotated[Positive, Unit("m")]
    """standard deviation of the distance, m"""

    components: ClassVar[tuple[str, ...]] = ("range",)
    angles: ClassVar[tuple[int, ...]] = ()

    @cached_property
    def R(self) -> Array:
        """Noise covariance (1, 1), m^2."""
        return fixed(np.array([[self.sigma * self.sigma]]))

    def measurement(self, x: Array, k: int) -> Gaussian:
        """Return N(range, R) for x (n, *batch)."""
        return Gaussian(distance(*self.relative_position(x, k))[None], self.R)

    def jacobian(self, x: Array, k: int) -> Array:
        """Return d(range)/dx (1, n, *batch)."""
        px, py = self.relative_position(x, k)
        # dr/dpx = px / r, dr/dpy = py / r
        r = distance(px, py)
        H = np.zeros((1, *x.shape))
        H[0, 0] = px / r
        H[0, 2] = py / r
        return H
