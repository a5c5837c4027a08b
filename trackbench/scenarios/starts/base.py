"""Base of initializations: distribution of the first state from scans or prior knowledge."""

from abc import abstractmethod
from typing import ClassVar, NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.random_streams import Streams
from trackbench.extension_points import Part
from trackbench.models.base import LocatingSensor
from trackbench.models.sensors.base import Sensors, rows_of, sensors_of


class InitialScans(NamedTuple):
    """Data for an initialization: truth (n_x, M) at the first scan, first scans (n_z, scans, M).

    ``T`` is the time between two scans, s; of recorded runs perhaps each one's own (M,).
    """

    truth: Array
    scans: Array
    first_step: int
    T: float | Array
    diffusion: float


class Start(Part):
    """A frozen dataclass that makes the distribution of the first state."""

    scans: ClassVar[int] = 0
    """how many scans it uses up; the first state is that of the last of them"""
    of_truth: ClassVar[bool] = False
    """whether the prior is made of the truth, which no recorded target has"""

    def for_state(self, components: tuple[str, ...]) -> "Start":
        """Return the start of a state with these components; raises InvalidKeyError."""
        return self

    def prior_type(self, sensor: Sensors) -> type[Distribution]:
        """Return the class of `prior`, which filters may ask for more than moments."""
        return Gaussian

    def check(self, components: tuple[str, ...], sensor: Sensors) -> None:
        """Raise InvalidKeyError if this start cannot be used with these components and sensors."""

    def truth(self, nominal: Array, rng: Streams) -> Array:
        """Return the true first state (n_x, M) of a driven target, given the configured one (n_x, M)."""
        return nominal

    @abstractmethod
    def prior(
        self, opening: InitialScans, sensor: Sensors, nominal: Array | None, rng: Streams
    ) -> Distribution:
        """Return the first state's distribution; ``nominal`` is the mean of its draw, if any."""

    def bound(self, path: Array, k: int, sensor: Sensors, T: float, diffusion: float) -> Array:
        """Return the covariance (n, n) of the first state at the truth, path (n, K) from step k."""
        raise NotImplementedError


class FixedStart(Start):
    """Base of the starts with one prior for every run, which a filter may also assume for itself."""

    draws_truth: ClassVar[bool] = True
    """whether the first state of a driven target is drawn from it"""

    @abstractmethod
    def distribution(self, runs: int) -> Distribution:
        """Return the prior (n, M)."""

    def truth(self, nominal: Array, rng: Streams) -> Array:
        """Draw the truth (n_x, M) from the prior, if the start does so."""
        return self.distribution(nominal.shape[1]).sample(rng) if self.draws_truth else nominal

    def prior(
        self, opening: InitialScans, sensor: Sensors, nominal: Array | None, rng: Streams
    ) -> Distribution:
        """Return the configured prior, equal in every run."""
        return self.distribution(opening.truth.shape[1])


def position_part(sensor: Sensors) -> tuple[LocatingSensor, slice] | None:
    """Return the first sensor that measures a position, and its rows of the stacked measurement."""
    for one, where in zip(sensors_of(sensor), rows_of(sensor), strict=True):
        if isinstance(one, LocatingSensor):
            return one, where
    return None


def repeated(state: Array, runs: int) -> Array:
    """Return a state (n,) in every run (n, M)."""
    return np.tile(state[:, None], runs)
