"""Base of targets: fly a path and measure it; the steps and times at which that is done."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trackbench.component_parts import Part
from trackbench.core.arrays import Array, Index, Mask
from trackbench.core.random_streams import RunStreams, Streams
from trackbench.core.read_only import fixed
from trackbench.field_types import MOST_STEPS, Finite, InvalidKeyError
from trackbench.metrics import in_window
from trackbench.models.base import Motion, SampledMotion
from trackbench.models.component_names import position_velocity_names
from trackbench.models.inputs import KnownInputs, inputs_in_equations
from trackbench.models.motions.coordinated_turn import CoordinatedTurn
from trackbench.models.motions.sampling_interval import sample_equally
from trackbench.models.motions.unequal_intervals import Irregular
from trackbench.models.sensors.stacked import Sensors
from trackbench.scenarios.settling_time import settled_row
from trackbench.scenarios.starts.base import Start

_HALF_TURN = 180.0  # deg
STRAY = 10.0
"""Error beyond which a track has strayed, in standard deviations of a measured position."""


class Timeline(NamedTuple):
    """Steps of a scenario, those that a start uses up included."""

    steps: Index
    """numbers k (K,) of the steps"""
    times: Array
    """times (K,), s"""
    T: float
    """time between two steps, s; that of the first two if the steps are not equal"""
    equal: bool = True
    """True if all steps are equally far apart, as those of simulated data"""
    apart: Array | float | None = None
    """time between the two scans of a start, s; (M,) if it differs from run to run; None: T"""
    inputs: KnownInputs | None = None
    """recorded inputs of motions, if there are any"""

    def sampled(self, motion: Motion, axes: int) -> SampledMotion:
        """Return a motion along ``axes`` axes from step to step, over the intervals between these steps.

        Raises InvalidKeyError for a motion that needs steps of equal length, or inputs that are not
        recorded.
        """
        if self.equal:
            return sample_equally(motion, self.T, axes, self.inputs)
        if motion.uses_time:
            message = "the motion depends on the time t = k T, and these steps are not equal"
            raise InvalidKeyError(message, "assume")
        # Check the inputs here, where a mistake is reported with its key.
        inputs_in_equations(motion, self.inputs)
        intervals = fixed(np.diff(self.times))
        return Irregular(
            motion=motion,
            axes=axes,
            first=int(self.steps[1]),
            intervals=intervals,
            recorded_inputs=self.inputs,
        )

    def between_scans(self, rng: Streams) -> Array | float:
        """Return the time between the two scans of a start, s.

        If recorded runs differ in it, the result (M,) has the time of each of the M runs of ``rng``.
        """
        if self.apart is None:
            return self.T
        if isinstance(self.apart, np.ndarray):
            return recorded_columns(self.apart, rng)
        return self.apart


class Flight(NamedTuple):
    """Truth and measurements of M runs of K steps."""

    truth: Array
    """states (n_x, K, M) at every step"""
    measurements: Array
    """measurements (n_z, K, M); (n_z, K - 1, M) if the first step is not measured"""
    arrival: Array | None = None
    """steps from 0 at which measurements of S sensors were received (S, K or K - 1, M), if recorded"""


@dataclass(frozen=True, kw_only=True)
class Launch:
    """Position and velocity at the first scan: of a planar target, unless z is given."""

    x: Finite = 0.0
    """m; of a scalar target its state"""
    y: Finite = 0.0
    """m"""
    z: Finite | None = None
    """height, m; default: the target moves in the plane"""
    vx: Finite = 0.0
    """m/s"""
    vy: Finite = 0.0
    """m/s"""
    vz: Finite = 0.0
    """m/s"""

    @property
    def axes(self) -> int:
        """Axes of the space the target moves in."""
        return 2 if self.z is None else 3

    @property
    def state(self) -> Array:
        """State (px, vx, py, vy[, pz, vz]), m and m/s."""
        state = [self.x, self.vx, self.y, self.vy]
        if self.z is not None:
            state += [self.z, self.vz]
        return np.array(state)


def turn_caution(subject: str, rate_deg_s: float, times: Array) -> str:
    """Write the note on a turn by more than half a turn between two steps; empty without one.

    ``subject`` is what turns, such as ``leg 1``.
    """
    longest = float(np.diff(times).max(initial=0.0))
    angle = abs(rate_deg_s) * longest
    if angle <= _HALF_TURN:
        return ""
    return (
        f"{subject} turns by {angle:g} deg between two steps, {longest:g} s apart: "
        "a turn rate is in degrees per second"
    )


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
        """Return notes on legal but unexpected keys, such as a turn rate that may be in rad/s."""
        motion = self.own_motion
        if isinstance(motion, CoordinatedTurn):
            caution = turn_caution("the motion", motion.turn_rate_deg_s, timeline.times)
            if caution:
                return [caution]
        return []

    def with_angles(self, angles: tuple[str, ...]) -> "Target":
        """Return the target whose truth has these angles; only a recorded one depends on them."""
        return self

    @property
    def is_moving(self) -> bool:
        """True if its state is position and velocity along each axis."""
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

        Steps without times are T seconds apart. Raises DataError with the mistakes of the data, and
        InvalidKeyError for a sensor or start that does not go with recorded data.
        """
        return None

    @property
    def why_no_bound(self) -> str | None:
        """Reason why a bound along its path is invalid; None if it is valid."""
        return None

    @abstractmethod
    def start(self, timeline: Timeline) -> Array:
        """Return the state (n_x,) at the first scan, as far as it is not drawn."""

    @abstractmethod
    def path(self, timeline: Timeline) -> Array:
        """Return states (n_x, K) without process noise, along which a bound is computed."""

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
        """Raise InvalidKeyError if it does not fit the time there is."""

    def windows(self, times: Array, scored: Mask) -> dict[str, Mask]:
        """Select stretches (K,) of the target's own, by name, from the times (K,) that are scored."""
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


