"""Order of a sensor's rows: late rows, a clock that falls, and several rows of one time."""

from collections.abc import Callable

import numpy as np

from trackbench.core.arrays import Array
from trackbench.durations import time_text
from trackbench.errors import and_others
from trackbench.field_types import DataError
from trackbench.scenarios.recordings.csv_tables import WholeNumbers
from trackbench.scenarios.recordings.rows import ReadingContext, Rows, usual_interval

_MOST_INTERVALS = 10.0
"""Largest fall of a clock, in usual intervals between rows, that late rows may explain."""
Difference = Callable[[Array, Array], Array]


def in_order(context: ReadingContext, rows: Rows, difference: Difference = np.subtract) -> Rows:
    """Sort the rows by run and time; report unsorted and repeated rows.

    Raises DataError if the clock falls far. Raises it also if two rows of a run have one time and
    different values, unless the key ``same_time`` says what becomes of them. ``difference`` subtracts
    values (n, R), and wraps angles.
    """
    # Step 1: bring the rows of each run together.
    order = np.argsort(rows.run, kind="stable")
    if (np.diff(order) != 1).any():
        rows = rows.at(order)
    # Step 2: sort by time within the runs if any row is late.
    same = rows.run[1:] == rows.run[:-1]
    if ((rows.time[1:] < rows.time[:-1]) & same).any():
        _check_falls(context, rows)
        rows = rows.at(np.lexsort((rows.time, rows.run)))
    # Step 3: find rows of one run at one time.
    ticks = rows.ticks
    again = np.flatnonzero((np.diff(ticks) == 0) & (rows.run[1:] == rows.run[:-1])) + 1
    if len(again):
        return _merge_equal_times(context, rows, again, difference)
    return rows


def _check_falls(context: ReadingContext, rows: Rows) -> None:
    """Add a note on rows that come after later ones. Raises DataError if the clock falls far."""
    late = 0
    largest = 0.0
    row_of_largest = 0  # row of the largest fall
    unit = "" if context.counts_steps else " s"
    # One run after the other: the rows of each are together.
    first_of_next_run = np.flatnonzero(np.diff(rows.run)) + 1
    for indices in np.split(np.arange(len(rows.run)), first_of_next_run):
        time = rows.time[indices]
        # A row is late by its distance to the latest time so far.
        falls = np.maximum.accumulate(time) - time
        late += int((falls > 0.0).sum())
        if falls.max() > largest:
            largest = float(falls.max())
            row_of_largest = int(indices[falls.argmax()])
            usual = usual_interval(time)
    if largest > _MOST_INTERVALS * usual:
        message = (
            f"time falls by {largest:.9g}{unit}, where rows usually are {usual:.9g}{unit} apart"
        )
        date_format = context.naming.time_format
        date_remedy = ""
        if date_format and "%d" not in date_format:
            date_remedy = " or say `columns: {date: NAME}`"
        remedy = f"write dates{date_remedy} or go on counting if a clock began anew, or sort"
        remedy += " the rows by time"
        week_remedy = _remedy_by_unread_column(context, "week")
        if week_remedy:
            remedy = f"{week_remedy}; or {remedy}"
        raise DataError(
            context.place(
                rows, row_of_largest, f"{message} ({late} rows come after later ones): {remedy}"
            )
        )
    message = f"{late} rows that came after later ones were put in order"
    context.notices.append(f"{message}; the largest fall is {largest:.9g}{unit}")


