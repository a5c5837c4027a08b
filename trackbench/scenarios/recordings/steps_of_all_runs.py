"""One clock of all runs, which begins where the filters start."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Index
from trackbench.errors import counted, first_names
from trackbench.field_types import MOST_STEPS, DataError, Place
from trackbench.scenarios.recordings.equal_steps import equal_interval
from trackbench.scenarios.recordings.rows_and_reading_context import (
    ONE_RUN,
    TICK,
    ReadingContext,
    Rows,
    usual_interval,
)

_MOST_NAMES = 8
_MOST_RECORDED = 5_000_000
"""steps of a recording that are read, of which a scenario takes those up to its `last`"""
_MANY_STEPS = 1.2
"""steps of all runs together, in those of the first, from which on a note says that a clock is shared"""


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


def common_clock(
    context: ReadingContext,
    sensors: Sequence[Rows],
    first_states: Array | None,
    T: float,
    resample: float | None,
    first_measured: float,
) -> Clock:
    """Choose the steps that all runs share.

    If the file numbers its steps, these are all steps from the first to the last, T s apart. If
    ``resample`` is given, the steps are so many seconds apart. Otherwise there is a step at every time
    at which any run measured.

    ``sensors`` are the rows of each sensor. ``first_states`` (M,) are the times, s or steps, of the
    first states if scans initialize the filters; the runs are shifted in time so that these coincide.
    Without scans (None) the first state is at the first row, if no sensor measured anything then, as in
    a log of wheels: ``first_measured`` is the first time at which one did. Otherwise the first state is
    one step, or an interval of the usual length, before the first row.
    """
    # Step 1: time of the first state; scans shift the runs so that their first states coincide. In a
    # file that numbers its steps, ``rows.time`` and all times of this step are these numbers.
    if first_states is None:
        shift = np.zeros(len(context.runs))
        begin = min(float(rows.time.min()) for rows in sensors)
        if begin > first_measured - TICK:
            begin -= _interval_before_first(context, sensors, resample)
    else:
        shift = first_states[0] - first_states
        begin = float(first_states[0])
    last = max(float((rows.time + shift[rows.run]).max()) for rows in sensors)
    # Step 2: equal steps, the file's own or resampled ones.
    spacing = 1.0 if context.counts_steps else resample
    if spacing is not None:
        number = _checked_number(context, np.floor((last - begin) / spacing + 0.5) + 1.0)
        steps = np.arange(number)
        if context.counts_steps:
            # The steps keep their numbers, and time counts from the first state.
            times = np.asarray(steps * T, dtype=float)
            clock = Clock(steps=steps + int(begin), times=times, shift=shift, T=T)
        else:
            # Times stay those of the file, and steps are numbered from the first state.
            times = np.asarray(steps * spacing, dtype=float) + begin
            clock = Clock(steps=steps, times=times, shift=shift, T=spacing)
    else:
        # Step 3: otherwise a step at every time at which any run measured.
        times = _union_of_times(sensors, shift, begin)
        steps = np.arange(len(times))
        clock = Clock(steps=steps, times=times, shift=shift, T=equal_interval(times))
    if len(clock.steps) < 2:
        raise DataError(Place(context.files[0], 1, 1, _describe_short_runs(context, sensors)))
    _checked_number(context, len(clock.steps))
    return clock


def _describe_short_runs(context: ReadingContext, sensors: Sequence[Rows]) -> str:
    """Explain that no run has a row after the first state, and what to do.

    ``sensors`` are the rows of each sensor. The message names the runs, and at how many times one has
    rows.
    """
    run_numbers = np.concatenate([rows.run for rows in sensors])
    ticks = np.concatenate([rows.ticks for rows in sensors])
    different_rows = np.unique(np.stack([run_numbers, ticks]), axis=1)
    most = int(np.bincount(different_rows[0].astype(np.intp)).max())
    reason = f"rows at {counted(most, 'time')}, so that nothing is left to measure after the start"
    if context.runs == [ONE_RUN]:
        return f"has {reason}: take a longer recording"
    names = first_names(context.runs, _MOST_NAMES)
    subject = f"run {names} has"
    if len(context.runs) > 1:
        subject = f"each of the runs {names} has at most"
    return f"{subject} {reason}: choose longer runs by `runs`, also in a `grid`"


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
    names = first_names([f"{m} is {name}" for m, name in enumerate(runs)], _MOST_NAMES)
    message = f"{len(runs)} runs share {steps} steps, of which run {runs[0]} measured at"
    message += f" {steps_of_first_run}"
    reason = "each run is also judged at the times of the others"
    remedy = "a grid over `runs` gives each a clock of its own"
    return [f"{message}: {reason}; {remedy} (numbers of the runs: {names})"]
