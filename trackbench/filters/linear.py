"""Filters for linear motion and a linear position sensor: Kalman with any motion, alpha-beta."""

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.random import Generator

from trackbench.core import kalman, linalg
from trackbench.core.arrays import Array
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.kalman import Innovation
from trackbench.keys import MistakenKeyError, OpenShare, Positive
from trackbench.models.base import Model
from trackbench.models.linear import PositionSensor
from trackbench.models.motions import ConstantAcceleration, ConstantVelocity, MotionKey
from trackbench.registry import register

LINEAR = ("motion.T", "motion.F", "sensor.H")
"""What a filter of this kind needs of the model."""


class Tracked(NamedTuple):
    """N(mean, cov) of all components, the last NIS (M,), and how many components are reported."""

    posterior: Gaussian
    nis: Array
    reported: int

    @property
    def estimate(self) -> Gaussian:
        """The scenario's own components."""
        n = self.reported
        return Gaussian(self.posterior.mean[:n], self.posterior.cov[:n, :n])


def extended(prior: Distribution, motion: Any) -> Gaussian:
    """The prior (4,) of a motion that may have accelerations: zero, ``initial_std`` each."""
    if not isinstance(motion, ConstantAcceleration):
        return Gaussian(prior.mean, prior.cov)
    n = len(prior.mean)
    mean = np.concatenate([prior.mean, np.zeros((2, *prior.mean.shape[1:]))])
    cov = np.zeros((n + 2, n + 2, *prior.cov.shape[2:]))
    cov[:n, :n] = prior.cov
    cov[n, n] = cov[n + 1, n + 1] = motion.initial_std**2
    return Gaussian(mean, cov)


def linear_step(
    state: Gaussian, F: Array, Q: Array, z: Array, sensor: PositionSensor
) -> tuple[Gaussian, Innovation]:
    """Predict by F and Q, update with positions z (2, M) (adaptive-kf, eqs. 8-12)."""
    predicted = kalman.predict(state, F, Q)
    H = sensor.H(len(F))
    return kalman.update(predicted, z - linalg.matvec(H, predicted.mean), H, sensor.R)


@register("filters", "kf")
@dataclass(frozen=True, kw_only=True)
class KF:
    """Kalman filter of a linear motion and a position sensor (adaptive-kf paper, eqs. 8-12).

    The covariance does not depend on the data, so it and the gain are computed once for all runs.
    """

    motion: MotionKey | None = None
    """motion assumed, such as {kind: cv, q: 0.01}; default: the scenario's"""
    needs: ClassVar[tuple[str, ...]] = LINEAR

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Tracked:
        """The prior's moments."""
        runs = prior.mean.shape[1]
        posterior = extended(prior, self.motion)
        return Tracked(posterior, np.full(runs, np.nan), len(prior.mean))

    def step(self, model: Model, state: Tracked, z: Array, k: int, rng: Generator) -> Tracked:
        """Predict and update."""
        own: Any = model.motion
        motion = own if self.motion is None else self.motion.sampled(own.T)
        sensor: Any = model.sensor
        posterior, innovation = linear_step(state.posterior, motion.F, motion.Q, z, sensor)
        return Tracked(posterior, innovation.nis, state.reported)

    def estimate(self, state: Tracked) -> Gaussian:
        """The posterior of position and velocity."""
        return state.estimate

    def diagnostics(self, state: Tracked) -> dict[str, Array]:
        """``nis``: normalised innovation squared, expected n_z."""
        return {"nis": state.nis}


@register("filters", "alpha-beta")
@dataclass(frozen=True, kw_only=True)
class AlphaBeta:
    """Alpha-beta filter: fixed gains, a constant-velocity Kalman filter in its steady state.

    Kalata 1984: gains from the tracking index. The reported covariance is the steady-state one of
    these gains for a random acceleration of variance q.
    """

    q: Positive
    """variance of the random acceleration held for T, per axis, (m/s^2)^2"""
    alpha: OpenShare | None = None
    """gain of the position; default: from q"""
    beta: Positive | None = None
    """gain of the velocity times T; default: from q"""
    needs: ClassVar[tuple[str, ...]] = (*LINEAR, "sensor.sigma")

    def __post_init__(self) -> None:
        if (self.alpha is None) != (self.beta is None):
            raise ValueError("alpha and beta are given together or not at all")
        if self.alpha is not None and self.beta is not None and self.beta >= 4 - 2 * self.alpha:
            raise MistakenKeyError(f"unstable: beta must be below {4 - 2 * self.alpha:g}", "beta")

    def gains(self, T: float, sigma: float) -> tuple[float, float]:
        """alpha and beta, from the tracking index ``sqrt(q) T^2 / sigma`` unless given."""
        if self.alpha is not None and self.beta is not None:
            return self.alpha, self.beta
        index = np.sqrt(self.q) * T**2 / sigma
        r = (4.0 + index - np.sqrt(8.0 * index + index**2)) / 4.0
        alpha = 1.0 - r**2
        return float(alpha), float(2.0 * (2.0 - alpha) - 4.0 * np.sqrt(1.0 - alpha))

    def gain(self, T: float, sigma: float) -> Array:
        """K (4, 2)."""
        alpha, beta = self.gains(T, sigma)
        return np.asarray(np.kron(np.eye(2), np.array([[alpha], [beta / T]])), dtype=float)

    def steady(self, T: float, sensor: PositionSensor) -> Array:
        """P (4, 4) of ``P = (I - K H)(F P F' + Q)(I - K H)' + K R K'``."""
        from scipy.linalg import solve_discrete_lyapunov

        motion = ConstantVelocity(q=self.q).sampled(T)
        K = self.gain(T, sensor.sigma)
        IKH = np.eye(4) - K @ sensor.H()
        noise = IKH @ motion.Q @ IKH.T + K @ sensor.R @ K.T
        return np.asarray(solve_discrete_lyapunov(IKH @ motion.F, noise), dtype=float)

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Tracked:
        """The prior's mean with the steady-state covariance."""
        motion: Any = model.motion
        sensor: Any = model.sensor
        runs = prior.mean.shape[1]
        posterior = Gaussian(prior.mean, self.steady(motion.T, sensor))
        return Tracked(posterior, np.full(runs, np.nan), len(prior.mean))

    def step(self, model: Model, state: Tracked, z: Array, k: int, rng: Generator) -> Tracked:
        """``x = F x``, ``x = x + K (z - H x)``; a missing measurement is predicted over."""
        own: Any = model.motion
        sensor: Any = model.sensor
        motion, H = ConstantVelocity(q=self.q).sampled(own.T), sensor.H()
        predicted = kalman.predict(state.posterior, motion.F, motion.Q)
        nu = z - linalg.matvec(H, predicted.mean)
        S = linalg.sandwich(H, predicted.cov) + sensor.R
        correction = linalg.matvec(self.gain(own.T, sensor.sigma), np.where(np.isnan(nu), 0.0, nu))
        posterior = Gaussian(predicted.mean + correction, state.posterior.cov)
        return Tracked(posterior, Innovation(nu, S).nis, state.reported)

    def estimate(self, state: Tracked) -> Gaussian:
        """The track with the steady-state covariance."""
        return state.estimate

    def diagnostics(self, state: Tracked) -> dict[str, Array]:
        """``nis``: normalised innovation squared, expected n_z."""
        return {"nis": state.nis}
