"""Rows of one time: those that agree become one row, others are treated as the key `same_time` says."""

from collections.abc import Callable

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.durations import time_text
from trackbench.errors import Answer, and_others, counted, counted_with_verb, form_for
from trackbench.field_types import DataError
from trackbench.scenarios.recordings.parse_tables import WholeNumbers
from trackbench.scenarios.recordings.rows_and_reading_context import ReadingContext, Rows

Difference = Callable[[Array, Array], Array]
"""Function that subtracts values (n, R) from values, and may wrap those that are angles."""


def merge_equal_times(
    context: ReadingContext, rows: Rows, difference: Difference, note_on_falls: str = ""
) -> Rows:
    """Join rows of one time that agree, and treat different ones as the key ``same_time`` says.

    ``difference`` subtracts values (n, R), and wraps angles. ``note_on_falls`` is that on rows that were
    put in order. Raises DataError if the key is not set.
    """
    if _begins_group(rows).all():
        return rows  # most tables have no two rows of one time
    same_time = context.naming.same_time
    # Step 1: join rows that agree. With `same_time: spread` equal rows are those of a target at rest,
    # and none is left out.
    if same_time != "spread":
        rows = _joined_rows(context, _without_empty_rows(rows))
    # Step 2: find the groups of rows of one time that remain.
    first, group = _groups_of_one_time(rows)
    not_first = np.flatnonzero(np.diff(group) == 0) + 1
    if not len(not_first):
        return rows
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
        if note_on_falls:
            hint = f"{note_on_falls}; or {hint}"
        mistake = context.place(rows, row, f"{message} not with the same values: {hint}")
        raise DataError(mistake._replace(answer=Answer("same_time", "mean")))
    message = f"{counted(len(not_first), 'row')} of a time that is there already"
    context.notices.append(f"{message}: `same_time: {same_time}`")
    if subsecond_remedy:
        context.notices.append(f"rows of one time differ, and {subsecond_remedy}")
    # Step 3: keep the last row, take the mean, or spread the times.
    last = np.append(first[1:], len(group)) - 1
    if same_time == "last":
        return rows.at(last)
    if same_time == "mean":
        means = _mean_of_groups(rows.values, first, group, difference)
        # A mean is known when the last of its rows has been received.
        received = np.maximum.reduceat(rows.received, first)
        return rows.at(first)._replace(values=means, received=received)
    return rows._replace(time=_spread_times(rows, first, last, group))


def _groups_of_one_time(rows: Rows) -> tuple[WholeNumbers, WholeNumbers]:
    """Return the first row (G,) of each group of rows of one run and time, and each row's group (R,).

    The rows of a group follow each other.
    """
    is_first = _begins_group(rows)
    return np.flatnonzero(is_first), np.cumsum(is_first) - 1


def _begins_group(rows: Rows) -> Mask:
    """Return a mask (R,) of the rows that are the first ones of their run and time.

    Rows of one run and time follow each other. Times are equal if they are in whole ticks.
    """
    is_first = np.ones(len(rows.run), dtype=np.bool_)
    is_first[1:] = (np.diff(rows.ticks) != 0) | (np.diff(rows.run) != 0)
    return is_first


def _without_empty_rows(rows: Rows) -> Rows:
    """Return rows without those in which nothing is measured, if another row of their time measures."""
    _, group = _groups_of_one_time(rows)
    is_empty = np.isnan(rows.values).all(axis=0)
    measures = np.bincount(group, weights=~is_empty) > 0
    return rows.at(np.flatnonzero(~is_empty | ~measures[group]))


def _joined_rows(context: ReadingContext, rows: Rows) -> Rows:
    """Return rows in which each group of one time that agrees is one row; a note counts repeated rows.

    A group agrees if no quantity has two different values in it, as if one row has x and another one y.
    Of other groups, rows that are equal to the row before are left out.
    """
    first, group = _groups_of_one_time(rows)
    # Step 1: find the rows that are equal to the row before.
    is_missing = np.isnan(rows.values)
    is_equal = (rows.values[:, 1:] == rows.values[:, :-1]) | (
        is_missing[:, 1:] & is_missing[:, :-1]
    )
    is_copy = np.zeros(len(group), dtype=np.bool_)
    is_copy[1:] = is_equal.all(axis=0) & (group[1:] == group[:-1])
    repeated = int((is_copy & ~is_missing.all(axis=0)).sum())
    if repeated:
        message = counted_with_verb(repeated, "row", "repeats", "repeat")
        message += f" the one before and {form_for(repeated, 'was', 'were')} left out"
        context.notices.append(message)
    # Step 2: the first row of a group that agrees gets the values of all its rows.
    least = np.fmin.reduceat(rows.values, first, axis=1)
    largest = np.fmax.reduceat(rows.values, first, axis=1)
    agrees = ((least == largest) | np.isnan(least)).all(axis=0)
    values = rows.values.copy()
    values[:, first[agrees]] = least[:, agrees]
    remains = ~agrees[group] & ~is_copy
    remains[first] = True
    remaining_rows = np.flatnonzero(remains)
    # Step 3: a value was received with the first row that has it, and a row with the last of its values.
    # Without any value the first row counts.
    received = np.minimum.reduceat(rows.received, remaining_rows)
    received_by_quantity = np.where(is_missing, np.inf, rows.received)
    first_received = np.minimum.reduceat(received_by_quantity, first, axis=1)
    last_received = np.where(np.isfinite(first_received), first_received, -np.inf).max(axis=0)
    is_joined = agrees & np.isfinite(last_received)
    received[is_joined[group[remaining_rows]]] = last_received[is_joined]
    joined = rows._replace(values=values).at(remaining_rows)
    return joined._replace(received=received)


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
