"""Motions along each axis by itself: matrices F and Q from a few keys.

A planar state is (px, vx, py, vy), m and m/s; one with accelerations appends (ax, ay), m/s^2. Matrices
are cached and read-only.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Literal, NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.read_only import fixed
from trackbench.field_types import NonNegative, Unit, UnitIf
from trackbench.models.base import Motion
from trackbench.models.component_names import AXES, position_velocity_names
from trackbench.models.motions.linear import Linear
from trackbench.registry import register

NoiseGain = Literal["standard", "printed"]
CACHED_MOTIONS = 4096  # a filter needs its matrices at every step, and recorded intervals differ


class Axis(NamedTuple):
    """One axis of a motion whose axes do not couple: F (n, n) and Q (n, n)."""

    F: Array
    Q: Array


@dataclass(frozen=True, kw_only=True)
class PerAxis(Motion):
    """Base of the motions whose axes do not couple."""

    def axis(self, T: float) -> Axis:
        """Return F and Q of one axis over T seconds.

        Parameters
        ----------
        T : float
            Length of the interval, s.

        Returns
        -------
        Axis
            F and Q (n, n) of position, velocity and, with n = 3, acceleration.
        """
        raise NotImplementedError

    @lru_cache(maxsize=CACHED_MOTIONS)  # noqa: B019 (a motion is a few numbers)
    @np.errstate(all="ignore")  # of a huge T or q, whose runs are counted as lost, not warned about
    def sampled(self, T: float, axes: int = 2) -> Linear:
        """Return the motion along all axes over one sampling interval.

        Parameters
        ----------
        T : float
            Length of the interval, s.
        axes : int
            Number of axes of the space, 1 to 3.

        Returns
        -------
        Linear
            Position and velocity of each axis, m and m/s; accelerations, m/s^2, are the last
            components.
        """
        axis = self.axis(T)
        components = position_velocity_names(axes)
        extra_std: tuple[float, ...] = ()
        if len(axis.F) > 2:
            components += tuple(f"a{name}" for name in AXES[:axes])
            extra_std = (self.acceleration_std,) * axes
        return Linear(
            T=T,
            F=fixed(_block_for_each_axis(axis.F, axes)),
            Q=fixed(_block_for_each_axis(axis.Q, axes)),
            components=components,
            extra_std=extra_std,
        )

    @np.errstate(all="ignore")  # as of `sampled`
    def matrices(self, intervals: Array, axes: int) -> tuple[Array, Array]:
        """Return F and Q of `sampled` for each of K intervals (s), in a small part of the time.

        Parameters
        ----------
        intervals : array (K,)
            Lengths of the intervals, s.
        axes : int
            Number of axes of the space, 1 to 3.

        Returns
        -------
        F, Q : array (K, n, n)
            Transition matrices, and covariances of the noise.
        """
        of_one_axis = [self.axis(T) for T in intervals.tolist()]
        F = np.stack([axis.F for axis in of_one_axis])
        Q = np.stack([axis.Q for axis in of_one_axis])
        return _block_for_each_axis(F, axes), _block_for_each_axis(Q, axes)

    @property
    def acceleration_std(self) -> float:
        """Initial standard deviation of the acceleration, m/s^2, if it is a component."""
        return 0.0


def _block_for_each_axis(block: Array, axes: int) -> Array:
    """Return matrices (*batch, m, m), m = axes n, which have the block (*batch, n, n) for each axis.

    The components are ordered as in `PerAxis.sampled`: [px vx py vy ax ay].
    """
    n = block.shape[-1]
    matrix = np.zeros((*block.shape[:-2], axes * n, axes * n))
    for a in range(axes):
        rows = [2 * a, 2 * a + 1]
        # The accelerations stand behind the positions and velocities of all axes.
        rows += [2 * axes + (n - 2) * a + i for i in range(n - 2)]
        matrix[..., np.array(rows)[:, None], rows] = block
    return matrix


@register("motions", "cv")
@dataclass(frozen=True, kw_only=True)
class ConstantVelocity(PerAxis):
    """Constant velocity, disturbed by a white sequence of variance q on each axis.

    ``G = [T^2/2, T]'`` (a random acceleration held for T) or, as the adaptive Kalman filter paper
    prints it after Bar-Shalom & Birmiwal 1982, ``G = [T/2, 1]'`` (a random velocity increment).
    """

    q: Annotated[NonNegative, UnitIf("noise_gain", "printed", "(m/s)^2"), Unit("(m/s^2)^2")]
    """variance of the disturbance per axis, (m/s^2)^2"""
    noise_gain: NoiseGain = "standard"
    """gain G of the disturbance: [T^2/2, T]', or the printed [T/2, 1]' of a q in (m/s)^2"""
    kind: Literal["cv"] = "cv"
    """constant velocity"""

    @lru_cache(maxsize=CACHED_MOTIONS)  # noqa: B019 (a motion is a few numbers)
    def axis(self, T: float) -> Axis:
        """Return F and ``Q = q G G'`` of one axis (position, velocity)."""
        # The disturbance is an acceleration that is held for T, or an increment of the velocity, as the
        # adaptive Kalman filter paper prints it. An increment of 1 within T moves the position by T / 2.
        gain = [T * T / 2, T] if self.noise_gain == "standard" else [T / 2, 1.0]
        G = np.array(gain)
        F = np.array([[1.0, T], [0.0, 1.0]])
        return Axis(F=fixed(F), Q=fixed(self.q * np.outer(G, G)))


