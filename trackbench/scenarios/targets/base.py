"""Base of targets: fly a path and measure it."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trackbench.component_parts import Part
from trackbench.core.arrays import Array, Mask
from trackbench.core.random_streams import Streams
from trackbench.models.base import Motion
from trackbench.models.component_names import position_velocity_names
from trackbench.models.delays import shortest_delay
from trackbench.models.motions.coordinated_turn import CoordinatedTurn
from trackbench.models.sensors.stacked import Sensors, sensors_of
from trackbench.scenarios.starts.base import Start
from trackbench.scenarios.targets.large_turns import turn_caution
from trackbench.scenarios.targets.peak_errors import Scored
from trackbench.scenarios.targets.timeline import Timeline


class Flight(NamedTuple):
    """Truth and measurements of M runs of K steps."""

    truth: Array
    """states (n_x, K, M) at every step"""
    measurements: Array
    """measurements (n_z, K, M); (n_z, K - 1, M) if the first step is not measured"""
    arrival: Array | None = None
    """steps at which measurements of S sensors were received (S, T, M), if recorded; T is the number of
    measurements after the first state, which is that of the start's last scan, and steps count from 0 at
    the first of these measurements"""


class Target(Part):
    """A frozen dataclass that flies, the same path in every run or another, and is measured."""

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the truth's components, in order."""
        return position_velocity_names(self.axes)

    @property
    def known_angles(self) -> tuple[str, ...]:
        """Names of components that are angles, as far as the target's own keys say so."""
        if self.own_motion is None:
            return ()
        return self.own_motion.known_angles

    def cautions(self, timeline: Timeline) -> list[str]:
        """Return notes on legal but unexpected keys, such as a turn rate that may be in rad/s.

        Parameters
        ----------
        timeline : Timeline
            The K steps, those that the start uses up included.

        Returns
        -------
        list of str
            Notes, which trackbench prints.
        """
        motion = self.own_motion
        if isinstance(motion, CoordinatedTurn):
            caution = turn_caution("the motion", motion.turn_rate_deg_s, timeline.times)
            if caution:
                return [caution]
        return []

    def with_angles(self, angles: tuple[str, ...]) -> "Target":
        """Return the target whose truth has these angles; only a recorded one depends on them.

        Parameters
        ----------
        angles : tuple of str
            Names of the truth's components that are angles, rad.

        Returns
        -------
        Target
            This target, or one whose recorded truth is interpolated with these angles.
        """
        return self

    @property
    def has_position_and_velocity(self) -> bool:
        """True if its state is position and velocity along each axis, and nothing else."""
        return self.components in map(position_velocity_names, (1, 2, 3))

    @property
    @abstractmethod
    def axes(self) -> int:
        """Number of axes of the space in which the target moves."""

    @property
    def own_motion(self) -> Motion | None:
        """Motion that drives the target, the filters' default model; None without one."""
        return None

    @property
    def diffusion(self) -> float:
        """Spectral density of its white acceleration, m^2/s^3, if it has one."""
        return 0.0

    @property
    def has_truth(self) -> bool:
        """True if the true path is known."""
        return True

    @property
    def recorded_truth(self) -> Array | None:
        """Recorded true states (n_x, K, M) at all steps, NaN where unknown; None without a recording."""
        return None

    @property
    def run_names(self) -> tuple[str, ...]:
        """Names of the recorded runs; empty of simulated ones."""
        return ()

    @property
    def longest_delay(self) -> int:
        """Largest number of steps by which a recorded measurement was received late."""
        return 0

    def shortest_delays(self, sensor: Sensors) -> list[int]:
        """Return the steps by which all measurements of each of S sensors are late at least.

        Parameters
        ----------
        sensor : Sensors
            Sensor, or all sensors as one.

        Returns
        -------
        list of int (S,)
            Number of steps for each sensor, in the sensors' order.
        """
        return [shortest_delay(each.delay) for each in sensors_of(sensor)]

    @property
    def recorded_runs(self) -> int | None:
        """Number of recorded runs; None for simulated targets."""
        return None

    @property
    def notices(self) -> tuple[str, ...]:
        """Notes on properties of the data that are legal and unexpected."""
        return ()

    def own_timeline(self, sensor: Sensors, start: Start, T: float) -> Timeline | None:
        """Return the steps and times of recorded data; None for a simulated target.

        Parameters
        ----------
        sensor : Sensors
            Sensor, or all sensors as one.
        start : Start
            Start, which may use up scans.
        T : float
            Time between steps, s, of data without times.

        Returns
        -------
        Timeline or None
            The recorded steps, those that the start uses up included. None, the default, for a target
            whose steps the config has.

        Raises
        ------
        DataError
            With the mistakes of the data.
        InvalidKeyError
            For a sensor or start that does not go with recorded data.
        """
        return None

    @property
    def why_no_bound(self) -> str | None:
        """Reason why a bound along its path is invalid; None if it is valid."""
        return None

    @abstractmethod
    def start(self, timeline: Timeline) -> Array:
        """Return the state (n_x,) at the first scan, as far as it is not drawn.

        Parameters
        ----------
        timeline : Timeline
            The K steps, those that the start uses up included.

        Returns
        -------
        array (n_x,)
            State at the first step. Zeros if a start draws it, NaN if nothing is known about it.
        """

    @abstractmethod
    def path(self, timeline: Timeline) -> Array:
        """Return states (n_x, K) without process noise, along which a bound is computed.

        Parameters
        ----------
        timeline : Timeline
            The K steps, those that the start uses up included.

        Returns
        -------
        array (n_x, K)
            State at each step. A recorded target has the first run's truth, NaN where it is unknown.
        """

    @abstractmethod
    def fly(
        self, start: Array, timeline: Timeline, sensor: Sensors, rng: Streams, scans: int
    ) -> Flight:
        """Fly the path and measure it.

        Parameters
        ----------
        start : Array (n_x, M)
            True first states.
        timeline : Timeline
            The K steps.
        sensor : Sensors
            Sensor, or all sensors as one.
        rng : Streams
            Random numbers, a stream per run.
        scans : int
            Number of scans that the start uses up. They are measured without a miss. Without any the
            first step is not measured.

        Returns
        -------
        Flight
            Truth (n_x, K, M), and measurements (n_z, K, M), or (n_z, K - 1, M) without scans.
        """

    def check(self, timeline: Timeline) -> None:
        """Raise InvalidKeyError if it does not fit the time there is.

        Parameters
        ----------
        timeline : Timeline
            The K steps, those that the start uses up included.

        Raises
        ------
        InvalidKeyError
            For a key that does not fit the times, such as a turn after the end.
        DataError
            For a file that does not cover them.
        """

    def windows(self, times: Array, scored: Mask) -> dict[str, Mask]:
        """Select stretches (K,) of the target's own, by name, from the times (K,) that are scored.

        Parameters
        ----------
        times : array (K,)
            Times of the steps from the first state's on, s.
        scored : array of bool (K,)
            True for the steps that are scored.

        Returns
        -------
        dict of array of bool (K,)
            Scored steps of each window, by its name. A window without a step is left out of the metrics.
        """
        return {}

    @property
    def spans(self) -> list[tuple[float, float]]:
        """Start and end times of stretches that a figure over time shades, s."""
        return []

    @property
    def turns(self) -> tuple[float, ...]:
        """Sizes of the accelerations of its turns, m/s^2."""
        return ()

    def run_metrics(self, values: Mapping[str, Array], scored: "Scored") -> dict[str, Array]:
        """Compute further metrics of each run.

        Parameters
        ----------
        values : Mapping[str, Array]
            Series (K, M) by name, such as ``squared_position``.
        scored : Scored
            Times and windows that are scored.

        Returns
        -------
        dict[str, Array]
            Number per run (M,) by the metric's name.
        """
        return {}


