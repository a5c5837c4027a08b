"""Gauss-Hermite Kalman filter: a product rule of points along each axis."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Interval

from trackbench.core.gauss_hermite_points import gauss_hermite
from trackbench.core.sigma_points import PointRule
from trackbench.filters.ukf import SigmaPointFilter
from trackbench.models.base import Scene
from trackbench.registry import register

MAX_ORDER = 32
"""Largest order of a Gauss-Hermite rule."""
_MAX_POINTS = 5000  # of a Gauss-Hermite rule


@register("filters", "ghkf")
@dataclass(frozen=True, kw_only=True)
class GHKF(SigmaPointFilter):
    """Gauss-Hermite Kalman filter: a product rule, exact for polynomials of degree 2 order - 1.

    Ito & Xiong 2000. A state of n components has order^n points.
    """

    order: Annotated[int, Interval(ge=2, le=MAX_ORDER)] = 3
    """points along each axis"""

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Reject also an order with too many points."""
        conflicts = super().conflicts(scenario)
        # A product rule has order^n points.
        number = self.order ** len(scenario.model.motion.components)
        if number > _MAX_POINTS:
            conflicts["order"] = f"{number} points a step; at most {_MAX_POINTS}"
        return conflicts

    @property
    def rule(self) -> PointRule:
        """Product rule."""
        return gauss_hermite(self.order)
