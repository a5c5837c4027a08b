"""Rows of one time: exact copies are left out, others treated as the key `same_time` says."""

from collections.abc import Callable

import numpy as np

from trackbench.core.arrays import Array
from trackbench.durations import time_text
from trackbench.errors import Answer, and_others
from trackbench.field_types import DataError
from trackbench.scenarios.recordings.csv_tables import WholeNumbers
from trackbench.scenarios.recordings.rows import ReadingContext, Rows

Difference = Callable[[Array, Array], Array]
"""Function that subtracts values (n, R) from values, and may wrap those that are angles."""


def merge_equal_times(
    context: ReadingContext, rows: Rows, repeated: WholeNumbers, difference: Difference
) -> Rows:
    """Leave out repeated rows, and treat different rows of one time as the key ``same_time`` says.

    ``repeated`` are the indices of the rows whose time is that of the row before. ``difference``
    subtracts values (n, R), and wraps angles. Raises DataError if the key is not set.
    """
    # Step 1: repeated rows agree if every value is equal or missing in both.
    now = rows.values[:, repeated]
    before = rows.values[:, repeated - 1]
    differ = ~((now == before) | (np.isnan(now) & np.isnan(before))).all(axis=0)
    # With `same_time: spread` equal rows are those of a target at rest, and none is left out.
    differ |= context.naming.same_time == "spread"
    if (~differ).any():
        message = "rows that say again what the one before says were left out"
        context.notices.append(f"{(~differ).sum()} {message}")
        # A row was received when the first of its repetitions was.
        remaining_rows = np.delete(np.arange(len(rows.run)), repeated[~differ])
        rows = rows.at(remaining_rows)._replace(
            received=np.minimum.reduceat(rows.received, remaining_rows)
        )
    if not differ.any():
        return rows
    # Step 2: number the groups of rows of one run and time, which are neighbors. Times are equal if they
    # are in whole ticks.
    is_new = np.ones(len(rows.run), dtype=np.bool_)
    is_new[1:] = (np.diff(rows.ticks) != 0) | (np.diff(rows.run) != 0)
    first = np.flatnonzero(is_new)
    group = np.cumsum(is_new) - 1
    not_first = np.flatnonzero(~is_new)
    same_time = context.naming.same_time
    # Rows of one time may differ by a part of the second, in a column that is not read.
    subsecond_remedy = remedy_by_unread_column(context, "subsecond")
    if same_time is None:
        row = int(not_first[0])
        time = f"time {time_text(rows.time[row])} s"
        if context.counts_steps:
            time = f"step {rows.time[row]:.0f}"
        place = f"run {context.runs[rows.run[row]]}: {time}"
        message = f"{place} is there twice{and_others(len(not_first))}, and"
        hint = "say `same_time: mean`, `last` or `spread` (evenly until the next time)"
        if subsecond_remedy:
            hint = f"{subsecond_remedy}; or {hint}"
        mistake = context.place(rows, row, f"{message} not with the same values: {hint}")
        raise DataError(mistake._replace(answer=Answer("same_time", "mean")))
    context.notices.append(
        f"{len(not_first)} rows of a time that is there already: `same_time: {same_time}`"
    )
    if subsecond_remedy:
        context.notices.append(f"rows of one time differ, and {subsecond_remedy}")
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


def remedy_by_unread_column(context: ReadingContext, key: str) -> str:
    """Return the advice to read an unread column that looks like a further part of the time.

    ``key`` is the part, ``week`` or ``subsecond``. The text is empty if there is no such column.
    """
    if key not in context.unread_time_parts:
        return ""
    column, unit = context.unread_time_parts[key]
    remedy = f"`columns: {{{key}: {column}}}`"
    # Weeks have no unit, and ns is the default of a part of a second.
    if unit not in (None, "ns"):
        remedy += f" and `units: {{{key}: {unit}}}`"
    return f"the column {column} may hold the rest of the time: say {remedy}"


def _mean_of_groups(
    values: Array, first: WholeNumbers, group: WholeNumbers, difference: Difference
) -> Array:
    """Return the mean values (n, G) of each group of rows with values (n, R); missing ones are left out.

    The rows of a group follow each other. ``first`` (G,) are the groups' first rows, ``group`` (R,) is
    the number of each row's group. ``difference`` subtracts values (n, R), and wraps angles.
    """
    # Step 1: z_0 is the first existing value of each group.
    start = np.full((len(values), len(first)), np.nan)
    for row in range(int(np.bincount(group).max())):
        indices = np.minimum(first + row, len(group) - 1)
        in_group = group[indices] == np.arange(len(first))
        start = np.where(np.isnan(start) & in_group, values[:, indices], start)
    # Step 2: the mean is z_0 + mean(z - z_0), so that angles are averaged about z_0.
    differences = difference(values, start[:, group])
    total = np.zeros_like(start)
    count = np.zeros_like(start)
    for row_total, row_count, row_differences in zip(total, count, differences, strict=True):
        finite = np.isfinite(row_differences)
        np.add.at(row_total, group[finite], row_differences[finite])
        np.add.at(row_count, group[finite], 1.0)
    return np.where(count > 0.0, start + total / np.maximum(count, 1.0), np.nan)


def _spread_times(
    rows: Rows, first: WholeNumbers, last: WholeNumbers, group: WholeNumbers
) -> Array:
    """Return the times (R,) of all rows, those of each group spread evenly until the next group.

    A group has the rows of one run and time. ``first`` and ``last`` (G,) are the groups' first and last
    rows, ``group`` (R,) is the number of each row's group.
    """
    starts = rows.time[first]
    run = rows.run[first]
    # From each group to the next one of its run, NaN for the last one.
    intervals = np.diff(starts, append=np.nan)
    intervals[:-1][run[1:] != run[:-1]] = np.nan
    # The last group of a run gets the interval before, or 1 (s, or step) if it is the only one.
    before = np.concatenate([[np.nan], intervals[:-1]])
    instead = np.where(np.isnan(before), 1.0, before)
    widths = np.where(np.isnan(intervals), instead, intervals)
    number_in_group = np.arange(len(group)) - first[group]
    return starts[group] + number_in_group * widths[group] / (last - first + 1)[group]
