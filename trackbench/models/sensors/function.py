"""A sensor written as equations."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from trackbench.core.arrays import Array, with_trailing
from trackbench.core.distributions import Gaussian
from trackbench.field_types import Finite, InvalidKeyError, freeze_mappings
from trackbench.models.equations import ArrayProgram, Covariance, Equations, Term
from trackbench.models.sensors.angular_base import wrap_angle
from trackbench.models.sensors.base import SensorBase
from trackbench.registry import register


@register("sensors", "function")
@dataclass(frozen=True, kw_only=True)
class FunctionSensor(SensorBase):
    """``z_k = h(x_k, k) + N(0, R)``: an expression for each component of the measurement.

    ``{kind: function, h: {bearing: "atan2(py, px)"}, angles: [bearing], R: 1e-4}``. Expressions are
    those of the motion ``map``, of the target's components and the number of the step, ``k``.
    """

    h: dict[str, Term]
    """expression of each component of the measurement, of the components of the state"""
    R: Covariance
    """covariance of the normal noise: one variance for all components, a list or mapping of variances,
    or a matrix, of numbers or expressions of the state"""
    angles: tuple[str, ...] = ()
    """components that are angles in rad, whose differences wrap to (-pi, pi]"""
    parameters: dict[str, Finite] = field(default_factory=dict)
    """names and values of constants"""
    where: dict[str, Term] = field(default_factory=dict)
    """names and expressions of parts of the equations, each of what stands above it"""
    state: tuple[str, ...] = ()
    """names of the state's components, in order; default: those of the target"""

    components: ClassVar[tuple[str, ...]] = ()
    """names of the measurement's components: the keys of ``h``"""

    def __post_init__(self) -> None:
        freeze_mappings(self)
        object.__setattr__(self, "components", tuple(self.h))
        super().__post_init__()
        if not self.h:
            raise InvalidKeyError("name at least one component of the measurement", "h")
        for i, name in enumerate(self.angles):
            if name not in self.h:
                raise InvalidKeyError(f"{name!r} is not one of {', '.join(self.h)}", "angles", i)
        if self.state:
            _ = self._programs  # so that a mistake is found where the config is read

    def for_state(self, components: tuple[str, ...]) -> "FunctionSensor":
        """Return the sensor for a target with these components; raises InvalidKeyError."""
        return self if self.state else replace(self, state=components)

    @cached_property
    def _programs(self) -> tuple[ArrayProgram, ArrayProgram, ArrayProgram]:
        """Return h (n_z,), its Jacobian (n_z, n_x) and R (n_z, n_z); raises InvalidKeyError."""
        equations = Equations(self.state, ("k",), self.parameters, self.where)
        nodes = [equations.parse(term, "h", name) for name, term in self.h.items()]
        R = equations.covariance(self.R, self.components, "R")
        return equations.vector(nodes), equations.jacobian(nodes), R

    def measurement(self, x: Array, k: int) -> Gaussian:
        """Return N(h(x, k), R) for x (n_x, *batch), of which the first components are the state's."""
        h, _, R = self._programs
        # Further components of a filter's state do not enter h.
        x = x[: len(self.state)]
        mean = with_trailing(h(x, k), x.ndim - 1)
        return Gaussian(np.broadcast_to(mean, (len(mean), *x.shape[1:])), R(x, k))

    def innovation(self, z: Array, z_pred: Array) -> Array:
        """Return ``z - z_pred`` (n_z, *batch), angles wrapped to (-pi, pi]."""
        nu = z - z_pred
        for i, name in enumerate(self.h):
            if name in self.angles:
                nu[i] = wrap_angle(nu[i])
        return nu

    def jacobian(self, x: Array, k: int) -> Array:
        """Return dh/dx (n_z, n_x[, *batch]); zero for components of a filter's own."""
        H = self._programs[1](x[: len(self.state)], k)
        # Columns of zeros for the further components of a filter's state.
        padding = [(0, 0), (0, len(x) - len(self.state)), *[(0, 0)] * (H.ndim - 2)]
        return np.pad(H, padding)

    @property
    def H(self) -> "Constant":
        """Return H (n_z, n) as a function of n; AttributeError if h is not linear."""
        h, jacobian, R = self._programs
        if jacobian.constant is None or R.constant is None or not h.is_zero_at_zero():
            raise AttributeError("h is not linear")
        return Constant(jacobian.constant)


@dataclass(frozen=True, eq=False)
class Constant:
    """The matrix of a linear sensor, with columns of zeros for a filter's own components."""

    H: Array

    def __call__(self, n: int) -> Array:
        """Return the matrix (n_z, n)."""
        return np.pad(self.H, [(0, 0), (0, n - self.H.shape[1])])
