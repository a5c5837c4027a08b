"""Base of all sensors, with properties of the true measurements that filters do not model."""

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from trackbench.component_parts import Part
from trackbench.core import linalg
from trackbench.core.arrays import Array, Index, Mask, with_trailing
from trackbench.core.distributions import Gaussian
from trackbench.core.random_streams import Streams
from trackbench.core.sums import total
from trackbench.field_types import (
    Count,
    Finite,
    InvalidKeyError,
    Natural,
    OpenShare,
    Positive,
    Share,
)
from trackbench.models.base import DensitySensor, DifferentiableSensor, LocatingSensor, NearSensor
from trackbench.models.delays import AnyDelay
from trackbench.models.likelihood import has_own_density
from trackbench.models.numerical_derivatives import central_differences
from trackbench.models.unsupported_keys import UNSUPPORTED_KEYS


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
        # `any_state` is False for a class that reads fixed rows of the state. A scalar state has one.
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

    def with_angles_of_state(self, angles: tuple[str, ...]) -> "SensorBase":
        """Return the sensor for a state whose components ``angles`` are angles in rad.

        Parameters
        ----------
        angles : tuple of str
            Names of the state's components that are equal after whole turns.

        Returns
        -------
        SensorBase
            This sensor, or one that wraps the differences of angles that it measures.
        """
        return self

    @property
    def measured_angles(self) -> tuple[str, ...]:
        """Components of the state that are measured as they are, as an angle; default: none."""
        return ()

    def innovation(self, z: Array, z_pred: Array) -> Array:
        """Subtract measurements; a sensor of angles overrides this to wrap them to (-pi, pi].

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

        By default there are none, as in `errors`.

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
            True if there is a measurement at this step. Otherwise the information is weighted by its
            probability: the key ``detection``, or zero at a step between two periods.

        Returns
        -------
        array (n_x, n_x) or (n_x, n_x, M)
            Information about the state.
        """
        information = information_of_certain(self, x, k)
        if certain:
            return information
        is_due = not (k - self.offset) % self.period
        return weighted_information(information, self.detection, is_due)

    def measures_at(self, steps: Index) -> Mask:
        """Return a mask (K,) of the ``steps`` (K,) at which the sensor measures, by its period.

        Parameters
        ----------
        steps : array of int (K,)
            Numbers of steps.

        Returns
        -------
        array of bool (K,)
            True at a step with a measurement, which may still be missed.
        """
        return np.asarray((steps - self.offset) % self.period == 0)

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
            True if no measurement is missing: neither for the key ``detection`` nor between two periods.

        Returns
        -------
        array (n_z, M)
            Measurements; NaN where one is missing.
        """
        # Step 1: draw from p(z | x), with larger noise for outliers, and add the bias. A sensor whose
        # noise is not normal draws from its own density, which filters know.
        if self.outliers is not None:
            noise = noise * outlier_factor(self.outliers, noise.shape[-1], rng)
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


def outlier_factor(outliers: Outliers, runs: int, rng: Streams) -> Array:
    """Draw the factor by which a run's standard normal errors are multiplied.

    It makes a share of them larger, gives them Student's t distribution, or both. One factor is drawn
    for all components of a measurement.

    Parameters
    ----------
    outliers : Outliers
        Law of the errors.
    runs : int
        Number M of runs.
    rng : Streams
        Random numbers.

    Returns
    -------
    array (M,)
        Factor of each run.
    """
    factor = np.ones(runs)
    if outliers.degrees is not None:
        # Student's t is a normal over the root of a mean of d squared normals.
        squares = np.square(rng.standard_normal((outliers.degrees, runs)))
        factor = np.sqrt(outliers.degrees / total(squares, axis=0))
    if outliers.share:
        is_outlier = rng.random((runs,)) < outliers.share
        factor = np.where(is_outlier, outliers.times * factor, factor)
    return factor


def information_of_certain(sensor: DifferentiableSensor, x: Array, k: int) -> Array:
    """Return the Fisher information ``H' R^-1 H`` of a measurement that is not missing.

    Parameters
    ----------
    sensor : DifferentiableSensor
        Sensor.
    x : array (n_x,) or (n_x, M)
        States.
    k : int
        Step.

    Returns
    -------
    array (n_x, n_x) or (n_x, n_x, M)
        Information about the state. Without a last axis it is equal for all states.
    """
    state = x if x.ndim > 1 else x[:, None]
    H = sensor.jacobian(state, k)
    R = sensor.measurement(state, k).cov
    if x.ndim == 1 and H.ndim > 2:
        H = H[..., 0]
    if x.ndim == 1 and R.ndim > 2:
        R = R[..., 0]
    return linalg.sandwich(linalg.transpose(H), linalg.inverse(R))


def weighted_information(information: Array, detection: float, is_due: bool) -> Array:
    """Return the information times the probability of the measurement.

    Parameters
    ----------
    information : array (n_x, n_x[, M])
        Information of a measurement that is not missing.
    detection : float
        Probability of a measurement at a step at which one is due.
    is_due : bool
        False at a step between two periods, at which there is no measurement.

    Returns
    -------
    array (n_x, n_x[, M])
        Expected information.
    """
    probability = float(detection) if is_due else 0.0
    return information * probability
