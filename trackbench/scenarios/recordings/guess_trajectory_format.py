"""Recognition of tables without names: a trajectory in the TUM format, or a time, x and y."""

import re
from itertools import chain

import numpy as np

from trackbench.scenarios.recordings.parse_numbers import number, parse_cells

TUM = ("timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
"""Columns of the TUM format of trajectories."""


def fits_names(rows: list[list[str]], names: tuple[str, ...]) -> bool:
    """Test whether the cells of rows may be a time, x and y, or a trajectory in the TUM format.

    ``names`` are those of these three or eight columns. Three columns do not fit if all numbers of the
    last two have the digits of degrees, or if one of these columns rises at equal intervals as a time
    does, and the first one does not. The last four columns of a trajectory must be a unit quaternion.
    """
    if len(names) == 3:
        coordinates = list(chain.from_iterable(row[1:] for row in rows))
        if all(re.fullmatch(r" *-?\d{1,3}\.\d{4,} *", cell) for cell in coordinates):
            return False
    complete_rows = [row for row in rows if len(row) == len(names)]
    cells = [cell.strip().replace(",", ".") for cell in chain.from_iterable(complete_rows)]
    numbers = parse_cells(number, cells)[0].reshape(len(complete_rows), len(names)).T
    if len(names) == len(TUM):
        # Written quaternions are rounded, and some rows may be wrong.
        size = np.sqrt(np.square(numbers[4:]).sum(axis=0))
        return bool((np.abs(size - 1.0) < 0.05).mean() > 0.9)
    intervals = np.diff(numbers, axis=1)
    usual = np.median(intervals, axis=1)
    # Written times are rounded, and some rows may be missing.
    near_usual = np.abs(intervals - usual[:, None]) <= 0.1 * np.abs(usual[:, None])
    is_clock = (near_usual.mean(axis=1) > 0.8) & (usual > 0.0) & (intervals >= 0.0).all(axis=1)
    return bool(is_clock[0] or not is_clock[1:].any())
