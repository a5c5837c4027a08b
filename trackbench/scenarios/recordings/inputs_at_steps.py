"""Known inputs of motions at each step: the mean of the values that hold over it."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from trackbench.core.angles import near
from trackbench.core.arrays import Array, Index
from trackbench.core.read_only import fixed
from trackbench.field_types import DataError, InvalidKeyError
from trackbench.models.inputs import KnownInputs
from trackbench.scenarios.recordings.input_gaps import describe_gap
from trackbench.scenarios.recordings.read_inputs import InputRows, missing_run
from trackbench.scenarios.recordings.rows_and_reading_context import (
    ONE_RUN,
    TICK,
    ReadingContext,
    usual_interval,
)
from trackbench.scenarios.recordings.steps_of_all_runs import Clock

_MOST_INTERVALS = 1.5
"""Usual intervals between two rows over which a value holds, unless the config has a `gap`."""


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

    ``context`` is that of the inputs' file, ``names`` are those of the inputs. The inputs are the values
    of ``rows.measured``; ``rows.blank`` only show which line a message on a gap names. A row's values
    hold ``before`` its time, back to the row before, or ``after`` it, until the next row. They hold over
    ``gap`` at most, by default 1.5 usual intervals; it is in s, or in steps if the files number steps in
    place of times. ``rows.angles`` go on counting beyond a turn before their mean is taken, so that that
    of 359 and 1 deg is 0 or 360. ``resample`` is the length of resampled steps, s, None for others. The
    numbers of the rows' runs are those of ``runs``, but rows without names of runs are those of every
    run. Raises InvalidKeyError if the runs' inputs differ, since a motion has one table of them.
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
        shift = float(clock.shift[m])  # added to the run's times, so that they are the clock's
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
    # row, and the last measurement may come after the last one. The first state may be a whole resampled
    # step before the first row.
    margin = usual if resample is None else max(usual, resample)
    edges = np.concatenate([[row_times[0] - margin], row_times, [row_times[-1] + margin]])
    values = rows.measured.values
    if holds == "before":
        pieces = np.concatenate([values, values[:, -1:]], axis=1)
    else:
        pieces = np.concatenate([values[:, :1], values], axis=1)
    # Step 2: the piece in which each step begins, and the one in which it ends. Times that differ by
    # less than a TICK are one.
    earlier = times[:-1]
    later = times[1:]
    last_piece = pieces.shape[1] - 1
    first_of_step = np.clip(np.searchsorted(edges, earlier + TICK) - 1, 0, last_piece)
    last_of_step = np.clip(np.searchsorted(edges, later - TICK) - 1, 0, last_piece)
    unwrapped = pieces.copy()
    for i in rows.angles:
        unwrapped[i] = np.unwrap(pieces[i])
    means = _means(edges, unwrapped, earlier, later)
    # The mean of an angle is put within half a turn of the value with which its step begins.
    means = near(means, pieces[:, first_of_step], rows.angles)
    # Within one piece the value itself is exact, while the mean has been rounded.
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
        described = describe_gap(context, names, rows, shift, times, step, usual)
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
