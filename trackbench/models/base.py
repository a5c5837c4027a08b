"""Protocols of motion and sensor, and the model that a filter gets of both.

A planar state begins ``(px, vx, py, vy)``, one in space ``(px, vx, py, vy, pz, vz)``, m and m/s.
Further components of a motion (accelerations, a turn rate) follow. Sensors, scores and filters therefore
find positions at the even and velocities at the odd indices that all motions of a target share.
"""

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextvars import ContextVar
from functools import cache
from itertools import product
from typing import ClassVar, NamedTuple, Protocol, TypeAlias, TypeGuard, cast, runtime_checkable

import numpy as np

from trackbench.core import kalman, linalg
from trackbench.core.arrays import (
    Array,
    Index,
    any_nan,
    count_operations,
    with_axes_of,
    with_trailing,
)
from trackbench.core.distributions import Distribution, Gamma, Gaussian, zero_mean_log_prob
from trackbench.core.random_streams import Streams
from trackbench.extension_points import Part
from trackbench.field_types import InvalidKeyError

AXES = ("x", "y", "z")
_DELAY = (
    "the key is `delay`, of a sensor: {delay: 3} or {delay: {kind: uniform, most: 5}}, in steps"
)
_CONTROL = (
    "the key is `input`, of a motion `map` or `ode` ({input: [v, w]}) and of a recording ({input: {v: "
    "COLUMN}}); in a simulation write known inputs as expressions of k and t"
)
_CORRELATION = "not supported: process noise and measurement noise are independent"
UNSUPPORTED_KEYS = (
    dict.fromkeys(("delay", "delays", "latency"), _DELAY)
    | dict.fromkeys(("control", "controls", "inputs", "u", "B"), _CONTROL)
    | dict.fromkeys(("correlation", "correlated", "cross_covariance", "S"), _CORRELATION)
)
"""Keys of models that do not exist, with the reason."""
_STEP = 1e-6  # of central differences, relative to a component
_SECOND_STEP = 1e-4  # of differences of Jacobians, which may have errors of 1e-10 by differences
_STATES_PER_CALL = 512  # of a function that takes displaced states side by side
_OF_SPREAD = 1e-4  # least step, in standard deviations of the component


@cache
def position_velocity_names(axes: int) -> tuple[str, ...]:
    """Return the names of position and velocity along ``axes`` axes in turn: px, vx, py, ..."""
    return tuple(kind + axis for axis, kind in product(AXES[:axes], "pv"))


def rows_in_plane(
    components: Sequence[str], errors: Mapping[str, Sequence[str]]
) -> tuple[int, int] | None:
    """Return the rows of the two components of a position; None if a state has none.

    They are px and py, or the first two of the error ``position`` if the ``errors`` of a score have it.
    """
    named = [name for name in errors.get("position", ()) if name in components]
    if len(named) < 2:
        named = [name for name in ("px", "py") if name in components]
    if len(named) < 2:
        return None
    return components.index(named[0]), components.index(named[1])


def by_component(
    numbers: dict[str, float] | tuple[float, ...], components: tuple[str, ...], *path: str | int
) -> Array:
    """Return ``numbers`` (n,) in the order of the components, 0 where a mapping has none.

    Raises InvalidKeyError for an unknown component, and for another number of values.
    """
    names = ", ".join(components)
    if not isinstance(numbers, dict):
        if len(numbers) != len(components):
            raise InvalidKeyError(f"{len(numbers)} numbers for {names}", *path)
        return np.array(numbers, dtype=float)
    for name in numbers:
        if name not in components:
            raise InvalidKeyError(f"unknown component {name!r}; known: {names}", *path, name)
    return np.array([numbers.get(name, 0.0) for name in components], dtype=float)


