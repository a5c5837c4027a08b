"""Recorded truth: its file, its columns and units, and its values at the steps of a recording."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from trackbench.core.angles import near, wrapped_difference
from trackbench.core.arrays import Array
from trackbench.core.read_only import fixed
from trackbench.durations import time_text
from trackbench.errors import counted, first_names, form_for
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.chosen_runs import chosen_runs
from trackbench.scenarios.recordings.naming_of_columns import Naming, NamingKeys
from trackbench.scenarios.recordings.read_rows_of_all_files import read_rows
from trackbench.scenarios.recordings.recording_keys import RecordingKeys
from trackbench.scenarios.recordings.row_order import in_order
from trackbench.scenarios.recordings.rows_and_reading_context import (
    ONE_RUN,
    TICK,
    ReadingContext,
    Rows,
    context_of_further_file,
)
from trackbench.scenarios.recordings.run_names_of_truth import MOST_NAMES, check_runs_of_truth
from trackbench.scenarios.recordings.steps_of_all_runs import Clock
from trackbench.scenarios.recordings.time_overlap_of_files import check_common_time
from trackbench.scenarios.recordings.truth_rows_check import notes_on_rows

_MANY_UNMEASURED = 0.2
"""share of the steps without a measurement, from which on they are noted"""


def note_on_steps_without_measurement(truth: Array, measurements: Array) -> list[str]:
    """Return a note, in a list, if many steps of a single run have a truth and no measurement.

    The list is empty otherwise. ``truth`` (n_x, K, 1) and ``measurements`` (n_z, K, 1) are those of the
    K steps after the start.
    """
    is_known = np.isfinite(truth[..., 0]).any(axis=0)
    is_measured = np.isfinite(measurements[..., 0]).any(axis=0)
    unmeasured = int((is_known & ~is_measured).sum())
    known = int(is_known.sum())
    if not unmeasured or unmeasured < _MANY_UNMEASURED * known:
        return []
    message = (
        f"{unmeasured} of {counted(known, 'step')} with a truth"
        f" {form_for(unmeasured, 'has', 'have')} no measurement, as rows whose cells for the sensors"
        " are empty: filters only predict there, and these errors count, too"
    )
    return [f"{message}; delete such rows if they should not"]


def truth_at(
    context: ReadingContext,
    rows: Rows,
    clock: Clock,
    runs: list[str],
    gap: float | None,
    angles: Sequence[int] = (),
) -> Array:
    """Return true states (n, K + 1, M) at the steps, interpolated between the rows.

    ``rows`` are those of the truth, in order, and ``runs`` are the names of the M runs of the
    measurements. Only rows that are at most ``gap`` apart (s, or steps) are interpolated, and no rows
    without a gap (None). Elsewhere the truth is NaN, as it is in a run without rows. Components
    ``angles``, by their number, turn the shorter way. A truth without names of runs is that of every
    run. Raises DataError if there is no truth at any step.
    """
    truth = np.full((len(rows.values), len(clock.steps), len(runs)), np.nan)
    times = clock.steps.astype(float) if context.counts_steps else clock.times
    number = {name: i for i, name in enumerate(context.runs)}
    is_shared = context.runs == [ONE_RUN]
    for m, name in enumerate(runs):
        i = 0 if is_shared else number.get(name)
        if i is None:
            continue
        # The run's rows, shifted in time as its measurements are.
        first, end = np.searchsorted(rows.run, [i, i + 1])
        row_times = rows.time[first:end] + clock.shift[m]
        truth[:, :, m] = _interpolate(row_times, rows.values[:, first:end], times, gap, angles)
    has_truth = np.isfinite(truth).any(axis=(0, 1))
    if not has_truth.any():
        hint = ": name a `truth_gap` within which it is interpolated"
        if gap is not None and len(rows.time):
            unit = " s"
            if context.counts_steps:
                unit = ""
            hint = f": its rows are from {time_text(rows.time.min())}"
            hint += f" to {time_text(rows.time.max())}{unit} of the clock, the steps from"
            hint += f" {time_text(times[0])} to {time_text(times[-1])}{unit}"
        raise DataError(Place(context.files[0], 1, 1, f"has no truth at any step{hint}"))
    without = [name for name, has in zip(runs, has_truth, strict=True) if not has]
    if without:
        shown = first_names(without, MOST_NAMES)
        verb = form_for(len(without), "has", "have")
        some = f"{len(without)} of {len(runs)} runs {verb} none at any step ({shown})"
        context.notices.append(f"{some}: errors are those of the others")
    return fixed(truth)


def _interpolate(
    row_times: Array, values: Array, times: Array, gap: float | None, angles: Sequence[int]
) -> Array:
    """Interpolate values (n, R) of rows at ``row_times`` (R,), in order, to ``times`` (K,): (n, K).

    They are NaN at times between rows that are more than ``gap`` apart; without a gap (None) there are
    values only at the times of rows. ``angles`` are the numbers of the values that turn the shorter way.
    """
    # Rows before and after each time; at the ends these are the first two and the last two rows.
    after = np.clip(np.searchsorted(row_times, times), 1, max(len(row_times) - 1, 1))
    before = after - 1
    interpolated = np.full((len(values), len(times)), np.nan)
    if len(row_times) > 1 and gap is not None:
        # Interpolate between rows that are near enough: v = v_0 + s (v_1 - v_0).
        interval = row_times[after] - row_times[before]
        share = (times - row_times[before]) / np.where(interval > 0.0, interval, 1.0)
        inside = (interval <= gap + TICK) & (share >= 0.0) & (share <= 1.0)
        next_values = near(values[:, after], values[:, before], angles)
        line = values[:, before] + share * (next_values - values[:, before])
        interpolated[:, inside] = line[:, inside]
    # At the time of a row its own values count.
    for row in (np.minimum(after, len(row_times) - 1), before):
        is_equal = np.abs(row_times[row] - times) < TICK
        interpolated[:, is_equal] = values[:, row[is_equal]]
    return interpolated


def read_truth(
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
    truth_context = context_of_further_file(context, naming, keys, has_own_keys)
    # A truth may lack some components, such as velocities, but must have one at least.
    (rows,) = read_rows(truth_context, [target.truth], [target.components], least=1)
    if target.truth_naming:
        truth_context.check_idle_keys()
    # No run is chosen here: all runs of the truth are kept, and only numbered anew.
    (rows,) = chosen_runs(truth_context, [rows], chosen=())
    angles = [i for i, name in enumerate(target.components) if name in target.angles]
    rows = in_order(truth_context, rows, partial(wrapped_difference, angles=angles))
    check_runs_of_truth(truth_context, rows, context)
    check_common_time(context, measured_rows, truth_context, rows)
    truth_context.notices += notes_on_rows(truth_context, target.components, rows)
    # Origin and distances are those of all files together.
    context.geodetic_file = truth_context.geodetic_file
    context.planar_file = truth_context.planar_file
    context.largest_distance = truth_context.largest_distance
    truth = truth_at(truth_context, rows, clock, context.runs, target.truth_gap, angles)
    context.notices += [f"truth: {notice}" for notice in truth_context.notices]
    return truth
