"""Several sensors of one target, stacked into one measurement."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from trackbench.core.arrays import Array, with_trailing
from trackbench.core.distributions import Gaussian
from trackbench.core.random_streams import Streams
from trackbench.field_types import InvalidKeyError
from trackbench.models.likelihood import has_own_density, log_likelihood
from trackbench.models.sensors.base import SensorBase


@dataclass(frozen=True)
class StackedSensor:
    """Independent sensors of one target; components are named by their sensor's number, from 1."""

    sensors: tuple[SensorBase, ...]

    @cached_property
    def components(self) -> tuple[str, ...]:
        """Names of the measurement's components, in order: 1.range, 1.azimuth, 2.range, ..."""
        names: list[str] = []
        for n, sensor in enumerate(self.sensors, 1):
            names += [f"{n}.{component}" for component in sensor.components]
        return tuple(names)

    def measurement(self, x: Array, k: int) -> Gaussian:
        """Return the distribution of all measurements given x_k = x (n_x, *batch)."""
        measured = [sensor.measurement(x, k) for sensor in self.sensors]
        # R is block diagonal, with batch axes if any sensor's covariance has them.
        n_z = len(self.components)
        axes = max(single.cov.ndim for single in measured) - 2
        batch = measured[0].mean.shape[1:] if axes else ()
        R = np.zeros((n_z, n_z, *batch))
        for rows, single in zip(self.rows, measured, strict=True):
            R[rows, rows] = with_trailing(single.cov, axes, leading=2)
        return Gaussian(np.concatenate([single.mean for single in measured]), R)

    def has_density(self) -> bool:
        """Return whether a sensor's noise is not normal."""
        return any(map(has_own_density, self.sensors))

    def why_no_moments(self) -> str:
        """Return the reason why a measurement has no covariance; empty if it has one.

        Only noise that is not normal, such as Student's t, may have none.
        """
        for sensor in self.sensors:
            if has_own_density(sensor):
                reason = sensor.why_no_moments()
                if reason:
                    return reason
        return ""

    def log_density(self, z: Array, x: Array, k: int) -> Array:
        """Return the sum (M[, N]) of the independent sensors' log-likelihoods."""
        pairs = zip(self.sensors, self.rows, strict=True)
        return np.add.reduce([log_likelihood(sensor, z[rows], x, k) for sensor, rows in pairs])

    def draw_known(self, x: Array, k: int, noise: Array, rng: Streams) -> Array:
        """Draw measurements (n_z, M) of true states x, without outliers and bias, as filters know them.

        ``noise`` (n_z, M) is standard normal.
        """
        drawn = []
        for sensor, rows in zip(self.sensors, self.rows, strict=True):
            if has_own_density(sensor):
                drawn.append(sensor.draw_known(x, k, noise[rows], rng))
            else:
                drawn.append(sensor.draw(x, k, noise[rows]))
        return np.concatenate(drawn)

    def innovation(self, z: Array, z_pred: Array) -> Array:
        """Return ``z - z_pred``, angles wrapped."""
        pairs = zip(self.sensors, self.rows, strict=True)
        return np.concatenate([s.innovation(z[rows], z_pred[rows]) for s, rows in pairs])

    def jacobian(self, x: Array, k: int) -> Array:
        """Return d E[z_k] / d x_k (n_z, n_x[, *batch])."""
        jacobians = [sensor.jacobian(x, k) for sensor in self.sensors]
        # Matrices get batch axes if any of them has some.
        axes = max(H.ndim for H in jacobians) - 2
        batch = x.shape[1:] if axes else ()
        rows = []
        for H in jacobians:
            rows.append(np.broadcast_to(with_trailing(H, axes, leading=2), (*H.shape[:2], *batch)))
        return np.concatenate(rows)

    @property
    def H(self) -> Callable[[int], Array]:
        """Function that returns the measurement matrix (n_z, n) for a state of n components.

        It raises AttributeError if a sensor is nonlinear, so that `hasattr` gives False.
        """
        matrices = [sensor.H for sensor in self.sensors]  # type: ignore[attr-defined]
        return lambda n: np.concatenate([H(n) for H in matrices])

    @property
    def linear(self) -> bool:
        """Return True; AttributeError if a sensor is nonlinear."""
        return all(sensor.linear for sensor in self.sensors)  # type: ignore[attr-defined]

    def information(self, x: Array, k: int, certain: bool = False) -> Array:
        """Return ``H' R^-1 H`` (n_x, n_x[, M]) of all measurements of x (n_x[, M]) at step k.

        Unless the measurements are ``certain``, each is weighted by its probability.
        """
        # The information of independent sensors adds.
        informations = [sensor.information(x, k, certain) for sensor in self.sensors]
        axes = max(J.ndim for J in informations) - 2
        alike = [with_trailing(J, axes, leading=2) for J in informations]
        return np.add.reduce(np.broadcast_arrays(*alike))

    def observables(self, x: Array) -> dict[str, Array]:
        """Return an empty dictionary: joined sensors have no observables."""
        return {}

    def measure(self, x: Array, k: int, noise: Array, rng: Streams, certain: bool = False) -> Array:
        """Return measurements (n_z, M) of true states x (n_x, M), NaN where one is missing."""
        pairs = zip(self.sensors, self.rows, strict=True)
        return np.concatenate([s.measure(x, k, noise[rows], rng, certain) for s, rows in pairs])

    @cached_property
    def rows(self) -> list[slice]:
        """Each sensor's rows in a measurement."""
        ends = np.cumsum([len(sensor.components) for sensor in self.sensors]).tolist()
        return [slice(a, b) for a, b in pairwise([0, *ends])]


