"""Order of a sensor's rows: late rows, and a clock that falls."""

from pathlib import Path

import numpy as np

from trackbench.errors import counted, counted_with_verb, form_for
from trackbench.field_types import DataError
from trackbench.scenarios.recordings.parse_dates import has_day
from trackbench.scenarios.recordings.rows_and_reading_context import (
    ReadingContext,
    Rows,
    usual_interval,
)
from trackbench.scenarios.recordings.same_time import (
    Difference,
    merge_equal_times,
    remedy_by_unread_column,
)

_MOST_INTERVALS = 10.0
"""Largest fall of a clock, in usual intervals between rows, that late rows may explain."""
_DAY = 86400.0  # s


def in_order(context: ReadingContext, rows: Rows, difference: Difference = np.subtract) -> Rows:
    """Sort the rows by run and time; report unsorted and repeated rows.

    Notes on them are added to the context. Raises DataError if the clock falls far. Raises it also if
    two rows of a run have one time and different values, unless the key ``same_time`` says what becomes
    of them. ``difference`` subtracts values (n, R), and wraps angles.
    """
    # Step 1: bring the rows of each run together.
    order = np.argsort(rows.run, kind="stable")
    if (np.diff(order) != 1).any():
        rows = rows.at(order)
    # Step 2: sort by time within the runs if any row is late.
    same = rows.run[1:] == rows.run[:-1]
    note_on_falls = ""
    if ((rows.time[1:] < rows.time[:-1]) & same).any():
        note_on_falls = _describe_falls(context, rows)
        context.notices.append(note_on_falls)
        rows = rows.at(np.lexsort((rows.time, rows.run)))
    # Step 3: treat rows of one run at one time.
    return merge_equal_times(context, rows, difference, note_on_falls)


def _describe_falls(context: ReadingContext, rows: Rows) -> str:
    """Return a note on rows that come after later ones. Raises DataError if the clock falls far.

    The ``rows`` of each run are together, and at least one of them is late. Times within one day that
    fall by more than half of it are those of a clock that passed midnight, however far apart the rows
    are: in order they would be mixed.
    """
    late = 0
    largest = 0.0
    row_of_largest = 0  # row of the largest fall
    passes_midnight = False
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
            is_in_day = not context.counts_steps and float(np.ptp(time)) < _DAY
            passes_midnight = is_in_day and largest > 0.5 * _DAY
    if largest > _MOST_INTERVALS * usual or passes_midnight:
        message = (
            f"time falls by {largest:.9g}{unit}, where rows usually are {usual:.9g}{unit} apart"
        )
        date_format = context.naming.time_format
        date_remedy = ""
        if date_format and not has_day(date_format):
            date_remedy = " or say `columns: {date: NAME}`"
        remedy = f"write dates{date_remedy} or go on counting if a clock began anew, or sort"
        remedy += " the rows by time"
        if passes_midnight:
            remedy = f"did the clock pass midnight? Write dates{date_remedy}, or add a day to the"
            remedy += " times from here on, or sort the rows by time"
        week_remedy = remedy_by_unread_column(context, "week")
        if week_remedy:
            remedy = f"{week_remedy}; or {remedy}"
        late_rows = counted_with_verb(late, "row", "comes", "come")
        raise DataError(
            context.place(
                rows, row_of_largest, f"{message} ({late_rows} after later ones): {remedy}"
            )
        )
    message = f"{counted(late, 'row')} that came after later ones"
    message += f" {form_for(late, 'was', 'were')} put in order; the largest fall is"
    file = Path(context.files[rows.file[row_of_largest]]).name
    place = f"{file}:{rows.line[row_of_largest]}"
    return f"{message} {largest:.9g}{unit}, at {place}: if a clock was set back there, correct it"