def measured_along(
    truth: Array, timeline: Timeline, sensor: Sensors, rng: Streams, scans: int, runs: int
) -> Flight:
    """Return the path of every run, and measurements that are drawn along it.

    Parameters
    ----------
    truth : array (n_x, K, M) or (n_x, K, 1)
        Path of each run, or one that all runs have. NaN stands for a target that is gone.
    timeline : Timeline
        The K steps.
    sensor : Sensors
        Sensor, or all sensors as one.
    rng : Streams
        Random numbers, a stream per run.
    scans : int
        Number of scans that the start uses up, of which none is missing.
    runs : int
        Number M of runs.

    Returns
    -------
    Flight
        Truth (n_x, K, M), which is read-only, and measurements (n_z, K, M). Without scans the first step
        has no measurement: (n_z, K - 1, M).
    """
    # The first step is measured only if the start needs its scan.
    first = 0 if scans else 1
    steps = timeline.steps.tolist()[first:]
    noise = rng.standard_normal((len(sensor.components), len(steps), runs))
    measurements = []
    for i, k in enumerate(steps, first):
        # None of the start's scans is missing.
        z = sensor.measure(truth[:, i], k, noise[:, i - first], rng, certain=i < scans)
        measurements.append(z)
    n, K, _ = truth.shape
    return Flight(
        truth=np.broadcast_to(truth, (n, K, runs)), measurements=np.stack(measurements, axis=1)
    )


@dataclass(frozen=True, kw_only=True)
class Flown(Target):
    """Base of the targets with a path of their own."""

    def states(self, times: Array) -> Array:
        """Return exact states (n_x, K) at these times, s.

        Parameters
        ----------
        times : array (K,)
            Any times, s, also a single one.

        Returns
        -------
        array (n_x, K)
            Position and velocity along each axis, one after the other, m and m/s.
        """
        raise NotImplementedError

    def start(self, timeline: Timeline) -> Array:
        """Return the state (n_x,) at the first scan."""
        return self.states(timeline.times[:1])[:, 0]

    def path(self, timeline: Timeline) -> Array:
        """Return states (n_x, K)."""
        return self.states(timeline.times)

    def fly(
        self, start: Array, timeline: Timeline, sensor: Sensors, rng: Streams, scans: int
    ) -> Flight:
        """Return the path, which is the same in every run, and simulated measurements of it.

        Of ``start`` (n_x, M) only the number M of runs is used. The start uses up ``scans`` scans.
        """
        path = self.path(timeline)[..., None]
        return measured_along(path, timeline, sensor, rng, scans, start.shape[1])

    def run_metrics(self, values: Mapping[str, Array], scored: Scored) -> dict[str, Array]:
        """Return each run's largest position error in each window, m, and ``beyond_10_sigma`` (M,).

        The first is ``peak_position``. The second is 1 for an error of more than 10 standard deviations
        of a measured position, with which no measurement would be assigned to the track any more.
        """
        squared = values["squared_position"]
        peaks = {name: np.sqrt(squared[mask].max(axis=0)) for name, mask in scored.windows.items()}
        return scored.peak_metrics(peaks)