Sensors: TypeAlias = SensorBase | StackedSensor
"""One sensor, or several as one."""


def stack(sensors: tuple[SensorBase, ...] | SensorBase) -> Sensors:
    """Join several sensors to one; a single sensor is returned as it is."""
    if not isinstance(sensors, tuple):
        return sensors
    return sensors[0] if len(sensors) == 1 else StackedSensor(sensors)


def stack_for(
    sensors: SensorBase | tuple[SensorBase, ...], components: tuple[str, ...], *path: str
) -> Sensors:
    """Join sensors that measure a state with these components to one.

    Parameters
    ----------
    sensors : SensorBase or tuple of SensorBase
        Sensors of the config.
    components : tuple of str
        Names of the state's components, in order.
    *path : str
        Key of the sensors in the config, for an error.

    Returns
    -------
    Sensors
        A single sensor, or a `StackedSensor`.

    Raises
    ------
    InvalidKeyError
        For a sensor that cannot measure the state.
    """
    several = sensors if isinstance(sensors, tuple) else (sensors,)
    fitted = []
    for i, sensor in enumerate(several):
        try:
            fitted.append(sensor.for_state(components))
        except InvalidKeyError as error:
            index = (i,) if isinstance(sensors, tuple) else ()
            raise InvalidKeyError(str(error), *path, *index, *error.path) from None
    return stack(tuple(fitted))


def with_angles_of_state(sensor: Sensors, angles: tuple[str, ...]) -> Sensors:
    """Return the sensor, or the joined sensors, for a state whose components ``angles`` are angles.

    Parameters
    ----------
    sensor : Sensors
        Sensor, or several as one.
    angles : tuple of str
        Names of the state's components that are angles, rad.

    Returns
    -------
    Sensors
        Sensor that wraps the angles that it measures. It is the argument itself if nothing changes.
    """
    sensors = sensors_of(sensor)
    fitted = tuple(each.with_angles_of_state(angles) for each in sensors)
    if all(a is b for a, b in zip(fitted, sensors, strict=True)):
        return sensor
    return stack(fitted)


def sensors_of(sensor: Sensors) -> tuple[SensorBase, ...]:
    """List the sensors that were joined to one, or the single sensor."""
    return sensor.sensors if isinstance(sensor, StackedSensor) else (sensor,)


def rows_of(sensor: Sensors) -> list[slice]:
    """List the rows of a measurement that each of the joined sensors measures."""
    return sensor.rows if isinstance(sensor, StackedSensor) else [slice(None)]


def sensor_name(number: int, names: Sequence[str]) -> str:
    """Return words for a sensor by its number from 0: ``sensor 3 (4)`` if its recorded name is 4."""
    words = f"sensor {number + 1}"
    if number < len(names) and str(names[number]) != str(number + 1):
        words += f" ({names[number]})"
    return words
