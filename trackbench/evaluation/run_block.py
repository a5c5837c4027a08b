"""From a task to its numbers: the block's data, the filter's way through them, its errors as metrics."""

from functools import lru_cache

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.evaluation.block import BlockResult, BlockTask, Tracks
from trackbench.evaluation.calibration import likelihood_ratio
from trackbench.evaluation.error_series import FOUND, per_run_metrics, series, step_sums
from trackbench.evaluation.run_filter import FilterOutput, run_filter_cached
from trackbench.evaluation.validate_output import check_names
from trackbench.scenarios.base import Simulation


def run_block(task: BlockTask) -> BlockResult:
    """Simulate the block's runs, filter them, and reduce the errors to metrics."""
    return run_whole_block(task)[task.runs_used]


def run_whole_block(task: BlockTask) -> dict[int, BlockResult]:
    """Return the block reduced over the runs that are used, and over all of its width.

    The second costs next to nothing, and is what a later batch of more runs needs.
    """
    keep_freed_memory()
    with np.errstate(all="ignore"):  # a run that leaves the numbers is counted, not warned about
        # Step 1: data and estimates of the whole block, of the filter and the reference.
        data = task.data
        result = run_filter_cached(
            task.filtering_key,
            task.runs_with_tracks_among(task.width) if task.keep_covariance else 0,
        )
        exact = None if task.reference is None else run_filter_cached(task.reference_task, 0)
        exact_mean = None if exact is None else exact.mean
        # Step 2: error series (T + 1, M), then the filter's diagnostics and the likelihood ratio.
        values = series(task.scenario, data.truth, result.mean, result.nees, exact_mean)
        values |= result.diagnostics
        if exact is not None and "likelihood_ratio" in task.predictive_metrics:
            values |= likelihood_ratio(values, exact.diagnostics)
        check_names(task.filter.summed_diagnostics)
        finite = _stayed_finite(result.mean)
        # Over the whole block, then trimmed: numpy adds up a single column in another order.
        per_run = per_run_metrics(task.scenario, values, task.filter.summed_diagnostics, finite)
        return {
            used: _trimmed(task, data, result, values, per_run, used)
            for used in {task.runs_used, task.width, *task.extra_run_counts}
        }


def _stayed_finite(mean: Array) -> Mask:
    """Return the runs (M,) that are finite at every step, in the components that any run estimates."""
    there = np.isfinite(mean)
    estimated = there.any(axis=(1, 2))  # a converted measurement, say, has no velocity
    return np.asarray(there[estimated].all(axis=(0, 1)) & estimated.any())


def _trimmed(
    task: BlockTask,
    data: Simulation,
    result: FilterOutput,
    values: dict[str, Array],
    per_run: dict[str, Array],
    used: int,
) -> BlockResult:
    # Keep the first ``used`` runs of every series and metric.
    values = {name: rows[:, :used] for name, rows in values.items()}
    per_run = {name: numbers[:used] for name, numbers in per_run.items()}
    kept = [name for name in task.keep_steps if name in values]
    # Whole tracks of the first runs, for figures.
    tracks, shown = None, task.runs_with_tracks_among(used)
    if shown:
        cov = None if result.cov is None else result.cov[..., :shown]
        seen = data.measurements[..., :shown]
        tracks = Tracks(data.truth[..., :shown], seen, result.mean[..., :shown], cov)
    return BlockResult(
        per_run=per_run,
        # Training runs (index < 0) have no sums per step.
        steps={
            name: step_sums(rows, per_run["lost"])
            for name, rows in values.items()
            if task.index >= 0
        },
        run_series={n: np.where(per_run["lost"] == FOUND, values[n], np.nan) for n in kept},
        tracks=tracks,
        cpu_s=result.cpu_s,
        width=task.width,
    )


@lru_cache(maxsize=1)
def keep_freed_memory() -> None:
    """Let the arrays of one step reuse the memory of the last, which can halve the time of a step.

    The GNU allocator gives freed memory back to the system, to fetch it again page by page a moment
    later, unless it has once freed a larger block (up to 32 MiB). This one is never touched.
    """
    np.empty(31 << 20, dtype=np.uint8)
