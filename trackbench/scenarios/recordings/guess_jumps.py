"""Question on jumps of place that no motion explains, as between the rows of several targets."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.field_types import DataError
from trackbench.scenarios.recordings.errors_from_neighbors import error_of_line
from trackbench.scenarios.recordings.guess_table_sample import TableSample
from trackbench.scenarios.recordings.rows_and_reading_context import (
    ReadingContext,
    Rows,
    positions_of_rows,
)
from trackbench.scenarios.recordings.yaml_values import in_option

_FEWEST = 5
"""rows before and after a jump; fewer may be outliers"""
_MOST_JUMPS = 10
"""more are those of a table of mixed rows, which are asked about otherwise"""
_FASTER = 2.5
"""times as fast as ever before and after, that a jump must be"""
_SIGMAS = 20.0
"""standard deviations of a position, that a jump must be long"""
FASTEST_AT_REST = 60.0
"""m/s that something may have had in a pause, if it hardly moves before and after"""
_RETURNS = 6
"""rows back, in which a row of one of several interleaved targets has another one of its target"""
_LEAST_JUMPS = 0.2
"""share of the rows that lie far from the row before, if the rows are those of several targets"""
_MOST_STRAYING = 0.2
"""share of these rows that are near none of the rows before, as outliers are"""


def check_jumps(
    context: ReadingContext, rows: Rows, kind: str, in_degrees: bool, sample: TableSample
) -> None:
    """Raise DataError if a run jumps to a position that no motion explains, and goes on from there.

    Its rows may be those of two targets: the name of the first one was given again, or two recordings
    stand in one table. ``kind`` is the type of the rows' sensor; ``in_degrees`` is True if its angles
    are in degrees. ``sample`` are the first rows as they are written. The caller leaves the check out if
    the user set ``columns.run``, even to the guessed column: this answers the question.
    """
    positions = positions_of_rows(rows, kind, in_degrees)
    if positions is None:
        return
    column = context.naming.columns.get("run", "")
    row = first_return(positions)
    # An empty name of the sensors is the user's answer that rows are mixed.
    is_answered = context.naming.columns.get("sensor") == ""
    if row is not None and not is_answered:
        message = "rows lie far from the row before and near one before that, again and again: are"
        message += " they several targets?"
        remedy = "Give each target a number in a column, and say --set 'columns.run=ITS NAME'"
        option = f"if all rows are those of one, say --set 'columns.run={in_option(column)}'"
        if not column:
            option = "if all rows are those of one, say --set 'columns.run=\"\"'"
        option += _advice_if_zero_is_no_fix(sample, context.naming.columns)
        raise DataError(context.place(rows, row, f"{message} {remedy}; {option}"))
    jump = unexplained_jump(rows.time, positions)
    if jump is None:
        return
    name = context.runs[rows.run[jump.row]]
    message = f"{jump.distance:.3g} m in {jump.duration:.3g} {context.time_unit} are"
    message += f" {jump.times_as_fast:.2g} times as fast as all rows before and after"
    doubt = f"does {column} {name} name another target from here on?"
    remedy = (
        f"Give it another name; if it is one target, say --set 'columns.run={in_option(column)}'"
    )
    if not column:
        doubt = "is this another target, or another recording, from here on?"
        remedy = (
            "Say which column names targets, --set 'columns.run=NAME'; if all rows are those of"
        )
        remedy += " one, say --set 'columns.run=\"\"'"
    remedy += _advice_if_zero_is_no_fix(sample, context.naming.columns)
    raise DataError(context.place(rows, jump.row, f"{message}: {doubt} {remedy}"))


def _advice_if_zero_is_no_fix(sample: TableSample, columns: Mapping[str, str]) -> str:
    """Return the end of a message: the options to set if a position of 0 stands for a missing fix.

    It is empty if no column of positions has zeros in rows one after the other.
    """
    options = []
    for quantity in ("latitude", "longitude", "x", "y", "range"):
        # Without a column, for an empty name, all numbers are NaN.
        is_zero = sample.numbers(columns.get(quantity, "")) == 0.0
        # A position that crosses an axis is seldom exactly 0 in row after row.
        if (is_zero[1:] & is_zero[:-1]).any() and not is_zero.all():
            options.append(f"--set 'missing.{quantity}=[0]'")
    if not options:
        return ""
    return f"; if 0 stands for no fix, say {' '.join(options)}"


class Jump(NamedTuple):
    """Jump between two neighboring rows of one run."""

    row: int
    """the row after the jump"""
    distance: float
    """m"""
    duration: float
    """s"""
    times_as_fast: float
    """ratio of its speed to the largest one before and after"""


def unexplained_jump(time: Array, positions: Array) -> Jump | None:
    """Return the first jump of a run that no motion explains; None without one.

    ``time`` (R,), s, is in order, and ``positions`` (2, R) are in meters. At least `_FEWEST` rows must
    lie before and after the jump, so that an outlier is no jump. The jump's speed must be several times
    the largest mean speed of these rows over as much time as the jump takes.
    """
    distances = np.hypot(*np.diff(positions, axis=1))
    durations = np.diff(time)
    takes_time = durations > 0.0
    if takes_time.sum() < 2 * _FEWEST:
        return None
    sigma = float(np.hypot(error_of_line(time, positions[0]), error_of_line(time, positions[1])))
    usual_interval = float(np.median(durations[takes_time]))
    # Step 1: candidates are ten times as long as the usual distance from row to row, and longer than
    # errors of positions explain.
    usual = float(np.median(distances[takes_time]))
    candidates = np.flatnonzero(distances > np.maximum(10.0 * usual, _SIGMAS * sigma))
    if not 0 < len(candidates) <= _MOST_JUMPS:
        return None
    # Step 2: compare each with the rows on both sides, up to the next candidate.
    bounds = np.concatenate([[-1], candidates, [len(distances)]])
    for number, candidate in enumerate(candidates.tolist(), 1):
        parts = [
            slice(int(bounds[number - 1]) + 1, candidate + 1),
            slice(candidate + 1, int(bounds[number + 1]) + 1),
        ]
        if any(rows.stop - rows.start < _FEWEST for rows in parts):
            continue
        duration = max(float(durations[candidate]), usual_interval)
        speeds = [_largest_speed(time[rows], positions[:, rows], duration) for rows in parts]
        largest = max(speeds)
        # If the target hardly moves on either side, the errors hide its speed: it may have moved in the
        # pause at a usual speed. Its movement is seen over the time of the jump, or of all rows of the
        # longer part if these last less long.
        span = min(duration, max(float(np.ptp(time[rows])) for rows in parts))
        if largest * span < _SIGMAS * sigma:
            # The jump must be _FASTER than this, and so faster than FASTEST_AT_REST.
            largest = max(largest, FASTEST_AT_REST / _FASTER)
        least_speed = (distances[candidate] - _SIGMAS * sigma) / duration
        if least_speed > _FASTER * largest:
            speed = float(distances[candidate]) / duration
            return Jump(
                row=candidate + 1,
                distance=float(distances[candidate]),
                duration=duration,
                times_as_fast=speed / max(*speeds, 1e-9),
            )
    return None


def first_return(positions: Array) -> int | None:
    """Return the first row far from the row before, if most such rows are near earlier ones; else None.

    They are the rows of several targets in turn, each of which returns to its own target. Outliers do
    not return to each other. The result is None also if few rows lie far from the row before.
    ``positions`` (2, R) are in order of time.
    """
    number = positions.shape[1]
    if number < 2 * _FEWEST + _RETURNS:
        return None
    # Distances (L, R) of each row from the L rows before it.
    distances = np.full((_RETURNS, number), np.inf)
    for lag in range(1, _RETURNS + 1):
        distances[lag - 1, lag:] = np.hypot(*(positions[:, lag:] - positions[:, :-lag]))
    nearest = distances.min(axis=0)
    # The usual distance between two rows of one target stands for the standard deviation.
    far = _SIGMAS * np.median(nearest)
    jumps = np.flatnonzero((distances[0] > far) & np.isfinite(distances[0]))
    if far == 0.0 or len(jumps) < _LEAST_JUMPS * number:
        return None
    if (nearest[jumps] > 0.5 * far).mean() > _MOST_STRAYING:
        return None
    return int(jumps[0])


def _largest_speed(time: Array, positions: Array, duration: float) -> float:
    """Return the largest mean speed, m/s, over stretches of at least ``duration``, s.

    If the rows last less than three times as long, a stretch lasts a third of their time. ``time`` (R,)
    is in order, and ``positions`` (2, R) are in meters. It is 0 if no stretch takes any time.
    """
    shortest = min(duration, float(time[-1] - time[0]) / 3.0)
    # Each row begins a stretch, which ends at the first row that is late enough, and at least one row
    # on.
    first = np.arange(len(time))
    last = np.searchsorted(time, time + shortest, side="left")
    last = np.maximum(last, first + 1)
    ends_within_rows = last < len(time)
    first = first[ends_within_rows]
    last = last[ends_within_rows]
    durations = time[last] - time[first]
    takes_time = durations > 0.0
    if not takes_time.any():
        return 0.0
    distances = np.hypot(*(positions[:, last] - positions[:, first]))
    return float((distances[takes_time] / durations[takes_time]).max())
