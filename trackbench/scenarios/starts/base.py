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
        """Return the start of a state with these components; raises InvalidKeyError.

        Parameters
        ----------
        components : tuple of str
            Names of the state's components, in order.

        Returns
        -------
        Start
            This start, or one whose numbers are in the order of the components.

        Raises
        ------
        InvalidKeyError
            For a component that the state does not have.
        """
        return self

    def prior_type(self, sensor: Sensors) -> type[Distribution]:
        """Return the class of `prior`, which filters may ask for more than moments.

        Parameters
        ----------
        sensor : Sensors
            Sensor, or all sensors as one.

        Returns
        -------
        type of Distribution
            Class of the result of `prior`. By default it is normal.
        """
        return Gaussian

    def check(self, components: tuple[str, ...], sensor: Sensors) -> None:
        """Raise InvalidKeyError if this start cannot be used with these components and sensors.

        Parameters
        ----------
        components : tuple of str
            Names of the state's components, in order.
        sensor : Sensors
            Sensor, or all sensors as one.

        Raises
        ------
        InvalidKeyError
            For a start that does not fit them. By default each start fits.
        """

    def truth(self, nominal: Array, rng: Streams) -> Array:
        """Return the true first state (n_x, M) of a driven target, given the configured one (n_x, M).

        Parameters
        ----------
        nominal : array (n_x, M)
            State that the target's keys give, equal in all runs.
        rng : Streams
            Random numbers, a stream per run.

        Returns
        -------
        array (n_x, M)
            True states at the first step. By default they are the configured ones.
        """
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

        Raises
        ------
        NotImplementedError
            By default, as for a start whose prior is not normal.
        """
        raise NotImplementedError


class FixedStart(Start):
    """Base of the starts with one prior for every run, which a filter may also assume for itself."""

    draws_truth: ClassVar[bool] = True
    """True if the first state of a driven target is drawn from it"""

    @abstractmethod
    def distribution(self, runs: int) -> Distribution:
        """Return the prior (n, M).

        Parameters
        ----------
        runs : int
            Number M of runs.

        Returns
        -------
        Distribution
            Prior with mean (n, M), and a covariance (n, n) or (n, n, M). It is the same in all runs.
        """

    def on_one_turn(self, angles: Sequence[int]) -> Self:
        """Return the start with the angles in these rows of the state on one turn.

        Only a start of several parts may have them on several turns.

        Parameters
        ----------
        angles : sequence of int
            Rows of the state that are angles, rad.

        Returns
        -------
        FixedStart
            This start, or one whose parts lie within half a turn of each other.
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
    """Return the state repeated for every run.

    Parameters
    ----------
    state : array (n,)
        State.
    runs : int
        Number M of runs.

    Returns
    -------
    array (n, M)
        The state in each column.
    """
    return np.tile(state[:, None], runs)
