"""Alignment of measurements: one clock of all runs, which begins where the filters start."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Index
from trackbench.core.read_only import fixed
from trackbench.errors import counted
from trackbench.field_types import MOST_STEPS, DataError, InvalidKeyError, Place
from trackbench.models.sensors.stacked import sensor_name
from trackbench.scenarios.recordings.csv_tables import WholeNumbers
from trackbench.scenarios.recordings.rows import TICK, ReadingContext, Rows, usual_interval

ONE_RUN = "0"
"""Name of the run of one file without names of runs."""
_MOST_NAMES = 8
_MOST_CELLS = 200_000_000
_MOST_RECORDED = 5_000_000
"""steps of a recording that are read, of which a scenario takes those up to its `last`"""
_MANY_STEPS = 1.2
"""steps of all runs together, in those of the first, from which on a note says that a clock is shared"""
_EQUAL = 1e-6  # of an interval: a clock that strays by less has equal steps


class Clock(NamedTuple):
    """Steps that all runs of a recording share."""

    steps: Index
    """numbers (K + 1,) of the steps from the first state's on"""
    times: Array
    """times (K + 1,), s"""
    shift: Array
    """time (M,) that is added to each run's own, s"""
    T: float | None
    """time between two steps, s; None if it differs from step to step"""


class InitialScans(NamedTuple):
    """First scans of each of M runs, from which the filters are initialized."""

    time: Array
    """time (M,) of the last of them, s or steps, which is that of the first state"""
    scans: Array
    """measurements (n, s, M) of the s scans, which the filters do not get again"""
    scan_interval: Array
    """time (M,) between the last two scans, s or steps; NaN for one scan"""


def initial_scans(context: ReadingContext, rows: Rows, scans: int) -> InitialScans:
    """Return the first ``scans`` complete rows of each run, by which the filters are initialized.

    ``rows`` are those of the sensor that measures positions, in order of run and time. Raises DataError
    for a run with fewer complete rows.
    """
    runs = len(context.runs)
    # Rows with all components; the place of each run's first one among them, and how many it has.
    whole = np.flatnonzero(np.isfinite(rows.values).all(axis=0))
    first = np.searchsorted(rows.run[whole], np.arange(runs))
    number = np.searchsorted(rows.run[whole], np.arange(runs), side="right") - first
    for m in np.flatnonzero(number < scans).tolist():
        message = f"run {context.runs[m]} has {number[m]} positions, and its start takes {scans}"
        raise DataError(Place(context.files[0], 1, 1, message))
    # The rows (s, M) of the first scans of each run. The first state has the time of the last scan.
    rows_of_scans = np.stack([whole[first + i] for i in range(scans)])
    times = rows.time[rows_of_scans]
    scan_interval = np.full(runs, np.nan)
    if scans > 1:
        scan_interval = times[-1] - times[-2]
    return InitialScans(
        time=times[-1], scans=rows.values[:, rows_of_scans], scan_interval=scan_interval
    )


def note_on_rows_before_start(
    sensors: Sequence[Rows], start: InitialScans, locating: int, names: Sequence[str], unit: str
) -> list[str]:
    """Return a note on each sensor with measurements before the first state, which are left out.

    ``sensors`` are the rows of each sensor. The filters are initialized by the scans ``start`` of the
    sensor with the number ``locating``, from 0. ``names`` are those of the sensors in the recording, if
    it has any. ``unit`` is that of the times in the text.
    """
    notes = []
    for number, rows in enumerate(sensors):
        measured = np.isfinite(rows.values).any(axis=0)
        early = measured & (rows.time < start.time[rows.run] - TICK)
        if number == locating or not early.any():
            continue
        earlier = float((start.time[rows.run] - rows.time)[early].max())
        left_out = counted(int(early.sum()), "measurement")
        message = f"{left_out} of {sensor_name(number, names)} before the first state left out"
        reason = f"the start takes the first position of {sensor_name(locating, names)}"
        remedy = "if it begins late, list a sensor that begins earlier before it"
        notes.append(f"{message}, up to {earlier:.4g} {unit} earlier: {reason}; {remedy}")
    return notes


