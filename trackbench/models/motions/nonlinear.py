"""Nonlinear motions: their noise, components that are angles, and motions written in Python."""

from abc import abstractmethod
from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import product
from typing import ClassVar, Self

import numpy as np

from trackbench.core.angles import near
from trackbench.core.arrays import Array, with_trailing
from trackbench.core.distributions import Gaussian
from trackbench.core.read_only import fixed
from trackbench.field_types import InvalidKeyError
from trackbench.models.base import Motion
from trackbench.models.compiled_expressions import ArrayProgram
from trackbench.models.inputs import KnownInputs
from trackbench.models.numerical_derivatives import central_differences


@dataclass(frozen=True, kw_only=True)
class AngledMotion(Motion):
    """Base of the motions whose components may be angles."""

    angles: tuple[str, ...] = ()
    """components that are angles in rad, equal after whole turns: {angles: [heading]}; default: those
    that a sensor measures alone as an angle. They turn by less than half a turn in a step"""

    @property
    def known_angles(self) -> tuple[str, ...]:
        """Names of components that are angles."""
        return self.angles

    def with_angles(self, angles: tuple[str, ...], axes: int) -> Self:
        """Return the motion with its own key ``angles``; if that is unset, with the argument ``angles``.

        Parameters
        ----------
        angles : tuple of str
            Names of components that are angles, rad. Names that are no components of the motion are left
            out.
        axes : int
            Number of axes of the space.

        Returns
        -------
        AngledMotion
            Copy of the motion with this key.
        """
        # The names of the components are the same for any interval.
        names = self.sampled(1.0, axes).components
        known = self.angles or tuple(name for name in angles if name in names)
        return replace(self, angles=known)

    def angle_rows(self, components: tuple[str, ...]) -> tuple[int, ...]:
        """Return the rows of the angles in a state of these components.

        Parameters
        ----------
        components : tuple of str
            Names of the state's components, in order.

        Returns
        -------
        tuple of int
            Rows of the components in the key ``angles``.

        Raises
        ------
        InvalidKeyError
            For a name in the key ``angles`` that is no component.
        """
        for i, name in enumerate(self.angles):
            if name not in components:
                message = f"{name!r} is not one of {', '.join(components)}"
                raise InvalidKeyError(message, "angles", i)
        return tuple(i for i, name in enumerate(components) if name in self.angles)


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

        Parameters
        ----------
        k : int
            Number of the new step.
        t : float
            Time at which the equations are evaluated, s.

        Returns
        -------
        tuple of float
            k and t. If the equations have inputs, T, s, and the inputs follow. The inputs are those that
            hold from step k - 1 to step k.

        Raises
        ------
        InvalidKeyError
            If the inputs have no values.
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


@dataclass(frozen=True, eq=False)
class SteppedMotion:
    """Base of a motion over T seconds: a step without noise and its derivatives."""

    components: tuple[str, ...]
    T: float
    step: Step
    rows_of_angles: tuple[int, ...] = field(default=(), kw_only=True)
    recorded_inputs: KnownInputs | None = field(default=None, kw_only=True)
    """inputs of the recording, if it has any, for motions that are sampled alike"""

    @property
    def known_inputs(self) -> KnownInputs | None:
        """Inputs in the equations, as `inputs.inputs_of`."""
        return self.step.known_inputs

    def with_inputs(self, known: KnownInputs) -> Self:
        """Return the motion with the values of its inputs, in the order of its key ``input``."""
        # The motion is cached, and other recordings may use it: its own step stays as it is.
        step = copy(self.step)
        step.known_inputs = known
        return replace(self, step=step)

    def jacobian(self, x: Array, k: int) -> Array:
        """Return df/dx (n, n[, *batch])."""
        return self.step.jacobian(x, k)

    @property
    def linear(self) -> bool:
        """Return True if x_k = F x_{k-1} + b + noise, with F, b and Q free of the state.

        F and b may depend on the step, as known inputs do. Any other motion raises AttributeError, so
        that `hasattr` gives False.
        """
        # The Jacobian, and Q if it is no constant, must not depend on a component. A step that is a
        # function in Python has no program J, so that this raises AttributeError, too.
        programs = [self.step.J]
        if isinstance(self, StateNoise):
            programs.append(self.cov)
        if any(program.uses(name) for program, name in product(programs, self.components)):
            raise AttributeError("this motion is not linear")
        return True

    @property
    def hessian(self) -> Callable[[Array, int], Array]:
        """Second derivatives of f as a function; AttributeError without a closed form."""
        return self.step.hessian  # type: ignore[attr-defined]


@dataclass(frozen=True, eq=False)
class AdditiveNoise(SteppedMotion):
    """Motion over T seconds with noise N(0, Q), Q (n, n)."""

    Q: Array

    def transition(self, x: Array, k: int) -> Gaussian:
        """Return N(f(x, k), Q) for x (n, *batch)."""
        return Gaussian(self.step(x, k), self.Q)


@dataclass(frozen=True, eq=False)
class StateNoise(SteppedMotion):
    """Motion over T seconds whose noise N(0, Q(x)) depends on the state before the step."""

    cov: ArrayProgram

    def transition(self, x: Array, k: int) -> Gaussian:
        """Return N(f(x, k), Q(x, k)) for x (n, *batch)."""
        return Gaussian(self.step(x, k), self.cov(x, *self.step.scalars(k, k * self.T)))


@dataclass(frozen=True, kw_only=True)
class NonlinearMotion(AngledMotion):
    """Base of a motion that is written in Python: a subclass has ``components``, `f` and `Q`.

    The Jacobian is taken by central differences.
    """

    components: ClassVar[tuple[str, ...]]
    """names of the state's components, in order"""

    @abstractmethod
    def f(self, x: Array, k: int, T: float) -> Array:
        """Return the states (n, *batch) at step k without noise.

        Parameters
        ----------
        x : array (n, *batch)
            States at step k - 1, which must stay as they are.
        k : int
            Number of the new step.
        T : float
            Time between the steps, s.

        Returns
        -------
        array (n, *batch)
            States at step k.
        """

    @abstractmethod
    def Q(self, T: float) -> Array:
        """Return the covariance of the noise.

        Parameters
        ----------
        T : float
            Time between the steps, s.

        Returns
        -------
        array (n, n)
            Covariance of the noise over T seconds.
        """

    @lru_cache(maxsize=64)  # noqa: B019 (a motion is a few numbers)
    def sampled(self, T: float, axes: int = 1) -> AdditiveNoise:
        """Return the motion over T seconds."""
        step = FunctionStep(self, T)
        Q = fixed(self.Q(T))
        return AdditiveNoise(self.components, T, step, Q, rows_of_angles=step.angles)


class FunctionStep(Step):
    """A noise-free step by a function, with a Jacobian by central differences."""

    def __init__(self, motion: NonlinearMotion, T: float) -> None:
        self.motion = motion
        self.T = T
        self.angles = motion.angle_rows(motion.components)

    def __call__(self, x: Array, k: int) -> Array:
        """Move states x (n, *batch) at step k - 1 to step k."""
        return near(np.asarray(self.motion.f(x, k, self.T)), x, self.angles)

    def jacobian(self, x: Array, k: int) -> Array:
        """Return the derivative (n, n, *batch) at x (n, *batch)."""
        return central_differences(lambda states: self(states, k), x)
