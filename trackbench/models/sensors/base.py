"""Base of all sensors, with the key `assume`, and several sensors stacked into one measurement."""

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cached_property
from itertools import pairwise
from typing import Annotated, ClassVar, Literal, TypeAlias

import numpy as np

from trackbench.core import linalg
from trackbench.core.arrays import Array, with_trailing
from trackbench.core.distributions import Gaussian
from trackbench.core.random_streams import Streams
from trackbench.core.sums import total
from trackbench.extension_points import Part
from trackbench.field_types import (
    Count,
    Finite,
    HoldsComponents,
    InvalidKeyError,
    Natural,
    OpenShare,
    Positive,
    Registered,
    Share,
)
from trackbench.models.base import (
    UNSUPPORTED_KEYS,
    DensitySensor,
    LocatingSensor,
    Motion,
    NearSensor,
)
from trackbench.models.delays import AnyDelay, Late, Treatment
from trackbench.models.derivatives import central_differences
from trackbench.models.likelihood import has_own_density, log_likelihood


@dataclass(frozen=True, kw_only=True)
class Outliers:
    """Errors that are larger than a filter assumes: now and then, or by a heavy tail."""

    share: Share = 0.0
    """share of the measurements with an error `times` as large"""
    times: Positive = 10.0
    """factor on their error"""
    degrees: Count | None = None
    """degrees of freedom of Student's t, in place of the normal distribution of the same scale"""


