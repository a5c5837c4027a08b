"""Sensor that measures the states of many steps in one call, for the scores of predictions."""

from collections.abc import Sequence

import numpy as np

from trackbench.core.arrays import Array, with_trailing
from trackbench.core.distributions import Gaussian
from trackbench.models.base import Sensor
from trackbench.models.sensors.position import LinearSensor


class SensorOfSteps:
    """Sensor of many steps at once: the batch (T M,) is the runs of each step in turn."""

    def __init__(self, sensor: Sensor, steps: Sequence[int]) -> None:
        self.components = sensor.components
        self.innovation = sensor.innovation
        self._sensor = sensor
        self._steps = steps

    def measurement(self, x: Array, k: int) -> Gaussian:
        """Return the distribution of the measurements of states x (n_x, *points, T M)."""
        if type(self._sensor).measurement is LinearSensor.measurement:
            return self._sensor.measurement(x, k)  # which is equal at every step
        means = []
        covs = []
        states_of_steps = np.split(x, len(self._steps), axis=-1)
        for states, step in zip(states_of_steps, self._steps, strict=True):
            measured = self._sensor.measurement(np.ascontiguousarray(states), step)
            cov = with_trailing(measured.cov, 1, leading=2)
            means.append(measured.mean)
            covs.append(np.broadcast_to(cov, (*cov.shape[:-1], states.shape[-1])))
        return Gaussian(np.concatenate(means, axis=-1), np.concatenate(covs, axis=-1))
