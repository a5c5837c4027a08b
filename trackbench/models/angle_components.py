"""Components that are angles: found by a sensor's innovations, or by their names; their unit."""

import re
from collections.abc import Collection

import numpy as np

from trackbench.metrics import unit_of
from trackbench.models.base import Sensor

_DIRECTIONS = frozenset(("heading", "bearing", "azimuth", "yaw", "course"))
"""Words of the names of components that are angles."""
_NO_DIRECTIONS = frozenset(("rate", "dot", "bias", "offset", "velocity", "speed"))
"""Words beside them in the names of components that are none."""


def measured_angle_rows(sensor: Sensor) -> tuple[int, ...]:
    """Return the rows of the measured angles: a whole turn changes nothing in their innovation."""
    n = len(sensor.components)
    zero = np.zeros((n, n))
    # Component i of column i differs by a whole turn, of which an angle's innovation is zero, or by a
    # tenth of a radian, which an angle's innovation keeps.
    of_turn = np.diagonal(sensor.innovation(2.0 * np.pi * np.eye(n), zero))
    of_tenth = np.diagonal(sensor.innovation(0.1 * np.eye(n), zero))
    is_angle = np.isclose(of_turn, 0.0, atol=1e-9) & np.isclose(of_tenth, 0.1)
    return tuple(np.flatnonzero(is_angle).tolist())


def may_be_angle(name: str) -> bool:
    """Test whether a component's name is that of a direction, such as heading and yaw_rad."""
    words = set(re.findall("[a-z]+", name.lower()))
    return not words.isdisjoint(_DIRECTIONS) and words.isdisjoint(_NO_DIRECTIONS)


def unit_of_component(name: str, angles: Collection[str]) -> str:
    """Return the unit of a component of the state: rad for an angle without another; empty if unknown.

    ``angles`` are the names of the components that are angles.
    """
    unit = unit_of(f"rmse_{name}")  # that of the component's error
    if not unit and name in angles:
        return "rad"
    return unit
