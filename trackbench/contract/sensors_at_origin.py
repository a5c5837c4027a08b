"""Problems whose sensors are moved to the origin: a filter that ignores their places fits these."""

from dataclasses import replace
from typing import Any

from trackbench.contract.problems import ModelDraws
from trackbench.models.sensors.angular import AngularSensor
from trackbench.scenarios.base import Scenario
from trackbench.scenarios.tracking import Tracking


def with_sensors_at_origin(problem: Scenario) -> ModelDraws | None:
    """Move all sensors of a problem to the origin; None if they stand there, or cannot be moved.

    A filter that ignores the places of sensors fits with data from such sensors. The result has equal
    intervals between steps if ``problem`` has.
    """
    base = problem
    unequal = False
    if isinstance(problem, ModelDraws):
        base = problem.base
        unequal = problem.unequal
    if not isinstance(base, Tracking):
        return None
    moved = replace(
        base,
        sensor=_at_origin(base.sensor),
        assume=replace(base.assume, sensor=_at_origin(base.assume.sensor)),
    )
    if moved == base:
        return None
    return ModelDraws(base=moved, unequal=unequal)


def _at_origin(sensor: Any) -> Any:
    """Return a sensor or a tuple of sensors without places and platforms; None stays None."""
    if isinstance(sensor, tuple):
        return tuple(_at_origin(single) for single in sensor)
    if isinstance(sensor, AngularSensor) and not sensor.at_origin:
        return replace(sensor, at=(), platform=None)
    return sensor
