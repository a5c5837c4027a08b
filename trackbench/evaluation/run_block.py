"""Compute the metrics of a block: simulate its runs, run the filter over them, reduce the errors."""

from collections.abc import Sequence

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.latest_results import LatestResults
from trackbench.evaluation.allowed_metric_names import check_diagnostic_names
from trackbench.evaluation.block import BlockTask
from trackbench.evaluation.block_result import BlockResult, Tracks
from trackbench.evaluation.blocks_side_by_side import (
    MOST_STACKED,
    cut_data,
    cut_output,
    join_blocks,
)
from trackbench.evaluation.damage_of_faults import task_without_faults
from trackbench.evaluation.error_series import series
from trackbench.evaluation.freed_memory import keep_freed_memory
from trackbench.evaluation.gate_decisions import gate_decisions
from trackbench.evaluation.likelihood_ratio import likelihood_ratio
from trackbench.evaluation.lost_runs import NOT_LOST, has_finite_truth, stayed_finite
from trackbench.evaluation.nees import first_indefinite_steps, rank_of
from trackbench.evaluation.per_run_metrics import per_run_metrics
from trackbench.evaluation.run_filter import (
    FilterOutput,
    run_filter_cached,
    run_reference,
    run_twin,
)
from trackbench.evaluation.series_sums import SeriesSums, StepSums, step_sums, with_unused
from trackbench.models.delays import LATE_COUNTS
from trackbench.scenarios.base import Simulation

_COLUMNS = 16_384  # runs times steps whose series are made and added up at a time, in the cache


def run_block(task: BlockTask) -> BlockResult:
    """Simulate the block's runs, filter them, and reduce the errors to metrics."""
    return run_whole_block(task)[task.runs_used]


def run_whole_block(task: BlockTask) -> dict[int, BlockResult]:
    """Return the block's metrics by the number of runs that they are computed from.

    The numbers are those of the used runs, of all runs of the block, and `BlockTask.extra_run_counts`. A
    later batch of more runs needs the metrics of all runs, which cost next to nothing.
    """
    return run_stack([task])[0]


def run_stack(blocks: Sequence[BlockTask]) -> list[dict[int, BlockResult]]:
    """Filter several blocks side by side, to save calls of numpy; return the results of each block.

    The results of a block are by the number of runs that they are computed from. They have the same
    bytes as if each block were filtered alone. The blocks are adjacent blocks of one filter, or have the
    same runs and filters of one structure (`JoinableFilter`).

    Of the joined task, ``width`` is the number of runs of one block, ``copies`` the number of filters
    that get the same runs (1 for adjacent blocks), and ``runs`` the number of runs of all blocks
    together.
    """
    keep_freed_memory()
    stack = join_blocks(blocks)
    # Number of runs, the first ones of the stack, whose covariances the filter's output keeps.
    covariances = 0
    if stack.keep_covariance:
        covariances = stack.runs_with_tracks_among(stack.runs)
        # The first runs of each copy are not the first ones of the stack: keep those of all runs.
        if covariances and stack.copies > 1:
            covariances = stack.runs
    with np.errstate(all="ignore"):  # a run that is no longer finite is counted, not warned about
        # The reference runs first, so that the filter's output is the last one and stays cached. The
        # cache of references has room for one of each block.
        run_reference.size = max(run_reference.size, len(blocks))
        for block in blocks:
            if block.reference is not None:
                _reference_output(block)
        # If the filter is itself the reference, its output is cached already, without covariances.
        if not covariances:
            cached = [run_reference.cached(block.filtering_task) for block in blocks]
            outputs = [output for output in cached if output is not None]
            if len(outputs) == len(blocks):
                return [
                    _reduce(block, block.data, output)
                    for block, output in zip(blocks, outputs, strict=True)
                ]
        data = stack.data
        output = run_filter_cached(stack.filtering_task, covariances)
        if len(blocks) == 1:
            return [_reduce(stack, data, output)]
        results = []
        for block, first in zip(blocks, range(0, stack.runs, stack.width), strict=True):
            block_data = cut_data(data, first, block.width)
            block_output = cut_output(output, first, block.width)
            results.append(_reduce(block, block_data, block_output))
        return results


