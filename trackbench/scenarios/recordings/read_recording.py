"""Order in which files become a recording: measurements, inputs, clock and truth of all runs."""

import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from trackbench.core.angles import wrapped_difference
from trackbench.core.arrays import Array
from trackbench.field_types import DataError
from trackbench.models.angle_components import measured_angle_rows
from trackbench.models.inputs import KnownInputs
from trackbench.models.sensors.stacked import Sensors, rows_of, sensors_of
from trackbench.scenarios.recordings.angle_size_check import check_turns
from trackbench.scenarios.recordings.chosen_runs import chosen_runs
from trackbench.scenarios.recordings.column_mapping import Naming, NamingKeys
from trackbench.scenarios.recordings.common_clock import (
    ONE_RUN,
    Clock,
    common_clock,
    note_on_shared_clock,
    with_scans,
)
from trackbench.scenarios.recordings.file_overlap import check_common_time, note_files_apart
from trackbench.scenarios.recordings.initial_scans import initial_scans, note_on_rows_before_start
from trackbench.scenarios.recordings.known_inputs import (
    InputRows,
    aligned_with,
    inputs_at,
    missing_run,
    rows_within,
    with_inputs_only,
)
from trackbench.scenarios.recordings.measurement_array import measurement_array
from trackbench.scenarios.recordings.quantities import plain_name
from trackbench.scenarios.recordings.read_rows import read_rows
from trackbench.scenarios.recordings.recorded_truth import truth_at
from trackbench.scenarios.recordings.recording_keys import RecordingKeys
from trackbench.scenarios.recordings.row_order import in_order
from trackbench.scenarios.recordings.rows import ReadingContext, Rows
from trackbench.scenarios.recordings.run_names_of_truth import check_runs_of_truth
from trackbench.scenarios.recordings.truth_check import StepClock, contradictions
from trackbench.scenarios.recordings.velocity_check import (
    note_on_measurements,
    note_on_places,
    note_on_returns,
    note_on_truth,
)
from trackbench.scenarios.starts.base import position_part


class Recording(NamedTuple):
    """M recorded runs on one clock."""

    clock: Clock
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
    if context.naming.columns.get("run") != "":
        context.notices += note_on_returns(components, rows, names)
    # Step 2: read the inputs. If a file of its own begins later or ends earlier, measurements without
    # inputs are left out.
    inputs = None
    if target.input:
        input_context, inputs = _read_inputs(target, context, rows)
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
    clock = common_clock(context, timed_rows, start, T, target.resample, first_measured)
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
    truth = None
    if target.truth is not None:
        truth = _read_truth(target, context, rows, clock)
        clockwise = []
        for m, each in enumerate(sensors_of(sensor)):
            naming = namings[m] if len(namings) > 1 else namings[0]
            measured_angles = [each.components[row] for row in measured_angle_rows(each)]
            clockwise.append(any(map(naming.is_clockwise, measured_angles)))
        step_clock = StepClock(
            steps=clock.steps[1:], times=clock.times[1:], counts_steps=context.counts_steps
        )
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
        )
        if not context.counts_steps:
            context.notices += note_on_truth(target.components, truth, clock.times)
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
    context.check_origin(origin, *origin_key)
    context.note_distances()
    notices = _with_file_names(target, context.notices)
    whole_clock = with_scans(clock, context, scans, scan_interval)
    if known_inputs is not None:
        known_inputs = aligned_with(known_inputs, whole_clock.steps)
    return Recording(
        clock=whole_clock,
        names=tuple(context.runs),
        scans=first_scans,
        scan_interval=scan_interval,
        measurements=measurements,
        truth=truth,
        notices=notices,
        arrivals=arrivals,
        inputs=known_inputs,
    )


