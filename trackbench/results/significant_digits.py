"""Significant digits of the numbers and times in the CSV files of a results folder."""

from collections.abc import Iterable
from math import isfinite

import numpy as np

from trackbench.config.experiment import Experiment
from trackbench.core.arrays import Array
from trackbench.execution.plan import Key

DIGITS = {"per_run.csv": 7, "per_step.csv": 6, "summary.csv": 7}
"""Significant digits of values and standard errors, far more than the errors justify."""
EXACT_DIGITS = 15
"""Significant digits in per_run.csv if a paper prints seven or more and nothing is random."""
_LARGEST_ROUNDING = 0.05
"""Share of the shortest interval by which usual digits may round a time in per_step.csv"""
_FINE_ROUNDING = 1e-3
"""Share of the shortest interval to which a time is written if the usual digits are too few"""
_MOST_DIGITS = 17


def digits_per_run(experiment: Experiment, key: Key) -> int:
    """Return the number of significant digits of a filter's values in per_run.csv.

    It is larger than usual if nothing is random and a paper prints so many digits, which are then
    compared one by one.
    """
    i, label = key
    point = experiment.points[i]
    usual = DIGITS["per_run.csv"]
    is_random = point.scenario.recorded_runs is None or not point.filters[label].deterministic
    if is_random:
        return usual
    printed = [
        number.significant_digits
        for number in experiment.published.numbers
        if label in number.labels
    ]
    if max(printed, default=0) < usual:
        return usual
    return EXACT_DIGITS


def digits_of_values(per_run: Iterable[Array]) -> int:
    """Return the number of significant digits of one filter's values (M,) read from per_run.csv.

    It is `EXACT_DIGITS` if any value has more digits than usual.
    """
    usual = DIGITS["per_run.csv"]
    for values in per_run:
        for value in values.tolist():
            # A value with no more than the usual digits is equal to itself when it is rounded.
            if isfinite(value) and float(f"{value:.{usual}g}") != value:
                return EXACT_DIGITS
    return usual


def digits_of_times(times: Array, usual: int) -> int:
    """Return the significant digits with which ascending times (T,) are written.

    They are the usual ones, unless neighbors would hardly differ, as those of a clock that counts from
    1970: then they are so many that a thousandth of the shortest interval is written.
    """
    intervals = np.diff(times)
    intervals = intervals[intervals > 0.0]
    largest = float(np.abs(times).max(initial=0.0))
    if not len(intervals) or not np.isfinite(largest):
        return usual
    shortest = float(intervals.min())
    # Digits before the decimal point.
    whole = int(np.floor(np.log10(largest))) + 1
    if 0.5 * 10.0 ** (whole - usual) <= _LARGEST_ROUNDING * shortest:
        return usual
    behind_point = int(np.ceil(-np.log10(_FINE_ROUNDING * shortest)))
    return min(whole + behind_point, _MOST_DIGITS)
