"""A target of which measurements were recorded, and perhaps the truth: nothing of it is simulated."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.random_streams import Streams
from trackbench.field_types import DataFile, InvalidKeyError, Positive
from trackbench.models.base import position_velocity_names
from trackbench.models.priors import TwoPoint
from trackbench.models.sensors.base import SensorBase, Sensors, rows_of, sensors_of
from trackbench.registry import register
from trackbench.scenarios.recordings.column_mapping import Naming, plain_name
from trackbench.scenarios.recordings.row_order import in_order
from trackbench.scenarios.recordings.rows import (
    TICK,
    FromFiles,
    Gathered,
    check_turns,
    chosen_runs,
    read_rows,
)
from trackbench.scenarios.recordings.time_alignment import (
    ONE_RUN,
    Clock,
    check_runs_of_truth,
    common_clock,
    initial_scans,
    measurement_array,
    truth_at,
    with_scans,
)
from trackbench.scenarios.recordings.truth_check import contradictions
from trackbench.scenarios.starts.base import Start, position_part
from trackbench.scenarios.targets.base import Flight, Scored, Target, Timeline, recorded_columns


class Recording(NamedTuple):
    """M runs on one clock: scans (n_z, s, M) that the start uses up, what is seen (n_z, K, M) after.

    ``apart`` (M,) is the time between the last two of those scans, s; the truth (n_x, K + 1, M).
    ``arrivals`` (S, K, M) are steps at which measurements of S sensors were received, if that is known.
    """

    clock: Clock
    scans: Array
    apart: Array
    measurements: Array
    truth: Array | None
    notices: tuple[str, ...]
    arrivals: Array | None


def _angles(sensor: SensorBase) -> dict[str, int]:
    """Return the number of each component whose differences wrap, by its name."""
    two_turns = np.full((len(sensor.components), 1), 4.0 * np.pi)
    wraps = sensor.innovation(two_turns, np.zeros_like(two_turns))[:, 0] < 1.0
    return {name: i for i, name in enumerate(sensor.components) if wraps[i]}


@register("targets", "measured")
@dataclass(frozen=True, kw_only=True, eq=False)
class Measured(FromFiles, Naming, Target):
    """Recorded measurements, by which filters start and are judged; nothing is simulated.

    Tables have a column ``time`` (seconds, or ISO 8601) or ``step``, one for each of the sensor's
    components, and perhaps ``run``; of several sensors a file each, or a column ``sensor``.
    Steps are the times at which anything was measured, and motions are given the true time between them;
    a start from scans takes the first of each run. A cell that is empty is a missing measurement. A
    column ``received`` has the time at which a filter gets the row.
    """

    measurements: DataFile | tuple[DataFile, ...]
    """CSV or Parquet, or a list, a file for each sensor; a pattern (data/*.csv) has a file per run"""
    truth: DataFile | None = None
    """CSV or Parquet of the state, at times of its own: px, py (or x, y), and perhaps velocities"""
    truth_gap: Positive | None = None
    """longest time between two rows of the truth, s (or steps), within which it is interpolated on a
    straight line; default: it counts at its own times only"""
    truth_naming: Naming | None = None
    """columns and units of the truth; default: as of the measurements, but for their `format`"""
    runs: tuple[str | int, ...] = ()
    """names of the runs that are taken, in this order; default: all"""
    sensors: tuple[str | int, ...] = ()
    """names in the column `sensor`, in the order of the scenario's sensors; default: 1, 2, ..."""
    resample: Positive | None = None
    """seconds between steps, for filters that need equal ones: a measurement counts at the nearest"""
    axes: Literal[0, 1, 2, 3] = 2
    """axes of the space it moves in; 0: its state is one number, x"""
    state: tuple[str, ...] = ()
    """names of the components of another state, in order, which are also columns of the truth"""
    angles: tuple[str, ...] = ()
    """components that are angles, equal after whole turns: {angles: [heading]}; default: those of the
    motion that filters assume, and those that a sensor measures alone as an angle"""

    def __post_init__(self) -> None:
        super().__post_init__()
        for i, name in enumerate(self.angles):
            if name not in self.components:
                what = f"{name!r} is not one of {', '.join(self.components)}"
                raise InvalidKeyError(what, "angles", i)
        if self.truth is None and (self.truth_gap is not None or self.truth_naming is not None):
            key = "truth_gap" if self.truth_gap is not None else "truth_naming"
            raise InvalidKeyError("there is no truth", key)
        of_truth = self.truth_naming.origin if self.truth_naming is not None else ()
        if self.origin and of_truth not in ((), self.origin):
            what = "is not that of the target, and both count from one point: leave it out"
            raise InvalidKeyError(what, "truth_naming", "origin")

    @property
    def patterns(self) -> tuple[str, ...]:
        """All files, as they are given."""
        return self._measured if self.truth is None else (*self._measured, self.truth)

    @property
    def _measured(self) -> tuple[str, ...]:
        files = self.measurements
        return files if isinstance(files, tuple) else (files,)

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the truth's components, in order."""
        if self.state:
            return self.state
        return position_velocity_names(self.axes) if self.axes else ("x",)

    @property
    def known_angles(self) -> tuple[str, ...]:
        """Names of components that are angles."""
        return self.angles

    def with_angles(self, angles: tuple[str, ...]) -> "Measured":
        """Return the target whose truth is interpolated by these angles."""
        return self if angles == self.angles or self.truth is None else replace(self, angles=angles)

    @property
    def has_truth(self) -> bool:
        """True if there is a file of it."""
        return self.truth is not None

    @property
    def longest_delay(self) -> int:
        """Number of steps after which the last recorded measurement was received."""
        arrivals = self._recording.arrivals
        if arrivals is None:
            return 0
        return int((arrivals - np.arange(arrivals.shape[1])[:, None]).max())

    @property
    def recorded_runs(self) -> int:
        """Number of recorded runs."""
        return self._recording.measurements.shape[-1]

    @property
    def notices(self) -> tuple[str, ...]:
        """Notes on changes to the rows."""
        return self._recording.notices

    @property
    def _recording(self) -> "Recording":
        """Recording read for the scenario's sensor and start."""
        return self.__dict__["_read"][1]

    def own_timeline(self, sensor: Sensors, start: Start, T: float) -> Timeline:
        """Return the steps of the files, those first that the start uses up."""
        self._check(sensor, start)
        requested = (sensor.components, start.scans, T)
        # Read the files again only for another sensor, start or T.
        if self.__dict__.get("_read", (None,))[0] != requested:
            with self.reading():
                object.__setattr__(
                    self, "_read", (requested, self._recorded(sensor, start.scans, T))
                )
        if self.longest_delay and any(one.delay for one in sensors_of(sensor)):
            what = "`delay` and a column `received` exclude each other; leave one out"
            raise InvalidKeyError(what, "sensor")
        clock, apart = self._recording.clock, self._recording.apart
        between = clock.T if clock.T is not None else float(clock.times[1] - clock.times[0])
        # Time between the scans of the start: one number, or one for each run.
        gap = None if start.scans < 2 else float(apart[0]) if np.ptp(apart) <= TICK else apart
        if isinstance(gap, np.ndarray) and issubclass(start.prior_type(sensor), TwoPoint):
            what = "two scans of a radar must be equally far apart in all runs: take one-scan"
            raise InvalidKeyError(what, "start")
        return Timeline(clock.steps, clock.times, between, clock.T is not None, gap)

    def _recorded(self, sensor: Sensors, scans: int, T: float) -> "Recording":
        # Step 1: read the chosen runs' rows of each sensor, in order of time.
        parts = rows_of(sensor)
        origin, path = self.origin, ["target", "origin"]
        if not origin and self.truth_naming is not None and self.truth_naming.origin:
            origin, path = self.truth_naming.origin, ["target", "truth_naming", "origin"]
        in_frame = {name for name in self.components if name in ("x", "y", "z", "px", "py", "pz")}
        in_frame |= self._of_position(sensor)
        components = [sensor.components[part] for part in parts]
        quantities = {plain_name(c) for c in (*self.components, *sensor.components)}
        chosen = [str(name) for name in self.runs]
        gathered = Gathered(
            self,
            origin=origin or None,
            origin_key=tuple(path),
            in_frame=in_frame,
            in_space="z" in quantities,
            chosen=chosen,
        )
        names = [str(name) for name in self.sensors]
        rows = read_rows(gathered, self._measured, components, names=names)
        rows = chosen_runs(gathered, rows, chosen, ("target", "runs"))
        for m, one in enumerate(sensors_of(sensor)):
            check_turns(gathered, rows[m], _angles(one))
            rows[m] = in_order(gathered, rows[m], one.innovation)
        # Step 2: take the first scans from the sensor that measures the position.
        telling = position_part(sensor)
        place = 0 if telling is None else parts.index(telling[1])
        start = initial_scans(gathered, rows[place], scans) if scans else None
        # Step 3: put all runs on one clock, and the measurements on its steps.
        clock = common_clock(gathered, rows, start, T, self.resample)
        resampled = self.resample is not None
        measurements, arrivals = measurement_array(gathered, rows, clock, resampled)
        # Step 4: add the scans of the start and the truth.
        first = np.full((len(sensor.components), scans, len(gathered.runs)), np.nan)
        if start is not None:
            first[parts[place]] = start.scans
        truth = None if self.truth is None else self._truth(gathered, clock)
        if truth is not None:
            later = truth[:, 1:]
            steps = clock.steps[1:]
            gathered.notices += contradictions(sensor, self.components, later, measurements, steps)
        gathered.check_origin(origin, *path)
        gathered.note_distances()
        apart = np.full(len(gathered.runs), np.nan) if start is None else start.apart
        notices = tuple(dict.fromkeys(gathered.notices))
        clock = with_scans(clock, gathered, scans, apart)
        return Recording(clock, first, apart, measurements, truth, notices, arrivals)

    def _of_position(self, sensor: Sensors) -> set[str]:
        """Find the components of the measurement that depend on the position."""
        # Move a state along its axes of positions, and compare.
        away = np.array([name in ("px", "py", "pz") for name in self.components])
        state = 1.0 + np.arange(len(away), dtype=float)[:, None]
        with np.errstate(all="ignore"):
            before, after = (
                sensor.measurement(x, 1).mean for x in (state, state + 7.0 * away[:, None])
            )
        return {
            c for c, same in zip(sensor.components, before == after, strict=True) if not same.all()
        }

    def _check(self, sensor: Sensors, start: Start) -> None:
        """Raise InvalidKeyError for what does not go with sensors and start."""
        every = sensors_of(sensor)
        if start.of_truth:
            what = "recorded data start from their scans, or as `given`: what is true is not known"
            raise InvalidKeyError(what, "start")
        # Errors and gaps that only a simulation adds.
        for one in every:
            if one.bias or one.outliers is not None or one.detection != 1 or one.period != 1:
                what = "bias, outliers, detection and period are of simulated measurements"
                raise InvalidKeyError(what, "sensor")
        # Columns and units must be of known quantities.
        plain = (name.rpartition(".")[2] for name in sensor.components)
        names = tuple(dict.fromkeys((*sensor.components, *plain, *self.components)))
        self.check_names(names, "target")
        if self.truth_naming is not None:
            self.truth_naming.check_names(names, "target", "truth_naming")
        if len(self._measured) not in (1, len(every)):
            what = f"{len(self._measured)} files for {len(every)} sensors"
            raise InvalidKeyError(what, "target", "measurements")
        if len(set(self.sensors)) not in (0, len(every)):
            what = f"names {len(set(self.sensors))} of {len(every)} sensors: give each a name"
            raise InvalidKeyError(what, "target", "sensors")

    def _truth(self, gathered: Gathered, clock: Clock) -> Array:
        """Return the truth (n_x, K + 1, M) at the clock's steps."""
        assert self.truth is not None
        naming = self.truth_naming or replace(self, format=None)
        of_truth = replace(
            gathered,
            naming=naming,
            runs=[],
            files=[],
            notices=[],
            unavailable=Counter(),
            chosen=(*gathered.runs, ONE_RUN),
        )
        (rows,) = read_rows(of_truth, [self.truth], [self.components], least=1)
        (rows,) = chosen_runs(of_truth, [rows], ())
        rows = in_order(of_truth, rows)
        check_runs_of_truth(of_truth, rows, gathered)
        gathered.geodetic, gathered.planar = of_truth.geodetic, of_truth.planar
        gathered.largest_distance = of_truth.largest_distance
        angles = [i for i, name in enumerate(self.components) if name in self.angles]
        truth = truth_at(of_truth, rows, clock, gathered.runs, self.truth_gap, angles)
        gathered.notices += [f"truth: {what}" for what in of_truth.notices]
        return truth

    def start(self, timeline: Timeline) -> Array:
        """Return the position of the first scan, as the true state is unknown."""
        return np.full(len(self.components), np.nan)

    def path(self, timeline: Timeline) -> Array:
        """Return the first run's truth (n_x, K), NaN where there is none."""
        return self._padded()[:, : len(timeline.steps), 0]

    def fly(
        self, start: Array, timeline: Timeline, sensor: Sensors, rng: Streams, scans: int
    ) -> Flight:
        """Return the recorded runs of these numbers; a run beyond the last is empty."""
        recording, steps = self._recording, len(timeline.steps)
        measurements = np.concatenate([recording.scans, recording.measurements], axis=1)
        # The scenario may end before the recording.
        end = measurements.shape[1] - (len(recording.clock.steps) - steps)
        truth = recorded_columns(self._padded()[:, :steps], rng)
        arrival = recording.arrivals
        if arrival is not None:
            arrival = recorded_columns(arrival[:, : end - recording.scans.shape[1]], rng)
        return Flight(truth, recorded_columns(measurements[:, :end], rng), arrival)

    def _padded(self) -> Array:
        """Return the truth at every step, those that the start uses up included."""
        recording = self._recording
        runs, steps = self.recorded_runs, len(recording.clock.steps)
        out = np.full((len(self.components), steps, runs), np.nan)
        if recording.truth is not None:
            out[:, steps - recording.truth.shape[1] :] = recording.truth
        return out

    def run_metrics(self, values: Mapping[str, Array], scored: Scored) -> dict[str, Array]:
        """Return the largest error in a window, m, and runs beyond ten sigmas, given a truth."""
        squared = values.get("squared_position")
        if squared is None:
            return {}
        peaks = {n: np.sqrt(np.fmax.reduce(squared[m], axis=0)) for n, m in scored.windows.items()}
        return scored.of_peaks(peaks)
