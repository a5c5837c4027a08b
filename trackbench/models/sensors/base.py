"""Base of all sensors: measurement times, and errors that filters do not model; the key `assume`."""

from abc import abstractmethod
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

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
    central_differences,
    has_density,
)


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

    components: ClassVar[tuple[str, ...]]
    """names of the measurement's components"""
    any_state: ClassVar[bool] = True
    """whether the state may be any; else it is a scalar, or positions and velocities"""
    unsupported_keys: ClassVar[dict[str, str]] = UNSUPPORTED_KEYS
    optional_capabilities: ClassVar[tuple[type, ...]] = (NearSensor, LocatingSensor, DensitySensor)

    def __post_init__(self) -> None:
        if self.bias and len(self.bias) != len(self.components):
            names = ", ".join(self.components)
            raise ValueError(f"bias has {len(self.bias)} numbers for {names}")

    @abstractmethod
    def measurement(self, x: Array, k: int) -> Gaussian:
        """Return N(h(x), R) of z_k given x_k = x without bias and outliers; see `Sensor.measurement`."""

    def for_state(self, components: tuple[str, ...]) -> "SensorBase":
        """Return the sensor for states that begin with these components; raises InvalidKeyError."""
        if not self.any_state and len(components) > 1 and components[:2] != ("px", "vx"):
            names = ", ".join(components)
            what = f"measures positions and velocities, and the state is {names}: take `function`"
            raise InvalidKeyError(what, "kind")
        return self

    @property
    def has_noise_of_state(self) -> bool:
        """Return whether R depends on the state, which the Fisher information leaves out."""
        return False

    def innovation(self, z: Array, z_pred: Array) -> Array:
        """Return ``z - z_pred`` (n_z, *batch); a sensor of angles wraps them to (-pi, pi]."""
        return z - z_pred

    def jacobian(self, x: Array, k: int) -> Array:
        """Return d E[z_k] / d x_k at x (n_x, *batch), by central differences; (n_z, n_x, *batch)."""
        return central_differences(lambda s: self.measurement(s, k).mean, x, self.innovation)

    def errors(self, mean: Array, truth: Array) -> dict[str, Array]:
        """Return errors (d, *batch) by quantity in the sensor's coordinates."""
        return {}

    def squares(self, P: Array, x: Array) -> dict[str, Array]:
        """Return mean squared errors (K,) by quantity, of covariances P (n_x, n_x, K) at x."""
        return {}

    def observables(self, x: Array) -> dict[str, Array]:
        """Return functions (*batch) of the state whose posterior means are scored as well."""
        return {}

    def information(self, x: Array, k: int, certain: bool = False) -> Array:
        """Return ``H' R^-1 H`` (n_x, n_x) of a measurement of the state x (n_x,) at step k.

        It is weighted by the probability of a measurement, unless ``certain``.
        """
        state = x[:, None]
        H, R = self.jacobian(state, k), self.measurement(state, k).cov
        H, R = (A[..., 0] if A.ndim > 2 else A for A in (H, R))
        # H' R^-1 H, weighted by the probability of a measurement at step k
        information = linalg.sandwich(linalg.transpose(H), linalg.inverse(R))
        due = not (k - self.offset) % self.period
        return information if certain else information * (float(self.detection) if due else 0.0)

    def measure(self, x: Array, k: int, noise: Array, rng: Streams, certain: bool = False) -> Array:
        """Return measurements (n_z, M) of true states x (n_x, M or 1) from normal noise (n_z, M).

        A missing measurement is NaN; ``certain`` means that none is missing.
        """
        # Step 1: draw from p(z | x), with larger noise for outliers, and add the bias.
        if self.outliers is not None:
            noise = noise * self._outlier_factor(self.outliers, noise.shape[-1], rng)
        if has_density(self):  # noqa: SIM108 - narrows the type
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
        """Draw measurements (n_z, M) of true states x from standard normal noise (n_z, M)."""
        distribution = self.measurement(x, k)
        z = linalg.matvec(linalg.root(distribution.cov), noise)
        z += distribution.mean
        return z

    @staticmethod
    def _outlier_factor(outliers: Outliers, runs: int, rng: Streams) -> Array:
        """Return the factor (M,) on the errors."""
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
class Assume:
    """Motion, sensor and prior of the filter model; a key that is not set takes the true one."""

    motion: Annotated[Motion | None, Registered("motions")] = None
    """motion: {kind: cv, q: 0.3}"""
    sensor: Annotated[SensorBase | tuple[SensorBase, ...] | None, Registered("sensors")] = None
    """sensor, or a list with one for each true sensor"""
    start: Annotated[Part | None, Registered("starts")] = None
    """prior that is independent of the data: given, uniform or mixture"""

    def over(self, other: "Assume") -> "Assume":
        """Return these assumptions, with the other's where a key is unset."""
        return Assume(
            motion=self.motion or other.motion,
            sensor=self.sensor or other.sensor,
            start=self.start or other.start,
        )
