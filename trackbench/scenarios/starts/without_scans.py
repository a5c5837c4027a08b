"""Starts that need no scan: the first state is known, or known to within an error."""

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.distributions import Distribution, Gaussian, PointMass
from trackbench.core.random_streams import Streams
from trackbench.field_types import (
    ByComponent,
    Finite,
    InvalidKeyError,
    freeze_mappings,
)
from trackbench.models.base import by_component
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


@dataclass(frozen=True, kw_only=True)
class NormalStart(Start):
    """Base of the starts from a normal distribution."""

    sigma: ByComponent | None = None
    """standard deviation of each component, in order (px, vx, py, vy of a planar target) or by name, 0
    where none is given; m and m/s"""
    cov: tuple[tuple[Finite, ...], ...] | None = None
    """covariance matrix, instead"""

    def __post_init__(self) -> None:
        freeze_mappings(self)
        if (self.sigma is None) == (self.cov is None):
            raise ValueError("give one of sigma and cov")

    def for_state(self, components: tuple[str, ...]) -> Self:
        """Return the start with numbers in the order of the components; raises InvalidKeyError."""
        if self.sigma is not None:
            sigma = by_component(self.sigma, components, "start", "sigma")
            if (sigma < 0.0).any():
                raise InvalidKeyError("a standard deviation is not negative", "start", "sigma")
            return replace(self, sigma=tuple(sigma.tolist()))
        n, P = len(components), self._cov
        if P.shape != (n, n):
            what = f"needs {n} rows of {n} numbers, for {', '.join(components)}"
            raise InvalidKeyError(what, "start", "cov")
        # Symmetric, and no eigenvalue below zero but for rounding.
        if (P != P.T).any() or np.linalg.eigvalsh(P)[0] < -1e-12 * np.abs(P).max():
            raise InvalidKeyError("not symmetric and non-negative definite", "start", "cov")
        return self

    @property
    def _cov(self) -> Array:
        """Return the covariance (n, n)."""
        if self.cov is None:
            assert isinstance(self.sigma, tuple)  # after `for_state`
            return np.diag(np.square(self.sigma))
        width = max(map(len, self.cov), default=0)
        if any(len(row) != width for row in self.cov):
            return np.empty((0, 0))
        return np.array(self.cov, dtype=float)

    def bound(self, path: Array, k: int, sensor: Sensors, T: float, diffusion: float) -> Array:
        """Return the covariance."""
        return self._cov


@register("starts", "gaussian")
@dataclass(frozen=True, kw_only=True)
class GaussianStart(NormalStart):
    """Truth and prior mean differ by a normal error, of which every filter knows the covariance.

    The truth of a driven target is drawn about its configured state; about a path that is flown in every
    run the prior's mean is.
    """

    of_truth: ClassVar[bool] = True

    def truth(self, nominal: Array, rng: Streams) -> Array:
        """Draw the truth (n_x, M) about the configured state (n_x, M)."""
        return Gaussian(nominal, self._cov).sample(rng)

    def prior(
        self, opening: InitialScans, sensor: Sensors, nominal: Array | None, rng: Streams
    ) -> Distribution:
        """Return the distribution that the truth was drawn from, or one about a draw about the truth."""
        if nominal is not None:
            return Gaussian(nominal, self._cov)
        return Gaussian(Gaussian(opening.truth, self._cov).sample(rng), self._cov)


@register("starts", "given")
@dataclass(frozen=True, kw_only=True)
class GivenStart(NormalStart):
    """Every filter starts from the same normal distribution, wherever the target really is."""

    mean: ByComponent
    """mean of each component, in order or by name, 0 where none is given; m and m/s"""

    def for_state(self, components: tuple[str, ...]) -> Self:
        """Return the start with numbers in the order of the components; raises InvalidKeyError."""
        mean = by_component(self.mean, components, "start", "mean")
        return replace(super().for_state(components), mean=tuple(mean.tolist()))

    def prior(
        self, opening: InitialScans, sensor: Sensors, nominal: Array | None, rng: Streams
    ) -> Distribution:
        """Return the configured prior, the same in every run."""
        return Gaussian(repeated(np.array(self.mean), opening.truth.shape[1]), self._cov)