@dataclass(frozen=True, kw_only=True)
class SensorBase(Part):
    """Base of every sensor, with properties of the true measurements that filters do not model.

    The error is ``bias + root(R) e``, e standard normal unless there are `outliers`. A subclass is a
    frozen dataclass with ``components`` and `measurement`; the other methods have defaults.
    """

    detection: OpenShare | Literal[1] = 1
    """probability of detection: a measurement is missing otherwise"""
    outliers: Outliers | None = None
    """errors larger than the sensor's standard deviations"""
    bias: tuple[Finite, ...] = ()
    """constant error of each component, in SI units and radians; default: none"""
    period: Count = 1
    """number of steps from one measurement to the next"""
    offset: Natural = 0
    """number of a step with a measurement"""
    delay: AnyDelay = 0
    """steps after which a measurement arrives, or their law: {kind: uniform, most: 5}"""

    components: ClassVar[tuple[str, ...]]
    """names of the measurement's components"""
    any_state: ClassVar[bool] = True
    """whether the state may be any; else it is a scalar, or positions and velocities"""
    unsupported_keys: ClassVar[dict[str, str]] = UNSUPPORTED_KEYS
    optional_capabilities: ClassVar[tuple[type, ...]] = (NearSensor, LocatingSensor, DensitySensor)

    def __post_init__(self) -> None:
        if self.bias and len(self.bias) != len(self.components):
            raise ValueError(f"bias has {len(self.bias)} numbers for {', '.join(self.components)}")

    @abstractmethod
    def measurement(self, x: Array, k: int) -> Gaussian:
        """Return the distribution N(h(x), R) of z_k given x_k = x, without bias and outliers.

        Parameters
        ----------
        x : array (n_x, *batch)
            States, in SI units and radians.
        k : int
            Number of the step.

        Returns
        -------
        Gaussian
            Mean h(x) (n_z, *batch), covariance R (n_z, n_z) or (n_z, n_z, *batch).
        """

    def for_state(self, components: tuple[str, ...]) -> "SensorBase":
        """Return the sensor for states that begin with these components.

        Parameters
        ----------
        components : tuple of str
            Names of the state's components, in order.

        Returns
        -------
        SensorBase
            This sensor, or one that knows the names.

        Raises
        ------
        InvalidKeyError
            The sensor cannot measure such a state.
        """
        if not self.any_state and len(components) > 1 and components[:2] != ("px", "vx"):
            names = ", ".join(components)
            message = (
                f"measures positions and velocities, and the state is {names}: take `function`"
            )
            raise InvalidKeyError(message, "kind")
        return self

    @property
    def has_noise_of_state(self) -> bool:
        """True if R depends on the state, which the Fisher information leaves out."""
        return False

    @property
    def measured_angles(self) -> tuple[str, ...]:
        """Components of the state that are measured as they are, as an angle; default: none."""
        return ()

    def innovation(self, z: Array, z_pred: Array) -> Array:
        """Subtract measurements; a sensor of angles wraps them to (-pi, pi].

        Parameters
        ----------
        z, z_pred : array (n_z, *batch)
            Measurements, and predicted ones.

        Returns
        -------
        array (n_z, *batch)
            ``z - z_pred``, NaN where a component of z is missing.
        """
        return z - z_pred

    def jacobian(self, x: Array, k: int) -> Array:
        """Return the derivatives of the mean measurement; by default by central differences.

        Parameters
        ----------
        x : array (n_x, *batch)
            States.
        k : int
            Number of the step.

        Returns
        -------
        array (n_z, n_x) or (n_z, n_x, *batch)
            d E[z_k] / d x_k at x.
        """
        return central_differences(lambda s: self.measurement(s, k).mean, x, self.innovation)

    def errors(self, mean: Array, truth: Array) -> dict[str, Array]:
        """Return errors in the sensor's coordinates, for metrics; default: none.

        Parameters
        ----------
        mean, truth : array (n_x, *batch)
            Estimates and true states.

        Returns
        -------
        dict of array (d, *batch)
            Signed errors by quantity.
        """
        return {}

    def squares(self, P: Array, x: Array) -> dict[str, Array]:
        """Return the mean squares of the quantities of `errors`, for the Cramer-Rao bound.

        Parameters
        ----------
        P : array (n_x, n_x, K)
            Covariances of the state's error.
        x : array (n_x, K)
            States.

        Returns
        -------
        dict of array (K,)
            Mean squared errors by quantity.
        """
        return {}

    def observables(self, x: Array) -> dict[str, Array]:
        """Return functions of the state whose posterior means are scored as well; default: none.

        Parameters
        ----------
        x : array (n_x, *batch)
            States.

        Returns
        -------
        dict of array (*batch)
            Values by name.
        """
        return {}

    def information(self, x: Array, k: int, certain: bool = False) -> Array:
        """Return the Fisher information ``H' R^-1 H`` of a measurement.

        Parameters
        ----------
        x : array (n_x,) or (n_x, M)
            State.
        k : int
            Number of the step.
        certain : bool
            The measurement is certain; else it is weighted by its probability.

        Returns
        -------
        array (n_x, n_x) or (n_x, n_x, M)
            Information about the state.
        """
        state = x if x.ndim > 1 else x[:, None]
        H = self.jacobian(state, k)
        R = self.measurement(state, k).cov
        if x.ndim == 1 and H.ndim > 2:
            H = H[..., 0]
        if x.ndim == 1 and R.ndim > 2:
            R = R[..., 0]
        information = linalg.sandwich(linalg.transpose(H), linalg.inverse(R))
        if certain:
            return information
        is_due = not (k - self.offset) % self.period
        probability = float(self.detection) if is_due else 0.0
        return information * probability

    def measure(self, x: Array, k: int, noise: Array, rng: Streams, certain: bool = False) -> Array:
        """Simulate measurements with detection, outliers, bias and period.

        Parameters
        ----------
        x : array (n_x, M) or (n_x, 1)
            True states.
        k : int
            Number of the step.
        noise : array (n_z, M)
            Standard normal noise.
        rng : Streams
            Further random numbers.
        certain : bool
            No measurement is missing.

        Returns
        -------
        array (n_z, M)
            Measurements; NaN where one is missing.
        """
        # Step 1: draw from p(z | x), with larger noise for outliers, and add the bias.
        if self.outliers is not None:
            noise = noise * self._outlier_factor(self.outliers, noise.shape[-1], rng)
        if has_own_density(self):  # noqa: SIM108 - narrows the type
            z = self.draw_known(x, k, noise, rng)
        else:
            z = self.draw(x, k, noise)
        if self.bias:
            z += with_trailing(np.array(self.bias), 1)
        # Step 2: drop measurements at random, and those of steps between the periods.
        if self.detection < 1 and not certain:
            z[:, rng.random(z.shape[-1:]) >= self.detection] = np.nan
        if (k - self.offset) % self.period and not certain:
            z[:] = np.nan
        return z

    def draw(self, x: Array, k: int, noise: Array) -> Array:
        """Draw measurements of true states, without outliers and bias.

        Parameters
        ----------
        x : array (n_x, M) or (n_x, 1)
            True states.
        k : int
            Number of the step.
        noise : array (n_z, M)
            Standard normal noise.

        Returns
        -------
        array (n_z, M)
            ``h(x) + root(R) noise``.
        """
        distribution = self.measurement(x, k)
        z = linalg.matvec(linalg.root(distribution.cov), noise)
        z += distribution.mean
        return z

    @staticmethod
    def _outlier_factor(outliers: Outliers, runs: int, rng: Streams) -> Array:
        """Draw the factor (M,) on normal errors that makes them outliers, or Student's t."""
        factor = np.ones(runs)
        if outliers.degrees is not None:
            # Student's t is a normal over the root of a mean of d squared normals.
            squares = np.square(rng.standard_normal((outliers.degrees, runs)))
            factor = np.sqrt(outliers.degrees / total(squares, axis=0))
        if outliers.share:
            is_outlier = rng.random((runs,)) < outliers.share
            factor = np.where(is_outlier, outliers.times * factor, factor)
        return factor


