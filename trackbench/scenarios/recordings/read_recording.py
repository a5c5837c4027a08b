"""Order in which files become a recording: measurements, inputs, clock and truth of all runs."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.models.angle_components import measured_angle_rows
from trackbench.models.inputs import KnownInputs
from trackbench.models.sensors.stacked import Sensors, rows_of, sensors_of
from trackbench.scenarios.position_from_one_scan import position_part
from trackbench.scenarios.recordings.angle_size_check import check_turns
from trackbench.scenarios.recordings.chosen_runs import chosen_runs
from trackbench.scenarios.recordings.initial_scans import (
    initial_scans,
    note_on_rows_before_start,
    with_scans,
)
from trackbench.scenarios.recordings.input_gaps import rows_within
from trackbench.scenarios.recordings.inputs_at_steps import aligned_with, inputs_at
from trackbench.scenarios.recordings.measurement_array import measurement_array
from trackbench.scenarios.recordings.names_and_digests_of_data_files import with_file_names
from trackbench.scenarios.recordings.origins import check_origin, note_distances
from trackbench.scenarios.recordings.quantity_keys import plain_name
from trackbench.scenarios.recordings.read_inputs import read_inputs
from trackbench.scenarios.recordings.read_rows_of_all_files import read_rows
from trackbench.scenarios.recordings.recorded_truth import (
    note_on_steps_without_measurement,
    read_truth,
)
from trackbench.scenarios.recordings.recording_keys import RecordingKeys
from trackbench.scenarios.recordings.repeated_positions_check import note_on_repetitions
from trackbench.scenarios.recordings.returning_positions_check import note_on_returns
from trackbench.scenarios.recordings.row_order import in_order
from trackbench.scenarios.recordings.rows_and_reading_context import ReadingContext, Rows
from trackbench.scenarios.recordings.sensors_far_apart_check import note_on_places, note_on_sensors
from trackbench.scenarios.recordings.steps_of_all_runs import (
    Clock,
    common_clock,
    note_on_shared_clock,
)
from trackbench.scenarios.recordings.time_overlap_of_files import note_files_apart
from trackbench.scenarios.recordings.truth_check import contradictions
from trackbench.scenarios.recordings.truth_check_delays import StepClock
from trackbench.scenarios.recordings.velocity_check import note_on_measurements, note_on_truth


class Recording(NamedTuple):
    """M recorded runs on one clock."""

    clock: Clock
    time_before_rows: float
    """time from the clock's first step to the first row, s or steps; 0 if this row is at the step"""
    names: tuple[str, ...]
    """names of the runs"""
    scans: Array
    """scans (n_z, s, M) that the start uses up"""
    scan_interval: Array
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


