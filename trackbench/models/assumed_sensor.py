"""Filter model of motion, sensor and prior where it differs from the true one: the key ``assume``."""

from dataclasses import dataclass
from typing import Annotated

from trackbench.extension_points import Part
from trackbench.field_types import Registered
from trackbench.models.base import Motion
from trackbench.models.sensors.base import SensorBase


@dataclass(frozen=True, kw_only=True)
class Assume:
    """Motion, sensor and prior of the filter model; a key that is not set takes the true one."""

    motion: Annotated[Motion | None, Registered("motions")] = None
    """motion: {kind: cv, q: 0.3}"""
    sensor: Annotated[SensorBase | tuple[SensorBase, ...] | None, Registered("sensors")] = None
    """sensor, or a list with one for each true sensor"""
    start: Annotated[Part | None, Registered("starts")] = None
    """prior that is independent of the data: given, uniform or mixture"""

    def over(self, other: "Assume") -> "Assume":
        """Return these assumptions, with the other's where a key is unset."""
        return Assume(
            motion=self.motion or other.motion,
            sensor=self.sensor or other.sensor,
            start=self.start or other.start,
        )
