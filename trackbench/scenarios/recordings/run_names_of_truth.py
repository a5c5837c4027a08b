"""Names of runs in the file of the truth, which may be spelled otherwise."""

import numpy as np

from trackbench.errors import counted_with_verb, first_names
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.label_spelling import plain_spelling
from trackbench.scenarios.recordings.origins import explain_far_truth
from trackbench.scenarios.recordings.rows_and_reading_context import ONE_RUN, ReadingContext, Rows

MOST_NAMES = 8
"""Names of runs that a message lists; of the others it has the number."""


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
            # The origins of runs are those of all files: this one is of the truth's only run.
            if name not in measured.runs:
                message = explain_far_truth(measured, measured.own_origins[name])
                raise DataError(Place(path, 1, 1, message))
            message = f"names no runs, and run {name} has an origin of its own, far from the others"
            remedy = "give the truth a column `run`, or choose runs near each other by `runs`"
            raise DataError(Place(path, 1, 1, f"{message}: {remedy}"))
        return
    # Runs of the measurements without rows of the truth.
    known = {of_truth.runs[number] for number in np.unique(rows.run).tolist()}
    without = [name for name in measured.runs if name not in known]
    if not without:
        return
    shown = first_names(without, MOST_NAMES)
    number = counted_with_verb(len(without), "run", "has", "have")
    if len(without) == len(measured.runs):
        existing = first_names(of_truth.runs, MOST_NAMES)
        message = f"has no run {shown}; there are {existing}: give runs one name in both files"
        if measured.runs == [ONE_RUN]:
            message = (
                f"names runs, {existing}, and the measurements name none: leave in it the rows"
            )
            message += " of the run that was measured, or name the runs of both files alike"
        raise DataError(Place(path, 1, 1, message))
    # Names that differ by zeros before them, spaces or capital letters may well be the same run's.
    others = {plain_spelling(name): name for name in of_truth.runs if name not in measured.runs}
    for name in without:
        other = others.get(plain_spelling(name))
        if other is not None:
            message = f"has no run {name!r}, but {other!r} ({number} no truth: {shown})"
            remedy = "write the name alike in both files, or leave the run out by `runs`"
            raise DataError(Place(path, 1, 1, f"{message}: {remedy}"))
