"""Start `known`: every filter starts at the true first state."""

from dataclasses import dataclass
from typing import ClassVar

from trackbench.core.arrays import Array
from trackbench.core.distributions import Distribution, PointMass
from trackbench.core.random_streams import Streams
from trackbench.models.sensors.stacked import Sensors
from trackbench.registry import register
from trackbench.scenarios.starts.base import InitialScans, Start


@register("starts", "known")
@dataclass(frozen=True, kw_only=True)
class Known(Start):
    """Every filter starts at the true first state."""

    of_truth: ClassVar[bool] = True

    def prior_type(self, sensor: Sensors) -> type[Distribution]:
        """Return a point."""
        return PointMass

    def prior(
        self, opening: InitialScans, sensor: Sensors, nominal: Array | None, rng: Streams
    ) -> Distribution:
        """Return point masses at the truth."""
        return PointMass(opening.truth)