def _read_inputs(
    target: RecordingKeys, context: ReadingContext, measured_rows: Sequence[Rows]
) -> tuple[ReadingContext, InputRows]:
    """Read the rows of the inputs, from their own file or that of the measurements.

    Return the context of their file, and their rows, in which runs have the numbers of those of the
    measurements. ``context`` is that of the measurements, ``measured_rows`` are those of each sensor.
    """
    path = target.input_file or target.measurement_files[0]
    own_naming: Naming = target.input_naming or target
    # The empty name stands for no column: the inputs belong to no sensor.
    columns = {**own_naming.columns, **target.input, "sensor": ""}
    # In a log of both, a column such as object, which names landmarks, names no targets either.
    if own_naming.columns.get("sensor"):
        columns.setdefault("run", "")
    file_format = own_naming.format
    if target.input_file and target.input_naming is None:
        # The target's format is that of the measurements' file. Another file may be written in another
        # way, and shows its format in its first lines.
        file_format = None
    naming = Naming(
        columns=columns,
        units=own_naming.units,
        time_format=own_naming.time_format,
        zone=own_naming.zone,
        missing=own_naming.missing,
        same_time=own_naming.same_time,
        format=file_format,
    )
    keys = NamingKeys(quantities="input")
    if target.input_file:
        clock_key = "columns" if target.input_naming is None else "input_naming.columns"
        keys = NamingKeys(quantities="input", clock=clock_key, own="input_naming")
    has_own_keys = target.input_naming is not None
    input_context = _context_of_further_file(context, naming, keys, has_own_keys)
    names = [*target.input]
    (rows,) = read_rows(input_context, [path], [names])
    if target.input_naming:
        input_context.check_idle_keys()
    if target.input_file:
        check_common_time(context, measured_rows, input_context, rows)
    # Number the runs as those of the measurements; inputs without names of runs are those of all.
    is_shared = input_context.runs == [ONE_RUN]  # the name of a run without a name
    chosen = [] if is_shared else context.runs
    without = [name for name in chosen if name not in input_context.runs]
    if without:
        raise DataError(missing_run(path, without[0], names))
    (rows,) = chosen_runs(input_context, [rows], chosen)
    return input_context, with_inputs_only(input_context, names, rows)


def _read_truth(
    target: RecordingKeys, context: ReadingContext, measured_rows: Sequence[Rows], clock: Clock
) -> Array:
    """Read the truth (n_x, K + 1, M) at the clock's steps; it is NaN where it is unknown.

    ``context`` is that of the measurements, to which the truth's notices are added. ``measured_rows``
    are those of each sensor.
    """
    assert target.truth is not None
    # By default the truth has the columns and units of the measurements; the format of its text is found
    # in its first lines.
    naming: Naming = target.truth_naming or replace(target, format=None)
    columns_key = "columns" if target.truth_naming is None else "truth_naming.columns"
    keys = NamingKeys(quantities=columns_key, clock=columns_key, own="truth_naming")
    has_own_keys = target.truth_naming is not None
    truth_context = _context_of_further_file(context, naming, keys, has_own_keys)
    # A truth may lack some components, such as velocities, but not all.
    (rows,) = read_rows(truth_context, [target.truth], [target.components], least=1)
    if target.truth_naming:
        truth_context.check_idle_keys()
    (rows,) = chosen_runs(truth_context, [rows], ())
    angles = [i for i, name in enumerate(target.components) if name in target.angles]
    rows = in_order(truth_context, rows, partial(wrapped_difference, angles=angles))
    check_runs_of_truth(truth_context, rows, context)
    check_common_time(context, measured_rows, truth_context, rows)
    # Origin and distances are those of all files together.
    context.geodetic_file = truth_context.geodetic_file
    context.planar_file = truth_context.planar_file
    context.largest_distance = truth_context.largest_distance
    truth = truth_at(truth_context, rows, clock, context.runs, target.truth_gap, angles)
    context.notices += [f"truth: {notice}" for notice in truth_context.notices]
    return truth


def _context_of_further_file(
    context: ReadingContext, naming: Naming, keys: NamingKeys, has_own_keys: bool
) -> ReadingContext:
    """Return the context with which `read_rows` begins a file of inputs or of the truth.

    It is that of the measurements, with their origin and clock, but without their runs, files and
    notices. If ``has_own_keys``, the file has keys of units and zones of its own; otherwise it shares
    those of the measurements. ``naming`` and ``keys`` are those of the file. The chosen runs are those
    of the measurements, and the one run of a file without names of runs.
    """
    further = replace(
        context,
        naming=naming,
        keys=keys,
        runs=[],
        files=[],
        notices=[],
        unavailable=Counter(),
        chosen=(*context.runs, ONE_RUN),
    )
    if has_own_keys:
        further.used_keys = set()
        further.idle_keys = {}
    return further


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


def _with_file_names(target: RecordingKeys, notices: Sequence[str]) -> tuple[str, ...]:
    """Return the notices without repetitions, and with names of files in place of their full paths."""
    patterns = target.measurements
    if isinstance(patterns, str):
        patterns = (patterns,)
    named = list(notices)
    for path in [*patterns, target.truth, target.input_file]:
        if path is not None:
            folder = f"{Path(path).parent}{os.sep}"
            named = [notice.replace(folder, "") for notice in named]
    return tuple(dict.fromkeys(named))
