"""Noise-free steps of nonlinear motions: a map from step to step."""

import numpy as np

from trackbench.core.angles import near
from trackbench.core.arrays import Array, with_trailing
from trackbench.field_types import InvalidKeyError
from trackbench.models.equations import ArrayProgram
from trackbench.models.inputs import KnownInputs


class Step:
    """A noise-free step by a map: ``x_k = f(x_{k-1}, k)``, with t = k T."""

    inputs: tuple[str, ...] = ()
    """names of known inputs in the equations"""
    known_inputs: KnownInputs | None = None
    """values of these inputs, once `SteppedMotion.with_inputs` has set them"""

    def __init__(
        self, T: float, f: ArrayProgram, jacobian: ArrayProgram, angles: tuple[int, ...] = ()
    ) -> None:
        """Take compiled equations: f (n,) and its Jacobian (n, n), both of x, k, t and known inputs.

        T is the time between steps, s, and ``angles`` are the rows of the state that are angles, rad.
        """
        self.T = T
        self.f = f
        self.J = jacobian
        self.angles = angles

    def scalars(self, k: int, t: float) -> tuple[float, ...]:
        """Return the variables of the equations beside the state: k and t, or k, t, T and inputs.

        The inputs are those that hold from step k - 1 to step k.
        """
        if not self.inputs:
            return k, t
        if self.known_inputs is None:
            raise InvalidKeyError(f"the inputs {', '.join(self.inputs)} have no values")
        return k, t, self.T, *self.known_inputs.at(k)

    def __call__(self, x: Array, k: int) -> Array:
        """Move states x (n, *batch) at step k - 1 to step k.

        An angle stays within half a turn of the one before: equations with a cut, as of `atan2`, must
        not tear particles or sigma points apart.
        """
        moved = with_trailing(self.f(x, *self.scalars(k, k * self.T)), x.ndim - 1)
        return near(np.broadcast_to(moved, x.shape), x, self.angles)

    def jacobian(self, x: Array, k: int) -> Array:
        """Return the derivative (n, n[, *batch]) at x (n, *batch)."""
        return self.J(x, *self.scalars(k, k * self.T))


class MapStep(Step):
    """A step by a map whose second derivatives are expressions."""

    def hessian(self, x: Array, k: int) -> Array:
        """Return the second derivatives (n, n, n[, *batch]) at x (n, *batch)."""
        return self.J.jacobian(x, *self.scalars(k, k * self.T))
