"""Questions on rows of several targets: jumps of place, and places of one time far apart."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackbench.core.arrays import Array
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.column_names import role_of, words_of
from trackbench.scenarios.recordings.guess_errors import error_of_line
from trackbench.scenarios.recordings.interleaved_rows import question_on_parts, split_by
from trackbench.scenarios.recordings.rows import ReadingContext, Rows
from trackbench.scenarios.recordings.table_sample import TableSample
from trackbench.scenarios.recordings.units import UNITS
from trackbench.scenarios.recordings.yaml_values import in_option

_MOST_NAMES = 8
_FEWEST = 5
"""rows before and after a jump; fewer may be outliers"""
_MOST_JUMPS = 10
"""more are those of a table of mixed rows, which are asked about otherwise"""
_FASTER = 2.5
"""times as fast as ever before and after, that a jump must be"""
_SIGMAS = 20.0
"""standard deviations of a position, that a jump must be long"""
_FASTEST_AT_REST = 60.0
"""m/s that something may have had in a pause, if it hardly moves before and after"""
_MOST_A_SECOND = 20
"""mean number of rows of a second, beyond which they may be those of many targets"""
_MOST_COMPARED = 1000
"""rows that show whether those of one time are several targets"""
_TIMES_APART = 3.0
"""ratio of the distance between rows of one time to that from the next time, of several targets"""
_SHARE_OF_DETECTIONS = 0.25
"""quantile of distances by which rows are compared, as more than half may be false detections"""
_RETURNS = 6
"""rows back, in which a row of one of several interleaved targets has another one of its target"""
_LEAST_JUMPS = 0.2
"""share of the rows that lie far from the row before, if the rows are those of several targets"""
_MOST_STRAYING = 0.2
"""share of these rows that are near none of the rows before, as outliers are"""
_DAY = 86400.0  # s


def guess_same_time(
    context: ReadingContext, rows: Rows, kind: str, in_degrees: bool
) -> Literal["spread"] | None:
    """Return "spread" for the key `same_time` if rows of one second differ and times are whole seconds.

    The times of these rows are then spread over the second. Return None otherwise. Raises DataError if
    these rows lie so far apart that they are those of several targets. ``kind`` is the type of the rows'
    sensor; ``in_degrees`` is True if its angles are in degrees.
    """
    # A row with the time of the row before, and other values.
    is_repeated = (np.diff(rows.ticks) == 0) & (np.diff(rows.values, axis=1) != 0.0).any(axis=0)
    if not is_repeated.any():
        return None
    positions = _positions_of_rows(rows, kind, in_degrees)
    if positions is not None and _lie_apart(
        rows.ticks[:_MOST_COMPARED], positions[:, :_MOST_COMPARED]
    ):
        message = "rows of one time are far apart, and near those of other times: are they several"
        message += " targets, or false detections?"
        remedy = "Give each target a number in a column, and say --set 'columns.run=ITS NAME'"
        option = "if they are one target, say --set same_time=spread, or mean or last"
        place = context.place(
            rows, int(np.flatnonzero(is_repeated)[0]) + 1, f"{message} {remedy}; {option}"
        )
        raise DataError(place)
    # Only times in whole seconds may lack a part of the second.
    different_seconds = len(np.unique(rows.time))
    if context.counts_steps or (rows.time % 1.0).any() or different_seconds < 2:
        return None
    if len(rows.time) > _MOST_A_SECOND * different_seconds:
        return None  # too many rows for one target
    if context.dated and not (rows.time % _DAY).any():
        return None  # dates without a time of day
    return "spread"


def check_sensors_apart(
    path: str, column: str, kinds: Sequence[str], rows_by_sensor: Sequence[Rows]
) -> None:
    """Raise DataError if the positions of a run's sensors lie apart, as those of several targets do.

    The words in the ``column``, which are taken as names of sensors, may then name targets. ``kinds``
    are the types of the sensors, ``rows_by_sensor`` their rows in one run. Only sensors that measure
    positions are compared.
    """
    rows = [rows for kind, rows in zip(kinds, rows_by_sensor, strict=True) if kind == "position"]
    if len(rows) < 2:
        return
    # The number of each row's sensor, its time and its position.
    codes = np.repeat(np.arange(len(rows)), [len(part.time) for part in rows])
    time = np.concatenate([part.time for part in rows])
    values = np.concatenate([part.values[:2] for part in rows], axis=1)
    # Sensors of one target agree as one, or have errors of different sizes (see `Split`).
    if split_by(codes, time, values) == "apart":
        raise DataError(question_on_parts(path, column, "sensor"))


def check_runs_apart(
    context: ReadingContext, kinds: Sequence[str], rows_by_sensor: Sequence[Rows]
) -> None:
    """Raise DataError if the rows of several runs follow one path in turn, as those of sensors do.

    Their column has a name such as id, gps_id or frame_id, which may name sensors as well as targets.
    ``kinds`` are the types of the sensors, ``rows_by_sensor`` all their rows, in the order of the file.
    """
    column = context.naming.columns.get("run", "")
    words = {*words_of(column)}
    if "id" not in words or role_of(column) == "target" or len(context.runs) < 2:
        return
    for kind, rows in zip(kinds, rows_by_sensor, strict=True):
        if kind != "position" or not len(rows.run):
            continue
        # Rows of recordings one after the other are no such rows, even if all follow one way.
        rarer = len(rows.run) - int(np.bincount(rows.run).max())
        takes_turns = int((np.diff(rows.run) != 0).sum()) >= max(1, rarer)
        split = split_by(rows.run.astype(np.intp), rows.time, rows.values[:2])
        if not takes_turns or split not in ("one", "errors"):
            continue
        name = in_option(column)
        shown = ", ".join(context.runs[:_MOST_NAMES])
        message = (
            f"rows of {column} {shown} follow one path in turn: are these sensors of one target?"
        )
        remedy = f"Say --set 'columns.sensor={name}'; if they are targets, say"
        remedy += f" --set 'columns.run={name}', and to mix them --set 'columns.run=\"\"'"
        raise DataError(Place(context.files[0], 1, 1, f"{message} {remedy}"))


def _lie_apart(ticks: NDArray[np.integer[Any]], positions: Array) -> bool:
    """Test whether positions (2, R) of one time lie much farther apart than from those of the next time.

    ``ticks`` (R,) are the times in whole units. Rows of one time are compared one after the other.
    """
    apart = []  # distances between successive rows of one time
    nearest = []  # distances from the nearest row of the next time
    times, first = np.unique(ticks, return_index=True)
    groups = [positions[:, ticks == tick] for tick in times[np.argsort(first)]]
    for group, following in pairwise(groups):
        apart += np.hypot(*np.diff(group, axis=1)).tolist()
        differences = group[:, :, None] - following[:, None, :]
        nearest += np.hypot(*differences).min(axis=1).tolist()
    if not apart:
        return False
    # Most false detections are far from all rows of the next time, so that a median would be theirs.
    usual_apart = np.quantile(apart, _SHARE_OF_DETECTIONS)
    usual_nearest = np.quantile(nearest, _SHARE_OF_DETECTIONS)
    return bool(usual_apart > _TIMES_APART * usual_nearest)


def check_jumps(
    context: ReadingContext, rows: Rows, kind: str, in_degrees: bool, sample: TableSample
) -> None:
    """Raise DataError if a run jumps to a position that no motion explains, and goes on from there.

    Its rows may be those of two targets: the name of the first one was given again, or two recordings
    stand in one table. ``kind`` is the type of the rows' sensor; ``in_degrees`` is True if its angles
    are in degrees. ``sample`` are the first rows as they are written. The caller leaves the check out if
    the user set ``columns.run``, even to the guessed column: this answers the question.
    """
    positions = _positions_of_rows(rows, kind, in_degrees)
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
    # Step 1: candidates are many times as long as the usual distance from row to row.
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
        # pause at a usual speed.
        span = min(duration, max(float(np.ptp(time[rows])) for rows in parts))
        if largest * span < _SIGMAS * sigma:
            largest = max(largest, _FASTEST_AT_REST / _FASTER)
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
    """Return the first row that lies far from the row before and near an earlier one; None without one.

    ``positions`` (2, R) are in order of time. There is such a row only if many rows do so, as those of
    several targets in turn. Outliers do not return to each other.
    """
    number = positions.shape[1]
    if number < 2 * _FEWEST + _RETURNS:
        return None
    # Distances (L, R) of each row from the L rows before it.
    distances = np.full((_RETURNS, number), np.inf)
    for lag in range(1, _RETURNS + 1):
        distances[lag - 1, lag:] = np.hypot(*(positions[:, lag:] - positions[:, :-lag]))
    nearest = distances.min(axis=0)
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


def _positions_of_rows(rows: Rows, kind: str, in_degrees: bool) -> Array | None:
    """Return the positions (2, R) of rows, m; None for a sensor that measures none.

    ``kind`` is the type of the rows' sensor; ``in_degrees`` is True if its angles are in degrees.
    """
    if kind == "position":
        return rows.values[:2]
    if kind == "range-azimuth":
        azimuth = rows.values[1] * (UNITS["deg"] if in_degrees else 1.0)
        return rows.values[0] * np.stack([np.cos(azimuth), np.sin(azimuth)])
    return None
