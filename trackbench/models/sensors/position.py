"""Linear sensors: of position, of velocity, and of a scalar state."""

from dataclasses import dataclass
from functools import cache, cached_property
from typing import Annotated, ClassVar

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.read_only import fixed
from trackbench.field_types import Positive, Unit
from trackbench.models.sensors.base import SensorBase
from trackbench.registry import register


@dataclass(frozen=True, kw_only=True)
class LinearSensor(SensorBase):
    """``z = H x + N(0, R)`` for some of the state's components."""

    places: ClassVar[slice]
    """slice of the state that is measured"""
    any_state: ClassVar[bool] = False
    linear: ClassVar[bool] = True
    """read by the Kalman filter, whose sensors may also have offsets and change with the step"""

    @property
    def R(self) -> Array:
        """Noise covariance (n_z, n_z)."""
        raise NotImplementedError

    def H(self, n: int = 4) -> Array:
        """Return the measurement matrix for a state of n components.

        Parameters
        ----------
        n : int
            Number of the state's components. Columns of components that are not measured are zero.

        Returns
        -------
        array (n_z, n)
            Matrix of zeros and ones.
        """
        return selection_matrix(self.places.start, self.places.stop, self.places.step, n)

    def measurement(self, x: Array, k: int) -> Gaussian:
        """Return N(H x, R) for x (n, *batch)."""
        return Gaussian(x[self.places], self.R)

    def jacobian(self, x: Array, k: int) -> Array:
        """Return H (n_z, n)."""
        return self.H(len(x))


@dataclass(frozen=True, kw_only=True)
class AlongAxes(LinearSensor):
    """Base of the sensors that measure all axes, each with an independent error of one size."""

    sigma: Positive
    """standard deviation along each axis"""

    @cached_property
    def R(self) -> Array:
        """Noise covariance (axes, axes)."""
        return fixed(self.sigma * self.sigma * np.eye(len(self.components)))

    def errors(self, mean: Array, truth: Array) -> dict[str, Array]:
        """Return signed errors (1, *batch) along each axis."""
        e = mean[self.places] - truth[self.places]
        return {name: e[i : i + 1] for i, name in enumerate(self.components)}


@dataclass(frozen=True, kw_only=True)
class Positions(AlongAxes):
    """Base of the sensors of all positions."""

    sigma: Annotated[Positive, Unit("m")]
    """standard deviation along each axis, m"""

    axes: ClassVar[int]

    def located(self, z: Array, k: int) -> Gaussian:
        """Return the measured position, which is the measurement."""
        return Gaussian(z, self.R)


@register("sensors", "position")
@dataclass(frozen=True, kw_only=True)
class PositionSensor(Positions):
    """Both positions of a planar target, each with an independent error."""

    components: ClassVar[tuple[str, ...]] = ("x", "y")
    places: ClassVar[slice] = slice(0, 4, 2)
    axes: ClassVar[int] = 2

    @property
    def per_axis(self) -> Array:
        """Variance (1, 1) along each axis, for filters with a state per axis."""
        return np.array([[self.sigma * self.sigma]])


@register("sensors", "position-3d")
@dataclass(frozen=True, kw_only=True)
class PositionInSpace(Positions):
    """The three positions of a target in space, each with an independent error."""

    components: ClassVar[tuple[str, ...]] = ("x", "y", "z")
    places: ClassVar[slice] = slice(0, 6, 2)
    axes: ClassVar[int] = 3


@register("sensors", "velocity")
@dataclass(frozen=True, kw_only=True)
class VelocitySensor(AlongAxes):
    """Both velocities of a planar target, as it reports them by speed and course."""

    sigma: Annotated[Positive, Unit("m/s")]
    """standard deviation along each axis, m/s"""

    components: ClassVar[tuple[str, ...]] = ("vx", "vy")
    places: ClassVar[slice] = slice(1, 4, 2)


@register("sensors", "scalar")
@dataclass(frozen=True, kw_only=True)
class ScalarSensor(LinearSensor):
    """The first component of the state, with an error."""

    sigma: Positive
    """standard deviation"""

    components: ClassVar[tuple[str, ...]] = ("z",)
    places: ClassVar[slice] = slice(0, 1, 1)

    @cached_property
    def R(self) -> Array:
        """Noise covariance (1, 1)."""
        return fixed(np.array([[self.sigma * self.sigma]]))


@cache
def selection_matrix(start: int, stop: int, step: int, n: int) -> Array:
    """Return rows of a unit matrix, which select components of a state.

    Parameters
    ----------
    start, stop, step : int
        Slice ``start:stop:step`` of the selected components.
    n : int
        Number of the state's components.

    Returns
    -------
    array (n_z, n)
        One row for each selected component. It is read-only.
    """
    return fixed(np.ascontiguousarray(np.eye(n)[start:stop:step]))
