"""Base classes of the audit's adapters: the scenario's model as matrices or as functions."""

from typing import Any, ClassVar

import numpy as np

from benchmarks.audit.nonlinear import Rule
from trackbench.adapters import PerRun
from trackbench.core.arrays import Array
from trackbench.models.angle_components import measured_angle_rows
from trackbench.models.motions.unequal_intervals import Irregular


class Matrices(PerRun):
    """A filter that takes F, Q, H and R, and perhaps all measurements so far."""

    def motion_matrices(self) -> tuple[Array, Array]:
        """Return F and Q of the interval before step k; before the first step, of the first."""
        motion: Any = self.model.motion
        if isinstance(motion, Irregular):
            motion = motion.motion_at(getattr(self, "k", motion.first))
        return motion.F, motion.Q

    def sensor_matrices(self) -> tuple[Array, Array]:
        """Return H and R; a nonlinear sensor has no H, and the contract then leaves it out."""
        sensor: Any = self.model.sensor
        return sensor.H(), sensor.R


class Functions(Matrices):
    """A filter that takes f(x) and h(x).

    ``rule`` is the filter of a textbook that it should equal on the nonlinear problems.
    """

    rule: ClassVar[Rule | None] = None
    k = 1

    def f(self, x: Array) -> Array:
        """Return the expected next state (n,)."""
        moved = self.model.motion.transition(np.ravel(x)[:, None], self.k)
        return np.asarray(moved.mean)[:, 0]

    def F(self, x: Array) -> Array:
        """Return the Jacobian of f (n, n)."""
        motion: Any = self.model.motion
        n = np.size(x)
        return np.asarray(motion.jacobian(np.ravel(x)[:, None], self.k)).reshape(n, n)

    def refuse_angles(self) -> None:
        """Raise ValueError if an angle is measured: the package has no option for its cut."""
        if measured_angle_rows(self.model.sensor):
            raise ValueError("the package has no option for angles")

    def h(self, x: Array) -> Array:
        """Return the expected measurement (n_z,)."""
        return np.asarray(self.model.sensor.measurement(np.ravel(x)[:, None], self.k).mean)[:, 0]

    def H(self, x: Array) -> Array:
        """Return the Jacobian of h (n_z, n)."""
        sensor: Any = self.model.sensor
        return np.asarray(sensor.jacobian(np.ravel(x)[:, None], self.k)).reshape(-1, np.size(x))

    def residual(self, a: Array, b: Array) -> Array:
        """Return a - b of measurements (n_z,), with angles in [-pi, pi)."""
        sensor = self.model.sensor
        return np.asarray(sensor.innovation(np.ravel(a)[:, None], np.ravel(b)[:, None]))[:, 0]

    @property
    def noises(self) -> tuple[Array, Array]:
        """Return Q and R."""
        x = np.zeros((len(self.model.motion.components), 1))
        Q = np.asarray(self.model.motion.transition(x, self.k).cov)
        R = np.asarray(self.model.sensor.measurement(x + 1.0, self.k).cov)
        return Q.reshape(len(Q), -1), R.reshape(len(R), -1)


class Batch(Matrices):
    """A function of all measurements so far: write ``filtered``; the last estimate is the step's.

    The first measurement comes a step after the prior.
    """

    def start(self, mean: Array, cov: Array) -> None:
        self.mean, self.cov = mean, cov
        self.rows: list[Array] = []
        self.steps: list[tuple[Array, Array]] = []

    def step(self, z: Array | None, dt: float) -> tuple[Array, Array]:
        H, R = self.sensor_matrices()
        self.rows.append(np.full(len(H), np.nan) if z is None else z)
        self.steps.append(self.motion_matrices())
        return self.filtered(np.array(self.rows), H, R)

    def filtered(self, z: Array, H: Array, R: Array) -> tuple[Array, Array]:
        """Return the last mean (n,) and covariance (n, n); z (T, n_z) has NaN for what is missing."""
        raise NotImplementedError

    @property
    def Fs(self) -> Array:
        """Return F of every step (T, n, n)."""
        return np.array([F for F, _ in self.steps])

    @property
    def Qs(self) -> Array:
        """Return Q of every step (T, n, n)."""
        return np.array([Q for _, Q in self.steps])

    @property
    def first(self) -> tuple[Array, Array]:
        """Return mean and covariance predicted to the first measurement."""
        F, Q = self.steps[0]
        return F @ self.mean, F @ self.cov @ F.T + Q

    def constant(self) -> tuple[Array, Array]:
        """Return F and Q of a package that takes one of each; an error at unequal intervals."""
        if not (np.ptp(self.Fs, axis=0) == 0.0).all():
            raise ValueError("the package takes one F for all steps")
        return self.steps[0]
