"""A range-azimuth sensor at the origin.

The state is (px, vx, py, vy); the measurement (range, azimuth), m and rad.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from trackbench.core.arrays import Array, fixed
from trackbench.core.conversions import Polar
from trackbench.core.distributions import Gaussian


@dataclass(frozen=True)
class RangeAzimuth:
    """``r = sqrt(px^2 + py^2) + w_r``, ``a = atan2(py, px) + w_a`` (banana paper, eqs. 7-8).

    Standard deviations in m and rad.
    """

    sigma_range: float
    sigma_azimuth: float
    components: tuple[str, ...] = ("range", "azimuth")
    position: tuple[int, int] = (0, 2)
    """where px and py stand in the state"""

    @cached_property
    def R(self) -> Array:
        """Noise covariance (2, 2)."""
        return fixed(np.diag([self.sigma_range**2, self.sigma_azimuth**2]))

    def measurement(self, x: Array, k: int) -> Gaussian:
        """N((range, azimuth), R) for x (4, *batch)."""
        return Gaussian(self.polar(x), self.R)

    def polar(self, x: Array) -> Array:
        """Range and azimuth (2, *batch) of states x (4, *batch)."""
        px, py = (x[i] for i in self.position)
        out = np.empty((2, *px.shape))
        np.sqrt(px * px + py * py, out=out[0])
        np.arctan2(py, px, out=out[1])
        return out

    def innovation(self, z: Array, z_pred: Array) -> Array:
        """``z - z_pred`` with the azimuth wrapped to (-pi, pi]."""
        nu = z - z_pred
        nu[1] = wrapped(nu[1])
        return nu

    def jacobian(self, x: Array, k: int) -> Array:
        """d(range, azimuth)/dx (2, 4, *batch)."""
        i, j = self.position
        px, py = x[i], x[j]
        square = px * px + py * py
        distance = np.sqrt(square)
        H = np.zeros((2, *x.shape))
        H[0, i], H[0, j] = px / distance, py / distance
        H[1, i], H[1, j] = -py / square, px / square
        return H

    def reading(self, z: Array) -> Polar:
        """The measurement with its variances."""
        return Polar(z[0], z[1], self.sigma_range**2, self.sigma_azimuth**2)


def wrapped(angle: Array) -> Array:
    """The angle in (-pi, pi]; nothing is computed if none is outside."""
    if angle.max(initial=0.0) < np.pi and angle.min(initial=0.0) > -np.pi:
        return angle
    return np.asarray(angle - 2.0 * np.pi * np.ceil(angle / (2.0 * np.pi) - 0.5))
