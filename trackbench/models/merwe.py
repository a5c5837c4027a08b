"""The scalar model of van der Merwe et al. (2000, section 6.1), used by the hdepf paper.

``x_k = 1 + sin(w pi s) + phi1 x_{k-1} + v``, v ~ Gamma(shape, rate)     (hdepf paper, eq. 12)
``z_k = phi2 x_k^2 + n`` up to the switch, ``phi3 x_k - 2 + n`` after,  n ~ N(0, R)   (eq. 13)
"""

from dataclasses import dataclass

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.distributions import Gamma, Gaussian, Shifted
from trackbench.core.elementary import cos_sin
from trackbench.core.grid import Interval

_TAIL = 1e-12  # probability of gamma noise beyond the support handed to the point-mass filter


@dataclass(frozen=True)
class MerweMotion:
    """Scalar motion with a sine drive and gamma noise; ``sine_lag`` = 1 uses k - 1 in the sine."""

    w: float
    phi1: float
    noise: Gamma
    sine_lag: int
    components: tuple[str, ...] = ("x",)

    def transition(self, x: Array, k: int) -> Shifted:
        """Gamma noise around ``1 + sin(w pi (k - lag)) + phi1 x`` for x (1, *batch)."""
        drive = 1.0 + cos_sin(self.w * np.pi * (k - self.sine_lag))[1]
        return Shifted(self.noise, self.phi1 * x + drive)

    def jacobian(self, x: Array, k: int) -> Array:
        """phi1 (1, 1)."""
        return np.array([[self.phi1]])

    def support(self, low: Array, high: Array, k: int) -> Interval:
        """Where x_k can be if x_{k-1} lies between low and high (M,): ends (M,)."""
        from scipy.special import gammainccinv

        # In whole parts of the scale: the library's last bit is not to show.
        longest = np.ceil(8.0 * gammainccinv(self.noise.shape, _TAIL)) / (8.0 * self.noise.rate)
        ends = self.transition(low, k).loc, self.transition(high, k).loc
        return np.minimum(*ends), np.maximum(*ends) + longest

    def origins(self, x: Array, k: int) -> Interval:
        """The interval of x_{k-1} from which x_k = x can be reached: the noise is positive."""
        everywhere = np.full_like(x, -np.inf), np.full_like(x, np.inf)
        if self.phi1 == 0.0 or not self.noise.smooth:
            return everywhere
        edge = (x - self.transition(np.zeros_like(x), k).loc) / self.phi1
        return (everywhere[0], edge) if self.phi1 > 0.0 else (edge, everywhere[1])


@dataclass(frozen=True)
class MerweSensor:
    """Quadratic up to step ``switch``, linear after; noise variance R."""

    phi2: float
    phi3: float
    R: float
    switch: int
    components: tuple[str, ...] = ("z",)

    def measurement(self, x: Array, k: int) -> Gaussian:
        """N(h(x), R) for x (1, *batch)."""
        h = self.phi2 * np.square(x) if k <= self.switch else self.phi3 * x - 2.0
        return Gaussian(h, np.array([[self.R]]))

    def innovation(self, z: Array, z_pred: Array) -> Array:
        """``z - z_pred``."""
        return z - z_pred

    def jacobian(self, x: Array, k: int) -> Array:
        """dh/dx (1, 1, *batch)."""
        slope = 2.0 * self.phi2 * x if k <= self.switch else np.full_like(x, self.phi3)
        return slope[None]

    def preimage(self, z: Array, deviations: float, k: int) -> list[Interval]:
        """The intervals of x whose h(x) lies within so many standard deviations of z (1, M)."""
        reach = deviations * np.sqrt(self.R)
        low, high = z[0] - reach, z[0] + reach
        if k > self.switch:
            ends = (low + 2.0) / self.phi3, (high + 2.0) / self.phi3
            return [(np.minimum(*ends), np.maximum(*ends))]
        ratios = low / self.phi2, high / self.phi2
        inner = np.sqrt(np.maximum(np.minimum(*ratios), 0.0))
        outer = np.sqrt(np.maximum(np.maximum(*ratios), 0.0))
        return [(inner, outer), (-outer, -inner)]

    def inverse(self, z: Array, k: int) -> Array:
        """The non-negative x with h(x) = z (1, M); zero where a quadratic z is negative."""
        if k > self.switch:
            return (z + 2.0) / self.phi3
        return np.sqrt(np.maximum(z / self.phi2, 0.0))
