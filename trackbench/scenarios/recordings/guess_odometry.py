"""Guess of the odometry of a robot: its rows, runs and errors."""

from dataclasses import replace

import numpy as np

from trackbench.scenarios.recordings.chosen_runs import longest_first
from trackbench.scenarios.recordings.errors_from_neighbors import scatter
from trackbench.scenarios.recordings.guess_record import Guess, ReasonByKey
from trackbench.scenarios.recordings.naming_of_columns import Naming
from trackbench.scenarios.recordings.parse_tables import header
from trackbench.scenarios.recordings.quantity_keys import ODOMETRY
from trackbench.scenarios.recordings.read_rows_of_all_files import read_rows
from trackbench.scenarios.recordings.row_order import in_order
from trackbench.scenarios.recordings.rows_and_reading_context import (
    ReadingContext,
    Rows,
    usual_interval,
)


def guess_odometry(path: str, naming: Naming, reasons: ReasonByKey) -> Guess:
    """Read all rows of a table of odometry; return the guess with its runs, errors and interval.

    ``naming`` and ``reasons`` are those guessed by the first rows.
    """
    rows, runs = read_odometry_rows(path, naming)
    # Inputs of one run are those of every run, so the column of its name is not read. A column that is
    # called run would be read without the empty name.
    columns = dict(naming.columns)
    if len(runs) == 1:
        columns.pop("run", None)
        if "run" in header(path, naming.format):
            columns["run"] = ""
    naming = replace(naming, columns=columns)
    return Guess(
        naming=naming,
        reasons=reasons,
        runs=runs,
        # A table of odometry has no sensors, and the speed of a target is not guessed.
        sensors=[],
        speed=0.0,
        steps=len(np.unique(rows.ticks)),  # different times
        inputs=sigmas_of_inputs(rows),
        odometry=rows,
        interval=usual_interval(rows.time),
    )


def read_odometry_rows(path: str, naming: Naming) -> tuple[Rows, list[tuple[str, int]]]:
    """Read the longest run's rows with a robot's speed and turn rate, in order of time.

    Return also the name and the number of rows of each run, the longest first.
    """
    # Inputs belong to no sensor: the empty name says that no column names sensors.
    columns = naming.columns | {"sensor": ""}
    # Without a column of runs one such as object would be taken for it, as it names targets elsewhere.
    # Here it may be the column that names landmarks. The empty name says that there are no runs.
    if naming.columns.get("sensor"):
        columns.setdefault("run", "")
    without_sensor = replace(naming, columns=columns)
    # Rows of a speed and a turn rate have no positions, and so none that is too far away.
    context = ReadingContext(without_sensor, refuses_far_rows=False)
    (rows,) = read_rows(context, [path], [ODOMETRY])
    sizes = np.bincount(rows.run, minlength=len(context.runs))
    runs = longest_first(context.runs, sizes)
    is_longest_run = rows.run == sizes.argmax()
    has_all = np.isfinite(rows.values).all(axis=0)
    return in_order(context, rows.at(np.flatnonzero(has_all & is_longest_run))), runs


def sigmas_of_inputs(rows: Rows) -> dict[str, float]:
    """Estimate the standard deviations of a robot's speed v, m/s, and turn rate w, rad/s, by name.

    ``rows`` are those of its odometry in order of time, with values (2, R).
    """
    sigmas = {}
    for name, values in zip(ODOMETRY, rows.values, strict=True):
        sigmas[name] = scatter(rows.time, values)
    return sigmas
