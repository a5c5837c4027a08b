"""Filter model of target and sensor where it differs from the true one: the key ``assume``."""

from dataclasses import dataclass
from typing import Annotated

from trackbench.field_types import Registered
from trackbench.models.base import Motion
from trackbench.models.sensors.base import SensorBase


@dataclass(frozen=True, kw_only=True)
class Assume:
    """Motion and sensor of the filter model; a key that is not set takes the true one."""

    motion: Annotated[Motion | None, Registered("motions")] = None
    """motion: {kind: cv, q: 0.3}"""
    sensor: Annotated[SensorBase | tuple[SensorBase, ...] | None, Registered("sensors")] = None
    """sensor, or a list with one for each true sensor"""

    def over(self, other: "Assume") -> "Assume":
        """Return these assumptions, with the other's where a key is unset."""
        return Assume(motion=self.motion or other.motion, sensor=self.sensor or other.sensor)
