"""Target with recorded measurements, and perhaps a recorded truth. Nothing is simulated."""

import os
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.random_streams import Streams
from trackbench.field_types import (
    DataError,
    DataFile,
    InvalidKeyError,
    Positive,
    freeze_mappings,
)
from trackbench.models.base import measured_angle_rows
from trackbench.models.components import position_velocity_names
from trackbench.models.inputs import KnownInputs
from trackbench.models.priors import TwoPoint
from trackbench.models.sensors.base import Sensors, rows_of, sensors_of
from trackbench.registry import register
from trackbench.scenarios.recordings.column_mapping import Naming, NamingKeys
from trackbench.scenarios.recordings.file_overlap import check_common_time, note_files_apart
from trackbench.scenarios.recordings.known_inputs import (
    InputRows,
    aligned_with,
    check_gaps,
    inputs_at,
    missing_run,
    rows_within,
    with_inputs_only,
)
from trackbench.scenarios.recordings.quantities import KEYS, plain_name
from trackbench.scenarios.recordings.row_order import in_order
from trackbench.scenarios.recordings.rows import (
    TICK,
    FromFiles,
    Gathered,
    Rows,
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
    note_on_shared_clock,
    truth_at,
    with_scans,
)
from trackbench.scenarios.recordings.truth_check import StepClock, contradictions
from trackbench.scenarios.starts.base import Start, position_part
from trackbench.scenarios.targets.base import Flight, Scored, Target, Timeline, recorded_columns


class Recording(NamedTuple):
    """M recorded runs on one clock."""

    clock: Clock
    names: tuple[str, ...]
    """names of the runs"""
    scans: Array
    """scans (n_z, s, M) that the start uses up"""
    apart: Array
    """time (M,) between the last two of those scans, s"""
    measurements: Array
    """measurements (n_z, K, M) after those scans"""
    truth: Array | None
    """true states (n_x, K + 1, M)"""
    notices: tuple[str, ...]
    """notes on changes to the rows"""
    arrivals: Array | None
    """steps (S, K, M) at which measurements of S sensors were received, if that is known"""
    inputs: KnownInputs | None
    """inputs of motions"""


def _first_measurement(rows: Rows) -> float:
    """Return the time of the first row with any value, s or steps; infinite if there is none."""
    is_measured = np.isfinite(rows.values).any(axis=0)
    return float(rows.time[is_measured].min(initial=np.inf))


