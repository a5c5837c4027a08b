"""Rows of known inputs, such as odometry, from their own file or that of the measurements."""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from trackbench.core.angles import wrapped_difference
from trackbench.errors import counted, form_for
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.chosen_runs import chosen_runs
from trackbench.scenarios.recordings.naming_of_columns import Naming, NamingKeys
from trackbench.scenarios.recordings.read_rows_of_all_files import read_rows
from trackbench.scenarios.recordings.recording_keys import RecordingKeys
from trackbench.scenarios.recordings.row_order import in_order
from trackbench.scenarios.recordings.rows_and_reading_context import (
    ONE_RUN,
    ReadingContext,
    Rows,
    context_of_further_file,
)
from trackbench.scenarios.recordings.time_overlap_of_files import check_common_time
from trackbench.scenarios.recordings.undeclared_angles_check import has_turns
from trackbench.scenarios.recordings.unit_names_and_sizes import DIMENSIONS

_ROUNDING = 1e-6
"""rad beyond one turn, that a recorded angle may have by its digits"""
MOST_MISTAKES = 20
"""mistakes that are listed, of which the last one has the number of all others"""


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
        for row in incomplete[:MOST_MISTAKES].tolist():
            name = names[int(np.flatnonzero(is_missing[:, row])[0])]
            message = f"{name}: there is no value beside the other inputs: fill the cell"
            mistakes.append(context.place(rows, row, message))
        left_out = len(incomplete) - len(mistakes)
        if left_out:
            more = f"{form_for(left_out, 'has', 'have')} {counted(left_out, 'more row')}"
            message = f"{mistakes[-1].message}; nor {more} all inputs"
            mistakes[-1] = mistakes[-1]._replace(message=message)
        raise DataError(*mistakes)
    if not has_all.any():
        message = f"the columns of the inputs {', '.join(names)} are empty"
        raise DataError(Place(context.files[0], 1, 1, message))
    complete = rows.at(np.flatnonzero(has_all))
    angles = _wrapped_angles(context, names, complete)
    # Rows of one time with different values may be averaged, as the key `same_time` says: the mean is
    # taken by differences, of which those of angles are wrapped.
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


def missing_run(path: str, run: str, names: Sequence[str]) -> Place:
    """Return the mistake of the file at ``path``, which has no inputs ``names`` for the ``run``."""
    message = f"run {run} has no rows with the inputs {', '.join(names)}"
    return Place(path, 1, 1, message)


def read_inputs(
    target: RecordingKeys, context: ReadingContext, measured_rows: Sequence[Rows]
) -> tuple[ReadingContext, InputRows]:
    """Read the rows of the inputs, from their own file or that of the measurements.

    Return the context of their file, and their rows, in which runs have the numbers of those of the
    measurements. ``context`` is that of the measurements, ``measured_rows`` are those of each sensor.
    """
    path = target.input_file or target.measurement_files[0]
    # The target is a naming itself, which holds for the file of the inputs without one of its own.
    own_naming: Naming = target.input_naming or target
    # The empty name stands for no column: the inputs belong to no sensor.
    columns = {**own_naming.columns, **target.input, "sensor": ""}
    # In a log of odometry and landmarks the column that names these, such as object, must not be taken
    # for that of the runs. The empty name says that no column names runs.
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
    # Keys of the config that a message names: that of the columns of the inputs, that of the time, and
    # one of this file alone.
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
