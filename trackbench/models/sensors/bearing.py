"""Sensor of a bearing alone."""

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, ClassVar

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.elementary import arctan2
from trackbench.core.read_only import fixed
from trackbench.field_types import Positive, Unit
from trackbench.models.sensors.angular import AngularSensor
from trackbench.registry import register


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
