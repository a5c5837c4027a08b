"""Measurements as an array: the row nearest to each step of the clock, and its arrival."""

from collections.abc import Sequence

import numpy as np

from trackbench.core.arrays import Array, Index
from trackbench.core.read_only import fixed
from trackbench.errors import counted, counted_with_verb, form_for
from trackbench.field_types import InvalidKeyError
from trackbench.scenarios.recordings.parse_tables import WholeNumbers
from trackbench.scenarios.recordings.rows_and_reading_context import TICK, ReadingContext, Rows
from trackbench.scenarios.recordings.steps_of_all_runs import Clock

_MOST_CELLS = 200_000_000


def measurement_array(
    context: ReadingContext, sensors: Sequence[Rows], clock: Clock, resampled: bool
) -> tuple[Array, Array | None]:
    """Return measurements (n_z, K, M) by step and run, NaN where there are none, and their arrivals.

    There are K steps after that of the first state, with which the ``clock`` begins. ``sensors`` are the
    rows of each of S sensors, whose components follow one another in n_z. If steps are ``resampled``,
    the row nearest to the step's time counts. The arrivals (S, K, M) are the steps at which the
    measurements were received, where 0 is the first one after the first state; None if the files have no
    such times.
    """
    steps = len(clock.steps)  # K + 1, that of the first state included
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
            message += f", {left_out} of one step {form_for(left_out, 'was', 'were')} left out"
        context.notices.append(message)
    if arrivals is not None:
        late = int((arrivals > due).sum())
        longest = int((arrivals - due).max())
        message = f"{counted_with_verb(late, 'measurement')} received late"
        context.notices.append(f"{message}, by {counted(longest, 'step')} at most")
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
