"""Key `assume`: motion, sensor and prior of the filter model."""

from dataclasses import dataclass, fields
from typing import Annotated, Literal

from trackbench.component_parts import Part
from trackbench.field_types import HoldsComponents, InvalidKeyError, Registered
from trackbench.models.base import Motion
from trackbench.models.delays import Late, Treatment
from trackbench.models.sensors.base import SensorBase
from trackbench.models.sensors.stacked import Sensors, stack_for


@dataclass(frozen=True, kw_only=True)
class Assume(HoldsComponents):
    """Motion, sensor and prior of the filter model; a key that is not set takes the true one."""

    motion: Annotated[Motion | None, Registered("motions")] = None
    """motion: {kind: cv, q: 0.3}"""
    sensor: Annotated[SensorBase | tuple[SensorBase, ...] | None, Registered("sensors")] = None
    """sensor, or a list with one for each true sensor"""
    start: Annotated[Part | None, Registered("starts")] = None
    """prior that is independent of the data: given, uniform or mixture"""
    faults: Literal["known"] | None = None
    """known: the true law of the sensors' faults; default: none"""
    delay: Literal["none"] | None = None
    """none: every measurement on time, as a bound; default: they arrive with their delays"""
    late: Treatment | Late | None = None
    """of late measurements: drop, apply or refilter, also as {kind: refilter, memory: 20}"""

    def __post_init__(self) -> None:
        if self.delay and self.late:
            raise InvalidKeyError("has no effect beside `delay: none`; leave one out", "late")

    def over(self, other: "Assume") -> "Assume":
        """Return these assumptions, with the other's where a key is unset.

        Parameters
        ----------
        other : Assume
            Assumptions of the scenario, for example, over which those of a filter have precedence.

        Returns
        -------
        Assume
            Assumptions of both. If ``delay`` or ``late`` is set here, neither is taken from ``other``.
        """
        delay = self.delay
        late = self.late
        # `delay` and `late` exclude each other: if one of them is set here, the other one is not taken
        # from ``other``.
        if not delay and not self.late:
            delay = other.delay
        if not late and not self.delay:
            late = other.late
        return Assume(
            motion=self.motion or other.motion,
            sensor=self.sensor or other.sensor,
            start=self.start or other.start,
            faults=self.faults or other.faults,
            delay=delay,
            late=late,
        )


def assumed_sensor(assume: Assume, true: Sensors, components: tuple[str, ...]) -> Sensors:
    """Choose the sensor of the filter model: the assumed or the true one.

    Parameters
    ----------
    assume : Assume
        Assumptions of a filter.
    true : Sensors
        True sensor, or all sensors as one.
    components : tuple of str
        Names of the state's components, in order.

    Returns
    -------
    Sensors
        Sensor for states of these components. It is the true one if the key ``sensor`` is unset.

    Raises
    ------
    InvalidKeyError
        If filters cannot assume the sensor, or if it measures other components than the true one.
    """
    if assume.sensor is None:  # the filter assumes the true one
        return true
    sensor = stack_for(assume.sensor, components, "assume", "sensor")
    _check_assumed(assume.sensor)
    if sensor.components != true.components:
        raise InvalidKeyError("the assumed sensor measures something else", "assume", "sensor")
    return sensor


def _check_assumed(sensors: SensorBase | tuple[SensorBase, ...]) -> None:
    """Raise InvalidKeyError if a key is set that is about true measurements, such as `bias`.

    No filter models these keys, so they have no effect on an assumed sensor.
    """
    several = sensors if isinstance(sensors, tuple) else (sensors,)
    # The base class of all sensors has these keys, and no others.
    names = [key.name for key in fields(SensorBase)]
    for i, sensor in enumerate(several):
        # Place of the sensor in the config's list, if it has a list.
        index = (i,) if isinstance(sensors, tuple) else ()
        for name in names:
            # The class's attribute is the key's default.
            if getattr(sensor, name) != getattr(SensorBase, name):
                message = (
                    "has no effect: no filter models it; set it at the scenario's own `sensor`"
                )
                raise InvalidKeyError(message, "assume", "sensor", *index, name)


OWN_MOTION = {"assume.motion": "as this filter has a motion of its own"}
"""Idle keys of a filter that uses only the time between steps of the assumed motion."""