@dataclass(frozen=True, kw_only=True)
class Assume(HoldsComponents):
    """Motion, sensor and prior of the filter model; a key that is not set takes the true one."""

    motion: Annotated[Motion | None, Registered("motions")] = None
    """motion: {kind: cv, q: 0.3}"""
    sensor: Annotated[SensorBase | tuple[SensorBase, ...] | None, Registered("sensors")] = None
    """sensor, or a list with one for each true sensor"""
    start: Annotated[Part | None, Registered("starts")] = None
    """prior that is independent of the data: given, uniform or mixture"""
    faults: Literal["known"] | None = None
    """known: the true law of the sensors' faults; default: none"""
    delay: Literal["none"] | None = None
    """none: every measurement on time, as a bound; default: they arrive with their delays"""
    late: Treatment | Late | None = None
    """of late measurements: drop, apply or refilter, also as {kind: refilter, memory: 20}"""

    def __post_init__(self) -> None:
        if self.delay and self.late:
            raise InvalidKeyError("has no effect beside `delay: none`; leave one out", "late")

    def over(self, other: "Assume") -> "Assume":
        """Return these assumptions, with the other's where a key is unset."""
        delay = self.delay
        late = self.late
        # `delay` and `late` exclude each other: if one of them is set here, the other one is not taken
        # from ``other``.
        if not delay and not self.late:
            delay = other.delay
        if not late and not self.delay:
            late = other.late
        return Assume(
            motion=self.motion or other.motion,
            sensor=self.sensor or other.sensor,
            start=self.start or other.start,
            faults=self.faults or other.faults,
            delay=delay,
            late=late,
        )


