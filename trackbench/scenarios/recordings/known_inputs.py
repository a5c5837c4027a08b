"""Known inputs of motions, such as recorded odometry: the values that hold over each step."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Literal, NamedTuple

import numpy as np

from trackbench.core.angles import near, wrapped_difference
from trackbench.core.arrays import Array, Index
from trackbench.core.read_only import fixed
from trackbench.durations import time_text
from trackbench.errors import Answer, counted
from trackbench.field_types import DataError, InvalidKeyError, Place
from trackbench.models.inputs import InputGap, KnownInputs
from trackbench.scenarios.recordings.chosen_runs import chosen_runs
from trackbench.scenarios.recordings.column_mapping import Naming, NamingKeys
from trackbench.scenarios.recordings.common_clock import ONE_RUN, Clock
from trackbench.scenarios.recordings.file_overlap import check_common_time
from trackbench.scenarios.recordings.further_files import context_of_further_file
from trackbench.scenarios.recordings.read_rows import read_rows
from trackbench.scenarios.recordings.recording_keys import RecordingKeys
from trackbench.scenarios.recordings.row_order import in_order
from trackbench.scenarios.recordings.rows import TICK, ReadingContext, Rows, usual_interval
from trackbench.scenarios.recordings.undeclared_angles import has_turns
from trackbench.scenarios.recordings.units import DIMENSIONS

_ROUNDING = 1e-6
"""rad beyond one turn, that a recorded angle may have by its digits"""
_MOST_INTERVALS = 1.5
"""Usual intervals between two rows over which a value holds, unless the config has a `gap`."""
_MOST_MISTAKES = 20
"""mistakes that are listed, of which the last one has the number of all others"""
_MOST_OUTSIDE = 0.5
"""share of the measurements, of which fewer may lie before the first and after the last inputs"""


class InputRows(NamedTuple):
    """Rows of a table of inputs."""

    measured: Rows
    """rows with all inputs, in order of time"""
    blank: Rows
    """rows without any input; they only show which line a message on a gap names"""
    angles: Sequence[int]
    """numbers of the inputs that are angles, rad, within one turn"""


def with_inputs_only(context: ReadingContext, names: Sequence[str], rows: Rows) -> InputRows:
    """Separate the rows with all inputs, which are put in order, from those without any.

    ``names`` are those of the inputs, which the values (n, R) of ``rows`` are. Raises DataError for rows
    with only some of them.
    """
    is_missing = np.isnan(rows.values)
    has_all = ~is_missing.any(axis=0)
    has_none = is_missing.all(axis=0)
    incomplete = np.flatnonzero(~has_all & ~has_none)
    if len(incomplete):
        mistakes = []
        for row in incomplete[:_MOST_MISTAKES].tolist():
            name = names[int(np.flatnonzero(is_missing[:, row])[0])]
            message = f"{name}: there is no value beside the other inputs: fill the cell"
            mistakes.append(context.place(rows, row, message))
        left_out = len(incomplete) - len(mistakes)
        if left_out:
            message = f"{mistakes[-1].message}; nor have {left_out} more rows all inputs"
            mistakes[-1] = mistakes[-1]._replace(message=message)
        raise DataError(*mistakes)
    if not has_all.any():
        message = f"the columns of the inputs {', '.join(names)} are empty"
        raise DataError(Place(context.files[0], 1, 1, message))
    complete = rows.at(np.flatnonzero(has_all))
    angles = _wrapped_angles(context, names, complete)
    measured = in_order(context, complete, partial(wrapped_difference, angles=angles))
    return InputRows(measured=measured, blank=rows.at(np.flatnonzero(has_none)), angles=angles)


def _wrapped_angles(context: ReadingContext, names: Sequence[str], rows: Rows) -> list[int]:
    """Return the numbers of the inputs that are angles within one turn, whose values jump where it ends.

    These inputs have a unit of angles and values within one turn, or their values jump by whole turns
    and change by far less otherwise. An angle that goes on counting beyond a turn is a number like
    others. ``names`` are those of the inputs.
    """
    angles = []
    for i, name in enumerate(names):
        values = rows.values[i]
        has_unit = context.naming.units.get(name) in DIMENSIONS["angle"]
        is_within_turn = np.ptp(values) <= 2.0 * np.pi + _ROUNDING
        values_of_runs = [values[rows.run == m] for m in np.unique(rows.run)]
        jumps_by_turns = any(has_turns(of_run[:, None]) for of_run in values_of_runs)
        if jumps_by_turns or (has_unit and is_within_turn):
            angles.append(i)
    return angles


def rows_within(
    context: ReadingContext,
    measured_rows: Sequence[Rows],
    of_inputs: ReadingContext,
    inputs: InputRows,
) -> list[Rows]:
    """Return the measurements between the first and the last inputs of their run, with a note on others.

    ``measured_rows`` are the measurements of each sensor. ``inputs`` are the rows of another file, whose
    context is ``of_inputs``, while ``context`` is that of the measurements. If most rows would be left
    out, all of them stay, since the files hardly belong together, and the missing inputs are an error.
    """
    is_shared = of_inputs.runs == [ONE_RUN]
    first = np.full(len(context.runs), -np.inf)
    last = np.full(len(context.runs), np.inf)
    for m in range(len(context.runs)):
        times = inputs.measured.time[inputs.measured.run == (0 if is_shared else m)]
        # A run without inputs keeps its rows; `inputs_at` raises the error.
        if len(times):
            first[m] = times.min() - TICK
            # The last values hold for one interval more.
            last[m] = times.max() + usual_interval(times) + TICK
    inside = [
        (rows.time >= first[rows.run]) & (rows.time <= last[rows.run]) for rows in measured_rows
    ]
    number = sum(len(mask) for mask in inside)
    outside = number - sum(int(mask.sum()) for mask in inside)
    if outside == 0 or outside >= _MOST_OUTSIDE * number:
        return list(measured_rows)
    message = f"{counted(outside, 'row')} of measurements before the first or after the last inputs"
    context.notices.append(f"{message} ({of_inputs.files[0]}) left out")
    return [rows.at(np.flatnonzero(mask)) for rows, mask in zip(measured_rows, inside, strict=True)]


def missing_run(path: str, run: str, names: Sequence[str]) -> Place:
    """Return the mistake of the file at ``path``, which has no inputs ``names`` for the ``run``."""
    message = f"run {run} has no rows with the inputs {', '.join(names)}"
    return Place(path, 1, 1, message)


def inputs_at(
    context: ReadingContext,
    names: Sequence[str],
    rows: InputRows,
    clock: Clock,
    runs: Sequence[str],
    holds: Literal["before", "after"],
    gap: float | None,
    resample: float | None,
) -> KnownInputs:
    """Return the inputs of each step of the clock: their mean over the time since the step before.

    ``context`` is that of the inputs' file, ``names`` are those of the inputs. They are the values of
    ``rows.measured``; ``rows.blank`` only show which line a message on a gap names. A row's values hold
    ``before`` its time, back to the row before, or ``after`` it, until the next row; over ``gap`` (s, or
    steps) at most, by default 1.5 usual intervals. ``rows.angles`` go on counting beyond a turn before
    their mean is taken, so that that of 359 and 1 deg is 0 or 360. ``resample`` is the length of
    resampled steps, s, None for others. The numbers of the rows' runs are those of ``runs``, but rows
    without names of runs are those of every run. Raises InvalidKeyError if the runs' inputs differ,
    since a motion has one table of them.
    """
    # Rows without names of runs all have the number 0, and hold for every run.
    is_shared = context.runs == [ONE_RUN]
    tables = []
    for m, name in enumerate(runs):
        number_in_rows = 0 if is_shared else m
        of_run = np.flatnonzero(rows.measured.run == number_in_rows)
        if not len(of_run):
            raise DataError(missing_run(context.files[0], name, names))
        blank = rows.blank.at(np.flatnonzero(rows.blank.run == number_in_rows))
        shift = float(clock.shift[m])
        one_run = InputRows(measured=rows.measured.at(of_run), blank=blank, angles=rows.angles)
        tables.append(_inputs_of_run(context, names, one_run, clock, shift, holds, gap, resample))
    first = tables[0]
    for name, table in zip(runs, tables, strict=True):
        if not np.array_equal(first.values, table.values, equal_nan=True):
            message = f"runs {runs[0]} and {name} have different inputs, and a motion has one table"
            remedy = f"choose one run, `runs: [{runs[0]}]`, or make the runs values of a grid"
            raise InvalidKeyError(f"{message}; {remedy}", "target", "input")
    return first


def _inputs_of_run(
    context: ReadingContext,
    names: Sequence[str],
    rows: InputRows,
    clock: Clock,
    shift: float,
    holds: Literal["before", "after"],
    gap: float | None,
    resample: float | None,
) -> KnownInputs:
    """Return the inputs of one run; ``shift`` is added to its times, so that they are the clock's.

    ``rows`` are those of the run, and ``names`` are those of the inputs. A row's values hold ``before``
    its time or ``after`` it, as ``holds`` says, over ``gap`` (s, or steps) at most. ``resample`` is the
    length of resampled steps, s, or None.
    """
    # Step 1: the inputs are piecewise constant in time. Each piece lasts from one edge to the next.
    times = clock.steps.astype(float) if context.counts_steps else clock.times
    row_times = rows.measured.time + shift
    usual = usual_interval(row_times)
    longest = _MOST_INTERVALS * usual if gap is None else gap
    # The first and last values hold for one interval more, as the first state lies before the first
    # row, and the last measurement may come after the last one.
    margin = usual if resample is None else max(usual, resample)
    edges = np.concatenate([[row_times[0] - margin], row_times, [row_times[-1] + margin]])
    values = rows.measured.values
    if holds == "before":
        pieces = np.concatenate([values, values[:, -1:]], axis=1)
    else:
        pieces = np.concatenate([values[:, :1], values], axis=1)
    # Step 2: the piece in which each step begins, and the one in which it ends.
    earlier = times[:-1]
    later = times[1:]
    last_piece = pieces.shape[1] - 1
    first_of_step = np.clip(np.searchsorted(edges, earlier + TICK) - 1, 0, last_piece)
    last_of_step = np.clip(np.searchsorted(edges, later - TICK) - 1, 0, last_piece)
    unwrapped = pieces.copy()
    for i in rows.angles:
        unwrapped[i] = np.unwrap(pieces[i])
    means = _means(edges, unwrapped, earlier, later)
    means = near(means, pieces[:, first_of_step], rows.angles)
    is_constant = first_of_step == last_of_step
    means[:, is_constant] = pieces[:, first_of_step[is_constant]]
    # Step 3: a step has no inputs outside the rows, nor if a piece within it is longer than the gap.
    is_long = np.diff(edges) > longest + TICK
    is_long[[0, -1]] = False  # the margins
    long_pieces_before = np.concatenate([[0], np.cumsum(is_long)])
    is_missing = long_pieces_before[last_of_step + 1] > long_pieces_before[first_of_step]
    is_missing |= (earlier < edges[0] - TICK) | (later > edges[-1] + TICK)
    means[:, is_missing] = np.nan
    table = np.full((len(values), len(times)), np.nan)
    table[:, 1:] = means
    known = KnownInputs(names=tuple(names), first=int(clock.steps[0]), values=fixed(table))
    # Step 4: describe the gaps. Several steps may be within one of them.
    missing_steps = np.flatnonzero(is_missing) + 1
    rows_before = np.searchsorted(row_times, times[missing_steps - 1] + TICK, side="right")
    _, first_of_gaps = np.unique(rows_before, return_index=True)
    gaps = []
    for step in missing_steps[first_of_gaps].tolist():
        described = _describe_gap(context, names, rows, shift, times, step, usual)
        gaps.append(described._replace(step=int(clock.steps[step])))
    return replace(known, gaps=tuple(gaps))


def _means(edges: Array, pieces: Array, earlier: Array, later: Array) -> Array:
    """Return the means (n, K) of piecewise constant values over intervals.

    The ``pieces`` (n, P) lie between ``edges`` (P + 1,); the intervals last from ``earlier`` to
    ``later`` (K,).
    """
    # C(t) is the integral from the first edge to t.
    integrals = np.cumsum(pieces * np.diff(edges), axis=1)
    integrals = np.concatenate([np.zeros((len(pieces), 1)), integrals], axis=1)
    means = np.empty((len(pieces), len(earlier)))
    for row, integral in enumerate(integrals):
        change = np.interp(later, edges, integral) - np.interp(earlier, edges, integral)
        means[row] = change / (later - earlier)
    return means


def _describe_gap(
    context: ReadingContext,
    names: Sequence[str],
    rows: InputRows,
    shift: float,
    times: Array,
    step: int,
    usual: float,
) -> InputGap:
    """Return the gap of the inputs in which a step begins: a message with a place in the file.

    ``step`` is the index, among the ``times`` of the steps, of the time at which this step ends. The
    place is the blank row in the gap, or the row before it. ``shift`` is added to the times of ``rows``,
    and ``usual`` is their usual interval. The gap has no length if it lies before or after all rows.
    """
    unit = f" {context.time_unit}"
    inputs = ", ".join(names)
    row_times = rows.measured.time + shift
    before = int(np.searchsorted(row_times, times[step - 1] + TICK, side="right")) - 1
    after = min(before + 1, len(row_times) - 1)
    low = row_times[before] if before >= 0 else -np.inf
    high = row_times[after] if after > before else np.inf
    if before < 0:
        message = f"the first values of the inputs {inputs} are at {time_text(row_times[0])}{unit}"
        message += f", and the first step begins at {time_text(times[step - 1])}{unit}"
        place = context.place(rows.measured, 0, f"{message}: give earlier values")
        return InputGap(place=place, step=step)
    if after == before:
        message = f"the inputs {inputs} end at {time_text(row_times[-1])}{unit}"
        message += f", and a step ends at {time_text(times[step])}{unit}"
        place = context.place(rows.measured, before, f"{message}: give later values, or say `last`")
        return InputGap(place=place, step=step)
    length = float(row_times[after] - row_times[before])
    blank_times = rows.blank.time + shift
    blank_in_gap = np.flatnonzero((blank_times > low + TICK) & (blank_times < high - TICK))
    if len(blank_in_gap):
        message = f"there is no value of the inputs {inputs}"
        place = context.place(rows.blank, int(blank_in_gap[0]), message)
    else:
        message = f"no values of the inputs {inputs} follow for {length:.4g}{unit}"
        message += f", where {usual:.4g}{unit} are usual"
        place = context.place(rows.measured, before, message)
    return InputGap(place=place, step=step, length=length)


def check_gaps(inputs: KnownInputs, last_step: int) -> None:
    """Raise DataError if a gap of the inputs begins up to ``last_step``, the scenario's last step."""
    gaps = [gap for gap in inputs.gaps if gap.step <= last_step]
    if not gaps:
        return
    # The key `input_gap` fills all gaps between two rows if it is as long as the longest one. A gap
    # before or after all rows has no length (None), and no gap is long enough for it.
    longest = max((gap.length for gap in gaps if gap.length is not None), default=0.0)
    mistakes = []
    for gap in gaps[:_MOST_MISTAKES]:
        message = gap.place.message
        answer = None
        if gap.length is not None:
            answer = Answer("input_gap", f"{_rounded_up(longest):g}")
            message += f": fill them, or say {answer.in_yaml} to hold the nearest values"
        mistakes.append(gap.place._replace(message=message, answer=answer))
    left_out = len(gaps) - len(mistakes)
    if left_out:
        message = f"{mistakes[-1].message}; there are {counted(left_out, 'more gap')}"
        mistakes[-1] = mistakes[-1]._replace(message=message)
    raise DataError(*mistakes)


def _rounded_up(length: float) -> float:
    """Round a positive time up to two digits: 0.123 becomes 0.13."""
    digit = 10.0 ** (np.floor(np.log10(length)) - 1.0)
    return float(f"{np.ceil(length / digit - 1e-9) * digit:.3g}")


def aligned_with(inputs: KnownInputs, steps: Index) -> KnownInputs:
    """Return the inputs with a column for each of the ``steps``, which begin earlier than the inputs.

    The added columns are NaN, and the gaps get the numbers of the new steps.
    """
    added = len(steps) - inputs.values.shape[1]
    # The first step with inputs, `inputs.first`, may have another number among ``steps``.
    shift = int(steps[0]) + added - inputs.first
    values = np.pad(inputs.values, [(0, 0), (added, 0)], constant_values=np.nan)
    gaps = tuple(gap._replace(step=gap.step + shift) for gap in inputs.gaps)
    return replace(inputs, first=int(steps[0]), values=fixed(values), gaps=gaps)


def read_inputs(
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
    input_context = context_of_further_file(context, naming, keys, has_own_keys)
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
