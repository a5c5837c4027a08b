"""Motions `map` and `ode`, whose equations stand in the config."""

from abc import abstractmethod
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Annotated

import numpy as np
from annotated_types import Interval

from trackbench.core.read_only import fixed
from trackbench.field_types import Finite, InvalidKeyError, freeze_mappings
from trackbench.models.base import SampledMotion
from trackbench.models.compiled_expressions import ArrayProgram
from trackbench.models.equations import Equations, Term
from trackbench.models.motions.linear import Linear
from trackbench.models.motions.nonlinear import (
    AdditiveNoise,
    AngledMotion,
    MapStep,
    StateNoise,
    Step,
)
from trackbench.models.motions.runge_kutta import MOST_SUBSTEPS, RungeKuttaStep
from trackbench.models.noise_covariances import Covariance, compile_covariance
from trackbench.registry import register


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
        """Compile f, its Jacobian and Q as `_compiled` does, with T and the inputs as variables.

        Raises InvalidKeyError for an input that neither f nor Q uses.
        """
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
        return f, f.jacobian, compile_covariance(equations, self.Q, self.components, "Q")

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
        # In programs of a motion with inputs T is a variable: they are the same for every T.
        f, jacobian, Q = self._compiled(T)
        step = self._step(T, f, jacobian)
        step.inputs = self.input
        angles = self.angle_rows(self.components)
        # If Q depends on nothing but T, it is one matrix for all steps of this length.
        if any(map(Q.uses, (*self.components, "k", "t", *self.input))):
            return StateNoise(self.components, T, step, Q, rows_of_angles=angles)
        # The state, k, t and the inputs may be any: zeros.
        scalars = (0.0, 0.0, T, *(0.0 for _ in self.input))
        Q_of_step = fixed(Q(np.zeros(len(self.components)), *scalars))
        return AdditiveNoise(self.components, T, step, Q_of_step, rows_of_angles=angles)

    @abstractmethod
    def _step(self, T: float, f: ArrayProgram, jacobian: ArrayProgram) -> "Step":
        """Return the noise-free motion over T seconds."""


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
        """Return the motion from step to step; of linear equations with constant noise a `Linear`.

        ``axes`` has no effect, as the key ``components`` names the state.
        """
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
    substeps: Annotated[int, Interval(ge=1, le=MOST_SUBSTEPS)] = 1
    """number of Runge-Kutta steps between two steps of the scenario"""

    @property
    def _terms(self) -> tuple[str, dict[str, Term]]:
        return "derivative", self.derivative

    def _step(self, T: float, f: ArrayProgram, jacobian: ArrayProgram) -> Step:
        return RungeKuttaStep(T, f, jacobian, self.substeps)
