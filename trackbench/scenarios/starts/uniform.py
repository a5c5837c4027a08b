"""Start `uniform`: every component is uniform between two limits."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from trackbench.core.distributions import Distribution, Uniform
from trackbench.field_types import ByComponent, InvalidKeyError, freeze_mappings
from trackbench.models.component_names import by_component
from trackbench.models.sensors.stacked import Sensors
from trackbench.registry import register
from trackbench.scenarios.starts.base import FixedStart


@register("starts", "uniform")
@dataclass(frozen=True, kw_only=True)
class UniformStart(FixedStart):
    """Every component is uniform between two limits; a driven target's first state is drawn from it.

    Particle filters and `grid` use the distribution itself, other filters its exact mean and covariance.
    """

    low: ByComponent
    """lower limit of each component, in order or by name, 0 where none is given"""
    high: ByComponent
    """upper limit of each component; a component with equal limits is known"""

    def __post_init__(self) -> None:
        freeze_mappings(self)

    def for_state(self, components: tuple[str, ...]) -> Self:
        """Return the start with numbers in the order of the components; raises InvalidKeyError."""
        low = by_component(self.low, components, "start", "low").tolist()
        high = by_component(self.high, components, "start", "high").tolist()
        for name, least, largest in zip(components, low, high, strict=True):
            if least > largest:
                message = f"{name}: {largest:g} is below `low`, {least:g}"
                raise InvalidKeyError(message, "start", "high")
        return replace(self, low=tuple(low), high=tuple(high))

    def prior_type(self, sensor: Sensors) -> type[Distribution]:
        """Return a uniform distribution."""
        return Uniform

    def distribution(self, runs: int) -> Distribution:
        """Return the configured prior."""
        return Uniform(np.array(self.low), np.array(self.high), runs)
