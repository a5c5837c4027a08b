"""Radar in space: range, azimuth and elevation."""

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from trackbench.core import linalg
from trackbench.core.arrays import Array, fixed
from trackbench.core.distributions import Gaussian
from trackbench.core.elementary import arctan2, cos_sin
from trackbench.field_types import Positive
from trackbench.models.sensors.angular_base import AngularSensor, distance
from trackbench.registry import register


@register("sensors", "range-azimuth-elevation")
@dataclass(frozen=True, kw_only=True)
class RangeAzimuthElevation(AngularSensor):
    """Range, azimuth from x to y, and elevation above that plane, each with an independent error."""

    sigma_range: Positive
    """standard deviation of the range, m"""
    sigma_azimuth_mrad: Positive
    """standard deviation of the azimuth, mrad"""
    sigma_elevation_mrad: Positive
    """standard deviation of the elevation, mrad"""

    components: ClassVar[tuple[str, ...]] = ("range", "azimuth", "elevation")
    angles: ClassVar[tuple[int, ...]] = (1, 2)
    axes: ClassVar[int] = 3

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.platform is not None:
            raise ValueError("a radar in space cannot move; remove `platform`")

    @cached_property
    def R(self) -> Array:
        """Return the noise covariance (3, 3)."""
        angles = 1e-3 * self.sigma_azimuth_mrad, 1e-3 * self.sigma_elevation_mrad
        return fixed(np.diag(np.square([self.sigma_range, *angles])))

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
        H[0, 0], H[0, 2], H[0, 4] = px / r, py / r, pz / r
        H[1, 0], H[1, 2] = -py / (ground * ground), px / (ground * ground)
        # e = atan2(pz, g): de/dpx = -px pz / (r^2 g), de/dpz = g / r^2.
        slope = pz / (r * r * ground)
        H[2, 0], H[2, 2], H[2, 4] = -px * slope, -py * slope, ground / (r * r)
        return H

    def located(self, z: Array, k: int) -> Gaussian:
        """Return the measured Cartesian position (3, M) and its first-order covariance (3, 3, M)."""
        # p = r (cos e cos a, cos e sin a, sin e)
        r, a, e = z
        (ca, sa), (ce, se) = cos_sin(a), cos_sin(e)
        position = np.stack([r * ce * ca, r * ce * sa, r * se])
        # J = d(position) / d(r, a, e), covariance J R J'
        J = np.stack(
            [
                np.stack([ce * ca, -r * ce * sa, -r * se * ca]),
                np.stack([ce * sa, r * ce * ca, -r * se * sa]),
                np.stack([se, np.zeros_like(r), r * ce]),
            ]
        )
        return Gaussian(self.absolute_position(position, k), linalg.sandwich(J, self.R))
