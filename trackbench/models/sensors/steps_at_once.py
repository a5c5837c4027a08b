"""Sensors over many steps in one call, for the scores of predictions."""

from collections.abc import Sequence

import numpy as np

from trackbench.component_parts import foreign_parts
from trackbench.core.arrays import Array, with_trailing
from trackbench.core.distributions import Gaussian
from trackbench.models.base import Sensor
from trackbench.models.sensors.angular import AngularSensor
from trackbench.models.sensors.landmark import Landmark
from trackbench.models.sensors.position import LinearSensor


def is_equal_at_every_step(sensor: Sensor) -> bool:
    """Test whether a sensor is known to measure a state alike at every step.

    Moving sensors do not, and nothing is known of joined sensors, equations and plugins.

    Parameters
    ----------
    sensor : Sensor
        Sensor.

    Returns
    -------
    bool
        True if `measurement` does not depend on the step.
    """
    if type(sensor).measurement is LinearSensor.measurement:
        return True
    if foreign_parts(sensor):  # a plugin's class, or a part of one
        return False
    if isinstance(sensor, AngularSensor):
        return sensor.platform is None
    return isinstance(sensor, Landmark)


class SensorOfSteps:
    """Sensor of many steps at once: the batch (T M,) is the runs of each step in turn."""

    def __init__(self, sensor: Sensor, steps: Sequence[int]) -> None:
        """Take the sensor of one step, and the numbers of the T steps."""
        self.components = sensor.components
        self.innovation = sensor.innovation
        self._sensor = sensor
        self._steps = steps
        self._is_equal_at_every_step = is_equal_at_every_step(sensor)

    def measurement(self, x: Array, k: int) -> Gaussian:
        """Return the distribution of the measurements of the states of all steps.

        Parameters
        ----------
        x : array (n_x, *points, T M)
            States. The last axis has the M runs of the first step, then those of the second, and so on.
            ``points`` are axes such as that of sigma points.
        k : int
            Step, which has no effect.

        Returns
        -------
        Gaussian
            Mean (n_z, *points, T M), covariance (n_z, n_z), (n_z, n_z, T M) or
            (n_z, n_z, *points, T M).
        """
        if self._is_equal_at_every_step:
            return self._sensor.measurement(x, k)
        means = []
        covs = []
        states_of_steps = np.split(x, len(self._steps), axis=-1)
        for states, step in zip(states_of_steps, self._steps, strict=True):
            measured = self._sensor.measurement(np.ascontiguousarray(states), step)
            cov = with_trailing(measured.cov, 1, leading=2)
            means.append(measured.mean)
            covs.append(np.broadcast_to(cov, (*cov.shape[:-1], states.shape[-1])))
        return Gaussian(np.concatenate(means, axis=-1), np.concatenate(covs, axis=-1))
