"""Radar in space: range, azimuth and elevation."""

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, ClassVar

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.elementary import arctan2
from trackbench.core.polar_conversions import convert_in_space, distance
from trackbench.core.read_only import fixed
from trackbench.field_types import Positive, Unit
from trackbench.models.sensors.angular import AngularSensor
from trackbench.registry import register


@register("sensors", "range-azimuth-elevation")
@dataclass(frozen=True, kw_only=True)
class RangeAzimuthElevation(AngularSensor):
    """Range, azimuth from x to y, and elevation above that plane, each with an independent error."""

    sigma_range: Annotated[Positive, Unit("m")]
    """standard deviation of the range, m"""
    sigma_azimuth_mrad: Annotated[Positive, Unit("mrad")]
    """standard deviation of the azimuth, mrad"""
    sigma_elevation_mrad: Annotated[Positive, Unit("mrad")]
    """standard deviation of the elevation, mrad"""

    components: ClassVar[tuple[str, ...]] = ("range", "azimuth", "elevation")
    angles: ClassVar[tuple[int, ...]] = (1, 2)
    axes: ClassVar[int] = 3
    standing: ClassVar[str] = "a radar in space"

    @cached_property
    def R(self) -> Array:
        """Noise covariance (3, 3), in m^2 and rad^2."""
        sigma_azimuth = 1e-3 * self.sigma_azimuth_mrad
        sigma_elevation = 1e-3 * self.sigma_elevation_mrad
        return fixed(np.diag(np.square([self.sigma_range, sigma_azimuth, sigma_elevation])))

    def measurement(self, x: Array, k: int) -> Gaussian:
        """Return N((range, azimuth, elevation), R) for x (n, *batch)."""
        # r = sqrt(g^2 + pz^2), a = atan2(py, px), e = atan2(pz, g), g the range on the ground
        px, py, pz = self.relative_position(x, k)
        ground = distance(px, py)
        mean = np.stack([distance(ground, pz), arctan2(py, px), arctan2(pz, ground)])
        return Gaussian(mean, self.R)

    def jacobian(self, x: Array, k: int) -> Array:
        """Return d(range, azimuth, elevation)/dx (3, n, *batch)."""
        px, py, pz = self.relative_position(x, k)
        ground = distance(px, py)
        r = distance(ground, pz)
        H = np.zeros((3, *x.shape))
        # r^2 = g^2 + pz^2 with the ground range g: dr/dp = p / r.
        H[0, 0] = px / r
        H[0, 2] = py / r
        H[0, 4] = pz / r
        H[1, 0] = -py / (ground * ground)
        H[1, 2] = px / (ground * ground)
        # e = atan2(pz, g): de/dpx = -px pz / (r^2 g), de/dpz = g / r^2.
        slope = pz / (r * r * ground)
        H[2, 0] = -px * slope
        H[2, 2] = -py * slope
        H[2, 4] = ground / (r * r)
        return H

    def located(self, z: Array, k: int) -> Gaussian:
        """Return the measured Cartesian position (3, M) and its first-order covariance (3, 3, M)."""
        relative = convert_in_space(z, self.R)
        return Gaussian(self.absolute_position(relative.mean, k), relative.cov)
