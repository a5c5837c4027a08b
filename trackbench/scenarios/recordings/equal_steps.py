"""Test whether the steps of a recording are equally long."""

import numpy as np

from trackbench.core.arrays import Array

_EQUAL = 1e-6  # of an interval: a clock that strays by less has equal steps


def equal_interval(times: Array) -> float | None:
    """Return the interval of equally spaced times, s, to 12 digits; None if intervals differ."""
    intervals = np.diff(times)
    if not len(intervals):
        return None
    # Equal if each interval is the mean one within a share of _EQUAL.
    T = float((times[-1] - times[0]) / len(intervals))
    if np.abs(intervals - T).max() <= _EQUAL * T:
        return float(f"{T:.12g}")
    return None
