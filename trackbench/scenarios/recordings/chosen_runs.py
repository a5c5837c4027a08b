"""Chosen runs and the order in which they are numbered."""

from collections.abc import Collection

import numpy as np

from trackbench.core.arrays import Index
from trackbench.field_types import InvalidKeyError
from trackbench.scenarios.recordings.rows_and_reading_context import ReadingContext, Rows


def chosen_runs(
    context: ReadingContext,
    rows: list[Rows],
    chosen: Collection[str],
    within: tuple[str, ...] = ("runs",),
) -> list[Rows]:
    """Return the rows of the chosen runs (default: all), and number the runs anew in their order.

    This is the order in which they are chosen. If none are chosen, it is the order of their names if
    these are whole numbers, and otherwise the order in the files. ``rows`` are those of each sensor; the
    list is emptied. The names in the context get the new order, too. ``within`` is the path of the
    config's key that chooses runs, for an error.
    """
    names = list(chosen) or context.runs
    if not chosen and all(name.isascii() and name.isdigit() for name in names):
        names = sorted(names, key=int)
    known = set(context.runs)
    for i, name in enumerate(names):
        if name not in known:
            message = f"there is no run {name!r}; there are {', '.join(context.runs[:20])}"
            raise InvalidKeyError(message, *within, i)
    wanted = {name: i for i, name in enumerate(names)}
    # new_number[number in the files] = number among the chosen runs, -1 if not chosen
    new_number = np.array([wanted.get(name, -1) for name in context.runs], dtype=np.int32)
    context.runs = names
    chosen_rows = []
    while rows:  # rows are dropped one sensor after the other, to save memory
        of_sensor = rows.pop(0)
        of_sensor = of_sensor._replace(run=new_number[of_sensor.run])
        is_chosen = of_sensor.run >= 0
        if not is_chosen.all():
            of_sensor = of_sensor.at(np.flatnonzero(is_chosen))
        chosen_rows.append(of_sensor)
    return chosen_rows


def longest_first(names: list[str], sizes: Index) -> list[tuple[str, int]]:
    """Return the name and the number of rows of each run, the longest first.

    ``names`` are those of the runs, and ``sizes`` their numbers of rows.
    """
    return sorted(zip(names, sizes.tolist(), strict=True), key=lambda run: -run[1])
