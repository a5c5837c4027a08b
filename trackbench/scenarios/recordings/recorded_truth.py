"""Recorded truth: the names of its runs, and its values between rows at the steps of a recording."""

import re
from collections.abc import Sequence

import numpy as np

from trackbench.core.angles import near
from trackbench.core.arrays import Array
from trackbench.core.read_only import fixed
from trackbench.durations import time_text
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.rows import TICK, ReadingContext, Rows
from trackbench.scenarios.recordings.time_alignment import ONE_RUN, Clock

_MOST_NAMES = 8


def check_runs_of_truth(of_truth: ReadingContext, rows: Rows, measured: ReadingContext) -> None:
    """Raise DataError if runs lack a truth because the file of the truth spells their names otherwise.

    ``of_truth`` is the context of the truth, ``rows`` are its rows, and ``measured`` is the context of
    the measurements. A truth without names of runs is that of every run. Then all runs must have one
    origin.
    """
    path = of_truth.files[0]
    if of_truth.runs == [ONE_RUN]:
        if measured.own_origins:
            name = next(iter(measured.own_origins))
            message = f"names no runs, and run {name} has an origin of its own, far from the others"
            remedy = "give the truth a column `run`, or choose runs near each other by `runs`"
            raise DataError(Place(path, 1, 1, f"{message}: {remedy}"))
        return
    # Runs of the measurements without rows of the truth.
    known = {of_truth.runs[number] for number in np.unique(rows.run).tolist()}
    without = [name for name in measured.runs if name not in known]
    if not without:
        return
    shown = _first_names(without)
    if len(without) == len(measured.runs):
        existing = _first_names(of_truth.runs)
        message = f"has no run {shown}; there are {existing}: give runs one name in both files"
        if measured.runs == [ONE_RUN]:
            message = (
                f"names runs, {existing}, and the measurements name none: leave in it the rows"
            )
            message += " of the run that was measured, or name the runs of both files alike"
        raise DataError(Place(path, 1, 1, message))
    # Names that differ by zeros before them, spaces or capital letters may well be the same run's.
    others = {_plain_spelling(name): name for name in of_truth.runs if name not in measured.runs}
    for name in without:
        other = others.get(_plain_spelling(name))
        if other is not None:
            message = (
                f"has no run {name!r}, but {other!r} ({len(without)} runs have no truth: {shown})"
            )
            remedy = "write the name alike in both files, or leave the run out by `runs`"
            raise DataError(Place(path, 1, 1, f"{message}: {remedy}"))


def _first_names(names: Sequence[str]) -> str:
    """Return the first names as a text, which ends with dots if there are more."""
    text = ", ".join(names[:_MOST_NAMES])
    if len(names) > _MOST_NAMES:
        text += ", ..."
    return text


def _plain_spelling(name: str) -> str:
    """Return a run's name without zeros before numbers, signs and capital letters.

    The name Run-007 becomes ``run 7``.
    """
    words = []
    for word in re.findall(r"[^\W\d_]+|[0-9]+", name.casefold()):
        if word.isdigit():
            word = word.lstrip("0") or "0"
        words.append(word)
    return " ".join(words)


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
        shown = _first_names(without)
        some = f"{len(without)} of {len(runs)} runs have none at any step ({shown})"
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