def central_differences(
    function: Callable[[Array], Array],
    x: Array,
    difference: Callable[[Array, Array], Array] = np.subtract,
    step: float = _STEP,
    spread: Array | None = None,
    side_by_side: bool = False,
) -> Array:
    """Return the derivatives of a function of states by central differences.

    Parameters
    ----------
    function
        Function of states (n, *batch) with values (m, *batch).
    x : array (n, *batch)
        States at which the derivatives are taken.
    difference
        Subtracts two values, for angles with a wrap.
    step : float
        Step, relative to the size of a component.
    spread : array (n[, *batch]), optional
        Standard deviations of the components, by default those of the state in `jacobian_at`. A step
        is at least a share of them. Without a spread it is at least ``step`` units.
    side_by_side : bool
        Call the function for many displaced states at once, (n, *batch, number), which saves calls
        where the batch is small.

    Returns
    -------
    array (m, n, *batch)
        Derivatives.
    """
    # Take the spread of the state that `jacobian_at` works on, unless x are other states than its mean.
    state = _AT.get()
    if spread is None and state is not None and state.mean.shape == x.shape:
        with np.errstate(invalid="ignore"):  # of a run that has diverged
            spread = np.sqrt(linalg.diagonal(state.cov))
    least = np.full(len(x), step)
    if spread is not None:
        least = _OF_SPREAD * spread
    steps = []
    for i, value in enumerate(x):
        h = np.maximum(step * np.abs(value), with_axes_of(value, least[i]))
        # A component that is zero and has no spread is moved by `step` units.
        steps.append(np.where(h > 0.0, h, step))
    displaced = _displaced_states(x, steps)
    if side_by_side:
        values = iter(_values_side_by_side(function, [*displaced]))
    else:
        values = map(function, displaced)
    columns = []
    for h in steps:
        # df/dx_i = (f(x + h e_i) - f(x - h e_i)) / (2 h)
        ahead = next(values)
        behind = next(values)
        columns.append(difference(ahead, behind) / (2.0 * h))
    return np.stack(columns, axis=1)


def _displaced_states(x: Array, steps: Sequence[Array]) -> Iterator[Array]:
    """Yield x + h_i e_i and then x - h_i e_i, (n, *batch) each, for each component i.

    ``steps`` are the h_i (*batch). The states are made as they are needed, to save memory.
    """
    for i, h in enumerate(steps):
        ahead = x.copy()
        ahead[i] += h
        yield ahead
        behind = x.copy()
        behind[i] -= h
        yield behind


