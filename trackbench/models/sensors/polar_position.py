"""A lidar that measures range and azimuth and reports positions."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.conversions import Conversion, ccm, position
from trackbench.core.distributions import Gaussian
from trackbench.models.sensors.position import selection_matrix
from trackbench.models.sensors.range_azimuth import Radar
from trackbench.registry import register


@register("sensors", "polar-position")
@dataclass(frozen=True, kw_only=True)
class PolarPosition(Radar):
    """Position of a planar target with the errors of a range and an azimuth.

    The measurement is ``(r + w_r) (cos, sin)(a + w_a)``, the conventional conversion. Filters assume a
    normal error of the first-order covariance, which rotates and grows with the target. A filter with a
    constant covariance assumes `{kind: position, sigma: ...}`.
    """

    components: ClassVar[tuple[str, ...]] = ("x", "y")
    angles: ClassVar[tuple[int, ...]] = ()

    def measurement(self, x: Array, k: int) -> Gaussian:
        """Return N(position, R(x)) for x (n, *batch)."""
        return Gaussian(x[0:4:2], ccm(self._reading(self.polar(x, k))).cov)

    def jacobian(self, x: Array, k: int) -> Array:
        """Return d(x, y)/dx (2, n)."""
        return selection_matrix(0, 4, 2, len(x))

    def draw(self, x: Array, k: int, noise: Array) -> Array:
        """Draw range and azimuth (2, M) with their errors, and convert them to a position."""
        r, a = self.polar(x, k)
        # z = (r + w_r) (cos, sin)(a + w_a)
        relative = position(r + self.sigma_range * noise[0], a + self.sigma_azimuth * noise[1])
        return self.absolute_position(relative, k)

    def located(self, z: Array, k: int, conversion: Conversion = "ccm") -> Gaussian:
        """Return the measured position (2, M), with the covariance (2, 2, M) at it."""
        state = np.zeros((4, *z.shape[1:]))
        state[0::2] = z
        return Gaussian(z, self.measurement(state, k).cov)