def read_recording(target: RecordingKeys, sensor: Sensors, scans: int, T: float) -> Recording:
    """Read the files of measurements, inputs and truth, and put all runs on one clock.

    ``target`` has the keys of the files in the config, ``sensor`` the scenario's sensors. ``scans`` is
    the number of scans by which filters are initialized. Steps without times are T seconds apart.
    """
    # Step 1: read the chosen runs' rows of each sensor, in order of time.
    sensor_rows = rows_of(sensor)
    origin = target.origin
    origin_key: tuple[str, ...] = ("target", "origin")
    if not origin and target.truth_naming is not None and target.truth_naming.origin:
        origin = target.truth_naming.origin
        origin_key = ("target", "truth_naming", "origin")
    position_dependent = {
        name for name in target.components if name in ("x", "y", "z", "px", "py", "pz")
    }
    position_dependent |= _position_dependent(target.components, sensor)
    components = [sensor.components[rows] for rows in sensor_rows]
    quantities = {plain_name(c) for c in (*target.components, *sensor.components)}
    chosen = [str(name) for name in target.runs]
    context = ReadingContext(
        target,
        origin=origin or None,
        origin_key=origin_key,
        position_dependent=position_dependent,
        in_space="z" in quantities,
        chosen=chosen,
        has_inputs=bool(target.input),
    )
    names = [str(name) for name in target.sensors]
    namings = target.namings
    rows = read_rows(context, target.measurement_files, components, names=names, namings=namings)
    rows = chosen_runs(context, rows, chosen, ("target", "runs"))
    for m, each in enumerate(sensors_of(sensor)):
        context.naming = namings[m] if len(namings) > 1 else namings[0]
        angles = {each.components[row]: row for row in measured_angle_rows(each)}
        check_turns(context, rows[m], angles)
        rows[m] = in_order(context, rows[m], each.innovation)
    if len(target.measurement_files) > 1:
        note_files_apart(context, rows)
    if not context.counts_steps:
        context.notices += note_on_measurements(components, rows)
        sigmas = []
        for each in sensors_of(sensor):
            sigma = getattr(each, "sigma", np.nan)
            sigmas.append(float(sigma) if isinstance(sigma, int | float) else np.nan)
        context.notices += note_on_places(components, sigmas, rows, names)
    context.notices += note_on_repetitions(components, rows, names)
    # An empty name of the column of runs is the user's answer that all rows are of one target.
    if context.naming.columns.get("run") != "":
        context.notices += note_on_returns(components, rows, names)
    # Step 2: read the inputs. If a file of its own begins later or ends earlier, measurements without
    # inputs are left out.
    inputs = None
    if target.input:
        input_context, inputs = read_inputs(target, context, rows)
        if target.input_file:
            rows = rows_within(context, rows, input_context, inputs)
    # Step 3: take the first scans from the sensor that measures the position, by its number.
    locating = position_part(sensor)
    number = 0
    if locating is not None:
        _, locating_rows = locating
        number = sensor_rows.index(locating_rows)
    start = None
    if scans:
        start = initial_scans(context, rows[number], scans)
        context.notices += note_on_rows_before_start(rows, start, number, names, context.time_unit)
    # Step 4: put all runs on one clock, and the measurements on its steps.
    # A sensor may have no rows in the chosen runs.
    timed_rows = [each for each in rows if len(each.time)]
    first_measured = min(map(_first_measurement, timed_rows), default=np.inf)
    if inputs is not None:
        # There is a step at every row of the inputs. The earliest rows give the usual interval.
        timed_rows = [inputs.measured, *timed_rows]
        timed_rows.sort(key=lambda each: float(each.time.min()))
    first_states = None if start is None else start.time
    clock = common_clock(context, timed_rows, first_states, T, target.resample, first_measured)
    begin = float(clock.steps[0]) if context.counts_steps else float(clock.times[0])
    first_row = min(float((each.time + clock.shift[each.run]).min()) for each in timed_rows)
    resampled = target.resample is not None
    if not resampled and not context.counts_steps:
        context.notices += note_on_shared_clock(context.runs, rows, clock)
    measurements, arrivals = measurement_array(context, rows, clock, resampled)
    # Step 5: collect the scans of the start, read the truth, and compare it with the measurements.
    runs = len(context.runs)
    first_scans = np.full((len(sensor.components), scans, runs), np.nan)
    scan_interval = np.full(runs, np.nan)
    if start is not None:
        first_scans[sensor_rows[number]] = start.scans
        scan_interval = start.scan_interval
    # Without a truth the sensors are compared with each other.
    truth = None
    clockwise = []
    scales = []
    geodetic = []
    for m, each in enumerate(sensors_of(sensor)):
        naming = namings[m] if len(namings) > 1 else namings[0]
        measured_angles = [each.components[row] for row in measured_angle_rows(each)]
        clockwise.append(any(map(naming.is_clockwise, measured_angles)))
        scales.append({name: naming.scale(name) for name in each.components})
        geodetic.append("latitude" in naming.columns)
    step_clock = StepClock(
        steps=clock.steps[1:], times=clock.times[1:], counts_steps=context.counts_steps
    )
    if target.truth is None:
        context.notices += note_on_sensors(
            sensor,
            target.components,
            measurements,
            step_clock,
            names=names,
            clockwise=clockwise,
            in_one_file=len(target.measurement_files) == 1,
            scales=scales,
            geodetic=geodetic,
        )
    else:
        truth = read_truth(target, context, rows, clock)
        context.notices += contradictions(
            sensor,
            target.components,
            truth[:, 1:],
            measurements,
            step_clock,
            names=names,
            angles=target.angles,
            in_one_file=len(target.measurement_files) == 1,
            clockwise=clockwise,
            scales=scales,
            is_geodetic=context.geodetic_file == target.truth,
        )
        if not context.counts_steps:
            context.notices += note_on_truth(target.components, truth, clock.times)
        # A robot's log has steps of its inputs, and several runs have a note on the steps they share.
        if inputs is None and len(context.runs) == 1:
            context.notices += note_on_steps_without_measurement(truth[:, 1:], measurements)
    # Step 6: take the inputs at the steps, and check that the keys of the config were used.
    known_inputs = None
    if inputs is not None:
        known_inputs = inputs_at(
            input_context,
            [*target.input],
            inputs,
            clock,
            context.runs,
            holds=target.input_holds,
            gap=target.input_gap,
            resample=target.resample,
        )
    context.check_idle_keys()
    check_origin(context, origin, *origin_key)
    note_distances(context)
    notices = with_file_names(target, context.notices)
    whole_clock = with_scans(clock, context, scans, scan_interval)
    if known_inputs is not None:
        known_inputs = aligned_with(known_inputs, whole_clock.steps)
    return Recording(
        clock=whole_clock,
        time_before_rows=max(first_row - begin, 0.0),
        names=tuple(context.runs),
        scans=first_scans,
        scan_interval=scan_interval,
        measurements=measurements,
        truth=truth,
        notices=notices,
        arrivals=arrivals,
        inputs=known_inputs,
    )


def _first_measurement(rows: Rows) -> float:
    """Return the time of the first row with any value, s or steps; infinite if there is none."""
    is_measured = np.isfinite(rows.values).any(axis=0)
    return float(rows.time[is_measured].min(initial=np.inf))


def _position_dependent(components: Sequence[str], sensor: Sensors) -> set[str]:
    """Return the names of the sensor's components that depend on the position.

    ``components`` are those of the state.
    """
    # Measure a state before and after an arbitrary move of its position, and compare.
    is_position = np.array([name in ("px", "py", "pz") for name in components])
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