def _values_side_by_side(
    function: Callable[[Array], Array], displaced: Sequence[Array]
) -> list[Array]:
    """Evaluate a function of states (n, *batch) for several arrays of states, many in a call."""
    number = max(1, _STATES_PER_CALL // max(1, displaced[0][0].size))
    values: list[Array] = []
    for first in range(0, len(displaced), number):
        together = function(np.stack(displaced[first : first + number], axis=-1))
        values += [together[..., i] for i in range(together.shape[-1])]
    return values


_AT: ContextVar[Gaussian | None] = ContextVar("state at which derivatives are taken", default=None)


def jacobian_at(function: "WithJacobian", state: Gaussian, k: int, order: int = 1) -> Array:
    """Return the first or second derivatives of a motion or sensor at a state's mean.

    Differences have steps relative to the standard deviations, so that they do not depend on the units.

    Parameters
    ----------
    function : WithJacobian
        Motion or sensor.
    state : Gaussian
        State at whose mean (n, *batch) the derivatives are taken.
    k : int
        Step.
    order : {1, 2}
        Order of the derivatives.

    Returns
    -------
    array (m, n[, *batch]) or (m, n, n[, *batch])
        Jacobian, or Hessian of each component.
    """
    token = _AT.set(state)
    try:
        if order == 1:
            return function.jacobian(state.mean, k)
        if hasattr(function, "hessian"):
            return cast(TwiceDifferentiable, function).hessian(state.mean, k)
        return hessian_by_differences(function.jacobian, state.mean, k)
    finally:
        _AT.reset(token)


def hessian_by_differences(
    jacobian: Callable[[Array, int], Array], x: Array, k: int, side_by_side: bool = False
) -> Array:
    """Return the second derivatives (m, n, n, *batch) at x by differences of a Jacobian at step k.

    ``side_by_side`` as of `central_differences`.
    """
    J = jacobian(x, k)
    if J.ndim == 2:  # constant
        return np.zeros((*J.shape, len(x)))

    def rows_of_jacobian(states: Array) -> Array:
        """Return the Jacobians of states (n, *batch) with their m n entries in one axis."""
        derivatives = jacobian(states, k)
        return derivatives.reshape(-1, *states.shape[1:])

    rows = central_differences(rows_of_jacobian, x, step=_SECOND_STEP, side_by_side=side_by_side)
    return rows.reshape(*J.shape[:2], *x.shape)


class SampledMotion(Protocol):
    """A motion over one sampling interval, p(x_k | x_{k-1})."""

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the state's components, in order."""

    def transition(self, x: Array, k: int) -> Distribution:
        """Return the distribution of x_k given x_{k-1} = x.

        Parameters
        ----------
        x : (n_x, *batch)
            States at step k - 1.
        k : int
            Step of the result.

        Returns
        -------
        Distribution
            Mean (n_x, *batch), covariance (n_x, n_x[, *batch]).
        """


def extra_std(motion: SampledMotion) -> tuple[float, ...]:
    """Return initial standard deviations of the components beyond position and velocity.

    A motion that has such components has an attribute of this name. They start from N(0, std^2).
    """
    return getattr(motion, "extra_std", ())


def angle_rows(motion: SampledMotion) -> tuple[int, ...]:
    """Return the rows of the state that are angles, rad: whole turns are no difference.

    A motion that has angles has an attribute `rows_of_angles`.
    """
    return getattr(motion, "rows_of_angles", ())


def append_noise(x: Array, std: tuple[float, ...], rng: Streams) -> Array:
    """Return states x (n, *batch) with a row appended for each s of ``std``: a draw from N(0, s^2)."""
    if not std:
        return x
    noise = rng.standard_normal((len(std), *x.shape[1:]))
    return np.concatenate([x, with_trailing(np.array(std), noise.ndim - 1) * noise])


class Motion(Part):
    """A motion as a config names it: a frozen dataclass, registered in the group ``motions``."""

    unsupported_keys: ClassVar[dict[str, str]] = UNSUPPORTED_KEYS

    @abstractmethod
    def sampled(self, T: float, axes: int = 2) -> SampledMotion:
        """Return the motion over one sampling interval.

        Parameters
        ----------
        T : float
            Length of the interval, s.
        axes : int
            Number of axes of the space; a scalar motion ignores it.

        Returns
        -------
        SampledMotion
            The motion, the same object for equal arguments if it is cached.
        """

    @property
    def known_angles(self) -> tuple[str, ...]:
        """Names of components that are angles, rad: whole turns are no error."""
        return ()

    @property
    def uses_time(self) -> bool:
        """True if the motion depends on the time k T, so that all steps must be equal."""
        return False

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of known inputs in the motion's equations, whose values the scenario has."""
        return ()


class Sensor(Protocol):
    """p(z_k | x_k), Gaussian in the sensor's coordinates; a dataclass of the group ``sensors``."""

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the measurement's components, in order."""

    def measurement(self, x: Array, k: int) -> Gaussian:
        """Return the distribution of z_k given x_k = x.

        Parameters
        ----------
        x : (n_x, *batch)
            States.
        k : int
            Step.

        Returns
        -------
        Gaussian
            Mean h(x) (n_z, *batch), covariance R (n_z, n_z[, *batch]).
        """

    def innovation(self, z: Array, z_pred: Array) -> Array:
        """Subtract measurements, angles wrapped to (-pi, pi].

        Parameters
        ----------
        z, z_pred : array (n_z, *batch)
            Measurements, and predicted ones.

        Returns
        -------
        array (n_z, *batch)
            ``z - z_pred``, NaN where a component of z is missing.
        """


class DifferentiableMotion(SampledMotion, Protocol):
    """A motion with a Jacobian, which extended Kalman filters need."""

    def jacobian(self, x: Array, k: int) -> Array:
        """Return the derivatives of the predicted mean.

        Parameters
        ----------
        x : array (n_x, *batch)
            States at step k - 1.
        k : int
            Step of the result.

        Returns
        -------
        array (n_x, n_x) or (n_x, n_x, *batch)
            d E[x_k] / d x_{k-1} at x.
        """


class DifferentiableSensor(Sensor, Protocol):
    """A sensor with a Jacobian, which extended Kalman filters need."""

    def jacobian(self, x: Array, k: int) -> Array:
        """Return the derivatives of the mean measurement.

        Parameters
        ----------
        x : array (n_x, *batch)
            States.
        k : int
            Step.

        Returns
        -------
        array (n_z, n_x) or (n_z, n_x, *batch)
            d E[z_k] / d x_k at x.
        """


@runtime_checkable
class WithJacobian(Protocol):
    """A motion or sensor that has a Jacobian."""

    def jacobian(self, x: Array, k: int) -> Array:
        """Return the derivatives of the mean (m, n_x[, *batch]) at x (n_x, *batch)."""


class TwiceDifferentiable(Protocol):
    """A motion or sensor with second derivatives in closed form."""

    def hessian(self, x: Array, k: int) -> Array:
        """Return the second derivatives of the mean.

        Parameters
        ----------
        x : array (n_x, *batch)
            States.
        k : int
            Step.

        Returns
        -------
        array (m, n_x, n_x[, *batch])
            Hessian of each of the m components of the mean.
        """


Differentiable: TypeAlias = tuple[DifferentiableMotion, DifferentiableSensor]
"""A model whose motion and sensor both have a Jacobian, for a cast."""


@runtime_checkable
class NormalMotion(Protocol):
    """A motion whose noise is N(0, Q)."""

    @property
    def Q(self) -> Array:
        """Covariance of the noise (n_x, n_x)."""


@runtime_checkable
class GammaMotion(Protocol):
    """A motion of a scalar whose noise is a gamma variate."""

    @property
    def noise(self) -> Gamma:
        """The noise's distribution."""


@runtime_checkable
class LocatingSensor(Protocol):
    """A sensor whose single measurement gives a position."""

    axes: ClassVar[int]
    """number of axes of the position"""

    def located(self, z: Array, k: int) -> Gaussian:
        """Return the position that a measurement gives.

        Parameters
        ----------
        z : array (n_z, M)
            Measurements.
        k : int
            Step.

        Returns
        -------
        Gaussian
            Position (axes, M), m, and its covariance (axes, axes[, M]).
        """


@runtime_checkable
class NearSensor(Protocol):
    """A sensor that computes innovations of particles faster than their predicted measurements."""

    def residual(self, z: Array, x: Array, k: int) -> Gaussian:
        """Return the innovations of particles.

        Parameters
        ----------
        z : array (n_z, M)
            Measurements.
        x : array (n_x, M, N)
            Particles.
        k : int
            Step.

        Returns
        -------
        Gaussian
            ``innovation(z, E[z_k | x_k = x])`` (n_z, M, N), and the covariance R of the noise.
        """


@runtime_checkable
class DensitySensor(Protocol):
    """A sensor whose noise may be other than normal; `measurement` then gives its moments."""

    def has_density(self) -> bool:
        """Return whether `log_density` and `draw_known` take the place of `measurement`."""

    def why_no_moments(self) -> str:
        """Return the reason why the measurement has no covariance, or nothing."""

    def log_density(self, z: Array, x: Array, k: int) -> Array:
        """Return the log-likelihood of measurements, by their measured components.

        Parameters
        ----------
        z : array (n_z, M)
            Measurements; NaN where a component is missing.
        x : array (n_x, M) or (n_x, M, N)
            States.
        k : int
            Step.

        Returns
        -------
        array (M,) or (M, N)
            log p(z_k | x_k = x).
        """

    def draw_known(self, x: Array, k: int, noise: Array, rng: Streams) -> Array:
        """Draw measurements of true states.

        Parameters
        ----------
        x : array (n_x, M) or (n_x, 1)
            True states.
        k : int
            Step.
        noise : array (n_z, M)
            Standard normal noise.
        rng : Streams
            Further random numbers.

        Returns
        -------
        array (n_z, M)
            Measurements, none of them missing.
        """


@cache
def _is_of(kind: type[object], protocol: type[object]) -> bool:
    return issubclass(kind, protocol)


def has_own_density(sensor: Sensor) -> TypeGuard[DensitySensor]:
    """Return whether a sensor has a likelihood that is not normal."""
    return _is_of(type(sensor), DensitySensor) and cast(DensitySensor, sensor).has_density()


class Model(NamedTuple):
    """Motion and sensor as a filter assumes them: p(x_k | x_{k-1}) and p(z_k | x_k)."""

    motion: SampledMotion
    sensor: Sensor


class Scene(Part):
    """Facts about a scenario that a filter may check before anything runs."""

    @property
    @abstractmethod
    def model(self) -> Model:
        """True motion and sensor, which are also the filter model by default."""

    @property
    @abstractmethod
    def steps(self) -> Index:
        """Step numbers k (T + 1,), starting with the step of the prior."""

    @property
    @abstractmethod
    def times(self) -> Array:
        """Times of the steps (T + 1,), s."""

    @property
    def prior_type(self) -> type[Distribution]:
        """Class of the prior, for filters that use more of it than moments."""
        return Gaussian

    @property
    def turns(self) -> tuple[float, ...]:
        """Sizes of the accelerations of the target's turns, m/s^2."""
        return ()


def measured_angle_rows(sensor: Sensor) -> tuple[int, ...]:
    """Return the rows of the measured angles: a whole turn changes nothing in their innovation."""
    n = len(sensor.components)
    zero = np.zeros((n, n))
    # The innovation of a component that differs by a whole turn, and by a tenth of a radian.
    of_turn = np.diagonal(sensor.innovation(2.0 * np.pi * np.eye(n), zero))
    of_tenth = np.diagonal(sensor.innovation(0.1 * np.eye(n), zero))
    is_angle = np.isclose(of_turn, 0.0, atol=1e-9) & np.isclose(of_tenth, 0.1)
    return tuple(np.flatnonzero(is_angle).tolist())


def log_likelihood(sensor: Sensor, z: Array, x: Array, k: int) -> Array:
    """Return the log-likelihood of measurements, by their measured components.

    Parameters
    ----------
    sensor : Sensor
        Sensor of the filter model.
    z : array (n_z, M)
        Measurements; NaN where a component is missing.
    x : array (n_x, M) or (n_x, M, N)
        States.
    k : int
        Step.

    Returns
    -------
    array (M,) or (M, N)
        log p(z_k | x_k = x), zero if all components are missing.
    """
    count_operations("likelihoods", x, component_axes=1)
    if has_own_density(sensor):
        return sensor.log_density(z, x, k)
    # Step 1: innovations nu and their covariance R, by the sensor's fast way for particles if any.
    if x.ndim == 3 and _is_of(type(sensor), NearSensor):
        residual = cast(NearSensor, sensor).residual(z, x, k)
        nu = residual.mean
        R = residual.cov
    else:
        predicted = sensor.measurement(x, k)
        R = predicted.cov
        nu = sensor.innovation(with_trailing(z, predicted.mean.ndim - 1), predicted.mean)
    # Step 2: log N(nu; 0, R), without the missing components.
    if not any_nan(z):
        return zero_mean_log_prob(nu, R)
    missing = np.isnan(with_trailing(z, nu.ndim - 1))
    value = kalman.log_prob_of_measured(nu, kalman.drop_missing_cov(R, missing), missing)
    return np.where(missing.all(axis=0), 0.0, value)
