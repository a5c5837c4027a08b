"""Radar in the plane that also measures the range rate."""

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from trackbench.core.arrays import Array, fixed
from trackbench.core.distributions import Gaussian
from trackbench.field_types import Positive
from trackbench.models.sensors.range_azimuth import Radar
from trackbench.registry import register


@register("sensors", "range-azimuth-doppler")
@dataclass(frozen=True, kw_only=True)
class RangeAzimuthDoppler(Radar):
    """Range, azimuth and ``r' = (px vx + py vy) / r``, each with an independent error.

    Bar-Shalom, Li & Kirubarajan 2001, section 10.4. The radar stands still.
    """

    sigma_range_rate: Positive
    """standard deviation of the range rate, m/s"""

    components: ClassVar[tuple[str, ...]] = ("range", "azimuth", "range_rate")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.platform is not None:
            raise ValueError("a radar with Doppler cannot move; remove `platform`")

    @cached_property
    def R(self) -> Array:
        """Return the noise covariance (3, 3)."""
        sigma = [self.sigma_range, self.sigma_azimuth, self.sigma_range_rate]
        return fixed(np.diag(np.square(sigma)))

    def measurement(self, x: Array, k: int) -> Gaussian:
        """Return N((range, azimuth, range rate), R) for x (n, *batch)."""
        # z = (r, a, (px vx + py vy) / r)
        r, a = self.polar(x, k)
        return Gaussian(np.stack([r, a, self._closing(x, k) / r]), self.R)

    def jacobian(self, x: Array, k: int) -> Array:
        """Return d(range, azimuth, range rate)/dx (3, n, *batch)."""
        (px, py), r = self.relative_position(x, k), self.range(x, k)
        rate = self._closing(x, k) / r
        H = np.zeros((3, *x.shape))
        H[:2] = self.polar_jacobian(x, k)
        # r' = (px vx + py vy) / r, so dr'/dpx = (vx - r' px / r) / r and dr'/dvx = px / r.
        H[2, 0], H[2, 2] = (x[1] - rate * px / r) / r, (x[3] - rate * py / r) / r
        H[2, 1], H[2, 3] = px / r, py / r
        return H

    def _closing(self, x: Array, k: int) -> Array:
        """Return ``px vx + py vy``."""
        px, py = self.relative_position(x, k)
        return px * x[1] + py * x[3]
