"""Protocols of motion and sensor, and the model that a filter gets of both.

A planar state begins ``(px, vx, py, vy)``, one in space ``(px, vx, py, vy, pz, vz)``, m and m/s; what a
motion has beside them (accelerations, a turn rate) comes after. So every sensor, score and filter finds
positions in the even and velocities in the odd places of what all motions of a target share.
"""

from abc import abstractmethod
from functools import cache
from typing import ClassVar, NamedTuple, Protocol, TypeAlias, cast, runtime_checkable

import numpy as np

from trackbench.core import kalman
from trackbench.core.arrays import Array, Index, with_trailing
from trackbench.core.counting import note
from trackbench.core.distributions import Distribution, Gamma, Gaussian, zero_mean_log_prob
from trackbench.extension_points import Part

AXES = ("x", "y", "z")


def position_velocity_names(axes: int) -> tuple[str, ...]:
    """Return components of position and velocity along so many axes."""
    return tuple(name for axis in AXES[:axes] for name in (f"p{axis}", f"v{axis}"))


class SampledMotion(Protocol):
    """p(x_k | x_{k-1}); ``components`` names the state's components, with units."""

    @property
    def components(self) -> tuple[str, ...]:
        """Return names of the state's components, in order."""

    def transition(self, x: Array, k: int) -> Distribution:
        """Return the distribution of x_k given x_{k-1} = x (n_x, *batch)."""


def extra_std(motion: SampledMotion) -> tuple[float, ...]:
    """Return standard deviations, where nothing is known, of a motion's last components.

    Those are neither a position nor a velocity, and a target may not have them; a motion that has such
    components says so by an attribute of this name.
    """
    return getattr(motion, "extra_std", ())


class Motion(Part):
    """A motion as a config names it: a frozen dataclass, registered in the group ``motions``."""

    @abstractmethod
    def sampled(self, T: float, axes: int = 2) -> SampledMotion:
        """Return the motion over T seconds along so many axes (a scalar one has none)."""


class Sensor(Protocol):
    """p(z_k | x_k), Gaussian in its own coordinates: a frozen dataclass of the group ``sensors``."""

    @property
    def components(self) -> tuple[str, ...]:
        """Return names of the measurement's components, in order."""

    def measurement(self, x: Array, k: int) -> Gaussian:
        """Return the distribution of z_k given x_k = x (n_x, *batch)."""

    def innovation(self, z: Array, z_pred: Array) -> Array:
        """Return ``z - z_pred`` (n_z, *batch), angles wrapped to (-pi, pi]."""


class DifferentiableMotion(SampledMotion, Protocol):
    """A motion with a Jacobian, which extended Kalman filters need."""

    def jacobian(self, x: Array, k: int) -> Array:
        """Return d E[x_k] / d x_{k-1} at x (n_x, *batch); (n_x, n_x[, *batch])."""


class DifferentiableSensor(Sensor, Protocol):
    """A sensor with a Jacobian, which extended Kalman filters need."""

    def jacobian(self, x: Array, k: int) -> Array:
        """Return d E[z_k] / d x_k at x (n_x, *batch); (n_z, n_x[, *batch])."""


Differentiable: TypeAlias = tuple[DifferentiableMotion, DifferentiableSensor]
"""A model of which both parts have a Jacobian, for a cast."""


@runtime_checkable
class NormalMotion(Protocol):
    """A motion whose noise is N(0, Q)."""

    @property
    def Q(self) -> Array:
        """Return the covariance of the noise (n_x, n_x)."""


@runtime_checkable
class GammaMotion(Protocol):
    """A motion of a scalar whose noise is a gamma variate."""

    @property
    def noise(self) -> Gamma:
        """Return the noise's distribution."""


@runtime_checkable
class LocatingSensor(Protocol):
    """A sensor of which one measurement tells the position."""

    axes: ClassVar[int]
    """along so many axes"""

    def located(self, z: Array, k: int) -> Gaussian:
        """Return the position (axes, M) that a measurement gives, and its covariance."""


@runtime_checkable
class NearSensor(Protocol):
    """A sensor that tells how far states are from a measurement faster than where they are."""

    def residual(self, z: Array, x: Array, k: int) -> Gaussian:
        """Return ``innovation(z, E[z_k | x_k = x])`` and its covariance, for particles x (n_x, M, N)."""


@cache
def _is_near(kind: type[object]) -> bool:
    return issubclass(kind, NearSensor)


class Model(NamedTuple):
    """Model of a filter: motion and sensor."""

    motion: SampledMotion
    sensor: Sensor


class Scene(Part):
    """Facts about a scenario that a filter may check before anything runs."""

    @property
    @abstractmethod
    def model(self) -> Model:
        """Return the motion and sensor of the truth, which filters assume unless told otherwise."""

    @property
    @abstractmethod
    def steps(self) -> Index:
        """Step numbers k (T + 1,), the prior's first."""

    @property
    @abstractmethod
    def times(self) -> Array:
        """Return times of the steps (T + 1,), s."""

    @property
    def prior_type(self) -> type[Distribution]:
        """Return the class of the prior, for filters that ask it for more than moments."""
        return Gaussian

    @property
    def turns(self) -> tuple[float, ...]:
        """Return sizes of the accelerations of the target's turns, m/s^2."""
        return ()


def log_likelihood(sensor: Sensor, z: Array, x: Array, k: int) -> Array:
    """Return log p(z_k | x_k = x) for z (n_z, M) and x (n_x, M[, N]).

    Of the components that were measured, if some are missing (NaN); zero where all are.
    """
    note("likelihoods", x, components=1)
    if x.ndim == 3 and _is_near(type(sensor)):
        seen = cast(NearSensor, sensor).residual(z, x, k)
        nu, R = seen.mean, seen.cov
    else:
        predicted = sensor.measurement(x, k)
        R = predicted.cov
        nu = sensor.innovation(with_trailing(z, predicted.mean.ndim - 1), predicted.mean)
    missing = np.isnan(with_trailing(z, nu.ndim - 1))
    if not missing.any():
        return zero_mean_log_prob(nu, R)
    value = kalman.log_prob_of_measured(nu, kalman.drop_missing_cov(R, missing), missing)
    return np.where(missing.all(axis=0), 0.0, value)
