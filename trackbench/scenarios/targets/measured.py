"""Target with recorded measurements, and perhaps a recorded truth. Nothing is simulated."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.random_streams import Streams
from trackbench.errors import counted
from trackbench.field_types import (
    InvalidKeyError,
)
from trackbench.models.inputs import KnownInputs
from trackbench.models.sensors.stacked import Sensors, rows_of, sensors_of
from trackbench.models.two_scan_prior import TwoPoint
from trackbench.registry import register
from trackbench.scenarios.recordings.input_gaps import check_gaps
from trackbench.scenarios.recordings.names_and_digests_of_data_files import FromFiles
from trackbench.scenarios.recordings.quantity_keys import KEYS
from trackbench.scenarios.recordings.read_recording import Recording, read_recording
from trackbench.scenarios.recordings.recording_keys import RecordingKeys
from trackbench.scenarios.recordings.rows_and_reading_context import TICK
from trackbench.scenarios.starts.base import Start
from trackbench.scenarios.targets.base import Flight, Target
from trackbench.scenarios.targets.peak_errors import Scored
from trackbench.scenarios.targets.recordings_of_runs import recorded_columns
from trackbench.scenarios.targets.timeline import Timeline


@register("targets", "measured")
@dataclass(frozen=True, kw_only=True, eq=False)
class Measured(FromFiles, RecordingKeys, Target):
    """Recorded measurements, by which filters start and are judged; nothing is simulated.

    Tables have a column ``time`` (seconds, or ISO 8601) or ``step``, one for each of the sensor's
    components, and perhaps ``run``; of several sensors a file each, or a column ``sensor``.
    Steps are the times at which anything was measured, and motions are given the true time between them;
    a start from scans takes the first of each run. A cell that is empty is a missing measurement. A
    column ``received`` has the time at which a filter gets the row.
    """

    @property
    def patterns(self) -> tuple[str, ...]:
        """All files, as they are given."""
        further = [path for path in (self.truth, self.input_file) if path is not None]
        return (*self.measurement_files, *further)

    @property
    def known_angles(self) -> tuple[str, ...]:
        """Names of components that are angles."""
        return self.angles

    def with_angles(self, angles: tuple[str, ...]) -> "Measured":
        """Return the target whose truth is interpolated with these components as angles."""
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
    def known_inputs(self) -> KnownInputs | None:
        """Inputs of all steps, such as a robot's speed and turn rate; None if it has none."""
        return self._recording.inputs

    @property
    def run_names(self) -> tuple[str, ...]:
        """Names of the recorded runs."""
        return self._recording.names

    @property
    def longest_delay(self) -> int:
        """Largest number of steps by which a recorded measurement was received late."""
        arrivals = self._recording.arrivals
        if arrivals is None:
            return 0
        # The arrivals (S, K, M) of S sensors are steps from 0, as `due` is.
        due = np.arange(arrivals.shape[1])[:, None]
        return int((arrivals - due).max())

    def shortest_delays(self, sensor: Sensors) -> list[int]:
        """Return the steps by which all measurements of each of S sensors were received late at least.

        Without times at which they were received the sensors' key ``delay`` says it. A sensor without
        measurements has 0.
        """
        arrivals = self._recording.arrivals
        if arrivals is None:
            return super().shortest_delays(sensor)
        last = arrivals.shape[1]
        due = np.arange(last)[:, None]
        # A measurement that is received after the last step is later than the recording is long.
        delays = np.where(arrivals < last, arrivals - due, last)
        shortest = []
        for delays_of_sensor, rows in zip(delays, rows_of(sensor), strict=True):
            is_measured = np.isfinite(self._recording.measurements[rows]).any(axis=0)
            measured = delays_of_sensor[is_measured]
            shortest.append(int(measured.min()) if len(measured) else 0)
        return shortest

    @property
    def time_before_rows(self) -> float:
        """Time from a `given` first state to the first row, s or steps; 0 if it is at this row."""
        return self._recording.time_before_rows

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
        """Recording that `own_timeline` has read for the scenario's sensor and start.

        It is put into the instance, as a frozen dataclass has no field for it, and stands there beside
        what it was read for: the sensors' components, the number of the start's scans, and T.
        """
        _, recording = self.__dict__["_read"]
        return recording

    def own_timeline(self, sensor: Sensors, start: Start, T: float) -> Timeline:
        """Return the steps of the files, which begin with those that the start uses up."""
        self._check_keys(sensor, start)
        requested = (sensor.components, start.scans, T)
        # Read the files again only for another sensor, start or T. `_read` is the pair of what was
        # requested and the recording.
        read_for, _ = self.__dict__.get("_read", (None, None))
        if read_for != requested:
            with self.reading():
                recording = read_recording(self, sensor, start.scans, T)
                object.__setattr__(self, "_read", (requested, recording))
        if self.longest_delay and any(each.delay for each in sensors_of(sensor)):
            message = "`delay` and a column `received` exclude each other; leave one out"
            raise InvalidKeyError(message, "sensor")
        clock = self._recording.clock
        between = clock.T  # None if intervals differ; then the first one counts
        if between is None:
            between = float(clock.times[1] - clock.times[0])
        # Time between the scans of the start: one number, or one for each run.
        apart: Array | float | None = None
        if start.scans >= 2:
            apart = self._recording.scan_interval
            if np.ptp(apart) <= TICK:
                apart = float(apart[0])
            # A prior that keeps both scans, as that of a radar at the origin does, has one T for all
            # runs.
            elif issubclass(start.prior_type(sensor), TwoPoint):
                message = (
                    "two scans of a radar must be equally far apart in all runs: take one-scan"
                )
                raise InvalidKeyError(message, "start")
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

    def _check_keys(self, sensor: Sensors, start: Start) -> None:
        """Raise InvalidKeyError for keys that exclude recorded data, or do not fit the sensors."""
        sensors = sensors_of(sensor)
        if start.of_truth:
            message = (
                "recorded data start from their scans, or as `given`: what is true is not known"
            )
            raise InvalidKeyError(message, "start")
        # Errors and gaps that only a simulation adds.
        for each in sensors:
            if each.bias or each.outliers is not None or each.detection != 1 or each.period != 1:
                message = "bias, outliers, detection and period are of simulated measurements"
                raise InvalidKeyError(message, "sensor")
        # Columns and units must be of known quantities: 1.range of several sensors, or range of all.
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
        files = len(self.measurement_files)
        if files not in (1, len(sensors)):
            message = f"{files} files for {counted(len(sensors), 'sensor')}"
            raise InvalidKeyError(message, "target", "measurements")
        names_of_sensors = len(set(self.sensors))
        if names_of_sensors not in (0, len(sensors)):
            message = (
                f"names {names_of_sensors} of {counted(len(sensors), 'sensor')}: give each a name"
            )
            raise InvalidKeyError(message, "target", "sensors")

    def _check_inputs(self, quantities: Collection[str]) -> None:
        """Raise InvalidKeyError for an input that is also a quantity, or whose file is not named."""
        for name in self.input:
            if name in quantities or name in self.columns or name in KEYS:
                message = (
                    f"{name!r} is the name of a quantity or of a key of `columns`: choose another"
                )
                raise InvalidKeyError(message, "target", "input", name)
        if self.input and self.input_file is None and len(self.measurement_files) > 1:
            message = (
                "there are several files of measurements: name that of the inputs, `input_file`"
            )
            raise InvalidKeyError(message, "target", "input")

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

        Nothing is drawn: a run beyond the last recorded one has no measurements. The true first states
        ``start``, the sensor and the number of scans have no effect.
        """
        recording = self._recording
        steps = len(timeline.steps)
        # The scans that the start uses up come first.
        measurements = np.concatenate([recording.scans, recording.measurements], axis=1)
        # The scenario may end before the recording.
        left_out = len(recording.clock.steps) - steps
        end = measurements.shape[1] - left_out
        # Arrivals have no columns for these scans, since filters are not given them as measurements.
        arrival = recording.arrivals
        if arrival is not None:
            arrival = recorded_columns(arrival[:, : end - recording.scans.shape[1]], rng)
        return Flight(
            truth=recorded_columns(self._padded_truth()[:, :steps], rng),
            measurements=recorded_columns(measurements[:, :end], rng),
            arrival=arrival,
        )

    def _padded_truth(self) -> Array:
        """Return the truth (n_x, all steps, M), NaN where it is unknown."""
        recording = self._recording
        steps = len(recording.clock.steps)
        # The recorded truth begins at the first state's step, after the scans that the start uses up.
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
        return scored.peak_metrics(scored.known_peaks(squared))
