"""Sensors and measurements that figures of the plane draw: paths, landmarks, measured positions."""

from typing import cast

import numpy as np

from trackbench.core.arrays import Array
from trackbench.models.sensors.angular import AngularSensor
from trackbench.models.sensors.base import SensorBase
from trackbench.models.sensors.landmark import Landmark
from trackbench.models.sensors.stacked import Sensors, sensors_of
from trackbench.models.sensors.steps_at_once import is_equal_at_every_step
from trackbench.scenarios.base import Scenario
from trackbench.scenarios.position_from_one_scan import position_part


def sensor_paths(scenario: Scenario) -> list[tuple[int, Array]]:
    """Find the number, from 1, and the path (2, T + 1), m, of each sensor that measures from a place.

    Such a sensor is an `AngularSensor`, as a radar is. Sensors of positions stand nowhere.
    """
    sensors = sensors_of(cast(Sensors, scenario.true_sensor))
    paths = []
    for n, sensor in enumerate(sensors, 1):
        if isinstance(sensor, AngularSensor):
            places = []
            for k in scenario.steps:
                # An empty place is the origin; a height is left out.
                place = sensor.place(int(k)) or (0.0, 0.0)
                places.append(place[:2])
            paths.append((n, np.array(places).T))
    return paths


def landmark_places(scenario: Scenario) -> list[tuple[int, Array]]:
    """Find the place (2,), m, of each measured landmark, after the number of its sensor, from 1."""
    sensors = sensors_of(cast(Sensors, scenario.true_sensor))
    places = []
    for n, sensor in enumerate(sensors, 1):
        if isinstance(sensor, Landmark):
            places.append((n, np.array(sensor.at)))
    return places


def measured_positions(scenario: Scenario, z: Array) -> Array | None:
    """Return the positions (axes, T, r) that the measurements z (n_z, T, r) of r runs show.

    The T steps are those after the first, which has no measurement. A missing measurement gives NaN.
    None if no sensor alone measures a position.
    """
    sensor = scenario.true_sensor
    # The sensor that measures a position, among one or several, and its rows of z.
    sensor_and_rows = position_part(sensor) if isinstance(sensor, Sensors) else None
    if sensor_and_rows is None:
        return None
    locating_sensor, rows = sensor_and_rows
    if is_equal_at_every_step(cast(SensorBase, locating_sensor)):
        # All steps in one call: the axes of steps and runs become one. The sensor is the same at every
        # step, so that 0 stands for any.
        measured = z[rows]
        located = locating_sensor.located(measured.reshape(len(measured), -1), 0).mean
        return located.reshape(-1, *z.shape[1:])
    positions = []
    for i, k in enumerate(scenario.steps[1:]):  # the first step has no measurement
        positions.append(locating_sensor.located(z[rows, i], int(k)).mean)
    return np.stack(positions, axis=1)
