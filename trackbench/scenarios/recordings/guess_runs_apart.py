"""Questions on runs or sensors of a table whose positions lie apart, as those of several targets."""

from collections.abc import Sequence

import numpy as np

from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.column_names import words_of
from trackbench.scenarios.recordings.column_roles import role_of
from trackbench.scenarios.recordings.guess_targets_or_sensors import question_on_parts, split_by
from trackbench.scenarios.recordings.rows import ReadingContext, Rows
from trackbench.scenarios.recordings.yaml_values import in_option

_MOST_NAMES = 8


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
        # Rows of recordings one after the other are no such rows, even if all follow one way: they
        # change seldom from run to run. Rows that take turns change at least once for each row of the
        # rarer runs, which are all but the one with most rows.
        rarer = len(rows.run) - int(np.bincount(rows.run).max())
        takes_turns = int((np.diff(rows.run) != 0).sum()) >= max(1, rarer)
        # The rows of all runs lie on one path ("one"), or differ by the sizes of their errors alone
        # ("errors", see `Split`).
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
