"""Autoregressive motion of a scalar, such as a random walk."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from trackbench.core.read_only import fixed
from trackbench.field_types import Finite, NonNegative
from trackbench.models.base import Motion
from trackbench.models.motions.linear import Linear
from trackbench.registry import register


@register("motions", "ar1")
@dataclass(frozen=True, kw_only=True)
class Autoregressive(Motion):
    """``x_k = phi x_{k-1} + N(0, q)``; phi = 1 is a random walk."""

    phi: Finite = 1.0
    """factor of x_{k-1}"""
    q: NonNegative
    """variance of the noise"""

    @lru_cache(maxsize=64)  # noqa: B019 (a motion is a few numbers)
    def sampled(self, T: float, axes: int = 1) -> Linear:
        """Return the motion from one step to the next, on which T and ``axes`` have no effect."""
        F = fixed(np.array([[self.phi]]))
        Q = fixed(np.array([[self.q]]))
        return Linear(T=T, F=F, Q=Q, components=("x",))
