"""Problems whose sensors are others: a filter fits these if it ignores places, or takes sigma for R."""

import math
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

from trackbench.contract.problems import ModelDraws
from trackbench.models.model_for_programs import UNITS
from trackbench.models.sensors.angular import AngularSensor
from trackbench.models.sensors.base import SensorBase
from trackbench.scenarios.base import Scenario
from trackbench.scenarios.tracking import Tracking


def with_sensors_at_origin(problem: Scenario) -> ModelDraws | None:
    """Move all sensors of a problem to the origin; None if they stand there, or cannot be moved.

    A filter that ignores the places of sensors fits with data from such sensors. The result has equal
    intervals between steps if ``problem`` has.
    """
    return _with_other_sensors(problem, _at_origin)


def with_sigma_as_variance(problem: Scenario) -> ModelDraws | None:
    """Take each sigma of the sensors as the variance; None if this changes nothing, or cannot be done.

    A filter whose R has sigma in place of sigma^2 fits with data from such sensors, also if it gets the
    model of ``problem``.
    """
    return _with_other_sensors(problem, _with_sigma_as_variance)


def _with_other_sensors(
    problem: Scenario, change_sensor: Callable[[Any], Any]
) -> ModelDraws | None:
    """Change all sensors of a problem, those of the truth and of the model; None if none changes.

    The result has equal intervals between steps if ``problem`` has.
    """
    base = problem
    unequal = False
    if isinstance(problem, ModelDraws):
        base = problem.base
        unequal = problem.unequal
    if not isinstance(base, Tracking):
        return None

    def change(sensor: Any) -> Any:
        """Change a sensor or each of a tuple of sensors; None stays None."""
        if isinstance(sensor, tuple):
            return tuple(change_sensor(single) for single in sensor)
        return change_sensor(sensor)

    changed = replace(
        base,
        sensor=change(base.sensor),
        assume=replace(base.assume, sensor=change(base.assume.sensor)),
    )
    if changed == base:
        return None
    return ModelDraws(base=changed, unequal=unequal)


def _at_origin(sensor: Any) -> Any:
    """Return a sensor without place and platform; None stays None."""
    if isinstance(sensor, AngularSensor) and not sensor.at_origin:
        return replace(sensor, at=(), platform=None)
    return sensor


def _with_sigma_as_variance(sensor: Any) -> Any:
    """Return a sensor whose keys `sigma...` are the roots of its own, in SI units; None stays None."""
    if not isinstance(sensor, SensorBase):
        return sensor
    roots: dict[str, Any] = {}
    for field in fields(sensor):
        sigma = getattr(sensor, field.name)
        if not field.name.startswith("sigma") or not isinstance(sigma, float):
            continue
        unit = 1.0
        for ending, factor in UNITS.items():
            if field.name.endswith(ending):
                unit = factor
        # Near one, sigma and sigma^2 are too alike for a cause: R would change by less than twice.
        if not 0.5 < sigma * unit < 2.0:
            roots[field.name] = math.sqrt(sigma * unit) / unit
    return replace(sensor, **roots)
