"""A lidar that reports positions, though it measures range and azimuth."""

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
    """Position of a planar target whose errors are those of a range and an azimuth.

    What is measured is ``(r + w_r) (cos, sin)(a + w_a)``, the conventional conversion; what filters
    assume is a normal error of the first-order covariance, which turns and grows with the target. A
    filter with a constant covariance assumes `{kind: position, sigma: ...}`.
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
        """Return the range and azimuth with their errors, as a position."""
        r, a = self.polar(x, k)
        seen = position(r + self.sigma_range * noise[0], a + self.sigma_azimuth * noise[1])
        return self.absolute_position(seen, k)

    def located(self, z: Array, k: int, conversion: Conversion = "ccm") -> Gaussian:
        """Return the measured position, and its covariance (2, 2, M) there."""
        state = np.zeros((4, *z.shape[1:]))
        state[0::2] = z
        return Gaussian(z, self.measurement(state, k).cov)
