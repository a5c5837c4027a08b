"""Starts that need no scan: the first state is known, or known to within an error."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.distributions import Distribution, Gaussian, PointMass
from trackbench.core.random_streams import Streams
from trackbench.field_types import Finite, InvalidKeyError, NonNegative
from trackbench.models.sensors.stacked import Sensors
from trackbench.registry import register
from trackbench.scenarios.starts.base import InitialScans, Start, repeated


@register("starts", "known")
@dataclass(frozen=True, kw_only=True)
class Known(Start):
    """Every filter starts at the true first state."""

    of_truth: ClassVar[bool] = True

    def prior_type(self, sensor: Sensors) -> type[Distribution]:
        """Return a point."""
        return PointMass

    def prior(
        self, opening: InitialScans, sensor: Sensors, nominal: Array | None, rng: Streams
    ) -> Distribution:
        """Return point masses at the truth."""
        return PointMass(opening.truth)


@register("starts", "gaussian")
@dataclass(frozen=True, kw_only=True)
class GaussianStart(Start):
    """Truth and prior mean differ by a normal error, of which every filter knows the covariance.

    The truth of a driven target is drawn about its configured state; about a path that is flown in every
    run the prior's mean is.
    """

    sigma: tuple[NonNegative, ...]
    """standard deviation of each component: of (px, vx, py, vy) of a planar target, m and m/s"""

    of_truth: ClassVar[bool] = True

    def check(self, components: tuple[str, ...], sensor: Sensors) -> None:
        """A standard deviation for each component."""
        if len(self.sigma) != len(components):
            what = f"{len(self.sigma)} numbers for {', '.join(components)}"
            raise InvalidKeyError(what, "start", "sigma")

    @property
    def cov(self) -> Array:
        """Return the covariance (n, n)."""
        return np.diag(np.square(self.sigma))

    def truth(self, nominal: Array, rng: Streams) -> Array:
        """Return the drawn about the configured state."""
        return Gaussian(nominal, self.cov).sample(rng)

    def prior(
        self, opening: InitialScans, sensor: Sensors, nominal: Array | None, rng: Streams
    ) -> Distribution:
        """Return the about what the truth was drawn about, or about a draw about the truth."""
        if nominal is not None:
            return Gaussian(nominal, self.cov)
        return Gaussian(Gaussian(opening.truth, self.cov).sample(rng), self.cov)

    def bound(self, path: Array, k: int, sensor: Sensors, T: float, diffusion: float) -> Array:
        """Return the covariance."""
        return self.cov


@register("starts", "given")
@dataclass(frozen=True, kw_only=True)
class GivenStart(Start):
    """Every filter starts from the same normal distribution, wherever the target really is."""

    mean: tuple[Finite, ...]
    """mean of each component: of (px, vx, py, vy) of a planar target, m and m/s"""
    sigma: tuple[NonNegative, ...]
    """standard deviation of each"""

    def check(self, components: tuple[str, ...], sensor: Sensors) -> None:
        """A number for each component."""
        for key in ("mean", "sigma"):
            if len(getattr(self, key)) != len(components):
                what = f"{len(getattr(self, key))} numbers for {', '.join(components)}"
                raise InvalidKeyError(what, "start", key)

    def prior(
        self, opening: InitialScans, sensor: Sensors, nominal: Array | None, rng: Streams
    ) -> Distribution:
        """Return the given prior, the same in every run."""
        mean = repeated(np.array(self.mean), opening.truth.shape[1])
        return Gaussian(mean, np.diag(np.square(self.sigma)))

    def bound(self, path: Array, k: int, sensor: Sensors, T: float, diffusion: float) -> Array:
        """Return the covariance."""
        return np.diag(np.square(self.sigma))
