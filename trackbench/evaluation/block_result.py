"""Results of a block: reduce the filter's output to metrics, and trim them to the reported runs.

They are metrics per run, sums per step, and the series and tracks that are stored.
"""

from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.allowed_metric_names import check_diagnostic_names
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.cached_filter_outputs import reference_output, run_twin
from trackbench.evaluation.damage_of_faults import task_without_faults
from trackbench.evaluation.filter_output import FilterOutput
from trackbench.evaluation.gate_decisions import gate_decisions
from trackbench.evaluation.likelihood_ratio import likelihood_ratio
from trackbench.evaluation.lost_runs import NOT_LOST, has_finite_truth, stayed_finite
from trackbench.evaluation.per_run_metrics import first_indefinite_steps, per_run_metrics
from trackbench.evaluation.series_sums import StepSums, series_and_sums, step_sums, with_unused
from trackbench.scenarios.base import Simulation


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


def reduce_to_results(
    task: BlockTask, data: Simulation, output: FilterOutput
) -> dict[int, BlockResult]:
    """Reduce the output of the filter over a block to metrics.

    Parameters
    ----------
    task
        filter, scenario and runs of the block
    data
        truth and measurements of the block
    output
        output of the filter over ``data``

    Returns
    -------
    dict
        results by the number of runs that they are computed from: those that are reported, all runs of
        the block, and the ``extra_run_counts`` of the task

    Raises
    ------
    WrongReturnError
        for a name that a diagnostic or a metric of a plugin cannot have
    """
    # A plugin's diagnostic must not have the name of a metric of the errors.
    check_diagnostic_names(task.filter.summed_diagnostics)
    exact_mean: Array | None = None
    # Series that are no errors: the filter's diagnostics and, from below, the likelihood ratio and the
    # gate's decisions.
    not_errors = dict(output.diagnostics)
    if task.reference is not None:
        exact = reference_output(task)
        exact_mean = exact.mean
        if "likelihood_ratio" in task.predictive_metrics:
            not_errors |= likelihood_ratio(not_errors, exact.diagnostics)
    # The twin is the same filter in the same runs without faults.
    twin_task = task_without_faults(task)
    twin_mean: Array | None = None
    weights: dict[str, Array] = {}
    if twin_task is not None:
        if task.scenario.has_truth:
            twin_mean = run_twin(twin_task).mean
        decisions, weights = gate_decisions(task, twin_task, data, output)
        not_errors |= decisions
    # Step 1: error series (T + 1, M), then the others.
    values, sums = series_and_sums(task, data, output, not_errors, exact_mean, twin_mean)
    # Step 2: compute the metrics of all runs of the block, and trim them then. numpy adds up the steps
    # of a single run in another order, and a run must have the same bytes alone as in its block.
    finite = stayed_finite(output.mean)
    finite_truth = has_finite_truth(task.scenario, data.truth)
    per_run = per_run_metrics(task.scenario, values, sums, finite, finite_truth, weights)
    if output.indefinite is not None:
        per_run |= first_indefinite_steps(task.scenario, output.indefinite, per_run["lost"])
    # Without lost runs the sums over all runs at each step are known already.
    sums_of_width: dict[int, dict[str, StepSums]] = {}
    if not (per_run["lost"] != NOT_LOST).any():
        sums_of_width[task.width] = sums.over_runs()
    results = {}
    # Results are needed of the runs that are reported, of all runs of the block, and of the numbers of
    # runs after which the batch may stop.
    for used in {task.runs_used, task.width, *task.extra_run_counts}:
        known_sums = sums_of_width.get(used, {})
        results[used] = _trimmed_result(task, data, output, values, per_run, used, known_sums)
    return results


def _trimmed_result(
    task: BlockTask,
    data: Simulation,
    output: FilterOutput,
    values: dict[str, Array],
    per_run: dict[str, Array],
    used: int,
    known_sums: dict[str, StepSums],
) -> BlockResult:
    """Return the results of the block's first ``used`` runs.

    ``data`` and ``output`` are those of all runs of the block. ``values`` are the series (T + 1, M) and
    ``per_run`` the metrics (M,) of all runs. ``known_sums`` are sums over the used runs at each step, of
    the series for which they are known already.
    """
    # Keep the first ``used`` runs of every series and metric.
    used_values = {name: rows[:, :used] for name, rows in values.items()}
    used_per_run = {name: numbers[:used] for name, numbers in per_run.items()}
    lost = used_per_run["lost"]
    run_series = {
        name: np.where(lost == NOT_LOST, used_values[name], np.nan)
        for name in task.keep_steps
        if name in used_values
    }
    # Whole tracks of the first runs, for figures.
    tracks = None
    shown = task.runs_with_tracks_among(used)
    if shown:
        tracks = Tracks(
            truth=_first_runs(data.truth, shown),
            measurements=_first_runs(data.measurements, shown),
            mean=_first_runs(output.mean, shown),
            cov=None,
        )
        if output.cov is not None:
            tracks = tracks._replace(cov=_first_runs(output.cov, shown))
    # Sums per step; training runs have none.
    steps: dict[str, StepSums] = {}
    if not task.is_training:
        for name, rows in used_values.items():
            steps[name] = known_sums[name] if name in known_sums else step_sums(rows, lost)
    # `with_unused` adds zeros for each NEES or NIS that lacks no components in this block: it may lack
    # some in others, to which the sums are added.
    return BlockResult(
        per_run=used_per_run,
        steps=with_unused(steps),
        run_series=run_series,
        tracks=tracks,
        cpu_s=output.cpu_s,
        width=task.width,
    )


def _first_runs(rows: Array, number: int) -> Array:
    """Return the first ``number`` runs as a copy, because a view would keep all runs in memory."""
    if rows.shape[-1] == number:
        return rows
    return rows[..., :number].copy()
