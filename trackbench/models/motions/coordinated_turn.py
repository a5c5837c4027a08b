"""Coordinated turns of a planar target: at a known rate, and at a rate in the state."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, ClassVar

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.elementary import cos_sin
from trackbench.core.read_only import fixed
from trackbench.field_types import Finite, NonNegative, Positive, Unit
from trackbench.models.base import Motion
from trackbench.models.component_names import position_velocity_names
from trackbench.models.inputs import KnownInputs
from trackbench.models.motions.kinematic import ConstantVelocity
from trackbench.models.motions.linear import Linear
from trackbench.registry import register

_STRAIGHT = 1e-9  # angle turned in one step, rad, below which there is no turn


@register("motions", "ct")
@dataclass(frozen=True, kw_only=True)
class CoordinatedTurn(Motion):
    """Turn at constant speed and a known rate (Bar-Shalom, Li & Kirubarajan 2001, eq. 11.7.1-4)."""

    turn_rate_deg_s: Finite
    """rate of the turn, degrees per second, positive from x to y"""
    q: Annotated[NonNegative, Unit("(m/s^2)^2")]
    """variance of a random acceleration held for T, per axis, (m/s^2)^2"""

    @lru_cache(maxsize=64)  # noqa: B019 (a motion is a few numbers)
    def sampled(self, T: float, axes: int = 2) -> Linear:
        """Return the motion of (px, vx, py, vy) over T seconds; a rate of zero is a straight line.

        A positive rate turns from x to y, counterclockwise. The noise is that of a straight line: a
        random acceleration held for T along each axis.
        """
        _check_planar(axes)
        straight = ConstantVelocity(q=self.q).sampled(T)
        w = np.deg2rad(self.turn_rate_deg_s)
        if abs(w * T) < _STRAIGHT:  # F below divides by w
            return straight
        # Bar-Shalom, Li & Kirubarajan 2001, eqs. 11.7.1-4, with c = cos(w T) and s = sin(w T).
        c, s = cos_sin(w * T)
        F = np.array(
            [
                [1.0, s / w, 0.0, (c - 1.0) / w],
                [0.0, c, 0.0, -s],
                [0.0, (1.0 - c) / w, 1.0, s / w],
                [0.0, s, 0.0, c],
            ]
        )
        return Linear(T=T, F=fixed(F), Q=straight.Q, components=position_velocity_names(2))


@register("motions", "ct-unknown")
@dataclass(frozen=True, kw_only=True)
class UnknownTurn(Motion):
    """Turn at constant speed, with a turn rate that is estimated and follows a random walk.

    Bar-Shalom, Li & Kirubarajan 2001, section 11.7.2. The state is (px, vx, py, vy, turn_rate), the rate
    in rad/s, positive from x to y.
    """

    q: Annotated[NonNegative, Unit("(m/s^2)^2")]
    """variance of a random acceleration held for T, per axis, (m/s^2)^2"""
    turn_walk_deg_s: Annotated[Positive, Unit("deg/s")]
    """standard deviation of the turn rate's change within one second, deg/s"""
    initial_std_deg_s: Annotated[Positive, Unit("deg/s")] = 3.0
    """standard deviation of the turn rate before the first measurement, deg/s"""

    @lru_cache(maxsize=64)  # noqa: B019 (a motion is a few numbers)
    def sampled(self, T: float, axes: int = 2) -> "Turning":
        """Return the motion of (px, vx, py, vy, turn rate) over T seconds."""
        _check_planar(axes)
        walk = np.deg2rad(self.turn_walk_deg_s)
        Q = np.zeros((5, 5))
        # Q = diag(Q of a random acceleration, walk^2 T)
        Q[:4, :4] = ConstantVelocity(q=self.q).sampled(T).Q
        Q[4, 4] = walk * walk * T
        initial_std = float(np.deg2rad(self.initial_std_deg_s))
        return Turning(T=T, Q=fixed(Q), extra_std=(initial_std,))


