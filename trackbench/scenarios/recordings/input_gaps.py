"""Gaps of known inputs: before the first, after the last, and steps that begin in one."""

from collections.abc import Sequence

import numpy as np

from trackbench.core.arrays import Array
from trackbench.durations import time_text
from trackbench.errors import Answer, counted
from trackbench.field_types import DataError
from trackbench.models.inputs import InputGap, KnownInputs
from trackbench.scenarios.recordings.read_inputs import MOST_MISTAKES, InputRows
from trackbench.scenarios.recordings.rows_and_reading_context import (
    ONE_RUN,
    TICK,
    ReadingContext,
    Rows,
    usual_interval,
)

_MOST_OUTSIDE = 0.5
"""share of the measurements, of which fewer may lie before the first and after the last inputs"""


def rows_within(
    context: ReadingContext,
    measured_rows: Sequence[Rows],
    of_inputs: ReadingContext,
    inputs: InputRows,
) -> list[Rows]:
    """Return the measurements between the first and the last inputs of their run, with a note on others.

    ``measured_rows`` are the measurements of each sensor. ``inputs`` are the rows of another file, whose
    context is ``of_inputs``, while ``context`` is that of the measurements. `read_inputs` has given the
    runs of the inputs the numbers of those of the measurements. If most rows would be left out, all of
    them stay, since the files hardly belong together, and the missing inputs are an error.
    """
    # Rows without names of runs all have the number 0, and hold for every run.
    is_shared = of_inputs.runs == [ONE_RUN]
    first = np.full(len(context.runs), -np.inf)
    last = np.full(len(context.runs), np.inf)
    for m in range(len(context.runs)):
        times = inputs.measured.time[inputs.measured.run == (0 if is_shared else m)]
        # A run without inputs keeps its rows; `inputs_at` raises the error.
        if len(times):
            first[m] = times.min() - TICK
            # The last values hold for one interval more.
            last[m] = times.max() + usual_interval(times) + TICK
    inside = [
        (rows.time >= first[rows.run]) & (rows.time <= last[rows.run]) for rows in measured_rows
    ]
    number = sum(len(mask) for mask in inside)
    outside = number - sum(int(mask.sum()) for mask in inside)
    if outside == 0 or outside >= _MOST_OUTSIDE * number:
        return list(measured_rows)
    message = f"{counted(outside, 'row')} of measurements before the first or after the last inputs"
    context.notices.append(f"{message} ({of_inputs.files[0]}) left out")
    return [rows.at(np.flatnonzero(mask)) for rows, mask in zip(measured_rows, inside, strict=True)]


def describe_gap(
    context: ReadingContext,
    names: Sequence[str],
    rows: InputRows,
    shift: float,
    times: Array,
    step: int,
    usual: float,
) -> InputGap:
    """Return the gap of the inputs in which a step begins: a message with a place in the file.

    ``step`` is the index, among the ``times`` of the steps, of the time at which this step ends. The
    place is the blank row in the gap, or the row before it. ``shift`` is added to the times of ``rows``,
    and ``usual`` is their usual interval. The gap has no length if it lies before or after all rows.
    """
    unit = f" {context.time_unit}"
    inputs = ", ".join(names)
    row_times = rows.measured.time + shift
    before = int(np.searchsorted(row_times, times[step - 1] + TICK, side="right")) - 1
    after = min(before + 1, len(row_times) - 1)
    low = row_times[before] if before >= 0 else -np.inf
    high = row_times[after] if after > before else np.inf
    # Case 1: the step begins before the first row.
    if before < 0:
        message = f"the first values of the inputs {inputs} are at {time_text(row_times[0])}{unit}"
        message += f", and the first step begins at {time_text(times[step - 1])}{unit}"
        place = context.place(rows.measured, 0, f"{message}: give earlier values")
        return InputGap(place=place, step=step)
    # Case 2: it begins after the last row.
    if after == before:
        message = f"the inputs {inputs} end at {time_text(row_times[-1])}{unit}"
        message += f", and a step ends at {time_text(times[step])}{unit}"
        place = context.place(rows.measured, before, f"{message}: give later values, or say `last`")
        return InputGap(place=place, step=step)
    # Case 3: it begins between two rows, and there may be a blank one between them.
    length = float(row_times[after] - row_times[before])
    blank_times = rows.blank.time + shift
    blank_in_gap = np.flatnonzero((blank_times > low + TICK) & (blank_times < high - TICK))
    if len(blank_in_gap):
        message = f"there is no value of the inputs {inputs}"
        place = context.place(rows.blank, int(blank_in_gap[0]), message)
    else:
        message = f"no values of the inputs {inputs} follow for {length:.4g}{unit}"
        message += f", where {usual:.4g}{unit} are usual"
        place = context.place(rows.measured, before, message)
    return InputGap(place=place, step=step, length=length)


def check_gaps(inputs: KnownInputs, last_step: int) -> None:
    """Raise DataError if a gap of the inputs begins up to ``last_step``, the scenario's last step."""
    gaps = [gap for gap in inputs.gaps if gap.step <= last_step]
    if not gaps:
        return
    # The key `input_gap` fills all gaps between two rows if it is as long as the longest one. A gap
    # before or after all rows has no length (None), and no gap is long enough for it.
    longest = max((gap.length for gap in gaps if gap.length is not None), default=0.0)
    mistakes = []
    for gap in gaps[:MOST_MISTAKES]:
        message = gap.place.message
        answer = None
        if gap.length is not None:
            answer = Answer("input_gap", f"{_rounded_up(longest):g}")
            message += f": fill them, or say {answer.in_yaml} to hold values over the gap"
        mistakes.append(gap.place._replace(message=message, answer=answer))
    left_out = len(gaps) - len(mistakes)
    if left_out:
        message = f"{mistakes[-1].message}; there are {counted(left_out, 'more gap')}"
        mistakes[-1] = mistakes[-1]._replace(message=message)
    raise DataError(*mistakes)


def _rounded_up(length: float) -> float:
    """Round a positive time up to two digits: 0.123 becomes 0.13."""
    digit = 10.0 ** (np.floor(np.log10(length)) - 1.0)
    return float(f"{np.ceil(length / digit - 1e-9) * digit:.3g}")
