"""Linear motion models of one or two axes: the matrices F and Q from their few parameters.

A state of two axes is (px, vx, py, vy), m and m/s.
"""

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np

from trackbench.core import linalg
from trackbench.core.arrays import Array, fixed
from trackbench.core.distributions import Gaussian


@dataclass(frozen=True)
class CWNA:
    """Continuous white noise acceleration on two axes (banana paper, eqs. 4-6).

    ``T`` sampling time, s; ``q`` power spectral density of the acceleration, m^2/s^3.
    """

    T: float
    q: float
    components: tuple[str, ...] = ("px", "vx", "py", "vy")

    @cached_property
    def F(self) -> Array:
        """Transition matrix (4, 4), eq. 5."""
        axis = np.array([[1.0, self.T], [0.0, 1.0]])
        return fixed(np.asarray(np.kron(np.eye(2), axis), dtype=float))

    @cached_property
    def Q(self) -> Array:
        """Process noise covariance (4, 4), eq. 6."""
        T = self.T
        axis = self.q * np.array([[T * T * T / 3, T * T / 2], [T * T / 2, T]])
        return fixed(np.asarray(np.kron(np.eye(2), axis), dtype=float))

    def transition(self, x: Array, k: int) -> Gaussian:
        """N(F x, Q)."""
        return Gaussian(linalg.matvec(self.F, x), self.Q)

    def jacobian(self, x: Array, k: int) -> Array:
        """F."""
        return self.F


@dataclass(frozen=True, eq=False)
class Linear:
    """x_k = F x_{k-1} + N(0, Q), sampled every T seconds; F and Q (n, n)."""

    T: float
    F: Array
    Q: Array
    components: tuple[str, ...]

    def transition(self, x: Array, k: int) -> Gaussian:
        """N(F x, Q)."""
        return Gaussian(linalg.matvec(self.F, x), self.Q)

    def jacobian(self, x: Array, k: int) -> Array:
        """F."""
        return self.F


@dataclass(frozen=True)
class PositionSensor:
    """Both positions of a state that begins (px, vx, py, vy), each with standard deviation sigma, m."""

    sigma: float
    components: tuple[str, ...] = ("x", "y")

    @cached_property
    def R(self) -> Array:
        """Noise covariance (2, 2), m^2."""
        return fixed(self.sigma * self.sigma * np.eye(2))

    @staticmethod
    @cache
    def H(n: int = 4) -> Array:
        """Measurement matrix (2, n) for a state of n components."""
        H = np.zeros((2, n))
        H[0, 0] = H[1, 2] = 1.0
        return fixed(H)

    def measurement(self, x: Array, k: int) -> Gaussian:
        """N(H x, R) for x (n, *batch)."""
        return Gaussian(x[[0, 2]], self.R)

    def innovation(self, z: Array, z_pred: Array) -> Array:
        """``z - z_pred``."""
        return z - z_pred

    def jacobian(self, x: Array, k: int) -> Array:
        """H (2, n)."""
        return self.H(len(x))