@dataclass(frozen=True)
class StackedSensor:
    """Independent sensors of one target; components are named by their sensor's number, from 1."""

    sensors: tuple[SensorBase, ...]

    @cached_property
    def components(self) -> tuple[str, ...]:
        """Names of the measurement's components, in order."""
        names: list[str] = []
        for n, sensor in enumerate(self.sensors, 1):
            names += [f"{n}.{component}" for component in sensor.components]
        return tuple(names)

    def measurement(self, x: Array, k: int) -> Gaussian:
        """Return the distribution of all measurements given x_k = x (n_x, *batch)."""
        measured = [sensor.measurement(x, k) for sensor in self.sensors]
        # R is block diagonal, with batch axes if any sensor's covariance has them.
        n_z = len(self.components)
        axes = max(single.cov.ndim for single in measured) - 2
        batch = measured[0].mean.shape[1:] if axes else ()
        R = np.zeros((n_z, n_z, *batch))
        for rows, single in zip(self.rows, measured, strict=True):
            R[rows, rows] = with_trailing(single.cov, axes, leading=2)
        return Gaussian(np.concatenate([single.mean for single in measured]), R)

    def has_density(self) -> bool:
        """Return whether a sensor's noise is not normal."""
        return any(map(has_own_density, self.sensors))

    def why_no_moments(self) -> str:
        """Return the reason why a measurement has no covariance, or nothing."""
        for sensor in self.sensors:
            if has_own_density(sensor):
                reason = sensor.why_no_moments()
                if reason:
                    return reason
        return ""

    def log_density(self, z: Array, x: Array, k: int) -> Array:
        """Return the sum (M[, N]) of the independent sensors' log-likelihoods."""
        pairs = zip(self.sensors, self.rows, strict=True)
        return np.add.reduce([log_likelihood(sensor, z[rows], x, k) for sensor, rows in pairs])

    def draw_known(self, x: Array, k: int, noise: Array, rng: Streams) -> Array:
        """Draw measurements (n_z, M) of true states x; ``noise`` (n_z, M) is standard normal."""
        return self.measure(x, k, noise, rng, certain=True)

    def innovation(self, z: Array, z_pred: Array) -> Array:
        """Return ``z - z_pred``, angles wrapped."""
        pairs = zip(self.sensors, self.rows, strict=True)
        return np.concatenate([s.innovation(z[rows], z_pred[rows]) for s, rows in pairs])

    def jacobian(self, x: Array, k: int) -> Array:
        """Return d E[z_k] / d x_k (n_z, n_x[, *batch])."""
        jacobians = [sensor.jacobian(x, k) for sensor in self.sensors]
        # Matrices get batch axes if any of them has some.
        axes = max(H.ndim for H in jacobians) - 2
        batch = x.shape[1:] if axes else ()
        rows = []
        for H in jacobians:
            rows.append(np.broadcast_to(with_trailing(H, axes, leading=2), (*H.shape[:2], *batch)))
        return np.concatenate(rows)

    @property
    def H(self) -> Callable[[int], Array]:
        """H (n_z, n) as a function of n; AttributeError if a sensor is nonlinear."""
        matrices = [sensor.H for sensor in self.sensors]  # type: ignore[attr-defined]
        return lambda n: np.concatenate([H(n) for H in matrices])

    @property
    def linear(self) -> bool:
        """Return True; AttributeError if a sensor is nonlinear."""
        return all(sensor.linear for sensor in self.sensors)  # type: ignore[attr-defined]

    def information(self, x: Array, k: int, certain: bool = False) -> Array:
        """Return ``H' R^-1 H`` (n_x, n_x[, M]) of all measurements of x (n_x[, M]) at step k."""
        # The information of independent sensors adds.
        informations = [sensor.information(x, k, certain) for sensor in self.sensors]
        axes = max(J.ndim for J in informations) - 2
        alike = [with_trailing(J, axes, leading=2) for J in informations]
        return np.add.reduce(np.broadcast_arrays(*alike))

    def observables(self, x: Array) -> dict[str, Array]:
        """Return an empty dictionary: joined sensors have no observables."""
        return {}

    def measure(self, x: Array, k: int, noise: Array, rng: Streams, certain: bool = False) -> Array:
        """Return measurements (n_z, M) of true states x (n_x, M), NaN where one is missing."""
        pairs = zip(self.sensors, self.rows, strict=True)
        return np.concatenate([s.measure(x, k, noise[rows], rng, certain) for s, rows in pairs])

    @cached_property
    def rows(self) -> list[slice]:
        """Each sensor's rows in a measurement."""
        ends = np.cumsum([len(sensor.components) for sensor in self.sensors]).tolist()
        return [slice(a, b) for a, b in pairwise([0, *ends])]


