"""Results of a block: metrics per run, sums per step, series and tracks that are stored."""

from typing import NamedTuple

from trackbench.core.arrays import Array
from trackbench.evaluation.series_sums import StepSums


class Tracks(NamedTuple):
    """Whole tracks of r runs: truth and mean (n_x, T + 1, r), measurements (n_z, T, r)."""

    truth: Array
    measurements: Array
    mean: Array
    cov: Array | None


class BlockResult(NamedTuple):
    """Metrics of the block's used runs, and the tracks of the runs that figures show."""

    per_run: dict[str, Array]
    """metrics per run (M,)"""
    steps: dict[str, StepSums]
    """sums over the runs at each step, by series"""
    run_series: dict[str, Array]
    """series (T + 1, M) that are stored per run and step"""
    tracks: Tracks | None
    cpu_s: float
    """CPU seconds of the filter for all runs of the block"""
    width: int
    """number of runs that the CPU time is for"""
