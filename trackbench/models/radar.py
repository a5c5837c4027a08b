"""A range-azimuth sensor at the origin.

The state is (px, vx, py, vy); the measurement (range, azimuth), m and rad.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from trackbench.core.arrays import Array, fixed
from trackbench.core.conversions import Polar
from trackbench.core.distributions import Gaussian
from trackbench.core.elementary import arctan2, cos_sin


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
        return fixed(np.diag(np.square([self.sigma_range, self.sigma_azimuth])))

    def measurement(self, x: Array, k: int) -> Gaussian:
        """N((range, azimuth), R) for x (4, *batch)."""
        return Gaussian(self.polar(x), self.R)

    def polar(self, x: Array) -> Array:
        """Range and azimuth (2, *batch) of states x (4, *batch)."""
        i, j = self.position
        return np.stack([self.range(x), arctan2(x[j], x[i])])

    def range(self, x: Array) -> Array:
        """Range (*batch) of states x (4, *batch)."""
        px, py = (x[i] for i in self.position)
        square = px * px
        square += py * py
        return np.sqrt(square, out=square)

    def innovation(self, z: Array, z_pred: Array) -> Array:
        """``z - z_pred`` with the azimuth wrapped to (-pi, pi]."""
        nu = z - z_pred
        nu[1] = wrapped(nu[1])
        return nu

    def residual(self, z: Array, x: Array, k: int) -> Gaussian:
        """``innovation(z, polar(x))`` of each particle of a cloud, and R."""
        nu = np.empty((2, *x.shape[1:]))
        i, j = self.position
        r, across, along = seen_along(z[1], x[i], x[j])
        np.subtract(z[0][:, None], r, out=nu[0])
        np.negative(arctan2(across, along), out=nu[1])
        return Gaussian(nu, self.R)

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
        return Polar(z[0], z[1], *np.diagonal(self.R).tolist())


def seen_along(azimuth: Array, px: Array, py: Array) -> tuple[Array, Array, Array]:
    """Range of positions (M, N), and their coordinates across and along the line at an azimuth (M,)."""
    c, s = (wave[:, None] for wave in cos_sin(azimuth))
    along, across = c * px, c * py
    along += s * py
    across -= s * px
    square = along * along
    square += across * across
    return np.sqrt(square, out=square), across, along


def wrapped(angle: Array) -> Array:
    """The angle in (-pi, pi]; nothing is computed if none is outside."""
    if angle.max(initial=0.0) < np.pi and angle.min(initial=0.0) > -np.pi:
        return angle
    return np.asarray(angle - 2.0 * np.pi * np.ceil(angle / (2.0 * np.pi) - 0.5))