@dataclass(frozen=True, eq=False)
class ScaledNoise:
    """A sensor whose standard deviations have factors (n_z, T), from step ``first`` on."""

    sensor: "Sensors"
    first: int
    scales: Array

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the measurement's components, in order."""
        return self.sensor.components

    def measurement(self, x: Array, k: int) -> Gaussian:
        """Return the distribution N(h(x), D R D) of z_k given x_k = x (n_x, *batch)."""
        unscaled = self.sensor.measurement(x, k)
        d = self.scales[:, k - self.first]
        factors = with_trailing(np.outer(d, d), unscaled.cov.ndim - 2, leading=2)
        return Gaussian(unscaled.mean, unscaled.cov * factors)

    def innovation(self, z: Array, z_pred: Array) -> Array:
        """Return ``z - z_pred``, angles wrapped."""
        return self.sensor.innovation(z, z_pred)

    def jacobian(self, x: Array, k: int) -> Array:
        """Return d E[z_k] / d x_k (n_z, n_x[, *batch])."""
        return self.sensor.jacobian(x, k)

    @property
    def H(self) -> Callable[[int], Array]:
        """H (n_z, n) as a function of n; AttributeError if the sensor is nonlinear."""
        return self.sensor.H  # type: ignore[union-attr]

    @property
    def linear(self) -> bool:
        """Return True; AttributeError if the sensor is nonlinear."""
        return self.sensor.linear  # type: ignore[union-attr]


Sensors: TypeAlias = SensorBase | StackedSensor
"""One sensor, or several as one."""


def stack(sensors: tuple[SensorBase, ...] | SensorBase) -> Sensors:
    """Join several sensors to one; a single sensor is returned as it is."""
    if not isinstance(sensors, tuple):
        return sensors
    return sensors[0] if len(sensors) == 1 else StackedSensor(sensors)


def stack_for(
    sensors: SensorBase | tuple[SensorBase, ...], components: tuple[str, ...], *path: str
) -> Sensors:
    """Join sensors of a state with these components to one; raises InvalidKeyError."""
    several = sensors if isinstance(sensors, tuple) else (sensors,)
    fitted = []
    for i, sensor in enumerate(several):
        try:
            fitted.append(sensor.for_state(components))
        except InvalidKeyError as error:
            index = (i,) if isinstance(sensors, tuple) else ()
            raise InvalidKeyError(str(error), *path, *index, *error.path) from None
    return stack(tuple(fitted))


def sensors_of(sensor: Sensors) -> tuple[SensorBase, ...]:
    """List the sensors that were joined to one, or the single sensor."""
    return sensor.sensors if isinstance(sensor, StackedSensor) else (sensor,)


def rows_of(sensor: Sensors) -> list[slice]:
    """List the rows of a measurement that each of the joined sensors measures."""
    return sensor.rows if isinstance(sensor, StackedSensor) else [slice(None)]


def assumed_sensor(assume: Assume, true: Sensors, components: tuple[str, ...]) -> Sensors:
    """Choose the sensor of the filter model for states of these components: the assumed or the true one.

    Raises InvalidKeyError if filters cannot assume it, or if it measures something else.
    """
    if assume.sensor is None:
        return true
    sensor = stack_for(assume.sensor, components, "assume", "sensor")
    _check_assumed(assume.sensor)
    if sensor.components != true.components:
        raise InvalidKeyError("the assumed sensor measures something else", "assume", "sensor")
    return sensor


def _check_assumed(sensors: SensorBase | tuple[SensorBase, ...]) -> None:
    """Raise InvalidKeyError for a property of true measurements that filters do not model."""
    several = sensors if isinstance(sensors, tuple) else (sensors,)
    names = [key.name for key in fields(SensorBase)]
    for i, sensor in enumerate(several):
        index = (i,) if isinstance(sensors, tuple) else ()
        for name in names:
            # The class's attribute is the key's default.
            if getattr(sensor, name) != getattr(SensorBase, name):
                message = (
                    "has no effect: no filter models it; set it at the scenario's own `sensor`"
                )
                raise InvalidKeyError(message, "assume", "sensor", *index, name)