def common_clock(
    context: ReadingContext,
    sensors: Sequence[Rows],
    start: InitialScans | None,
    T: float,
    resample: float | None,
    first_measured: float,
) -> Clock:
    """Choose the steps that all runs share.

    If the file numbers its steps, these are all steps from the first to the last, T s apart. If
    ``resample`` is given, the steps are so many seconds apart. Otherwise there is a step at every time
    at which any run measured.

    ``sensors`` are the rows of each sensor. ``start`` has the scans that initialize the filters; the
    runs are shifted in time so that their first states coincide. Without scans (None) the first state is
    at the first row, if no sensor measured anything then, as in a log of wheels: ``first_measured`` is
    the first time at which one did. Otherwise the first state is one step, or an interval of the usual
    length, before the first row.
    """
    # Step 1: time of the first state; scans shift the runs so that their first states coincide.
    if start is None:
        shift = np.zeros(len(context.runs))
        begin = min(float(rows.time.min()) for rows in sensors)
        if begin > first_measured - TICK:
            begin -= _interval_before_first(context, sensors, resample)
    else:
        shift = start.time[0] - start.time
        begin = float(start.time[0])
    last = max(float((rows.time + shift[rows.run]).max()) for rows in sensors)
    # Step 2: equal steps, the file's own or resampled ones.
    spacing = 1.0 if context.counts_steps else resample
    if spacing is not None:
        number = _checked_number(context, np.floor((last - begin) / spacing + 0.5) + 1.0)
        steps = np.arange(number)
        if context.counts_steps:
            times = np.asarray(steps * T, dtype=float)
            clock = Clock(steps=steps + int(begin), times=times, shift=shift, T=T)
        else:
            times = np.asarray(steps * spacing, dtype=float) + begin
            clock = Clock(steps=steps, times=times, shift=shift, T=spacing)
    else:
        # Step 3: otherwise a step at every time at which any run measured.
        times = _union_of_times(sensors, shift, begin)
        steps = np.arange(len(times))
        clock = Clock(steps=steps, times=times, shift=shift, T=_equal_interval(times))
    if len(clock.steps) < 2:
        raise DataError(Place(context.files[0], 1, 1, "leaves nothing to measure after the start"))
    _checked_number(context, len(clock.steps))
    return clock


def _checked_number(context: ReadingContext, number: float) -> int:
    """Return the ``number`` of steps as an integer. Raises DataError if they are too many."""
    if number > _MOST_RECORDED:
        # The message has the limit of a scenario, which is lower.
        message = (
            f"gives {number:.9g} steps, more than {MOST_STEPS}: choose runs, or a longer `resample`"
        )
        raise DataError(Place(context.files[0], 1, 1, message))
    return int(number)


def _interval_before_first(
    context: ReadingContext, sensors: Sequence[Rows], resample: float | None
) -> float:
    """Return the time, s or steps, from a first state that takes no scans to the first row.

    It is one step, the length ``resample`` of resampled steps, or the usual interval in the run of the
    first row of the first sensor.
    """
    if context.counts_steps:
        return 1.0
    if resample is not None:
        return resample
    first = sensors[0]
    return usual_interval(first.time[first.run == first.run[0]])


def _union_of_times(sensors: Sequence[Rows], shift: Array, begin: float) -> Array:
    """Return the times (K + 1,) at which any run measured, in order, from that of the first state on.

    ``begin`` is this time, and earlier ones are left out. ``shift`` (M,) is added to the times of each
    run.
    """
    pieces = [np.array([begin])]
    # One time for each tick, first of every sensor and then of all.
    for rows in sensors:
        pieces.append(_one_per_tick(rows.time + shift[rows.run]))
    times = _one_per_tick(np.concatenate(pieces))
    return times[np.rint(times / TICK) >= np.rint(begin / TICK)]


def _one_per_tick(times: Array) -> Array:
    """Return the times in order, and of several times within one `TICK` only the first."""
    _, first = np.unique(np.rint(times / TICK), return_index=True)
    return times[first]


def _equal_interval(times: Array) -> float | None:
    """Return the interval of equally spaced times, s, to 12 digits; None if intervals differ."""
    intervals = np.diff(times)
    if not len(intervals):
        return None
    # Equal if each interval is the mean one within a share of _EQUAL.
    T = float((times[-1] - times[0]) / len(intervals))
    if np.abs(intervals - T).max() <= _EQUAL * T:
        return float(f"{T:.12g}")
    return None


def note_on_shared_clock(runs: Sequence[str], sensors: Sequence[Rows], clock: Clock) -> list[str]:
    """Return a note, in a list, if many steps of the common clock have no measurement of the first run.

    The list is empty otherwise. ``runs`` are the names of the runs, ``sensors`` the rows of each sensor.
    """
    if len(runs) < 2:
        return []
    ticks = [np.unique(rows.ticks[rows.run == 0]) for rows in sensors]
    steps_of_first_run = len(np.unique(np.concatenate(ticks)))
    steps = len(clock.steps)
    if steps <= _MANY_STEPS * steps_of_first_run:
        return []
    names = ", ".join(f"{m} is {name}" for m, name in enumerate(runs[:_MOST_NAMES]))
    if len(runs) > _MOST_NAMES:
        names += ", ..."
    message = f"{len(runs)} runs share {steps} steps, of which run {runs[0]} measured at"
    message += f" {steps_of_first_run}"
    reason = "each run is also judged at the times of the others"
    remedy = "a grid over `runs` gives each a clock of its own"
    return [f"{message}: {reason}; {remedy} (numbers of the runs: {names})"]