def _reference_output(task: BlockTask) -> FilterOutput:
    """Return the output of the task's reference filter, or one of NaN if the reference fails.

    The filter then has only the numbers that need no reference.
    """
    reference = task.reference_task
    # If the reference is itself the filter of the task, its failure is raised: its numbers are missing.
    is_reference = (task.filter, task.assume) == (task.reference, task.reference_assume)
    # A reference that failed before, beside another filter of the block, is not run again: its output of
    # NaN is in the cache.
    unknown = _unknown_references.cached(reference)
    if unknown is not None and not is_reference:
        return unknown
    try:
        return run_reference(reference)
    except MemoryError:
        raise
    except Exception:
        unknown = _unknown_references(reference)
        if is_reference:
            raise
        return unknown


def _unknown_output(task: BlockTask) -> FilterOutput:
    """Return an output of NaN, in place of that of a reference that failed.

    It has a log-likelihood if predictive metrics are requested, as the likelihood ratio needs it.
    """
    unknown = np.full(task.data.truth.shape, np.nan)  # (n_x, T + 1, M)
    scores: dict[str, Array] = {}
    if task.predictive_metrics:
        scores["log_likelihood"] = unknown[0]
    return FilterOutput(mean=unknown, nees=unknown[0], cov=None, diagnostics=scores, cpu_s=0.0)


_unknown_references = LatestResults(_unknown_output, size=MOST_STACKED)
"""Outputs of references that failed: each is run once for all filters of a block."""


def _reduce(task: BlockTask, data: Simulation, output: FilterOutput) -> dict[int, BlockResult]:
    """Reduce the ``output`` of the filter over the block's ``data`` to metrics.

    They are returned by the number of runs that they are computed from.
    """
    # A plugin's diagnostic must not have the name of a metric of the errors.
    check_diagnostic_names(task.filter.summed_diagnostics)
    exact_mean: Array | None = None
    # Series that are no errors: the filter's diagnostics and, from below, the likelihood ratio and the
    # gate's decisions.
    not_errors = dict(output.diagnostics)
    if task.reference is not None:
        exact = _reference_output(task)
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
    values, sums = _series_and_sums(task, data, output, not_errors, exact_mean, twin_mean)
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


def _series_and_sums(
    task: BlockTask,
    data: Simulation,
    output: FilterOutput,
    not_errors: dict[str, Array],
    exact_mean: Array | None,
    twin_mean: Array | None,
) -> tuple[dict[str, Array], SeriesSums]:
    """Return the series (T + 1, M) of errors, those of ``not_errors``, and the sums of all of them.

    ``not_errors`` has the filter's diagnostics (T + 1, M) and other series that are no errors, such as
    the likelihood ratio. One of them may give the degrees of freedom of the NEES, for `rank_of`.
    ``exact_mean`` is the mean of the reference, ``twin_mean`` that of the same filter without faults,
    (n_x, T + 1, M) each. They are None if there is no reference, or the scenario has no faults.

    The steps are taken in pieces, whose series are added up while they are in the processor's cache.
    """
    values: dict[str, Array] = {}
    # Series that exist already for all steps.
    whole = {"nees": output.nees} | not_errors
    # Series that are summed over the steps, not averaged: the filter's own, and the numbers of
    # measurements that arrive late and that are dropped.
    counts = task.filter.summed_diagnostics | LATE_COUNTS
    sums = SeriesSums(task.scenario.windows, counts)
    steps, runs = output.nees.shape
    at_a_time = max(1, _COLUMNS // runs)
    rank = rank_of("nees", not_errors, len(data.truth))

    for first in range(0, steps, at_a_time):
        piece = slice(first, first + at_a_time)
        rows_by_name = series(
            task.scenario,
            truth=data.truth[:, piece],
            mean=output.mean[:, piece],
            nees=output.nees[piece],
            exact=_steps_of_mean(exact_mean, piece),
            rank=None if rank is None else rank[piece],
            twin=_steps_of_mean(twin_mean, piece),
        )
        for name, rows in not_errors.items():
            rows_by_name[name] = rows[piece]
        for name, rows in rows_by_name.items():
            if name in whole:
                values[name] = whole[name]
            else:
                if name not in values:
                    values[name] = np.empty((steps, runs))
                values[name][piece] = rows
            sums.add(name, rows, first)
    return values, sums


def _steps_of_mean(mean: Array | None, piece: slice) -> Array | None:
    """Return some steps of a mean (n_x, T + 1, M), if there is one."""
    if mean is None:
        return None
    return mean[:, piece]


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
