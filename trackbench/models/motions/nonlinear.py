"""Nonlinear motions written as equations: a map from step to step, and a differential equation."""

from abc import abstractmethod
from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import product
from typing import Annotated, ClassVar, Self

import numpy as np
from annotated_types import Interval

from trackbench.core.angles import near
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.read_only import fixed
from trackbench.field_types import Finite, InvalidKeyError, freeze_mappings
from trackbench.models.base import Motion, SampledMotion
from trackbench.models.equations import ArrayProgram, Covariance, Equations, Term
from trackbench.models.inputs import KnownInputs
from trackbench.models.motions.kinematic import Linear
from trackbench.models.motions.map_step import MapStep, Step
from trackbench.models.motions.runge_kutta import RungeKuttaStep
from trackbench.models.numerical_derivatives import central_differences
from trackbench.registry import register

_MOST_SUBSTEPS = 10_000  # some seconds for a step


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

        Names in the argument that are no components are left out. ``axes`` is the number of axes of the
        space.
        """
        # The names of the components are the same for any interval.
        names = self.sampled(1.0, axes).components
        known = self.angles or tuple(name for name in angles if name in names)
        return replace(self, angles=known)

    def angle_rows(self, components: tuple[str, ...]) -> tuple[int, ...]:
        """Return the rows of the angles in a state of these components.

        Raises InvalidKeyError for a name in the key ``angles`` that is no component.
        """
        for i, name in enumerate(self.angles):
            if name not in components:
                message = f"{name!r} is not one of {', '.join(components)}"
                raise InvalidKeyError(message, "angles", i)
        return tuple(i for i, name in enumerate(components) if name in self.angles)


@dataclass(frozen=True, kw_only=True)
class EquationMotion(AngledMotion):
    """Base of the motions whose equations stand in the config.

    Expressions have numbers, ``+ - * / **``, the functions sin, cos, tan, exp, log, sqrt, atan2, abs,
    min and max, and the names of components, parameters, inputs and parts; ``k`` is the number of the
    new step, ``T`` the time between steps, s, and ``pi``.
    """

    components: tuple[str, ...]
    """names of the state's components, in order"""
    parameters: dict[str, Finite] = field(default_factory=dict)
    """names and values of constants"""
    input: tuple[str, ...] = ()
    """names of known inputs in the equations, such as a robot's speed and turn rate: {input: [v, w]};
    the recording gives their values, by the target's key `input`"""
    where: dict[str, Term] = field(default_factory=dict)
    """names and expressions of parts of the equations, each of what stands above it"""
    Q: Covariance
    """covariance of the normal noise that is added once at each step, not multiplied by T: one variance
    for all components, a list or mapping of variances, or a matrix, of numbers or expressions of the
    state before the step"""

    def __post_init__(self) -> None:
        freeze_mappings(self)
        if not self.components:
            raise InvalidKeyError("name at least one component", "components")
        # Both raise InvalidKeyError, so that a mistake is found where the config is read.
        self.angle_rows(self.components)
        self._compiled(1.0)

    @property
    @abstractmethod
    def _terms(self) -> tuple[str, dict[str, Term]]:
        """Key of the equations and their expressions by component."""

    def _compiled(self, T: float) -> tuple[ArrayProgram, ArrayProgram, ArrayProgram]:
        """Compile the right sides f (n,), their Jacobian (n, n) and Q (n, n); raises InvalidKeyError.

        T, s, is a number in them, but a variable if there are inputs.
        """
        if self.input:
            return self._compiled_with_inputs()
        return self._compile(Equations(self.components, ("k", "t"), self.parameters, self.where, T))

    @lru_cache(maxsize=64)  # noqa: B019 (a motion is a few numbers)
    def _compiled_with_inputs(self) -> tuple[ArrayProgram, ArrayProgram, ArrayProgram]:
        """Compile as `_compiled` does, with T and the inputs as variables."""
        scalars = ("k", "t", "T")
        programs = self._compile(
            Equations(self.components, scalars, self.parameters, self.where, inputs=self.input)
        )
        f, _, Q = programs
        for i, name in enumerate(self.input):
            if not (f.uses(name) or Q.uses(name)):
                message = f"no equation uses the input {name!r}: use it, or leave it out"
                raise InvalidKeyError(message, "input", i)
        return programs

    def _compile(self, equations: Equations) -> tuple[ArrayProgram, ArrayProgram, ArrayProgram]:
        """Compile the right sides f (n,), their Jacobian (n, n) and Q (n, n); raises InvalidKeyError."""
        # Key of the config that has the equations, and the expression of each component.
        key, terms = self._terms
        for name in terms:
            if name not in self.components:
                raise InvalidKeyError(f"{name!r} is not one of the components", key, name)
        for name in self.components:
            if name not in terms:
                raise InvalidKeyError(f"there is no expression for {name!r}", key)
        f = equations.vector([equations.parse(terms[name], key, name) for name in self.components])
        return f, f.jacobian, equations.covariance(self.Q, self.components, "Q")

    @property
    def uses_time(self) -> bool:
        """True if the time t is in the equations."""
        return any(program.uses("t") for program in self._compiled(1.0))

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of the known inputs in the equations."""
        return self.input

    @lru_cache(maxsize=64)  # noqa: B019 (a motion is a few numbers)
    def sampled(self, T: float, axes: int = 1) -> SampledMotion:
        """Return the motion over T seconds; ``axes`` has no effect."""
        if self.input:
            return self._sampled_with_inputs(T)
        f, jacobian, Q = self._compiled(T)
        step = self._step(T, f, jacobian)
        angles = self.angle_rows(self.components)
        # Q may depend on the state before the step.
        if Q.constant is not None:
            return AdditiveNoise(self.components, T, step, Q.constant, rows_of_angles=angles)
        return StateNoise(self.components, T, step, Q, rows_of_angles=angles)

    def _sampled_with_inputs(self, T: float) -> "AdditiveNoise | StateNoise":
        """Return the motion over T seconds, whose inputs `with_inputs` is to set."""
        f, jacobian, Q = self._compiled(T)
        step = self._step(T, f, jacobian)
        step.inputs = self.input
        angles = self.angle_rows(self.components)
        # Q is one matrix for all steps of this length if nothing else is in it.
        if any(map(Q.uses, (*self.components, "k", "t", *self.input))):
            return StateNoise(self.components, T, step, Q, rows_of_angles=angles)
        # Q depends on T alone, so the state, k, t and the inputs may be any.
        scalars = (0.0, 0.0, T, *(0.0 for _ in self.input))
        Q_of_step = fixed(Q(np.zeros(len(self.components)), *scalars))
        return AdditiveNoise(self.components, T, step, Q_of_step, rows_of_angles=angles)

    @abstractmethod
    def _step(self, T: float, f: ArrayProgram, jacobian: ArrayProgram) -> "Step":
        """Return the noise-free motion over T seconds."""


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


@register("motions", "map")
@dataclass(frozen=True, kw_only=True)
class MapMotion(EquationMotion):
    """``x_k = f(x_{k-1}, k) + N(0, Q)``: an expression for each component.

    ``{kind: map, components: [x], next: {x: x/2 + 25*x/(1 + x**2) + 8*cos(1.2*k)}, Q: 10}``. The
    functions are sin, cos, tan, exp, log, sqrt, atan2, abs, min and max; ``k`` is the number of the new
    step, ``T`` the time between steps, s, and ``t`` is k T.
    """

    next: dict[str, Term]
    """expression of each component at the new step, of the components at the step before"""

    @property
    def _terms(self) -> tuple[str, dict[str, Term]]:
        return "next", self.next

    @lru_cache(maxsize=64)  # noqa: B019 (a motion is a few numbers)
    def sampled(self, T: float, axes: int = 1) -> SampledMotion:
        """Return the motion from step to step; of linear equations with constant noise a `Linear`."""
        if self.input:
            return self._sampled_with_inputs(T)
        f, jacobian, Q = self._compiled(T)
        # Linear: the Jacobian and Q are constant, and f(0) = 0.
        F = jacobian.constant
        if F is not None and Q.constant is not None and f.is_zero_at_zero():
            angles = self.angle_rows(self.components)
            return Linear(T=T, F=F, Q=Q.constant, components=self.components, rows_of_angles=angles)
        return super().sampled(T, axes)

    def _step(self, T: float, f: ArrayProgram, jacobian: ArrayProgram) -> Step:
        """Return the noise-free step, which keeps angles within half a turn of those before it.

        It does so only if an equation has an `atan2`: no other function jumps by a turn.
        """
        equations = (*self.next.values(), *self.where.values())
        has_cut = any("atan2" in str(term) for term in equations)
        return MapStep(T, f, jacobian, self.angle_rows(self.components) if has_cut else ())


@register("motions", "ode")
@dataclass(frozen=True, kw_only=True)
class OdeMotion(EquationMotion):
    """``dx/dt = f(x, t)`` from step to step by the classical Runge-Kutta method, then noise N(0, Q).

    ``{kind: ode, components: [x, y, z], derivative: {x: 10*(y - x), y: x*(28 - z) - y, z: x*y - 8/3*z},
    substeps: 5, Q: 0.1}``. Expressions are those of ``map``; the time ``t`` is zero at step 0. The noise
    is added after all substeps. White noise of spectral density q has about ``Q: q*T``.
    """

    derivative: dict[str, Term]
    """expression of each component's derivative by time"""
    substeps: Annotated[int, Interval(ge=1, le=_MOST_SUBSTEPS)] = 1
    """number of Runge-Kutta steps between two steps of the scenario"""

    @property
    def _terms(self) -> tuple[str, dict[str, Term]]:
        return "derivative", self.derivative

    def _step(self, T: float, f: ArrayProgram, jacobian: ArrayProgram) -> Step:
        return RungeKuttaStep(T, f, jacobian, self.substeps)