class Scored(NamedTuple):
    """Times and windows over which errors are measured."""

    times: Array
    """times (K,), s"""
    windows: Mapping[str, Mask]
    """steps (K,) of each window, by name; ``""`` is all that is scored"""
    sigma: float
    """standard deviation of a position by one measurement, m"""

    def peak_metrics(self, peaks: Mapping[str, Array]) -> dict[str, Array]:
        """Return ``peak_position``, m, (M,) in each window, and ``beyond_10_sigma`` (M,).

        ``peaks`` (M,) are each run's largest errors of position, m, by window.
        """
        metrics = {in_window("peak_position", name): peak for name, peak in peaks.items()}
        # 1 beyond the limit, 0 within; NaN if the peak is NaN. The window "" is all scored steps.
        whole_peak = peaks[""]
        is_beyond = (whole_peak > STRAY * self.sigma).astype(float)
        metrics["beyond_10_sigma"] = np.where(np.isnan(whole_peak), np.nan, is_beyond)
        return metrics

    def settling(
        self, error: Array, limit: float, stretches: Mapping[str, tuple[float, float]]
    ) -> dict[str, Array]:
        """Measure ``settling_s`` and ``not_settled`` (M,) by errors (K, M), in each stretch of time.

        A run has settled at the first scored step from which on the error is at most ``limit`` up to the
        stretch's end. Its time, s, counts from the stretch's beginning; NaN if it has not settled, or
        without an error. ``stretches`` have their begin and end, s, by name.
        """
        metrics: dict[str, Array] = {}
        for name, (begin, end) in stretches.items():
            after = self.windows[""] & (self.times >= begin) & (self.times <= end)
            if not after.any():
                continue  # shorter than the sampling time
            # First row from which on the error is within the limit; one after the last row if none is.
            row = settled_row(error[after] > limit)
            seconds = np.append(self.times[after] - begin, np.nan)[row]
            not_settled = (row == after.sum()).astype(float)
            unknown = np.isnan(error[after]).any(axis=0)
            metrics[in_window("settling_s", name)] = np.where(unknown, np.nan, seconds)
            metrics[in_window("not_settled", name)] = np.where(unknown, np.nan, not_settled)
        return metrics