def measurement_array(
    context: ReadingContext, sensors: Sequence[Rows], clock: Clock, resampled: bool
) -> tuple[Array, Array | None]:
    """Return measurements (n_z, K, M) by step and run, NaN where there are none, and their arrivals.

    ``sensors`` are the rows of each of S sensors, whose components follow one another in n_z. If steps
    are ``resampled``, the row nearest to the step's time counts. The arrivals (S, K, M) are the steps,
    counted from 0, at which the measurements were received; None if the files have no such times.
    """
    steps = len(clock.steps)
    runs = len(context.runs)
    sizes = [len(rows.values) for rows in sensors]
    if sum(sizes) * steps * runs > _MOST_CELLS:
        message = f"{runs} runs of {steps} steps are too many: choose runs, or `resample`"
        raise InvalidKeyError(message, "target", "runs")
    measurements = np.full((sum(sizes), steps - 1, runs), np.nan)
    # Without a delay a measurement arrives at its own step.
    due = np.arange(steps - 1.0)[:, None]
    arrivals = None
    if context.has_delays:
        arrivals = np.broadcast_to(due, (len(sizes), steps - 1, runs)).copy()
    moved = 0.0  # longest time by which a measurement is moved
    left_out = 0
    first_row = 0  # of the sensor, among the measurements
    for n, (rows, size) in enumerate(zip(sensors, sizes, strict=True)):
        # Place the rows among the steps; only those after the first state are measurements.
        step_of_row, distance = _nearest_steps(context, rows, clock)
        used = np.flatnonzero(step_of_row > 0)
        if resampled:
            # Of several rows of a step the nearest in time counts.
            nearest = _nearest_rows(rows.run, step_of_row, distance, used)
            left_out += len(used) - len(nearest)
            moved = max(moved, float(distance[nearest].max(initial=0.0)))
            used = nearest
        for component in range(size):
            row = first_row + component
            measurements[row, step_of_row[used] - 1, rows.run[used]] = rows.values[component, used]
        first_row += size
        if arrivals is not None:
            received = np.maximum(_received_steps(context, rows, clock), step_of_row) - 1
            arrivals[n, step_of_row[used] - 1, rows.run[used]] = received[used]
    if resampled:
        message = f"resampled: measurements are taken to be up to {moved:.3g} s from when they were"
        if left_out:
            message += f", {left_out} of one step were left out"
        context.notices.append(message)
    if arrivals is not None:
        late = int((arrivals > due).sum())
        longest = int((arrivals - due).max())
        message = f"{late} measurements were received late, by {longest} steps at most"
        context.notices.append(message)
    return fixed(measurements), arrivals


def _received_steps(context: ReadingContext, rows: Rows, clock: Clock) -> Index:
    """Return the index (R,) of the first step of the clock at which each row has been received."""
    times = rows.received + clock.shift[rows.run]
    if context.counts_steps:
        return np.rint(times).astype(np.intp) - int(clock.steps[0])
    return np.searchsorted(clock.times, times - TICK, side="left")


def _nearest_steps(context: ReadingContext, rows: Rows, clock: Clock) -> tuple[Index, Array]:
    """Return the index (R,) of the clock's step nearest to each row, and its distance (R,) in time, s.

    The index is negative for a row before the first state.
    """
    times = rows.time + clock.shift[rows.run]
    if context.counts_steps:
        return np.rint(times).astype(np.intp) - int(clock.steps[0]), np.zeros_like(times)
    # The index of the nearest step is the number of middles between two steps that lie before the time.
    middles = 0.5 * (clock.times[1:] + clock.times[:-1])
    step_of_row = np.searchsorted(middles, times, side="right")
    # Rows before the first state have no step.
    step_of_row[times < clock.times[0] - TICK] = -1
    return step_of_row, np.abs(clock.times[np.maximum(step_of_row, 0)] - times)


def _nearest_rows(run: WholeNumbers, step_of_row: Index, distance: Array, rows: Index) -> Index:
    """Return, of the indices ``rows``, one for each run and step: that of the row nearest to the step.

    ``run``, ``step_of_row`` and ``distance`` (R,) are the run, the step and the distance in time of all
    rows.
    """
    # Sort by run, step and distance; take the first of each run and step.
    order = rows[np.lexsort((distance[rows], step_of_row[rows], run[rows]))]
    first = np.ones(len(order), dtype=np.bool_)
    first[1:] = (np.diff(step_of_row[order]) != 0) | (np.diff(run[order]) != 0)
    return order[first]


def with_scans(clock: Clock, context: ReadingContext, scans: int, scan_interval: Array) -> Clock:
    """Return the clock with a step before the first state for each scan of the start but the last one.

    ``scans`` is the number of scans of the start, ``scan_interval`` (M,) the time between the last two,
    s.
    """
    added = max(0, scans - 1)
    if not added:
        return clock
    before = np.arange(-added, 0)
    if context.counts_steps:
        assert clock.T is not None
        steps = np.concatenate([clock.steps[0] + before, clock.steps])
        return clock._replace(steps=steps, times=(steps - steps[0]) * clock.T)
    # Scans before the first state are as far apart as those of the first run.
    times = np.concatenate([clock.times[0] + before * scan_interval[0], clock.times])
    return clock._replace(steps=np.arange(len(times)), times=times)
