"""Sensor of a range alone."""

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, ClassVar

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.polar_conversions import distance
from trackbench.core.read_only import fixed
from trackbench.field_types import Positive, Unit
from trackbench.models.sensors.angular import AngularSensor
from trackbench.registry import register


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
