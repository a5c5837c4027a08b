"""What a motion and a sensor model are, and what may be asked of a pair of them."""

from functools import cache
from typing import NamedTuple, Protocol, cast, runtime_checkable

import numpy as np

from trackbench.core.arrays import Array, with_trailing
from trackbench.core.distributions import Distribution, Gaussian, zero_mean_log_prob


class Motion(Protocol):
    """p(x_k | x_{k-1}); ``components`` names the state's components, with units."""

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the state's components, in order."""

    def transition(self, x: Array, k: int) -> Distribution:
        """The distribution of x_k given x_{k-1} = x (n_x, *batch)."""


class Sensor(Protocol):
    """p(z_k | x_k), Gaussian in its own coordinates."""

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the measurement's components, in order."""

    def measurement(self, x: Array, k: int) -> Gaussian:
        """The distribution of z_k given x_k = x (n_x, *batch)."""

    def innovation(self, z: Array, z_pred: Array) -> Array:
        """``z - z_pred`` (n_z, *batch), angles wrapped to (-pi, pi]."""


@runtime_checkable
class DifferentiableMotion(Motion, Protocol):
    """A motion with a Jacobian, which extended Kalman filters need."""

    def jacobian(self, x: Array, k: int) -> Array:
        """d E[x_k] / d x_{k-1} at x (n_x, *batch); (n_x, n_x[, *batch])."""


@runtime_checkable
class DifferentiableSensor(Sensor, Protocol):
    """A sensor with a Jacobian, which extended Kalman filters need."""

    def jacobian(self, x: Array, k: int) -> Array:
        """d E[z_k] / d x_k at x (n_x, *batch); (n_z, n_x[, *batch])."""


@runtime_checkable
class NearSensor(Protocol):
    """A sensor that tells how far states are from a measurement faster than where they are."""

    def residual(self, z: Array, x: Array, k: int) -> Gaussian:
        """``innovation(z, E[z_k | x_k = x])`` and its covariance, for z (n_z, M) and x (n_x, M, N)."""


@cache
def _is_near(kind: type[object]) -> bool:
    return issubclass(kind, NearSensor)


class Model(NamedTuple):
    """What a filter knows: how the target moves and how it is seen."""

    motion: Motion
    sensor: Sensor


def log_likelihood(sensor: Sensor, z: Array, x: Array, k: int) -> Array:
    """log p(z_k | x_k = x) for z (n_z, M) and x (n_x, M[, N]); zero for a missing measurement."""
    if x.ndim == 3 and _is_near(type(sensor)):
        residual = cast(NearSensor, sensor).residual(z, x, k)
        value = zero_mean_log_prob(residual.mean, residual.cov)
    else:
        predicted = sensor.measurement(x, k)
        nu = sensor.innovation(with_trailing(z, predicted.mean.ndim - 1), predicted.mean)
        value = zero_mean_log_prob(nu, predicted.cov)
    missing = np.isnan(with_trailing(z, value.ndim)).any(axis=0)
    return np.where(missing, 0.0, value) if missing.any() else value