def _before_further_file(
    gathered: Gathered, naming: Naming, keys: NamingKeys, has_own_keys: bool
) -> Gathered:
    """Return the properties of a file beside the measurements, before it is read.

    ``gathered`` are those of the measurements. The file has its own keys of units and zones if
    ``has_own_keys``, and else uses those of the measurements, too.
    """
    further = replace(
        gathered,
        naming=naming,
        keys=keys,
        runs=[],
        files=[],
        notices=[],
        unavailable=Counter(),
        chosen=(*gathered.runs, ONE_RUN),
    )
    if has_own_keys:
        further.used_keys = set()
        further.idle_keys = {}
    return further


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
    measurement_naming: tuple[Naming, ...] = ()
    """columns and units of each file in the list `measurements`, in its order; a key or a column that
    one of them does not name is that of the target"""
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
    input: dict[str, str] = field(default_factory=dict)
    """columns of known inputs, by the names that motions use: {v: odometry_speed, w: yaw_rate}; their
    units are among `units`"""
    input_file: DataFile | None = None
    """CSV or Parquet of the inputs, at times of its own; default: the file of the measurements"""
    input_naming: Naming | None = None
    """columns of the times and runs of `input_file`, and units of its times and of the inputs; default:
    as of the measurements, but for their `format`"""
    input_holds: Literal["before", "after"] = "before"
    """when the values of a row hold: before its time, back to the row before, as wheels measure them, or
    after it, until the next row, as commands do"""
    input_gap: Positive | None = None
    """longest time between two rows over which inputs hold, s (or steps); default: 1.5 usual ones"""
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
        freeze_mappings(self)
        if not self.input:
            for key in ("input_file", "input_gap", "input_naming"):
                if getattr(self, key) is not None:
                    raise InvalidKeyError("there is no `input`", key)
        if self.input_naming is not None:
            self._check_input_naming(self.input_naming)
        for i, name in enumerate(self.angles):
            if name not in self.components:
                what = f"{name!r} is not one of {', '.join(self.components)}"
                raise InvalidKeyError(what, "angles", i)
        self._check_measurement_naming()
        if self.truth is None:
            if self.truth_gap is not None:
                raise InvalidKeyError("there is no truth", "truth_gap")
            if self.truth_naming is not None:
                raise InvalidKeyError("there is no truth", "truth_naming")
        truth_origin = () if self.truth_naming is None else self.truth_naming.origin
        if self.origin and truth_origin not in ((), self.origin):
            what = "is not that of the target, and both count from one point: leave it out"
            raise InvalidKeyError(what, "truth_naming", "origin")

    def _check_input_naming(self, naming: Naming) -> None:
        """Raise InvalidKeyError if the keys of the file of the inputs contradict those of the target."""
        if self.input_file is None:
            what = "there is no `input_file`, and the file of the measurements has their names and units"
            raise InvalidKeyError(what, "input_naming")
        for name in self.input:
            if name in naming.columns:
                what = (
                    f"the column of an input stands in `input`: {{{name}: {naming.columns[name]}}}"
                )
                raise InvalidKeyError(what, "input_naming", "columns", name)
            if name in self.units:
                way = f"`input_naming: {{units: {{{name}: {self.units[name]}}}}}`"
                what = f"its file has `input_naming`, so write the unit there, {way}"
                raise InvalidKeyError(what, "units", name)

    def _check_measurement_naming(self) -> None:
        """Raise InvalidKeyError for namings that do not fit the files, or have an origin."""
        namings = len(self.measurement_naming)
        files = len(self._measurement_files)
        if namings and not isinstance(self.measurements, tuple):
            what = "is of several files: write columns and units of one file into the target"
            raise InvalidKeyError(what, "measurement_naming")
        if namings not in (0, files):
            what = f"{namings} entries for {files} files: write one for each; {{}} has the target's keys"
            raise InvalidKeyError(what, "measurement_naming")
        for i, naming in enumerate(self.measurement_naming):
            if naming.origin:
                what = "all files count from one point: write it into the target"
                raise InvalidKeyError(what, "measurement_naming", i, "origin")

    @property
    def patterns(self) -> tuple[str, ...]:
        """All files, as they are given."""
        further = [path for path in (self.truth, self.input_file) if path is not None]
        return (*self._measurement_files, *further)

    @property
    def _measurement_files(self) -> tuple[str, ...]:
        if isinstance(self.measurements, tuple):
            return self.measurements
        return (self.measurements,)

    @property
    def _namings(self) -> tuple[Naming, ...]:
        """Columns and units of each file of measurements; of the target without its own."""
        if not self.measurement_naming:
            return (self,) * len(self._measurement_files)
        return tuple(naming.with_defaults(self) for naming in self.measurement_naming)

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the truth's components, in order."""
        if self.state:
            return self.state
        if self.axes:
            return position_velocity_names(self.axes)
        return ("x",)

    @property
    def known_angles(self) -> tuple[str, ...]:
        """Names of components that are angles."""
        return self.angles

    def with_angles(self, angles: tuple[str, ...]) -> "Measured":
        """Return the target whose truth is interpolated by these angles."""
        if angles == self.angles or self.truth is None:
            return self
        return replace(self, angles=angles)

    @property
    def has_truth(self) -> bool:
        """True if there is a file of it."""
        return self.truth is not None

    @property
    def recorded_truth(self) -> Array | None:
        """True states (n_x, K, M) at all steps, NaN where unknown; None without a file of them."""
        if self._recording.truth is None:
            return None
        return self._padded_truth()

    @property
    def run_names(self) -> tuple[str, ...]:
        """Names of the recorded runs."""
        return self._recording.names

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
    def _recording(self) -> Recording:
        """Recording read for the scenario's sensor and start."""
        _, recording = self.__dict__["_read"]
        return recording

    def own_timeline(self, sensor: Sensors, start: Start, T: float) -> Timeline:
        """Return the steps of the files, which begin with those that the start uses up."""
        self._check(sensor, start)
        requested = (sensor.components, start.scans, T)
        # Read the files again only for another sensor, start or T.
        read_for, _ = self.__dict__.get("_read", (None, None))
        if read_for != requested:
            with self.reading():
                recording = self._read_recording(sensor, start.scans, T)
                object.__setattr__(self, "_read", (requested, recording))
        if self.longest_delay and any(each.delay for each in sensors_of(sensor)):
            what = "`delay` and a column `received` exclude each other; leave one out"
            raise InvalidKeyError(what, "sensor")
        clock = self._recording.clock
        between = clock.T
        if between is None:
            between = float(clock.times[1] - clock.times[0])
        # Time between the scans of the start: one number, or one for each run.
        apart: Array | float | None = None
        if start.scans >= 2:
            apart = self._recording.apart
            if np.ptp(apart) <= TICK:
                apart = float(apart[0])
            elif issubclass(start.prior_type(sensor), TwoPoint):
                what = "two scans of a radar must be equally far apart in all runs: take one-scan"
                raise InvalidKeyError(what, "start")
        return Timeline(
            steps=clock.steps,
            times=clock.times,
            T=between,
            equal=clock.T is not None,
            apart=apart,
            inputs=self._recording.inputs,
        )

    def check(self, timeline: Timeline) -> None:
        """Raise DataError if steps up to the last one of the timeline have no inputs."""
        if timeline.inputs is not None:
            check_gaps(timeline.inputs, int(timeline.steps[-1]))

    def _read_recording(self, sensor: Sensors, scans: int, T: float) -> Recording:
        """Read the files of measurements, inputs and truth, and put all runs on one clock.

        ``scans`` is the number of scans that the start uses up. Steps without times are T seconds apart.
        """
        # Step 1: read the chosen runs' rows of each sensor, in order of time.
        sensor_rows = rows_of(sensor)
        origin = self.origin
        origin_key: tuple[str, ...] = ("target", "origin")
        if not origin and self.truth_naming is not None and self.truth_naming.origin:
            origin = self.truth_naming.origin
            origin_key = ("target", "truth_naming", "origin")
        in_frame = {name for name in self.components if name in ("x", "y", "z", "px", "py", "pz")}
        in_frame |= self._position_dependent(sensor)
        components = [sensor.components[rows] for rows in sensor_rows]
        quantities = {plain_name(c) for c in (*self.components, *sensor.components)}
        chosen = [str(name) for name in self.runs]
        gathered = Gathered(
            self,
            origin=origin or None,
            origin_key=origin_key,
            in_frame=in_frame,
            in_space="z" in quantities,
            chosen=chosen,
            has_inputs=bool(self.input),
        )
        names = [str(name) for name in self.sensors]
        namings = self._namings
        rows = read_rows(
            gathered, self._measurement_files, components, names=names, namings=namings
        )
        rows = chosen_runs(gathered, rows, chosen, ("target", "runs"))
        for m, each in enumerate(sensors_of(sensor)):
            gathered.naming = namings[m] if len(namings) > 1 else namings[0]
            angles = {each.components[row]: row for row in measured_angle_rows(each)}
            check_turns(gathered, rows[m], angles)
            rows[m] = in_order(gathered, rows[m], each.innovation)
        if len(self._measurement_files) > 1:
            note_files_apart(gathered, rows)
        # Step 2: read the inputs. Those of a file of their own may begin later or end earlier.
        inputs = None
        if self.input:
            gathered_inputs, inputs = self._read_inputs(gathered, rows)
            if self.input_file:
                rows = rows_within(gathered, rows, gathered_inputs, inputs)
        # Step 3: take the first scans from the sensor that measures the position.
        locating = position_part(sensor)
        number = 0  # of that sensor
        if locating is not None:
            _, locating_rows = locating
            number = sensor_rows.index(locating_rows)
        start = None
        if scans:
            start = initial_scans(gathered, rows[number], scans)
        # Step 4: put all runs on one clock, and the measurements on its steps.
        timed_rows = rows
        if inputs is not None:
            # There is a step at every row of the inputs. The earliest rows give the usual interval.
            timed_rows = [inputs.measured, *rows]
            timed_rows.sort(key=lambda each: float(each.time.min()))
        first_measured = min(map(_first_measurement, rows))
        clock = common_clock(gathered, timed_rows, start, T, self.resample, first_measured)
        resampled = self.resample is not None
        if not resampled and not gathered.stepped:
            gathered.notices += note_on_shared_clock(gathered.runs, rows, clock)
        measurements, arrivals = measurement_array(gathered, rows, clock, resampled)
        # Step 5: add the scans of the start and the truth.
        runs = len(gathered.runs)
        first_scans = np.full((len(sensor.components), scans, runs), np.nan)
        apart = np.full(runs, np.nan)
        if start is not None:
            first_scans[sensor_rows[number]] = start.scans
            apart = start.apart
        truth = None
        if self.truth is not None:
            truth = self._read_truth(gathered, rows, clock)
            step_clock = StepClock(
                steps=clock.steps[1:], times=clock.times[1:], stepped=gathered.stepped
            )
            gathered.notices += contradictions(
                sensor,
                self.components,
                truth[:, 1:],
                measurements,
                step_clock,
                names=names,
                angles=self.angles,
                in_one_file=len(self._measurement_files) == 1,
            )
        known_inputs = None
        if inputs is not None:
            known_inputs = inputs_at(
                gathered_inputs,
                [*self.input],
                inputs,
                clock,
                gathered.runs,
                holds=self.input_holds,
                gap=self.input_gap,
                resample=self.resample,
            )
        gathered.check_idle_keys()
        gathered.check_origin(origin, *origin_key)
        gathered.note_distances()
        notices = self._with_file_names(gathered.notices)
        whole_clock = with_scans(clock, gathered, scans, apart)
        if known_inputs is not None:
            known_inputs = aligned_with(known_inputs, whole_clock.steps)
        return Recording(
            clock=whole_clock,
            names=tuple(gathered.runs),
            scans=first_scans,
            apart=apart,
            measurements=measurements,
            truth=truth,
            notices=notices,
            arrivals=arrivals,
            inputs=known_inputs,
        )

    def _read_inputs(
        self, gathered: Gathered, measured_rows: Sequence[Rows]
    ) -> tuple[Gathered, InputRows]:
        """Read the rows of the inputs, from their own file or that of the measurements.

        Return the data gathered about their file, and their rows. ``measured_rows`` are those of each
        sensor.
        """
        path = self.input_file or self._measurement_files[0]
        given: Naming = self.input_naming or self
        # The empty name stands for no column: the inputs belong to no sensor.
        columns = {**given.columns, **self.input, "sensor": ""}
        file_format = given.format
        if self.input_file and self.input_naming is None:
            file_format = None
        naming = Naming(
            columns=columns,
            units=given.units,
            time_format=given.time_format,
            zone=given.zone,
            missing=given.missing,
            same_time=given.same_time,
            format=file_format,
        )
        keys = NamingKeys(quantities="input")
        if self.input_file:
            clock_key = "columns" if self.input_naming is None else "input_naming.columns"
            keys = NamingKeys(quantities="input", clock=clock_key, own="input_naming")
        has_own_keys = self.input_naming is not None
        gathered_inputs = _before_further_file(gathered, naming, keys, has_own_keys)
        names = [*self.input]
        (rows,) = read_rows(gathered_inputs, [path], [names])
        if self.input_naming:
            gathered_inputs.check_idle_keys()
        if self.input_file:
            check_common_time(gathered, measured_rows, gathered_inputs, rows)
        # Number the runs as those of the measurements; inputs without names of runs are those of all.
        is_shared = gathered_inputs.runs == [ONE_RUN]  # the name of a run without a name
        chosen = [] if is_shared else gathered.runs
        without = [name for name in chosen if name not in gathered_inputs.runs]
        if without:
            raise DataError(missing_run(path, without[0], names))
        (rows,) = chosen_runs(gathered_inputs, [rows], chosen)
        return gathered_inputs, with_inputs_only(gathered_inputs, names, rows)

    def _position_dependent(self, sensor: Sensors) -> set[str]:
        """Return the names of the measured components that depend on the position."""
        # Measure a state before and after an arbitrary move of its position, and compare.
        is_position = np.array([name in ("px", "py", "pz") for name in self.components])
        state = 1.0 + np.arange(len(is_position), dtype=float)[:, None]
        moved = state + 7.0 * is_position[:, None]
        with np.errstate(all="ignore"):
            before = sensor.measurement(state, 1).mean
            after = sensor.measurement(moved, 1).mean
        dependent = set()
        for component, is_equal in zip(sensor.components, before == after, strict=True):
            if not is_equal.all():
                dependent.add(component)
        return dependent

    def _check(self, sensor: Sensors, start: Start) -> None:
        """Raise InvalidKeyError for keys that exclude recorded data, or do not fit the sensors."""
        sensors = sensors_of(sensor)
        if start.of_truth:
            what = "recorded data start from their scans, or as `given`: what is true is not known"
            raise InvalidKeyError(what, "start")
        # Errors and gaps that only a simulation adds.
        for each in sensors:
            if each.bias or each.outliers is not None or each.detection != 1 or each.period != 1:
                what = "bias, outliers, detection and period are of simulated measurements"
                raise InvalidKeyError(what, "sensor")
        # Columns and units must be of known quantities.
        plain = (name.rpartition(".")[2] for name in sensor.components)
        names = tuple(dict.fromkeys((*sensor.components, *plain, *self.components)))
        self._check_inputs(names)
        self.check_names((*names, *self.input), "target")
        for i, naming in enumerate(self.measurement_naming):
            naming.check_names(names, "target", "measurement_naming", i)
        if self.truth_naming is not None:
            self.truth_naming.check_names(names, "target", "truth_naming")
        if self.input_naming is not None:
            self.input_naming.check_names([*self.input], "target", "input_naming")
        files = len(self._measurement_files)
        if files not in (1, len(sensors)):
            what = f"{files} files for {len(sensors)} sensors"
            raise InvalidKeyError(what, "target", "measurements")
        names_of_sensors = len(set(self.sensors))
        if names_of_sensors not in (0, len(sensors)):
            what = f"names {names_of_sensors} of {len(sensors)} sensors: give each a name"
            raise InvalidKeyError(what, "target", "sensors")

    def _check_inputs(self, quantities: Collection[str]) -> None:
        """Raise InvalidKeyError for an input that is also a quantity, or whose file is not named."""
        for name in self.input:
            if name in quantities or name in self.columns or name in KEYS:
                what = (
                    f"{name!r} is the name of a quantity or of a key of `columns`: choose another"
                )
                raise InvalidKeyError(what, "target", "input", name)
        if self.input and self.input_file is None and len(self._measurement_files) > 1:
            what = "there are several files of measurements: name that of the inputs, `input_file`"
            raise InvalidKeyError(what, "target", "input")

    def _read_truth(self, gathered: Gathered, measured_rows: Sequence[Rows], clock: Clock) -> Array:
        """Read the truth (n_x, K + 1, M) at the clock's steps.

        ``measured_rows`` are those of each sensor.
        """
        assert self.truth is not None
        # By default the truth has the columns and units of the measurements.
        naming: Naming = self.truth_naming or replace(self, format=None)
        columns_key = "columns" if self.truth_naming is None else "truth_naming.columns"
        keys = NamingKeys(quantities=columns_key, clock=columns_key, own="truth_naming")
        has_own_keys = self.truth_naming is not None
        gathered_truth = _before_further_file(gathered, naming, keys, has_own_keys)
        (rows,) = read_rows(gathered_truth, [self.truth], [self.components], least=1)
        if self.truth_naming:
            gathered_truth.check_idle_keys()
        (rows,) = chosen_runs(gathered_truth, [rows], ())
        rows = in_order(gathered_truth, rows)
        check_runs_of_truth(gathered_truth, rows, gathered)
        check_common_time(gathered, measured_rows, gathered_truth, rows)
        # Origin and distances are those of all files together.
        gathered.geodetic = gathered_truth.geodetic
        gathered.planar = gathered_truth.planar
        gathered.largest_distance = gathered_truth.largest_distance
        angles = [i for i, name in enumerate(self.components) if name in self.angles]
        truth = truth_at(gathered_truth, rows, clock, gathered.runs, self.truth_gap, angles)
        gathered.notices += [f"truth: {notice}" for notice in gathered_truth.notices]
        return truth

    def _with_file_names(self, notices: Sequence[str]) -> tuple[str, ...]:
        """Return each note once, in which files have their names in place of their absolute paths."""
        patterns = self.measurements
        if isinstance(patterns, str):
            patterns = (patterns,)
        named = list(notices)
        for path in [*patterns, self.truth, self.input_file]:
            if path is not None:
                folder = f"{Path(path).parent}{os.sep}"
                named = [notice.replace(folder, "") for notice in named]
        return tuple(dict.fromkeys(named))

    def start(self, timeline: Timeline) -> Array:
        """Return NaN: nothing is configured about the first state."""
        return np.full(len(self.components), np.nan)

    def path(self, timeline: Timeline) -> Array:
        """Return the first run's truth (n_x, K), NaN where there is none."""
        return self._padded_truth()[:, : len(timeline.steps), 0]

    def fly(
        self, start: Array, timeline: Timeline, sensor: Sensors, rng: Streams, scans: int
    ) -> Flight:
        """Return the recorded runs with the numbers of the streams ``rng``.

        Nothing is drawn: a run beyond the last recorded one has no measurements.
        """
        recording = self._recording
        steps = len(timeline.steps)
        measurements = np.concatenate([recording.scans, recording.measurements], axis=1)
        # The scenario may end before the recording.
        left_out = len(recording.clock.steps) - steps
        end = measurements.shape[1] - left_out
        arrival = recording.arrivals
        if arrival is not None:
            arrival = recorded_columns(arrival[:, : end - recording.scans.shape[1]], rng)
        return Flight(
            truth=recorded_columns(self._padded_truth()[:, :steps], rng),
            measurements=recorded_columns(measurements[:, :end], rng),
            arrival=arrival,
        )

    def _padded_truth(self) -> Array:
        """Return the truth at every step, those that the start uses up included."""
        recording = self._recording
        steps = len(recording.clock.steps)
        truth = np.full((len(self.components), steps, self.recorded_runs), np.nan)
        if recording.truth is not None:
            truth[:, steps - recording.truth.shape[1] :] = recording.truth
        return truth

    def run_metrics(self, values: Mapping[str, Array], scored: Scored) -> dict[str, Array]:
        """Return ``peak_position`` and ``beyond_10_sigma``, as `Flown` does; nothing without a truth.

        Steps at which the truth is missing are left out.
        """
        squared = values.get("squared_position")
        if squared is None:
            return {}
        peaks = {}
        for name, mask in scored.windows.items():
            peaks[name] = np.sqrt(np.fmax.reduce(squared[mask], axis=0))
        return scored.peak_metrics(peaks)
