"""Singer's motion: an acceleration that fades."""

from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import Annotated

import numpy as np

from trackbench.core import linalg
from trackbench.core.arrays import Array
from trackbench.core.read_only import fixed
from trackbench.field_types import Positive, Unit
from trackbench.models.motions.kinematic import CACHED_MOTIONS, Axis, PerAxis
from trackbench.registry import register

_TERMS = 10  # of exp(-h / tau), h at most a 32nd of tau


@register("motions", "singer")
@dataclass(frozen=True, kw_only=True)
class Singer(PerAxis):
    """Acceleration that fades: first-order Markov with a time constant (Singer 1970).

    Bar-Shalom, Li & Kirubarajan 2001, section 8.2.
    """

    sigma: Annotated[Positive, Unit("m/s^2")]
    """standard deviation of the acceleration per axis, m/s^2"""
    tau: Annotated[Positive, Unit("s")]
    """time constant of the acceleration, s"""

    @lru_cache(maxsize=CACHED_MOTIONS)  # noqa: B019 (a motion is a few numbers)
    def axis(self, T: float) -> Axis:
        """Return F and Q of one axis (position, velocity, acceleration).

        The closed form would lose its digits for T much shorter than tau.
        """
        # Step 1: F and Q by their series, of an interval h so short that few terms give all digits.
        halvings = 0
        h = T
        while h > self.tau / 32.0:
            h = 0.5 * h
            halvings += 1
        F, Q = self._matrices_of_short_interval(h)
        # Step 2: double the interval: F(2 h) = F F, Q(2 h) = F Q F' + Q.
        for _ in range(halvings):
            Q = linalg.sandwich(F, Q) + Q
            F = linalg.matmul(F, F)
        return Axis(F=fixed(F), Q=fixed(Q))

    def _matrices_of_short_interval(self, h: float) -> tuple[Array, Array]:
        """Return F(h) and ``Q(h) = 2 sigma^2 / tau int_0^h g(s) g(s)' ds`` (3, 3) by power series.

        g(s) is the effect on (position, velocity, acceleration) of a unit acceleration s seconds ago.
        """
        # Step 1: coefficients by power of s of the acceleration exp(-s / tau), its integral, the speed,
        # and its double integral, the position.
        fading = [1.0]
        for n in range(1, _TERMS):
            fading.append(fading[-1] * -1.0 / (n * self.tau))
        speed = _integrate(fading)
        g = (_integrate(speed), speed, fading)
        # Step 2: the last column of F is g(h); Q is the integral of the products of g's components.
        values = [_evaluate(p, h) for p in g]
        F = np.array([[1.0, h, values[0]], [0.0, 1.0, values[1]], [0.0, 0.0, values[2]]])
        density = 2.0 * self.sigma * self.sigma / self.tau
        Q = [density * _evaluate(_integrate(_multiply(a, b)), h) for a, b in product(g, repeat=2)]
        return F, np.array(Q).reshape(3, 3)

    @property
    def acceleration_std(self) -> float:
        """Stationary standard deviation of the acceleration."""
        return self.sigma


def _integrate(p: list[float]) -> list[float]:
    """Integrate a polynomial from zero; both are coefficients, that of the constant first."""
    return [0.0, *(c / (n + 1) for n, c in enumerate(p))]


def _multiply(a: list[float], b: list[float]) -> list[float]:
    """Multiply two polynomials; all are coefficients, that of the constant first."""
    product_of_both = [0.0] * (len(a) + len(b) - 1)
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            product_of_both[i + j] += x * y
    return product_of_both


def _evaluate(p: list[float], h: float) -> float:
    """Evaluate a polynomial at h by its coefficients p, that of the constant first."""
    value = 0.0
    for c in reversed(p):
        value = value * h + c
    return value
