"""Base of targets: fly a path and measure it; the steps and times at which that is done."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Index, Mask, fixed, settled_row
from trackbench.core.random_streams import RunStreams, Streams
from trackbench.extension_points import Part
from trackbench.field_types import MOST_STEPS, Finite, InvalidKeyError
from trackbench.metrics import in_window
from trackbench.models.base import Motion, SampledMotion, position_velocity_names
from trackbench.models.motions.irregular import Irregular
from trackbench.models.motions.turn import CoordinatedTurn
from trackbench.models.sensors.base import Sensors
from trackbench.scenarios.starts.base import Start

_HALF_TURN = 180.0  # deg
STRAY = 10.0
"""Error beyond which a track has strayed, in standard deviations of a measured position."""


class Timeline(NamedTuple):
    """Numbers k (K,) of the scans from the first on, their times (K,), s, and the time between, s.

    Of recorded data that time may differ from step to step (``equal``), and is the first one then; the
    time between the two scans of a start is another, ``apart``, perhaps each run's own (M,), s.
    """

    steps: Index
    times: Array
    T: float
    equal: bool = True
    apart: Array | float | None = None

    def sampled(self, motion: Motion, axes: int) -> SampledMotion:
        """Return a motion from step to step; raises InvalidKeyError."""
        if self.equal:
            return motion.sampled(self.T, axes)
        if motion.uses_time:
            what = "the motion depends on the time t = k T, and these steps are not equal"
            raise InvalidKeyError(what, "assume")
        return Irregular(motion, axes, int(self.steps[1]), fixed(np.diff(self.times)))

    def between_scans(self, rng: Streams) -> Array | float:
        """Return the time between the two scans of a start, s, of each run (M,) if they differ."""
        apart = self.T if self.apart is None else self.apart
        return recorded_columns(apart, rng) if isinstance(apart, np.ndarray) else apart


class Flight(NamedTuple):
    """Truth (n_x, K, M) at every step, and measurements (n_z, K or K - 1, M).

    ``arrival`` (S, K or K - 1, M) are steps from 0 at which measurements of S sensors were received, if
    they were recorded.
    """

    truth: Array
    measurements: Array
    arrival: Array | None = None


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
        """(px, vx, py, vy[, pz, vz])."""
        z = () if self.z is None else (self.z, self.vz)
        return np.array([self.x, self.vx, self.y, self.vy, *z])


def turn_caution(what: str, rate_deg_s: float, times: Array) -> str:
    """Write the note on a turn by more than half a turn between two steps; empty without one."""
    longest = float(np.diff(times).max(initial=0.0))
    angle = abs(rate_deg_s) * longest
    if angle <= _HALF_TURN:
        return ""
    return (
        f"{what} turns by {angle:g} deg between two steps, {longest:g} s apart: "
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
        return () if self.own_motion is None else self.own_motion.known_angles

    def cautions(self, timeline: Timeline) -> list[str]:
        """Return notes on legal but unexpected keys."""
        motion = self.own_motion
        times = timeline.times
        if isinstance(motion, CoordinatedTurn):
            what = turn_caution("the motion", motion.turn_rate_deg_s, times)
            return [what] if what else []
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
    def longest_delay(self) -> int:
        """Number of steps after which the last recorded measurement was received."""
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
        """Return the clock of recorded data; steps without times are T seconds apart.

        Raises DataError with the mistakes of the data, InvalidKeyError for what does not go with them.
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
        """Return the truth from ``start`` (n_x, M) on, and its measurements from the second step on.

        With ``scans``, of which a start is made, from the first on, and so many without a miss.
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
        """Return further numbers per run (M,) by name, from the series (K, M)."""
        return {}


class Scored(NamedTuple):
    """Times (K,), s, windows (K,) by name, and what one measurement leaves of the position, m."""

    times: Array
    windows: Mapping[str, Mask]
    sigma: float

    def of_peaks(self, peaks: Mapping[str, Array]) -> dict[str, Array]:
        """Return ``peak_position``, m, (M,) in each window, and ``beyond_10_sigma`` (M,)."""
        out = {in_window("peak_position", name): peak for name, peak in peaks.items()}
        # 1 beyond the limit, 0 within; NaN if the peak is NaN.
        strayed = (peaks[""] > STRAY * self.sigma).astype(float)
        return out | {"beyond_10_sigma": np.where(np.isnan(peaks[""]), np.nan, strayed)}

    def settling(
        self, error: Array, limit: float, stretches: Mapping[str, tuple[float, float]]
    ) -> dict[str, Array]:
        """Measure ``settling_s`` and ``not_settled`` (M,) by errors (K, M), in each stretch of time.

        A run has settled at the first scored step from which on the error is at most ``limit`` up to the
        stretch's end. Its time, s, counts from the stretch's beginning; NaN if it has not settled, or
        without an error.
        """
        out: dict[str, Array] = {}
        for name, (begin, end) in stretches.items():
            after = self.windows[""] & (self.times >= begin) & (self.times <= end)
            if not after.any():
                continue  # shorter than the sampling time
            number = settled_row(error[after] > limit)
            seconds = np.append(self.times[after] - begin, np.nan)[number]
            late = (number == after.sum()).astype(float)
            unknown = np.isnan(error[after]).any(axis=0)
            out[in_window("settling_s", name)] = np.where(unknown, np.nan, seconds)
            out[in_window("not_settled", name)] = np.where(unknown, np.nan, late)
        return out


def measured_along(
    truth: Array, timeline: Timeline, sensor: Sensors, rng: Streams, scans: int, runs: int
) -> Flight:
    """Return a path (n, K, M), or (n, K, 1) for all runs, and its noisy measurements."""
    # The first step is measured only if the start needs its scan.
    first = 0 if scans else 1
    steps = timeline.steps.tolist()[first:]
    noise = rng.standard_normal((len(sensor.components), len(steps), runs))
    measurements = [
        sensor.measure(truth[:, i], k, noise[:, i - first], rng, certain=i < scans)
        for i, k in enumerate(steps, first)
    ]
    return Flight(np.broadcast_to(truth, (*truth.shape[:2], runs)), np.stack(measurements, axis=1))


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
        """Return the path, and measurements whose noise is drawn in one go."""
        path = self.path(timeline)[..., None]
        return measured_along(path, timeline, sensor, rng, scans, start.shape[1])

    def run_metrics(self, values: Mapping[str, Array], scored: Scored) -> dict[str, Array]:
        """Return ``peak_position``, the largest error in a window, m, and ``beyond_10_sigma``.

        Beyond ten standard deviations of a measurement none would be taken for the track's any more.
        """
        squared = values["squared_position"]
        peaks = {n: np.sqrt(squared[m].max(axis=0)) for n, m in scored.windows.items()}
        return scored.of_peaks(peaks)


class Schedule(NamedTuple):
    """Numbers of the first and the last step and the first one's time, s, as the keys have them.

    ``skipped`` steps come before that of the first state.
    """

    first: int
    last: int | None
    begin: float | None
    skipped: int

    def check(self, recorded: Timeline | None) -> None:
        """Raise InvalidKeyError if there is no step, or are too many, of these or the target's own."""
        if recorded is not None:
            # Recorded data number the steps: only the last one can be chosen.
            if self.first:
                raise InvalidKeyError("the recorded data say it", "first")
            steps = recorded.steps[self.skipped + 1 :]
            if self.last is not None and not steps[0] <= self.last <= steps[-1]:
                what = f"what is recorded is measured in steps {steps[0]} to {steps[-1]}"
                raise InvalidKeyError(what, "last")
            taken = len(self.of_recorded(recorded).steps) - self.skipped
            if taken > MOST_STEPS:
                latest = int(recorded.steps[self.skipped + MOST_STEPS - 1])
                what = f"the recording gives {taken} steps, more than {MOST_STEPS}"
                way = f"say `last: {latest}`, choose runs, or a longer `resample`"
                raise InvalidKeyError(f"{what}: {way}")
            return
        # Otherwise the keys must give a step after the start's scans, and not too many.
        if self.last is None:
            raise InvalidKeyError("`last` is required: the target has no steps of its own")
        if self.last - self.first > MOST_STEPS:
            raise InvalidKeyError(f"more than {MOST_STEPS} steps", "last")
        begun = self.first + self.skipped
        if self.last <= begun:
            what = f"{self.last} leaves no step to measure after step {begun}"
            raise InvalidKeyError(what, "last")

    def regular(self, T: float) -> Timeline:
        """Return every step, T s apart."""
        assert self.last is not None
        steps = np.arange(self.first, self.last + 1)
        return Timeline(steps, np.asarray((steps - self.first) * T + (self.begin or 0.0)), T)

    def of_recorded(self, recorded: Timeline) -> Timeline:
        """Return the recorded steps up to the key `last`, shifted to start at the key `begin`."""
        if self.last is not None:
            end = int(np.searchsorted(recorded.steps, self.last, side="right"))
            recorded = recorded._replace(steps=recorded.steps[:end], times=recorded.times[:end])
        # Shift all times so that the first one is `begin`.
        shift = 0.0 if self.begin is None else self.begin - recorded.times[0]
        return recorded._replace(times=recorded.times + shift) if shift else recorded


def recorded_columns(values: Array, rng: Streams) -> Array:
    """Return the columns (..., M) of these streams' runs, NaN for runs without a recording.

    Training runs, -1 and so on, are the last ones: run -1 is the last of all.
    """
    assert isinstance(rng, RunStreams)
    out = np.full((*values.shape[:-1], len(rng.runs)), np.nan)
    # Recordings with these numbers; a negative number counts from the last.
    existing = [m for m in rng.runs if -values.shape[-1] <= m < values.shape[-1]]
    out[..., : len(existing)] = values[..., existing]
    return out
