"""Ratio of the CPU times of two filters: the median over the repeats of the ratio in each repeat."""

from typing import Any

import numpy as np

from trackbench.core.arrays import Array
from trackbench.statistics.estimates import RunEstimate
from trackbench.statistics.sample_statistics import median


def ratio_of_repeats(a: Array, b: Array) -> RunEstimate | None:
    """Return the median of the ratios of the CPU times of two filters.

    Parameters
    ----------
    a, b
        seconds per run of each repeat, in which both filters are timed in turn

    Returns
    -------
    RunEstimate or None
        median of a / b, whose number of runs is that of the repeats. None unless both filters have
        equally many repeats, at least two
    """
    if len(a) != len(b) or len(a) < 2:
        return None
    ratio = median(a / b)
    # ``runs`` is the number of repeats here.
    return RunEstimate(value=ratio.value, stderr=ratio.stderr, influences=None, runs=len(a))


def repeats_of(row: dict[str, Any]) -> Array:
    """Return CPU seconds per run of each repeat, from a row of timing.csv: ``0.12;0.13``."""
    return np.array([float(s) for s in str(row.get("repeats", "")).split(";") if s])
