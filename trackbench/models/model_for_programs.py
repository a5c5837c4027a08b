"""Filter model as plain data, with the keys of a config: what a program is told on its first line.

Numbers are in SI units and radians. A key whose name ends in another unit loses that ending:
``sigma_azimuth_mrad: 2`` becomes ``sigma_azimuth: 0.002``.
"""

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from trackbench.component_parts import Part, field_values
from trackbench.core.arrays import Array
from trackbench.field_types import key_of
from trackbench.models.angle_components import measured_angle_rows
from trackbench.models.base import Model, Motion, SampledMotion, Sensor
from trackbench.models.motions.linear import Linear
from trackbench.models.sensors.angular import AngularSensor
from trackbench.models.sensors.base import SensorBase
from trackbench.models.sensors.function import FunctionSensor
from trackbench.models.sensors.stacked import StackedSensor, sensors_of

PlainData: TypeAlias = dict[str, Any]
"""Mappings, lists, numbers and words."""

UNITS = {"_mrad": 1e-3, "_deg_s": math.pi / 180.0, "_deg": math.pi / 180.0}
"""Endings of keys whose numbers are not in radians, and the factor to radians."""
_NOT_MODELED = frozenset(field.name for field in fields(SensorBase))
"""Keys of true measurements, such as the bias, that no filter is told."""


class ModelDescription(NamedTuple):
    """Components of a config that a filter model was made from."""

    motion: Motion | None
    sensor: Sensor
    start: Part | None
    first_step: int
    """number of the step of the first state"""


class DescribedModel(Model):
    """Model of a scenario, with the components of the config that it was made from."""

    description: ModelDescription | None = None


def with_description(model: Model, description: ModelDescription | None) -> Model:
    """Return the model with a description, if there is one.

    Parameters
    ----------
    model : Model
        Filter model.
    description : ModelDescription or None
        Components of a config that the model was made from. None if there is no config.

    Returns
    -------
    Model
        A `DescribedModel`. It is the model itself if the description is None.
    """
    if description is None:
        return model
    described = DescribedModel(*model)
    described.description = description
    return described


def description_of(model: Model) -> ModelDescription | None:
    """Return the description of a model; None for one that was made without a config."""
    if isinstance(model, DescribedModel):
        return model.description
    return None


def describe_model(model: Model) -> PlainData:
    """Return motion, sensors, start and number of the first step of a model as plain data.

    Parameters
    ----------
    model : Model
        Filter model.

    Returns
    -------
    PlainData
        Mapping with the keys ``first_step``, ``motion``, ``sensors`` and ``start``, in SI units and
        radians. Without a description all but ``sensors`` are None. Sensors of an unknown class are
        None.
    """
    description = description_of(model)
    motion = None
    start = None
    first_step = None
    sensor = model.sensor
    if description is not None:
        sensor = description.sensor
        first_step = description.first_step
        if description.motion is not None:
            motion = _describe_motion(description.motion, model.motion)
        if description.start is not None:
            start = _to_plain_data(description.start)
    return {
        "first_step": first_step,
        "motion": motion,
        "sensors": _describe_sensors(sensor, len(model.motion.components)),
        "start": start,
    }


def _describe_motion(motion: Motion, sampled: SampledMotion) -> PlainData:
    """Return the keys of a motion, with F and Q as matrices if they are constant.

    ``motion`` is as the config names it, ``sampled`` the same motion over one sampling interval.
    """
    described: PlainData = _to_plain_data(motion)
    if isinstance(sampled, Linear):
        described["F"] = sampled.F.tolist()
    # A motion over unequal intervals is no `Linear` and has no T. Its Q is that of the first interval
    # only.
    Q = getattr(sampled, "Q", None)
    if hasattr(sampled, "T") and isinstance(Q, np.ndarray):
        described["Q"] = Q.tolist()
    return described


def _describe_sensors(sensor: Sensor, n: int) -> list[PlainData] | None:
    """Describe one sensor, or those that are joined to one; None for a sensor of an unknown class.

    ``n`` is the number of components of the state.
    """
    if not isinstance(sensor, SensorBase | StackedSensor):
        return None
    return [_describe_sensor(single, n) for single in sensors_of(sensor)]


def _describe_sensor(sensor: SensorBase, n: int) -> PlainData:
    """Return the keys of a sensor with its components, H if it is linear, and R if it is constant.

    ``n`` is the number of components of the state.
    """
    described: PlainData = {
        "kind": sensor.kind,
        "components": list(sensor.components),
        "angles": [sensor.components[row] for row in measured_angle_rows(sensor)],
    }
    # The origin, unless the sensor's own key `at` replaces it below.
    if isinstance(sensor, AngularSensor) and sensor.platform is None:
        described["at"] = [0.0] * sensor.axes
    for key, value in _to_plain_data(sensor).items():
        # Keys of true measurements, such as the bias, are left out: filters do not model them.
        if key not in _NOT_MODELED and key not in ("components", "angles"):
            described[key] = value
    H = getattr(sensor, "H", None)
    if H is not None:
        described["H"] = H(n).tolist()
    R = _constant_R(sensor)
    if R is not None:
        described["R"] = R.tolist()
    return described


def _constant_R(sensor: SensorBase) -> Array | None:
    """Return the covariance (n_z, n_z) of a sensor's noise if it is constant, and known as a matrix.

    Return None otherwise.
    """
    if isinstance(sensor, FunctionSensor):
        return sensor.constant_R
    R = getattr(sensor, "R", None)
    if isinstance(R, np.ndarray):
        return R
    if isinstance(R, float) and len(sensor.components) == 1:
        return np.array([[R]])
    return None


def _to_plain_data(value: object) -> Any:
    """Write a component, or the value of a key, with mappings, lists, numbers and words.

    Keys of a component without a value are left out. An infinite number or NaN becomes None, which
    counts as no value.
    """
    if is_dataclass(value) and not isinstance(value, type):
        mapping: PlainData = {}
        if isinstance(value, Part):
            mapping["kind"] = value.kind
        for name, inner in field_values(value).items():
            _put_value(mapping, key_of(name), inner)
        return mapping
    if isinstance(value, Mapping):
        mapping = {}
        for name, inner in value.items():
            mapping[str(name)] = _to_plain_data(inner)
        return mapping
    if isinstance(value, list | tuple):
        return [_to_plain_data(inner) for inner in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None  # JSON has no such number
    if value is None or isinstance(value, bool | int | float | str):
        return value
    return str(value)


def _put_value(mapping: PlainData, key: str, value: object) -> None:
    """Put the value of a key into a mapping, in SI units and radians, unless it is unset.

    A key whose name ends in another unit loses it: sigma_azimuth_mrad of 2 is sigma_azimuth of 0.002.
    """
    plain = _to_plain_data(value)
    if plain is None or plain in ([], {}):
        return
    for ending, factor in UNITS.items():
        if key.endswith(ending) and isinstance(plain, int | float):
            key = key.removesuffix(ending)
            plain = factor * plain
            break
    mapping[key] = plain