@dataclass(frozen=True, eq=False)
class Turning:
    """One step of T seconds at the turn rate of its start, then noise N(0, Q)."""

    T: float
    Q: Array
    extra_std: tuple[float, ...]
    recorded_inputs: KnownInputs | None = None
    """inputs of the recording, if it has any, for motions that are sampled alike"""
    components: ClassVar[tuple[str, ...]] = (*position_velocity_names(2), "turn_rate")

    def transition(self, x: Array, k: int) -> Gaussian:
        """Return N(f(x), Q) for x (5, *batch)."""
        return Gaussian(np.stack([*turn_state(x[:4], x[4], self.T), x[4]]), self.Q)

    def jacobian(self, x: Array, k: int) -> Array:
        """Return df/dx (5, 5, *batch)."""
        # Step 1: derivatives of f by position and velocity.
        _, vx, _, vy, w = x
        T = self.T
        along, across, c, s = arc(w, T)
        F = np.zeros((5, *x.shape))
        F[0, 0] = F[2, 2] = F[4, 4] = 1.0
        F[0, 1] = F[2, 3] = along
        F[0, 3] = -across
        F[2, 1] = across
        F[1, 1] = F[3, 3] = c
        F[1, 3] = -s
        F[3, 1] = s
        # Step 2: derivatives of T sin(u) / u and T (1 - cos u) / u by w, u = w T.
        u = w * T
        d_along = T * T * _sinc_slope(u)
        d_across = T * (along - 0.5 * T * np.square(_sinc(0.5 * u)))
        # Step 3: derivatives of f by w.
        F[0, 4] = d_along * vx - d_across * vy
        F[1, 4] = -T * (s * vx + c * vy)
        F[2, 4] = d_across * vx + d_along * vy
        F[3, 4] = T * (c * vx - s * vy)
        return F


def turn_state(x: Array, w: Array, T: Array | float) -> list[Array]:
    """Turn states (px, vx, py, vy) for T seconds at w rad/s.

    Bar-Shalom, Li & Kirubarajan 2001, eq. 11.7.1-4.

    Parameters
    ----------
    x : array (4, *batch)
        States before the turn, m and m/s.
    w : array (*batch)
        Turn rate, rad/s, positive from x to y. Zero is a straight line.
    T : array (*batch) or float
        Length of the turn, s.

    Returns
    -------
    list of array (*batch)
        The four components after the turn. The axes of x, w and T are broadcast.
    """
    px, vx, py, vy = x
    along, across, c, s = arc(w, T)
    return [
        px + along * vx - across * vy,
        c * vx - s * vy,
        py + across * vx + along * vy,
        s * vx + c * vy,
    ]


def arc(w: Array, T: Array | float) -> tuple[Array, Array, Array, Array]:
    """Compute ``sin(u) / w, (1 - cos u) / w, cos u, sin u`` of the angle u = w T turned in T seconds.

    Parameters
    ----------
    w : array (*batch)
        Turn rate, rad/s. The limits are returned at zero.
    T : array (*batch) or float
        Length of the turn, s.

    Returns
    -------
    tuple of four arrays (*batch)
        The first two are in s: the way along and across the first direction, per speed.
    """
    u = w * T
    c, s = cos_sin(u)
    # (1 - cos u) / w = T u (sin(u / 2) / (u / 2))^2 / 2, which keeps its digits near zero.
    half = _sinc(0.5 * u)
    return T * _sinc(u), 0.5 * T * u * half * half, c, s


def _sinc(u: Array) -> Array:
    """Compute ``sin(u) / u``."""
    # sin(u) / u rounds to one near zero.
    at_zero = np.abs(u) < 1e-8
    return np.where(at_zero, 1.0, cos_sin(u)[1] / np.where(at_zero, 1.0, u))


def _sinc_slope(u: Array) -> Array:
    """Return the derivative of ``sin(u) / u``: its series near zero, else (cos u - sin(u) / u) / u."""
    # Near zero cos u and sin(u) / u share their first digits, which their difference would lose.
    near_zero = np.abs(u) < 0.1
    square = u * u
    # -u / 3 + u^3 / 30 - u^5 / 840 + u^7 / 45360
    series = u * (-1 / 3 + square * (1 / 30 + square * (-1 / 840 + square / 45360)))
    large = np.where(near_zero, 1.0, u)
    return np.where(near_zero, series, (cos_sin(large)[0] - _sinc(large)) / large)


def _check_planar(axes: int) -> None:
    if axes != 2:
        raise ValueError("a coordinated turn is a motion in the plane")
