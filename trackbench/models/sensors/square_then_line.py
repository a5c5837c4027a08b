"""A scalar sensor that is quadratic and then linear."""

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.grid_quadrature import Interval
from trackbench.core.read_only import fixed
from trackbench.field_types import Natural, Positive
from trackbench.models.sensors.base import SensorBase
from trackbench.registry import register


@register("sensors", "square-then-line")
@dataclass(frozen=True, kw_only=True)
class SquareThenLine(SensorBase):
    """``z_k = phi2 x_k^2 + n`` up to the switch, ``phi3 x_k - 2 + n`` after, n ~ N(0, R).

    Van der Merwe et al. 2000, section 6.1; hdepf paper, eq. 13.
    """

    phi2: Positive = 0.2
    """factor of x^2 up to the switch"""
    phi3: Positive = 0.5
    """factor of x after the switch"""
    R: Positive = 1e-5
    """variance of the noise"""
    switch: Natural = 30
    """last step with the square"""

    components: ClassVar[tuple[str, ...]] = ("z",)
    any_state: ClassVar[bool] = False

    def measurement(self, x: Array, k: int) -> Gaussian:
        """Return N(h(x), R) for x (1, *batch)."""
        # h(x) = phi2 x^2, then phi3 x - 2
        if k <= self.switch:
            return Gaussian(self.phi2 * np.square(x), self._cov)
        return Gaussian(self.phi3 * x - 2.0, self._cov)

    @cached_property
    def _cov(self) -> Array:
        return fixed(np.array([[self.R]]))

    def jacobian(self, x: Array, k: int) -> Array:
        """Return dh/dx (1, 1, *batch)."""
        if k <= self.switch:
            return (2.0 * self.phi2 * x)[None]
        return np.full_like(x, self.phi3)[None]

    def preimage(self, z: Array, deviations: float, k: int) -> list[Interval]:
        """Return the intervals of x whose h(x) lies within so many standard deviations of a measurement.

        Parameters
        ----------
        z : array (1, M)
            Measurements.
        deviations : float
            Number of standard deviations of the noise.
        k : int
            Step, which chooses between square and line.

        Returns
        -------
        list of Interval
            Lower and upper ends (M,). The square has two intervals, the line has one.
        """
        margin = deviations * np.sqrt(self.R)
        low = z[0] - margin
        high = z[0] + margin
        if k > self.switch:
            # x = (z + 2) / phi3
            x_of_low = (low + 2.0) / self.phi3
            x_of_high = (high + 2.0) / self.phi3
            return [(np.minimum(x_of_low, x_of_high), np.maximum(x_of_low, x_of_high))]
        # sqrt(low / phi2) <= |x| <= sqrt(high / phi2)
        square_of_low = low / self.phi2
        square_of_high = high / self.phi2
        inner = np.sqrt(np.maximum(np.minimum(square_of_low, square_of_high), 0.0))
        outer = np.sqrt(np.maximum(np.maximum(square_of_low, square_of_high), 0.0))
        return [(inner, outer), (-outer, -inner)]

    def inverse(self, z: Array, k: int) -> Array:
        """Return the non-negative x with h(x) = z (1, M); zero where a quadratic z is negative."""
        if k > self.switch:
            return (z + 2.0) / self.phi3
        return np.sqrt(np.maximum(z / self.phi2, 0.0))
