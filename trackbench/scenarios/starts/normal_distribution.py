"""Keys of a normal distribution: its mean, and its standard deviations or covariance."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.field_types import ByComponent, Finite, InvalidKeyError, freeze_mappings
from trackbench.models.component_names import by_component
from trackbench.models.noise_covariances import asymmetry, check_eigenvalues
from trackbench.models.sensors.stacked import Sensors
from trackbench.scenarios.starts.base import Start


@dataclass(frozen=True, kw_only=True)
class Spread:
    """Keys of a normal distribution's covariance."""

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
        """Return the start with numbers in the order of the components; raises InvalidKeyError.

        Parameters
        ----------
        components : tuple of str
            Names of the state's components, in order.

        Returns
        -------
        Spread
            Copy with a standard deviation of each component. With the key ``cov`` it is the start
            itself.

        Raises
        ------
        InvalidKeyError
            For an unknown component, a negative standard deviation, and a matrix that is no covariance
            of these components.
        """
        if self.sigma is not None:
            sigma = by_component(self.sigma, components, "start", "sigma")
            if (sigma < 0.0).any():
                raise InvalidKeyError("a standard deviation is not negative", "start", "sigma")
            return replace(self, sigma=tuple(sigma.tolist()))
        n = len(components)
        P = self._cov  # (0, 0) if rows of the key differ in length
        if P.shape != (n, n):
            message = f"needs {n} rows of {n} numbers, for {', '.join(components)}"
            raise InvalidKeyError(message, "start", "cov")
        differing = np.argwhere(P != P.T)
        if len(differing):
            row, column = differing[0].tolist()
            raise asymmetry(row, column, "start", "cov")
        check_eigenvalues(P, "start", "cov")
        return self

    @property
    def _cov(self) -> Array:
        """Covariance (n, n).

        If rows of the key ``cov`` differ in length, it has the shape (0, 0), which `for_state` refuses.
        """
        if self.cov is None:
            assert isinstance(self.sigma, tuple)  # after `for_state`
            return np.diag(np.square(self.sigma))
        width = max(map(len, self.cov), default=0)
        if any(len(row) != width for row in self.cov):
            return np.empty((0, 0))
        return np.array(self.cov, dtype=float)


@dataclass(frozen=True, kw_only=True)
class Located(Spread):
    """Keys of a normal distribution."""

    mean: ByComponent
    """mean of each component, in order or by name, 0 where none is given; m and m/s"""

    def for_state(self, components: tuple[str, ...]) -> Self:
        """Return the distribution with numbers in the order of the components."""
        mean = by_component(self.mean, components, "start", "mean")
        return replace(super().for_state(components), mean=tuple(mean.tolist()))

    @property
    def gaussian(self) -> Gaussian:
        """Distribution with mean (n,), after `for_state`."""
        return Gaussian(np.array(self.mean), self._cov)


@dataclass(frozen=True, kw_only=True)
class NormalStart(Spread, Start):
    """Base of the starts from a normal distribution."""

    def bound(self, path: Array, k: int, sensor: Sensors, T: float, diffusion: float) -> Array:
        """Return the covariance."""
        return self._cov
