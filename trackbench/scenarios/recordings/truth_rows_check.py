"""Notes on a truth whose rows are repeated, or lie far from those before and after them."""

from collections.abc import Sequence

import numpy as np

from trackbench.core.arrays import Array
from trackbench.durations import time_text
from trackbench.errors import counted, form_for
from trackbench.scenarios.recordings.errors_from_neighbors import error_of_line
from trackbench.scenarios.recordings.guess_jumps import FASTEST_AT_REST, unexplained_jump
from trackbench.scenarios.recordings.quantity_keys import PLACE, plain_name
from trackbench.scenarios.recordings.repeated_positions_check import usual_repetitions
from trackbench.scenarios.recordings.rows_and_reading_context import (
    ReadingContext,
    Rows,
    in_kilometers,
)

_LONGEST = 10
"""rows, one after the other, that may lie far from those before and after; more are a jump"""
_SIGMAS = 20.0
"""standard deviations of a position, that they must be away"""
_NEAR = 0.2
"""share of their distance, within which the rows before and after them lie"""
_FASTER = 5.0
"""times as fast as all other rows, that a target would have had to move there and back"""
_MOST = 0.1
"""share of the rows; more are no outliers, as of a ferry whose truth has few rows"""
_FEWEST = 20
"""rows of a run that show how a target moves"""


def notes_on_rows(context: ReadingContext, components: Sequence[str], rows: Rows) -> list[str]:
    """Return texts on the truth's rows that are repeated, and on those far from their neighbors.

    ``context`` is that of the truth, ``components`` are those of its ``rows``, which are in order of run
    and time. Errors would be computed from such rows.
    """
    names = [plain_name(name) for name in components]
    if not {*PLACE} <= {*names}:
        return []
    position = [names.index(name) for name in PLACE]
    is_known = np.isfinite(rows.values[position]).all(axis=0)
    rows = rows.at(np.flatnonzero(is_known))
    path = context.files[0]
    unit = "" if context.counts_steps else " s"
    texts: list[str] = []
    outlying: list[tuple[int, float]] = []
    for run in np.unique(rows.run):
        of_run = rows.at(np.flatnonzero(rows.run == run))
        positions = of_run.values[position]
        if not texts:
            times = usual_repetitions(positions)
            if times is not None:
                text = f"{path}: most positions are there {times:g} times, in rows one after the other:"
                text += (
                    " does the logger repeat the last one? Errors would be computed from positions"
                )
                texts.append(f"{text} that are too old: leave out the rows of the repetitions")
        found = rows_far_from_neighbors(of_run.time, positions, context.counts_steps)
        outlying += [(int(of_run.line[row]), distance) for row, distance in found]
        kept = np.ones(len(of_run.time), dtype=bool)
        kept[[row for row, _ in found]] = False
        jump = unexplained_jump(of_run.time[kept], positions[:, kept])
        if jump is not None:
            line = int(of_run.line[kept][jump.row])
            text = (
                f"{path}: line {line} lies {in_kilometers(jump.distance)} from the row before it,"
            )
            text += f" {time_text(jump.duration)}{unit} earlier, and the truth goes on from there"
            texts.append(f"{text}: are both parts of one target, and from one origin?")
    if outlying:
        line, _ = outlying[0]
        number = len(outlying)
        largest = max(distance for _, distance in outlying)
        text = f"{path}: {counted(number, 'row')} {form_for(number, 'lies', 'lie')}"
        text += f" up to {in_kilometers(largest)} from the rows before and after (line {line}"
        text += ")" if number == 1 else " is the first)"
        texts.append(f"{text}: errors would be computed from them; empty their cells")
    return texts


def rows_far_from_neighbors(
    time: Array, positions: Array, counts_steps: bool
) -> list[tuple[int, float]]:
    """Return the rows that no motion explains, with their distances, m, from their neighbors.

    A target would have had to move there and back, by the next few rows, much faster than ever else.
    ``time`` (R,), s, or steps if it ``counts_steps``, is in order, and ``positions`` (2, R) are in m.
    """
    number = len(time)
    if number < _FEWEST:
        return []
    error_x, error_y = (error_of_line(time, axis) for axis in positions)
    sigma = float(np.hypot(error_x, error_y))
    lengths = np.hypot(*np.diff(positions, axis=1))
    durations = np.maximum(np.diff(time), 1e-12)
    is_far = lengths > _SIGMAS * sigma
    # Step 1: pairs of long steps, from row i to i + 1 and from row i + lag to i + lag + 1, after which
    # the position is near that of row i again.
    pairs: list[tuple[int, int]] = []
    is_of_pair = np.zeros(number - 1, dtype=bool)
    for lag in range(1, _LONGEST + 1):
        there = lengths[:-lag]
        back = lengths[lag:]
        apart = np.hypot(*(positions[:, lag + 1 :] - positions[:, : -lag - 1]))
        returns = is_far[:-lag] & is_far[lag:] & (apart < _NEAR * np.minimum(there, back))
        for first in np.flatnonzero(returns).tolist():
            if not is_of_pair[first : first + lag + 1].any():
                is_of_pair[first : first + lag + 1] = True
                pairs.append((first, first + lag))
    if is_of_pair.all():
        return []
    # Step 2: compare their speeds with that of all other steps. A target that hardly moves else may have
    # moved at a usual speed.
    speeds = lengths / durations
    fastest = float(speeds[~is_of_pair].max())
    least = _FASTER * fastest
    if not counts_steps and fastest * float(np.median(durations)) < _SIGMAS * sigma:
        least = max(least, FASTEST_AT_REST)
    rows: list[tuple[int, float]] = []
    for first, last in sorted(pairs):
        if min(speeds[first], speeds[last]) > least:
            rows += [(row, float(lengths[first])) for row in range(first + 1, last + 1)]
    if len(rows) > _MOST * number:
        return []
    return rows