@register("motions", "ca")
@dataclass(frozen=True, kw_only=True)
class ConstantAcceleration(PerAxis):
    """Constant acceleration, disturbed by a white sequence of variance q on each axis.

    ``G = [T^2/2, T, 1]'`` (a Wiener sequence of accelerations) or ``[T^2/4, T/2, 1]'``, as the paper on
    the adaptive Kalman filter prints it.
    """

    q: Annotated[NonNegative, Unit("(m/s^2)^2")]
    """variance of the acceleration's increment per axis, (m/s^2)^2"""
    noise_gain: NoiseGain = "standard"
    """gain G of the disturbance: [T^2/2, T, 1]' or the printed [T^2/4, T/2, 1]'"""
    initial_std: Annotated[NonNegative, Unit("m/s^2")] = 0.1
    """standard deviation of the acceleration before the first measurement, m/s^2"""
    kind: Literal["ca"] = "ca"
    """constant acceleration"""

    @lru_cache(maxsize=CACHED_MOTIONS)  # noqa: B019 (a motion is a few numbers)
    def axis(self, T: float) -> Axis:
        """Return F and ``Q = q G G'`` of one axis (position, velocity, acceleration)."""
        if self.noise_gain == "standard":
            G = np.array([T * T / 2, T, 1.0])
        else:  # as the paper on the adaptive Kalman filter prints it
            G = np.array([T * T / 4, T / 2, 1.0])
        F = np.array([[1.0, T, T * T / 2], [0.0, 1.0, T], [0.0, 0.0, 1.0]])
        return Axis(F=fixed(F), Q=fixed(self.q * np.outer(G, G)))

    @property
    def acceleration_std(self) -> float:
        """Key ``initial_std``, m/s^2."""
        return self.initial_std


@register("motions", "cwna")
@dataclass(frozen=True, kw_only=True)
class WhiteAcceleration(PerAxis):
    """Continuous white noise acceleration (Bar-Shalom, Li & Kirubarajan 2001, section 6.2.2)."""

    q: Annotated[NonNegative, Unit("m^2/s^3")]
    """power spectral density of the acceleration per axis, m^2/s^3"""

    @lru_cache(maxsize=CACHED_MOTIONS)  # noqa: B019 (a motion is a few numbers)
    def axis(self, T: float) -> Axis:
        """Return F and Q of one axis (position, velocity); banana paper, eqs. 5 and 6."""
        # Q = q int_0^T [s 1]' [s 1] ds
        Q = self.q * np.array([[T * T * T / 3, T * T / 2], [T * T / 2, T]])
        F = np.array([[1.0, T], [0.0, 1.0]])
        return Axis(F=fixed(F), Q=fixed(Q))
