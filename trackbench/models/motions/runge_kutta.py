"""Integration of ``dx/dt = f(x, t)`` over a step of a motion: the classical Runge-Kutta method."""

import numpy as np

from trackbench.core import linalg
from trackbench.core.arrays import Array, with_trailing
from trackbench.models.compiled_expressions import ArrayProgram
from trackbench.models.motions.nonlinear import Step
from trackbench.models.numerical_derivatives import hessian_by_differences

MOST_SUBSTEPS = 10_000
"""Largest number of substeps, which takes some seconds for a step."""
_COLUMNS = 16_384  # states that are integrated at a time: their slopes stay in the cache


class RungeKuttaStep(Step):
    """A noise-free step by ``dx/dt = f(x, t)`` from t = (k - 1) T on, by the Runge-Kutta method."""

    def __init__(self, T: float, f: ArrayProgram, jacobian: ArrayProgram, substeps: int) -> None:
        super().__init__(T, f, jacobian)
        self.substeps = substeps

    def __call__(self, x: Array, k: int) -> Array:
        """Move states x (n, *batch) at step k - 1 to step k."""
        if x.size <= len(x) * _COLUMNS:
            return self._integrate(x, k)
        # Many particles: take each piece that fits the cache through all substeps before the next one.
        flat = x.reshape(len(x), -1)
        out = np.empty(flat.shape)
        for first in range(0, flat.shape[1], _COLUMNS):
            piece = slice(first, first + _COLUMNS)
            out[:, piece] = self._integrate(flat[:, piece], k)
        return out.reshape(x.shape)

    def _integrate(self, x: Array, k: int) -> Array:
        """Integrate states x (n, *batch) from step k - 1 to step k, in equal substeps."""
        h = self.T / self.substeps
        for i in range(self.substeps):
            # x + h/6 (k1 + 2 k2 + 2 k3 + k4)
            slopes = [slope for slope, _ in self._stages(x, k, i)]
            x = x + h / 6.0 * sum_of_slopes(*slopes)
        return x

    def _stages(self, x: Array, k: int, i: int) -> list[tuple[Array, Array]]:
        """Return (slope, state at which it is taken), (n, *batch) each, of the four stages of a substep.

        It is substep i, from 0, between steps k - 1 and k, and begins in states x.
        """
        h = self.T / self.substeps
        stages = list[tuple[Array, Array]]()
        t = (k - 1) * self.T + i * h
        state = x
        # k1 = f(x, t), k2 = f(x + h/2 k1, t + h/2), k3 = f(x + h/2 k2, t + h/2), k4 = f(x + h k3, t + h)
        # Each stage sets state and time of the next one, `ahead` substeps after the first.
        for ahead in (0.5, 0.5, 1.0, None):
            # The scalars of f are k and t, or k, t, T and the inputs that hold up to step k.
            slope = with_trailing(self.f(state, *self.scalars(k, t)), x.ndim - 1)
            stages.append((slope, state))
            if ahead is not None:
                state = x + (ahead * h) * slope
                t = (k - 1) * self.T + (i + ahead) * h
        return stages

    def jacobian(self, x: Array, k: int) -> Array:
        """Return the derivative (n, n, *batch) of the Runge-Kutta step at x (n, *batch)."""
        h = self.T / self.substeps
        identity = with_trailing(np.eye(len(x)), x.ndim - 1, leading=2)
        F = identity
        for i in range(self.substeps):
            stages = self._stages(x, k, i)
            slopes: list[Array] = []
            # K1 = J(x), K2 = J(x + h/2 k1) (I + h/2 K1), ...: the derivatives of the stages by x.
            for (_, state), ahead in zip(stages, (0.0, 0.5, 0.5, 1.0), strict=True):
                t = (k - 1) * self.T + (i + ahead) * h
                # The scalars of J are k and t, or k, t, T and the inputs that hold up to step k.
                J = with_trailing(self.J(state, *self.scalars(k, t)), x.ndim - 1, leading=2)
                if slopes:
                    inner = identity + (ahead * h) * slopes[-1]
                    slopes.append(linalg.matmul(J, inner))
                else:
                    slopes.append(J)
            # Chain rule: F = (I + h/6 (K1 + 2 K2 + 2 K3 + K4)) F
            of_substep = identity + h / 6.0 * sum_of_slopes(*slopes)
            F = of_substep if i == 0 else linalg.matmul(of_substep, F)
            x = x + h / 6.0 * sum_of_slopes(*[slope for slope, _ in stages])
        return F

    def hessian(self, x: Array, k: int) -> Array:
        """Return the second derivatives (n, n, n, *batch) of the Runge-Kutta step, by differences."""
        return hessian_by_differences(self.jacobian, x, k, side_by_side=True)


def sum_of_slopes(k1: Array, k2: Array, k3: Array, k4: Array) -> Array:
    """Compute ``k1 + 2 k2 + 2 k3 + k4``."""
    return k1 + 2.0 * (k2 + k3) + k4
