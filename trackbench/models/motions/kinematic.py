"""Linear motions, and those along each axis by itself: matrices F and Q from a few keys.

A planar state is (px, vx, py, vy), m and m/s; one with accelerations appends (ax, ay), m/s^2. Matrices
are cached and read-only.
"""

from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import Annotated, Literal, NamedTuple

import numpy as np

from trackbench.core import linalg
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.read_only import fixed
from trackbench.field_types import NonNegative, Positive, Unit, UnitIf
from trackbench.models.base import Motion
from trackbench.models.component_names import AXES, position_velocity_names
from trackbench.models.inputs import KnownInputs
from trackbench.registry import register

NoiseGain = Literal["standard", "printed"]
_CACHED = 4096  # motions: a filter needs its matrices at every step, and recorded intervals differ
_TERMS = 10  # of exp(-h / tau), h at most a 32nd of tau


@dataclass(frozen=True, eq=False)
class Linear:
    """Linear motion x_k = F x_{k-1} + N(0, Q) over T seconds."""

    T: float
    """length of the interval, s"""
    F: Array
    """transition matrix (n, n)"""
    Q: Array
    """covariance (n, n) of the noise"""
    components: tuple[str, ...]
    """names of the state's components, in order"""
    extra_std: tuple[float, ...] = ()
    """initial standard deviations of the components beyond position and velocity"""
    rows_of_angles: tuple[int, ...] = ()
    """rows of the state that are angles, rad"""
    recorded_inputs: KnownInputs | None = None
    """inputs of the recording, if it has any, for motions that are sampled alike"""

    def transition(self, x: Array, k: int) -> Gaussian:
        """Return the distribution of x_k given x_{k-1} = x.

        Parameters
        ----------
        x : array (n, *batch)
            States at step k - 1.
        k : int
            Step of the result, on which nothing depends.

        Returns
        -------
        Gaussian
            Mean F x (n, *batch), covariance Q (n, n).
        """
        return Gaussian(linalg.matvec(self.F, x), self.Q)

    def jacobian(self, x: Array, k: int) -> Array:
        """Return the derivatives F (n, n) of the predicted mean, the same for all states and steps."""
        return self.F

    @property
    def alike_axes(self) -> tuple[Array, Array]:
        """F = [1 T; 0 1] and Q (2, 2) of each axis of (px, vx, py, vy), which some filters require.

        It raises AttributeError unless this is constant velocity with equal noise along x and y, so
        that `hasattr` gives False.
        """
        F = np.array([[1.0, self.T], [0.0, 1.0]])
        Q = self.Q[:2, :2]
        # Compare with the matrices of two equal axes.
        has_planar_F = np.array_equal(self.F, np.kron(np.eye(2), F))
        has_planar_Q = np.array_equal(self.Q, np.kron(np.eye(2), Q))
        if not (has_planar_F and has_planar_Q):
            raise AttributeError("this is not constant velocity with equal noise along x and y")
        return F, Q


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

    @lru_cache(maxsize=_CACHED)  # noqa: B019 (a motion is a few numbers)
    @np.errstate(all="ignore")  # runs that leave the numbers are counted, not warned about
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

    @np.errstate(all="ignore")
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

    @lru_cache(maxsize=_CACHED)  # noqa: B019 (a motion is a few numbers)
    def axis(self, T: float) -> Axis:
        """Return F and ``Q = q G G'`` of one axis (position, velocity)."""
        # An acceleration that is held for T, or the printed increment of the velocity.
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

    @lru_cache(maxsize=_CACHED)  # noqa: B019 (a motion is a few numbers)
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

    @lru_cache(maxsize=_CACHED)  # noqa: B019 (a motion is a few numbers)
    def axis(self, T: float) -> Axis:
        """Return F and Q of one axis (position, velocity); banana paper, eqs. 5 and 6."""
        # Q = q int_0^T [s 1]' [s 1] ds
        Q = self.q * np.array([[T * T * T / 3, T * T / 2], [T * T / 2, T]])
        F = np.array([[1.0, T], [0.0, 1.0]])
        return Axis(F=fixed(F), Q=fixed(Q))


@register("motions", "singer")
@dataclass(frozen=True, kw_only=True)
class Singer(PerAxis):
    """Acceleration that fades: first-order Markov with a time constant (Singer 1970).

    Bar-Shalom, Li & Kirubarajan 2001, section 8.2.
    """

    sigma: Annotated[Positive, Unit("m/s^2")]
    """standard deviation of the acceleration per axis, m/s^2"""
    tau: Annotated[Positive, Unit("s")]
    """time constant of the acceleration, s"""

    @lru_cache(maxsize=_CACHED)  # noqa: B019 (a motion is a few numbers)
    def axis(self, T: float) -> Axis:
        """Return F and Q of one axis (position, velocity, acceleration).

        The closed form would lose its digits for T much shorter than tau.
        """
        # Step 1: F and Q by their series, of an interval h so short that few terms give all digits.
        halvings = 0
        h = T
        while h > self.tau / 32.0:
            h = 0.5 * h
            halvings += 1
        F, Q = self._matrices_of_short_interval(h)
        # Step 2: double the interval: F(2 h) = F F, Q(2 h) = F Q F' + Q.
        for _ in range(halvings):
            Q = linalg.sandwich(F, Q) + Q
            F = linalg.matmul(F, F)
        return Axis(F=fixed(F), Q=fixed(Q))

    def _matrices_of_short_interval(self, h: float) -> tuple[Array, Array]:
        """Return F(h) and ``Q(h) = 2 sigma^2 / tau int_0^h g(s) g(s)' ds`` (3, 3) by power series.

        g(s) is the effect on (position, velocity, acceleration) of a unit acceleration s seconds ago.
        """
        # Step 1: coefficients by power of s of the acceleration exp(-s / tau), its integral, the speed,
        # and its double integral, the position.
        fading = [1.0]
        for n in range(1, _TERMS):
            fading.append(fading[-1] * -1.0 / (n * self.tau))
        speed = _integrate(fading)
        g = (_integrate(speed), speed, fading)
        # Step 2: the last column of F is g(h); Q is the integral of the products of g's components.
        values = [_evaluate(p, h) for p in g]
        F = np.array([[1.0, h, values[0]], [0.0, 1.0, values[1]], [0.0, 0.0, values[2]]])
        density = 2.0 * self.sigma * self.sigma / self.tau
        Q = [density * _evaluate(_integrate(_multiply(a, b)), h) for a, b in product(g, repeat=2)]
        return F, np.array(Q).reshape(3, 3)

    @property
    def acceleration_std(self) -> float:
        """Stationary standard deviation of the acceleration."""
        return self.sigma


def _integrate(p: list[float]) -> list[float]:
    """Integrate a polynomial from zero; both are coefficients, that of the constant first."""
    return [0.0, *(c / (n + 1) for n, c in enumerate(p))]


def _multiply(a: list[float], b: list[float]) -> list[float]:
    """Multiply two polynomials; all are coefficients, that of the constant first."""
    product_of_both = [0.0] * (len(a) + len(b) - 1)
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            product_of_both[i + j] += x * y
    return product_of_both


def _evaluate(p: list[float], h: float) -> float:
    """Evaluate a polynomial at h by its coefficients p, that of the constant first."""
    value = 0.0
    for c in reversed(p):
        value = value * h + c
    return value