def _merge_equal_times(
    context: ReadingContext, rows: Rows, again: WholeNumbers, difference: Difference
) -> Rows:
    """Leave out repeated rows, and treat different rows of one time as the key ``same_time`` says.

    ``again`` are the indices of the rows whose time is that of the row before. ``difference`` subtracts
    values (n, R).
    """
    # Step 1: repeated rows agree if every value is equal or missing in both.
    now = rows.values[:, again]
    before = rows.values[:, again - 1]
    differ = ~((now == before) | (np.isnan(now) & np.isnan(before))).all(axis=0)
    # With `same_time: spread` equal rows are those of a target at rest, and none is left out.
    differ |= context.naming.same_time == "spread"
    if (~differ).any():
        message = "rows that say again what the one before says were left out"
        context.notices.append(f"{(~differ).sum()} {message}")
        # A row was received when the first of its repetitions was.
        remaining_rows = np.delete(np.arange(len(rows.run)), again[~differ])
        rows = rows.at(remaining_rows)._replace(
            received=np.minimum.reduceat(rows.received, remaining_rows)
        )
    if not differ.any():
        return rows
    # Step 2: number the times; rows of one time are neighbors.
    is_new = np.ones(len(rows.run), dtype=np.bool_)
    is_new[1:] = (np.diff(rows.ticks) != 0) | (np.diff(rows.run) != 0)
    first = np.flatnonzero(is_new)
    group = np.cumsum(is_new) - 1
    repeated = np.flatnonzero(~is_new)
    same_time = context.naming.same_time
    rest_remedy = _remedy_by_unread_column(context, "subsecond")
    if same_time is None:
        row = int(repeated[0])
        time = f"time {time_text(rows.time[row])} s"
        if context.counts_steps:
            time = f"step {rows.time[row]:.0f}"
        place = f"run {context.runs[rows.run[row]]}: {time}"
        message = f"{place} is there twice{and_others(len(repeated))}, and"
        hint = "say `same_time: mean`, `last` or `spread` (evenly until the next time)"
        if rest_remedy:
            hint = f"{rest_remedy}; or {hint}"
        raise DataError(context.place(rows, row, f"{message} not with the same values: {hint}"))
    context.notices.append(
        f"{len(repeated)} rows of a time that is there already: `same_time: {same_time}`"
    )
    if rest_remedy:
        context.notices.append(f"rows of one time differ, and {rest_remedy}")
    # Step 3: keep the last row, take the mean, or spread the times.
    last = np.append(first[1:], len(is_new)) - 1
    if same_time == "last":
        return rows.at(last)
    if same_time == "mean":
        means = _mean_of_groups(rows.values, first, group, difference)
        # A mean is known when the last of its rows has been received.
        received = np.maximum.reduceat(rows.received, first)
        return rows.at(first)._replace(values=means, received=received)
    return rows._replace(time=_spread_times(rows, first, last, group))


def _remedy_by_unread_column(context: ReadingContext, key: str) -> str:
    """Return the advice to read a column that looks like a further part of the time.

    ``key`` is ``week`` or ``subsecond``, the part. The text is empty if there is no such column.
    """
    if key not in context.unread_time_parts:
        return ""
    column, unit = context.unread_time_parts[key]
    remedy = f"`columns: {{{key}: {column}}}`"
    if unit not in (None, "ns"):
        remedy += f" and `units: {{{key}: {unit}}}`"
    return f"the column {column} may hold the rest of the time: say {remedy}"


def _mean_of_groups(
    values: Array, first: WholeNumbers, group: WholeNumbers, difference: Difference
) -> Array:
    """Return the mean values (n, G) of each group of rows with values (n, R); missing ones are left out.

    ``first`` (G,) are the groups' first rows, ``group`` (R,) is the number of each row's group.
    """
    # z_0 + mean(z - z_0), so that angles are averaged about the first existing value of the group.
    start = np.full((len(values), len(first)), np.nan)
    for row in range(int(np.bincount(group).max())):
        indices = np.minimum(first + row, len(group) - 1)
        in_group = group[indices] == np.arange(len(first))
        start = np.where(np.isnan(start) & in_group, values[:, indices], start)
    away = difference(values, start[:, group])
    total = np.zeros_like(start)
    count = np.zeros_like(start)
    for row_total, row_count, row_away in zip(total, count, away, strict=True):
        finite = np.isfinite(row_away)
        np.add.at(row_total, group[finite], row_away[finite])
        np.add.at(row_count, group[finite], 1.0)
    return np.where(count > 0.0, start + total / np.maximum(count, 1.0), np.nan)


def _spread_times(
    rows: Rows, first: WholeNumbers, last: WholeNumbers, group: WholeNumbers
) -> Array:
    """Return the times of all rows, those of each group spread evenly until the next group of the run.

    ``first`` and ``last`` (G,) are the groups' rows, ``group`` (R,) is the number of each row's group.
    """
    starts = rows.time[first]
    run = rows.run[first]
    intervals = np.diff(starts, append=np.nan)
    intervals[:-1][run[1:] != run[:-1]] = np.nan
    # After the last time of a run: the interval before, or one unit.
    before = np.concatenate([[np.nan], intervals[:-1]])
    instead = np.where(np.isnan(before), 1.0, before)
    widths = np.where(np.isnan(intervals), instead, intervals)
    number_in_group = np.arange(len(group)) - first[group]
    return starts[group] + number_in_group * widths[group] / (last - first + 1)[group]
