"""Van der Merwe's motion of a scalar: a sine drive and gamma noise."""

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, Literal

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.elementary import cos_sin
from trackbench.core.gamma_noise import Gamma, Shifted
from trackbench.core.grid_quadrature import Interval
from trackbench.field_types import Finite, Positive
from trackbench.models.base import Motion
from trackbench.registry import register

_TAIL = 1e-12  # probability of gamma noise beyond the support that the point-mass filter uses


@register("motions", "sine-gamma")
@dataclass(frozen=True, kw_only=True)
class SineGamma(Motion):
    """``x_k = 1 + sin(w pi s) + phi1 x_{k-1} + v``, v ~ Gamma(shape, rate): van der Merwe's motion.

    Van der Merwe et al. 2000, section 6.1; hdepf paper, eq. 12.
    """

    w: Finite = 0.04
    """frequency of the sine drive, in half turns per step"""
    phi1: Finite = 0.5
    """factor of x_{k-1}"""
    gamma_shape: Positive = 3.0
    """shape of the gamma noise"""
    gamma_rate: Positive = 2.0
    """rate of the gamma noise (mean shape/rate; as a scale it would triple every RMSE)"""
    sine_index: Literal["new", "old"] = "new"
    """step s in the sine: k of x_k (the public demo) or k - 1 (as printed)"""

    @lru_cache(maxsize=64)  # noqa: B019 (a motion is a few numbers)
    def sampled(self, T: float, axes: int = 1) -> "MerweMotion":
        """Return the motion from one step to the next, on which T and ``axes`` have no effect."""
        # The sine is that of step k of x_k, or of step k - 1.
        return MerweMotion(
            w=self.w,
            phi1=self.phi1,
            noise=Gamma(self.gamma_shape, self.gamma_rate),
            sine_lag=0 if self.sine_index == "new" else 1,
        )


@lru_cache(maxsize=1024)  # of the steps
def _sine(angle: float) -> float:
    return float(cos_sin(angle)[1])


@dataclass(frozen=True)
class MerweMotion:
    """Scalar motion with a sine drive and gamma noise; ``sine_lag`` = 1 uses k - 1 in the sine."""

    w: float
    phi1: float
    noise: Gamma
    sine_lag: int
    components: ClassVar[tuple[str, ...]] = ("x",)
    extra_std: ClassVar[tuple[float, ...]] = ()

    def transition(self, x: Array, k: int) -> Shifted:
        """Return Gamma noise plus ``1 + sin(w pi (k - lag)) + phi1 x`` for x (1, *batch)."""
        # f(x) = 1 + sin(w pi s) + phi1 x
        drive = 1.0 + _sine(self.w * np.pi * (k - self.sine_lag))
        loc = self.phi1 * x
        loc += drive
        return Shifted(self.noise, loc)

    def jacobian(self, x: Array, k: int) -> Array:
        """Return phi1 (1, 1)."""
        return np.array([[self.phi1]])

    def support(self, low: Array, high: Array, k: int) -> Interval:
        """Return the interval of x_k for x_{k-1} between two limits.

        Gamma noise is not bounded: noise of a probability ``_TAIL`` lies beyond the interval.

        Parameters
        ----------
        low, high : array (M,)
            Least and largest x_{k-1} of each run.
        k : int
            Step of x_k.

        Returns
        -------
        Interval
            Lower and upper ends (M,).
        """
        from scipy.special import gammainccinv

        # Round the noise's upper quantile up to eighths of its scale, 1 / rate, so that the last bit of
        # the library's function has no effect.
        longest = np.ceil(8.0 * gammainccinv(self.noise.shape, _TAIL)) / (8.0 * self.noise.rate)
        # The motion is monotone in x: the ends of the interval map to ends.
        from_low = self.transition(low, k).loc
        from_high = self.transition(high, k).loc
        return np.minimum(from_low, from_high), np.maximum(from_low, from_high) + longest

    def origins(self, x: Array, k: int) -> Interval:
        """Return the interval of x_{k-1} over which the density of x_k = x is to be integrated.

        If the noise's shape is an integer, `Gamma.density` evaluates its formula also for v <= 0, where
        x cannot be reached. The interval then leaves out the x_{k-1} that need such noise. Otherwise
        the computed density is zero there, and the interval has no ends. It has none either if phi1 is
        zero, as x_{k-1} then has no effect.

        Parameters
        ----------
        x : array (...)
            Values of x_k.
        k : int
            Step of x_k.

        Returns
        -------
        Interval
            Lower and upper ends, in the shape of x. An infinite number stands for no end.
        """
        lowest = np.full_like(x, -np.inf)
        highest = np.full_like(x, np.inf)
        if self.phi1 == 0.0 or not self.noise.has_integer_shape:
            return lowest, highest
        # v = x_k - f(0) - phi1 x_{k-1} > 0 bounds x_{k-1} on one side.
        edge = (x - self.transition(np.zeros_like(x), k).loc) / self.phi1
        if self.phi1 > 0.0:
            return lowest, edge
        return edge, highest
