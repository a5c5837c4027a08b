"""Motions that a config may name: the matrices F and Q of two-axis models from their few keys.

A state of two axes is (px, vx, py, vy), m and m/s; one with accelerations appends (ax, ay), m/s^2, so
that its first four components are those of every other. The sampling time T is the scenario's. Matrices
are kept and read-only.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, ClassVar, Literal, NamedTuple, TypeAlias

import numpy as np
from pydantic import Discriminator

from trackbench.core.arrays import Array, fixed
from trackbench.core.elementary import cos_sin
from trackbench.keys import Finite, NonNegative
from trackbench.models.linear import CWNA, Linear

NoiseGain = Literal["standard", "printed"]
_POSITION_VELOCITY = ("px", "vx", "py", "vy")
_KEPT = 64  # matrices: a filter asks for them at every step
_AXES_LAST = [0, 1, 3, 4, 2, 5]  # (px, vx, ax, py, vy, ay) -> (px, vx, py, vy, ax, ay)


class Axis(NamedTuple):
    """One axis of a motion whose axes do not couple: F (n, n) and Q (n, n)."""

    F: Array
    Q: Array


@dataclass(frozen=True, kw_only=True)
class ConstantVelocity:
    """Constant velocity, disturbed by a white sequence of variance q on each axis.

    ``G = [T^2/2, T]'`` (a random acceleration held for T) or, as the adaptive Kalman filter paper
    prints it after Bar-Shalom & Birmiwal 1982, ``G = [T/2, 1]'`` (a random velocity increment).
    """

    q: NonNegative
    """variance of the disturbance per axis: (m/s^2)^2, or (m/s)^2 with the printed gain"""
    noise_gain: NoiseGain = "standard"
    """how the disturbance enters: [T^2/2, T]' or the printed [T/2, 1]'"""
    kind: Literal["cv"] = "cv"
    """constant velocity"""

    @lru_cache(maxsize=_KEPT)  # noqa: B019 (a motion is a few numbers)
    def axis(self, T: float) -> Axis:
        """F and Q of one axis (position, velocity)."""
        G = np.array([T * T / 2, T] if self.noise_gain == "standard" else [T / 2, 1.0])
        return Axis(fixed(np.array([[1.0, T], [0.0, 1.0]])), fixed(self.q * np.outer(G, G)))

    @lru_cache(maxsize=_KEPT)  # noqa: B019 (a motion is a few numbers)
    def sampled(self, T: float) -> Linear:
        """The motion of (px, vx, py, vy) over T seconds."""
        F, Q = self.axis(T)
        return Linear(T, _both(F), _both(Q), _POSITION_VELOCITY)


@dataclass(frozen=True, kw_only=True)
class ConstantAcceleration:
    """Constant acceleration, disturbed by a white sequence of variance q on each axis.

    ``G = [T^2/2, T, 1]'`` (a Wiener sequence of accelerations) or the printed ``[T^2/4, T/2, 1]'``.
    """

    q: NonNegative
    """variance of the acceleration's increment per axis, (m/s^2)^2"""
    noise_gain: NoiseGain = "standard"
    """how the disturbance enters: [T^2/2, T, 1]' or the printed [T^2/4, T/2, 1]'"""
    initial_std: NonNegative = 0.1
    """standard deviation of the acceleration before any measurement, m/s^2, where none is known"""
    kind: Literal["ca"] = "ca"
    """constant acceleration"""

    @lru_cache(maxsize=_KEPT)  # noqa: B019 (a motion is a few numbers)
    def axis(self, T: float) -> Axis:
        """F and Q of one axis (position, velocity, acceleration)."""
        standard = self.noise_gain == "standard"
        G = np.array([T * T / 2, T, 1.0] if standard else [T * T / 4, T / 2, 1.0])
        F = np.array([[1.0, T, T * T / 2], [0.0, 1.0, T], [0.0, 0.0, 1.0]])
        return Axis(fixed(F), fixed(self.q * np.outer(G, G)))

    @lru_cache(maxsize=_KEPT)  # noqa: B019 (a motion is a few numbers)
    def sampled(self, T: float) -> Linear:
        """The motion of (px, vx, py, vy, ax, ay) over T seconds."""
        F, Q = (fixed(_both(A)[np.ix_(_AXES_LAST, _AXES_LAST)]) for A in self.axis(T))
        return Linear(T, F, Q, (*_POSITION_VELOCITY, "ax", "ay"))


@dataclass(frozen=True, kw_only=True)
class WhiteAcceleration:
    """Continuous white noise acceleration (Bar-Shalom, Li & Kirubarajan 2001, section 6.2.2)."""

    q: NonNegative
    """power spectral density of the acceleration per axis, m^2/s^3"""
    kind: Literal["cwna"] = "cwna"
    """continuous white noise acceleration"""

    @lru_cache(maxsize=_KEPT)  # noqa: B019 (a motion is a few numbers)
    def axis(self, T: float) -> Axis:
        """F and Q of one axis (position, velocity)."""
        motion = self.sampled(T)
        return Axis(motion.F[:2, :2], motion.Q[:2, :2])

    @lru_cache(maxsize=_KEPT)  # noqa: B019 (a motion is a few numbers)
    def sampled(self, T: float) -> CWNA:
        """The motion of (px, vx, py, vy) over T seconds."""
        return CWNA(T, self.q)


@dataclass(frozen=True, kw_only=True)
class CoordinatedTurn:
    """Turn at constant speed and a known rate (Bar-Shalom, Li & Kirubarajan 2001, eq. 11.7.1-4)."""

    turn_rate_deg_s: Finite
    """rate of the turn, degrees per second, positive from x to y"""
    q: NonNegative
    """variance of a random acceleration held for T, per axis, (m/s^2)^2"""
    kind: Literal["ct"] = "ct"
    """coordinated turn"""
    _straight: ClassVar[float] = 1e-9

    @lru_cache(maxsize=_KEPT)  # noqa: B019 (a motion is a few numbers)
    def sampled(self, T: float) -> Linear:
        """The motion of (px, vx, py, vy) over T seconds; a rate of zero is a straight line."""
        straight = ConstantVelocity(q=self.q).sampled(T)
        w = np.deg2rad(self.turn_rate_deg_s)
        if abs(w * T) < self._straight:
            return straight
        c, s = cos_sin(w * T)
        F = np.array(
            [
                [1.0, s / w, 0.0, (c - 1.0) / w],
                [0.0, c, 0.0, -s],
                [0.0, (1.0 - c) / w, 1.0, s / w],
                [0.0, s, 0.0, c],
            ]
        )
        return Linear(T, fixed(F), straight.Q, _POSITION_VELOCITY)


MotionKey: TypeAlias = Annotated[
    ConstantVelocity | ConstantAcceleration | WhiteAcceleration | CoordinatedTurn,
    Discriminator("kind"),
]
"""A motion as a config names it: ``{kind: cv, q: 0.01}``."""


def _both(A: Array) -> Array:
    return fixed(np.asarray(np.kron(np.eye(2), A), dtype=float))