def measured_along(
    truth: Array, timeline: Timeline, sensor: Sensors, rng: Streams, scans: int, runs: int
) -> Flight:
    """Return a path (n, K, M), or (n, K, 1) for all runs, and its noisy measurements.

    ``scans`` is the number of scans that the start uses up, ``runs`` the number M of runs.
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
        """Return exact states (n_x, K) at these times, s."""
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


class Schedule(NamedTuple):
    """Steps of a run as the keys of the config have them."""

    first: int
    """number of the first step"""
    last: int | None
    """number of the last step, if the config has it"""
    begin: float | None
    """time of the first step, s, if the config has it"""
    skipped: int
    """number of steps before that of the first state"""

    def check(self, recorded: Timeline | None) -> None:
        """Raise InvalidKeyError if the keys, or the ``recorded`` steps, leave no step or too many."""
        if recorded is not None:
            self._check_recorded(recorded)
            return
        # The keys must give a step after the start's scans, and not too many.
        if self.last is None:
            raise InvalidKeyError("`last` is required: the target has no steps of its own")
        if self.last - self.first > MOST_STEPS:
            raise InvalidKeyError(f"more than {MOST_STEPS} steps", "last")
        begun = self.first + self.skipped
        if self.last <= begun:
            message = f"{self.last} leaves no step to measure after step {begun}"
            raise InvalidKeyError(message, "last")

    def _check_recorded(self, recorded: Timeline) -> None:
        """Raise InvalidKeyError for keys that do not fit the recorded steps, or leave too many."""
        # Recorded data number the steps: only the last one can be chosen.
        if self.first:
            raise InvalidKeyError("the recorded data say it", "first")
        # The step of the first state is not measured, or the start uses up its scan. `skipped` is the
        # number of steps before it, whose scans the start uses up, too.
        measured = recorded.steps[self.skipped + 1 :]
        if not len(measured):
            raise InvalidKeyError("the recording has no step after those that the start uses up")
        if self.last is not None and not measured[0] <= self.last <= measured[-1]:
            message = f"what is recorded is measured in steps {measured[0]} to {measured[-1]}"
            raise InvalidKeyError(message, "last")
        taken = len(self.cut_and_shift(recorded).steps) - self.skipped
        if taken > MOST_STEPS:
            latest = int(recorded.steps[self.skipped + MOST_STEPS - 1])
            message = f"the recording gives {taken} steps, more than {MOST_STEPS}"
            way = f"say `last: {latest}`, choose runs, or a longer `resample`"
            raise InvalidKeyError(f"{message}: {way}")

    def simulated_timeline(self, T: float) -> Timeline:
        """Return every step, T s apart."""
        assert self.last is not None
        steps = np.arange(self.first, self.last + 1)
        times = np.asarray((steps - self.first) * T + (self.begin or 0.0))
        return Timeline(steps=steps, times=times, T=T)

    def cut_and_shift(self, recorded: Timeline) -> Timeline:
        """Return the recorded steps up to the key `last`, shifted to start at the key `begin`."""
        if self.last is not None:
            end = int(np.searchsorted(recorded.steps, self.last, side="right"))
            recorded = recorded._replace(steps=recorded.steps[:end], times=recorded.times[:end])
        if self.begin is None or self.begin == recorded.times[0]:
            return recorded
        # Shift all times so that the first one is `begin`.
        shift = self.begin - recorded.times[0]
        return recorded._replace(times=recorded.times + shift)


def recorded_columns(values: Array, rng: Streams) -> Array:
    """Return the columns (..., M) of the M runs of ``rng``, NaN for runs without a recording.

    ``values`` (..., R) have a column for each of R recorded runs. Run m is recording m. Training runs
    have the numbers -1, -2, ...: run -1 is the last recording.
    """
    assert isinstance(rng, RunStreams)
    columns = np.full((*values.shape[:-1], len(rng.runs)), np.nan)
    # A negative index counts from the last recording.
    recordings = values.shape[-1]
    existing = [m for m in rng.runs if -recordings <= m < recordings]
    # The numbers in ``rng`` count away from zero, so runs without a recording come last.
    columns[..., : len(existing)] = values[..., existing]
    return columns
