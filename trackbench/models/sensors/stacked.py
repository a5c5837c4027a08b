"""Several sensors as one: their measurements are stacked, NaN where a sensor has none."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from trackbench.core.arrays import Array, with_trailing
from trackbench.core.distributions import Gaussian
from trackbench.core.random_streams import Streams
from trackbench.models.base import has_density, log_likelihood
from trackbench.models.sensors.base import SensorBase


@dataclass(frozen=True)
class StackedSensor:
    """Independent sensors of one target; components are named by their sensor's number, from 1."""

    sensors: tuple[SensorBase, ...]

    @cached_property
    def components(self) -> tuple[str, ...]:
        """Return names of the measurement's components, in order."""
        return tuple(f"{n}.{c}" for n, s in enumerate(self.sensors, 1) for c in s.components)

    def measurement(self, x: Array, k: int) -> Gaussian:
        """Return the distribution of all measurements given x_k = x (n_x, *batch)."""
        parts = [sensor.measurement(x, k) for sensor in self.sensors]
        # R is block diagonal, with a batch axis if any sensor's covariance has one.
        batch = max(part.cov.ndim for part in parts) - 2
        R = np.zeros((len(self.components),) * 2 + (parts[0].mean.shape[1:] if batch else ()))
        for rows, part in zip(self.rows, parts, strict=True):
            R[rows, rows] = with_trailing(part.cov, batch, leading=2)
        return Gaussian(np.concatenate([part.mean for part in parts]), R)

    def has_density(self) -> bool:
        """Return whether a sensor's noise is not normal."""
        return any(map(has_density, self.sensors))

    def why_no_moments(self) -> str:
        """Return the reason why a measurement has no covariance, or nothing."""
        return next(
            (why for s in self.sensors if has_density(s) and (why := s.why_no_moments())), ""
        )

    def log_density(self, z: Array, x: Array, k: int) -> Array:
        """Return the sum (M[, N]) of the independent sensors' log-likelihoods."""
        parts = zip(self.sensors, self.rows, strict=True)
        return np.add.reduce([log_likelihood(s, z[rows], x, k) for s, rows in parts])

    def draw_known(self, x: Array, k: int, noise: Array, rng: Streams) -> Array:
        """Draw measurements (n_z, M) of true states x; ``noise`` (n_z, M) is standard normal."""
        return self.measure(x, k, noise, rng, certain=True)

    def innovation(self, z: Array, z_pred: Array) -> Array:
        """Return ``z - z_pred``, angles wrapped."""
        pairs = zip(self.sensors, self.rows, strict=True)
        return np.concatenate([s.innovation(z[rows], z_pred[rows]) for s, rows in pairs])

    def jacobian(self, x: Array, k: int) -> Array:
        """Return d E[z_k] / d x_k (n_z, n_x[, *batch])."""
        parts = [sensor.jacobian(x, k) for sensor in self.sensors]
        batch = max(H.ndim for H in parts) - 2
        parts = [with_trailing(H, batch, leading=2) for H in parts]
        shape = x.shape[1:] if batch else ()
        return np.concatenate([np.broadcast_to(H, (*H.shape[:2], *shape)) for H in parts])

    @property
    def H(self) -> Callable[[int], Array]:
        """Return H (n_z, n) as a function of n; AttributeError if a sensor is nonlinear."""
        parts = [sensor.H for sensor in self.sensors]  # type: ignore[attr-defined]
        return lambda n: np.concatenate([H(n) for H in parts])

    def information(self, x: Array, k: int, certain: bool = False) -> Array:
        """Return ``H' R^-1 H`` (n_x, n_x) of all measurements of the state x (n_x,) at step k."""
        # The information of independent sensors adds.
        return np.add.reduce([sensor.information(x, k, certain) for sensor in self.sensors])

    def observables(self, x: Array) -> dict[str, Array]:
        """Return no observables."""
        return {}

    def measure(self, x: Array, k: int, noise: Array, rng: Streams, certain: bool = False) -> Array:
        """Return measurements (n_z, M) of true states x (n_x, M), NaN where one is missing."""
        pairs = zip(self.sensors, self.rows, strict=True)
        return np.concatenate([s.measure(x, k, noise[rows], rng, certain) for s, rows in pairs])

    @cached_property
    def rows(self) -> list[slice]:
        """Return each sensor's rows in a measurement."""
        ends = np.cumsum([len(sensor.components) for sensor in self.sensors]).tolist()
        return [slice(a, b) for a, b in pairwise([0, *ends])]


Sensors: TypeAlias = SensorBase | StackedSensor
"""One sensor, or several as one."""


def stack(sensors: tuple[SensorBase, ...] | SensorBase) -> Sensors:
    """Return one sensor, or several as one."""
    if not isinstance(sensors, tuple):
        return sensors
    return sensors[0] if len(sensors) == 1 else StackedSensor(sensors)


def sensors_of(sensor: Sensors) -> tuple[SensorBase, ...]:
    """Return the single sensors."""
    return sensor.sensors if isinstance(sensor, StackedSensor) else (sensor,)


def rows_of(sensor: Sensors) -> list[slice]:
    """Return the rows of each sensor's components in a measurement."""
    return sensor.rows if isinstance(sensor, StackedSensor) else [slice(None)]
