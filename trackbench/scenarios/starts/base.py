"""Base of initializations: distribution of the first state from scans or prior knowledge."""

from abc import abstractmethod
from collections.abc import Sequence
from typing import ClassVar, NamedTuple, Self

import numpy as np

from trackbench.component_parts import Part
from trackbench.core.arrays import Array
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.random_streams import Streams
from trackbench.models.sensors.stacked import Sensors


class InitialScans(NamedTuple):
    """Data for an initialization."""

    truth: Array
    """true states (n_x, M) at the first scan"""
    scans: Array
    """first scans (n_z, scans, M)"""
    first_step: int
    """number of the first scan's step"""
    T: float | Array
    """time between two scans, s; (M,) if it differs from run to run of a recording"""
    diffusion: float
    """spectral density of the target's white acceleration, m^2/s^3"""


class Start(Part):
    """A frozen dataclass that makes the distribution of the first state."""

    scans: ClassVar[int] = 0
    """number of scans that it uses up; the first state is that of the last of them"""
    of_truth: ClassVar[bool] = False
    """True if the prior depends on the truth, which is unknown for a recorded target"""

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
        """Make the distribution of the first state, which every filter is given.

        A start uses those of the arguments that it needs.

        Parameters
        ----------
        opening : InitialScans
            Truth at the first scan, and the scans that the start uses up.
        sensor : Sensors
            Sensor, or all sensors as one.
        nominal : Array (n_x, M) or None
            Configured first state, if the truth was drawn about it.
        rng : Streams
            Random numbers, a stream per run.

        Returns
        -------
        Distribution
            Prior of M runs.
        """

    def bound(self, path: Array, k: int, sensor: Sensors, T: float, diffusion: float) -> Array:
        """Compute the covariance of the first state at the truth.

        The posterior Cramer-Rao bound begins with it.

        Parameters
        ----------
        path : Array (n, K)
            True states from step k on. A start from several scans uses as many of them.
        k : int
            Number of the first step.
        sensor : Sensors
            Sensor, or all sensors as one.
        T : float
            Time between two scans, s, for a start from several scans.
        diffusion : float
            Spectral density of the target's white acceleration, m^2/s^3, by which the velocity changes
            between two scans.

        Returns
        -------
        Array (n, n)
            Covariance, not its inverse.
        """
        raise NotImplementedError


class FixedStart(Start):
    """Base of the starts with one prior for every run, which a filter may also assume for itself."""

    draws_truth: ClassVar[bool] = True
    """True if the first state of a driven target is drawn from it"""

    @abstractmethod
    def distribution(self, runs: int) -> Distribution:
        """Return the prior (n, M)."""

    def on_one_turn(self, angles: Sequence[int]) -> Self:
        """Return the start with the angles in these rows of the state on one turn.

        Only a start of several parts may have them on several turns.
        """
        return self

    def truth(self, nominal: Array, rng: Streams) -> Array:
        """Draw the true first state (n_x, M) from the prior, if the start does so.

        Else it is the configured one, ``nominal`` (n_x, M).
        """
        if not self.draws_truth:
            return nominal
        return self.distribution(nominal.shape[1]).sample(rng)

    def prior(
        self, opening: InitialScans, sensor: Sensors, nominal: Array | None, rng: Streams
    ) -> Distribution:
        """Return the configured prior, equal in every run."""
        return self.distribution(opening.truth.shape[1])


def repeated(state: Array, runs: int) -> Array:
    """Return the state (n,) repeated for every run (n, M)."""
    return np.tile(state[:, None], runs)
