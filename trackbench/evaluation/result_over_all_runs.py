"""Result of one filter over all runs: its merged blocks, from which the files of results are made."""

from typing import NamedTuple

from trackbench.core.arrays import Array
from trackbench.evaluation.block_result import Tracks
from trackbench.evaluation.measure_cpu_times import Measured
from trackbench.evaluation.series_sums import StepSums


class Timing(NamedTuple):
    """CPU seconds of one block's filter, and the runs it was computed for."""

    cpu_s: float
    runs: int


class FilterResult(NamedTuple):
    """One filter over all runs: values per run (M,), sums per step, kept series (T + 1, M)."""

    per_run: dict[str, Array]
    steps: dict[str, StepSums]
    run_series: dict[str, Array]
    tracks: Tracks | None
    timing: list[Timing]
    measured: Measured | None = None
    """CPU times of repeated steps, measured in turns with the other filters"""
