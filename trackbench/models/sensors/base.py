"""Base of all sensors: measurement times, and errors that filters do not model."""

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from trackbench.core import linalg
from trackbench.core.arrays import Array, with_trailing
from trackbench.core.distributions import Gaussian
from trackbench.core.random_streams import Streams
from trackbench.core.sums import total
from trackbench.extension_points import Part
from trackbench.field_types import Count, Finite, Natural, OpenShare, Positive, Share
from trackbench.models.base import LocatingSensor, NearSensor

_STEP = 1e-6  # of a component, or of its unit if that is larger


@dataclass(frozen=True, kw_only=True)
class Outliers:
    """Errors that are larger than a filter assumes: now and then, or by a heavy tail."""

    share: Share = 0.0
    """share of the measurements whose error is `times` as large"""
    times: Positive = 10.0
    """how much larger their error is"""
    degrees: Count | None = None
    """degrees of freedom of Student's t, in place of the normal distribution of the same scale"""


@dataclass(frozen=True, kw_only=True)
class SensorBase(Part):
    """Base of every sensor. What stands here is true of the measurements; a filter knows none of it.

    The error is ``bias + root(R) e``, e standard normal unless there are `outliers`.
    """

    detection: OpenShare | Literal[1] = 1
    """probability that a measurement is there at all"""
    outliers: Outliers | None = None
    """errors that are larger than the sensor's standard deviations say"""
    bias: tuple[Finite, ...] = ()
    """constant error of each component, in SI units and radians; default: none"""
    period: Count = 1
    """measures at every so many-th step"""
    offset: Natural = 0
    """number of a step at which it measures"""

    components: ClassVar[tuple[str, ...]]
    """names of the measurement's components"""
    optional_capabilities: ClassVar[tuple[type, ...]] = (NearSensor, LocatingSensor)

    def __post_init__(self) -> None:
        if self.bias and len(self.bias) != len(self.components):
            names = ", ".join(self.components)
            raise ValueError(f"bias has {len(self.bias)} numbers for {names}")

    @abstractmethod
    def measurement(self, x: Array, k: int) -> Gaussian:
        """Return the distribution of z_k given x_k = x (n_x, *batch), as a filter assumes it."""

    def innovation(self, z: Array, z_pred: Array) -> Array:
        """Return ``z - z_pred`` (n_z, *batch); a sensor of angles wraps them to (-pi, pi]."""
        return z - z_pred

    def jacobian(self, x: Array, k: int) -> Array:
        """Return d E[z_k] / d x_k at x (n_x, *batch), by central differences; (n_z, n_x, *batch)."""
        columns = []
        for i, value in enumerate(x):
            h = _STEP * np.maximum(np.abs(value), 1.0)
            ahead, behind = x.copy(), x.copy()
            ahead[i] += h
            behind[i] -= h
            seen = (self.measurement(there, k).mean for there in (ahead, behind))
            columns.append(self.innovation(*seen) / (2.0 * h))
        return np.stack(columns, axis=1)

    def errors(self, mean: Array, truth: Array) -> dict[str, Array]:
        """Return errors (d, *batch) by quantity in the sensor's coordinates."""
        return {}

    def squares(self, P: Array, x: Array) -> dict[str, Array]:
        """Return mean squared errors (K,) by quantity, of covariances P (n_x, n_x, K) at x."""
        return {}

    def observables(self, x: Array) -> dict[str, Array]:
        """Return functions (*batch) of the state whose posterior means are worth scoring."""
        return {}

    def information(self, x: Array, k: int, certain: bool = False) -> Array:
        """Return ``H' R^-1 H`` (n_x, n_x) of a measurement of the state x (n_x,) at step k.

        By the probability that there is one, unless it is ``certain``.
        """
        of_one = x[:, None]
        H, R = self.jacobian(of_one, k), self.measurement(of_one, k).cov
        H, R = (A[..., 0] if A.ndim > 2 else A for A in (H, R))
        gained = linalg.sandwich(linalg.transpose(H), linalg.inverse(R))
        due = not (k - self.offset) % self.period
        return gained if certain else gained * (float(self.detection) if due else 0.0)

    def measure(self, x: Array, k: int, noise: Array, rng: Streams, certain: bool = False) -> Array:
        """Return measurements (n_z, M) of true states x (n_x, M or 1) from normal noise (n_z, M).

        NaN where there is none, unless it is ``certain`` that there is.
        """
        if self.outliers is not None:
            noise = noise * self._stretch(self.outliers, noise.shape[-1], rng)
        z = self.draw(x, k, noise)
        if self.bias:
            z += with_trailing(np.array(self.bias), 1)
        if self.detection < 1 and not certain:
            z[:, rng.random(z.shape[-1:]) >= self.detection] = np.nan
        if (k - self.offset) % self.period and not certain:
            z[:] = np.nan
        return z

    def draw(self, x: Array, k: int, noise: Array) -> Array:
        """Draw measurements (n_z, M) of true states x from standard normal noise (n_z, M)."""
        seen = self.measurement(x, k)
        z = linalg.matvec(linalg.root(seen.cov), noise)
        z += seen.mean
        return z

    @staticmethod
    def _stretch(outliers: Outliers, runs: int, rng: Streams) -> Array:
        """Return the factor (M,) on the errors: Student's t is normal over the root of a mean square."""
        stretch = np.ones(runs)
        if outliers.degrees is not None:
            squares = np.square(rng.standard_normal((outliers.degrees, runs)))
            stretch = np.sqrt(outliers.degrees / total(squares, axis=0))
        if outliers.share:
            hit = rng.random((runs,)) < outliers.share
            stretch = np.where(hit, outliers.times * stretch, stretch)
        return stretch
