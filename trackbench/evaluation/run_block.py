"""From a task to its numbers: the block's data, the filter's way through them, its errors as metrics."""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, cast

import numpy as np

from trackbench.core.arrays import Array, LatestResults, Mask
from trackbench.evaluation.block import MOST_STACKED, BlockResult, BlockTask, Tracks
from trackbench.evaluation.consistency_and_calibration import likelihood_ratio, rank_of
from trackbench.evaluation.error_series import (
    NOT_LOST,
    SeriesSums,
    StepSums,
    per_run_metrics,
    rejections,
    sensor_rejections,
    series,
    step_sums,
    with_unused,
)
from trackbench.evaluation.late_measurements import deliveries
from trackbench.evaluation.run_filter import (
    FilterOutput,
    run_filter_cached,
    run_reference,
    run_twin,
)
from trackbench.evaluation.validate_output import check_names
from trackbench.filters.base import JoinableFilter
from trackbench.models.delays import LATE_COUNTS
from trackbench.models.sensors.base import Sensors, rows_of
from trackbench.scenarios.base import Simulation

_COLUMNS = 16_384  # runs times steps whose series are made and added up at a time, in the cache


def run_block(task: BlockTask) -> BlockResult:
    """Simulate the block's runs, filter them, and reduce the errors to metrics."""
    return run_whole_block(task)[task.runs_used]


def run_whole_block(task: BlockTask) -> dict[int, BlockResult]:
    """Return the block reduced over the runs that are used, and over all of its width.

    The second costs next to nothing, and is what a later batch of more runs needs.
    """
    return run_stack([task])[0]


def run_stack(blocks: Sequence[BlockTask]) -> list[dict[int, BlockResult]]:
    """Return each block's results, with the same bytes as alone, by the number of runs used.

    The blocks are filtered side by side, to save calls of numpy. They are adjacent blocks of one filter,
    or have the same runs and filters of one structure (`JoinableFilter`).
    """
    keep_freed_memory()
    stack = _stack_of(blocks)
    covariances = stack.runs_with_tracks_among(stack.runs) if stack.keep_covariance else 0
    if covariances and stack.copies > 1:
        covariances = stack.runs  # each copy has its first runs
    with np.errstate(all="ignore"):  # a run that leaves the numbers is counted, not warned about
        # The reference first, so that the filter's output is the one that stays cached.
        run_reference.size = max(run_reference.size, len(blocks))
        for block in blocks:
            if block.reference is not None:
                _reference_of(block)
        # A filter that is the others' reference may have been run.
        cached = [run_reference.cached(block.filtering_key) for block in blocks]
        known = [output for output in cached if output is not None]
        if len(known) == len(blocks) and not covariances:
            return [_reduce(b, b.data, output) for b, output in zip(blocks, known, strict=True)]
        data, output = stack.data, run_filter_cached(stack.filtering_key, covariances)
        if len(blocks) == 1:
            return [_reduce(stack, data, output)]
        return [
            _reduce(block, *_cut(data, output, first, block.width))
            for block, first in zip(blocks, range(0, stack.runs, stack.width), strict=True)
        ]


def _reference_of(task: BlockTask) -> FilterOutput:
    """Return the reference's output, NaN if it fails: the filter keeps its other numbers."""
    reference = task.reference_task
    # The reference among the filters reports its own failure.
    is_reference = (task.filter, task.assume) == (task.reference, task.reference_assume)
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
    unknown = np.full(task.data.truth.shape, np.nan)
    scores = {"log_likelihood": unknown[0]} if task.predictive_metrics else {}
    return FilterOutput(mean=unknown, nees=unknown[0], cov=None, diagnostics=scores, cpu_s=0.0)


_unknown_references = LatestResults(_unknown_output, size=MOST_STACKED)
"""Outputs of references that failed: each is run once for all filters of a block."""


def _stack_of(blocks: Sequence[BlockTask]) -> BlockTask:
    """Return the task of all blocks side by side."""
    first, filters = blocks[0], [block.filter for block in blocks]
    if len(set(filters)) == 1:
        return replace(first, stacked=len(blocks))
    joined = cast(JoinableFilter[Any], first.filter).joined(filters, first.width)
    return replace(first, filter=joined, copies=len(blocks))


def _cut(
    data: Simulation, output: FilterOutput, first: int, width: int
) -> tuple[Simulation, FilterOutput]:
    """Return a block's share of a stack: sums over contiguous copies have the order of a lone block."""
    share = width / output.mean.shape[-1]

    def runs_of(rows: Any) -> Any:
        return np.ascontiguousarray(rows[..., first : first + width])

    return (
        data._replace(
            truth=runs_of(data.truth),
            measurements=runs_of(data.measurements),
            arrival=None if data.arrival is None else runs_of(data.arrival),
        ),
        FilterOutput(
            mean=runs_of(output.mean),
            nees=runs_of(output.nees),
            cov=_runs_of(output.cov, first, width),
            diagnostics={name: runs_of(rows) for name, rows in output.diagnostics.items()},
            cpu_s=output.cpu_s * share,
            particles=_runs_of(output.particles, first, width),
            refused=_runs_of(output.refused, first, width),
        ),
    )


def _runs_of(rows: Any, first: int, width: int) -> Any:
    return None if rows is None else rows[..., first : first + width]


def _reduce(task: BlockTask, data: Simulation, output: FilterOutput) -> dict[int, BlockResult]:
    """Return the block's metrics by the number of runs that they are reduced over."""
    check_names(task.filter.summed_diagnostics)
    exact = None if task.reference is None else _reference_of(task)
    predictive = dict(output.diagnostics)
    weights = dict[str, Array]()
    if exact is not None and "likelihood_ratio" in task.predictive_metrics:
        predictive |= likelihood_ratio(predictive, exact.diagnostics)
    twin_task, twin_mean = task.twin_task, None
    if twin_task is not None:
        if task.scenario.has_truth:
            twin_mean = run_twin(twin_task).mean
        z, clean = data.measurements, twin_task.data.measurements
        if delivered := deliveries(task, data):
            z, clean = delivered.given(z), delivered.given(clean)
        if output.refused is None:
            predictive |= rejections(z, clean, output.diagnostics)
        else:
            sensors = rows_of(cast(Sensors, task.scenario.true_sensor))
            decided, weights = sensor_rejections(z, clean, output.refused, sensors)
            predictive |= decided
    # Step 1: error series (T + 1, M), then the filter's diagnostics and the likelihood ratio.
    exact_mean = None if exact is None else exact.mean
    values, sums = _series_and_sums(task, data, output, predictive, exact_mean, twin_mean)
    # Step 2: over the whole block, then trimmed: numpy adds up a single column in another order.
    finite = _stayed_finite(output.mean)
    finite_truth: Mask | None = None
    if task.scenario.recorded_runs is None:
        # An unknown truth of a recording is NaN, as that of a target that is gone.
        bad_truth = np.isinf(data.truth)
        if task.scenario.exists_always:
            bad_truth |= np.isnan(data.truth)
        finite_truth = ~np.asarray(bad_truth.any(axis=(0, 1)))
    per_run = per_run_metrics(task.scenario, values, sums, finite, finite_truth, weights)
    lost = (per_run["lost"] != NOT_LOST).any()
    known = {task.width: {} if lost else sums.over_runs()}
    return {
        used: _trimmed(task, data, output, values, per_run, used, known.get(used, {}))
        for used in {task.runs_used, task.width, *task.extra_run_counts}
    }


def _series_and_sums(
    task: BlockTask,
    data: Simulation,
    output: FilterOutput,
    predictive: dict[str, Array],
    exact_mean: Array | None,
    twin_mean: Array | None,
) -> tuple[dict[str, Array], SeriesSums]:
    """Return the series of errors and those that are told, and their sums.

    The steps are taken in pieces, whose series are added up while they are in the cache.
    """
    values, whole = dict[str, Array](), {"nees": output.nees} | predictive
    sums = SeriesSums(task.scenario.windows, task.filter.summed_diagnostics | LATE_COUNTS)
    steps, runs = output.nees.shape
    at_a_time = max(1, _COLUMNS // runs)
    rank = rank_of("nees", predictive, len(data.truth))
    for first in range(0, steps, at_a_time):
        part = slice(first, first + at_a_time)
        mean, truth, nees = output.mean[:, part], data.truth[:, part], output.nees[part]
        exact = None if exact_mean is None else exact_mean[:, part]
        of_part = None if rank is None else rank[part]
        twin = None if twin_mean is None else twin_mean[:, part]
        rows = series(task.scenario, truth, mean, nees, exact, of_part, twin)
        for name, row in (rows | {name: whole[name][part] for name in predictive}).items():
            if name not in values:
                values[name] = whole[name] if name in whole else np.empty((steps, runs))
            if name not in whole:
                values[name][part] = row
            sums.add(name, row, first)
    return values, sums


def _stayed_finite(mean: Array) -> Mask:
    """Return the runs (M,) that are finite at every step, in the components that any run estimates."""
    if np.isfinite(np.add.reduce(mean, axis=None)):  # in any order: a finite sum has finite terms
        return np.ones(mean.shape[-1], dtype=np.bool_)
    finite = np.isfinite(mean)
    estimated = finite.any(axis=(1, 2))  # a converted measurement, say, has no velocity
    return np.asarray(finite[estimated].all(axis=(0, 1)) & estimated.any())


def _trimmed(
    task: BlockTask,
    data: Simulation,
    result: FilterOutput,
    values: dict[str, Array],
    per_run: dict[str, Array],
    used: int,
    known: dict[str, StepSums],
) -> BlockResult:
    # Keep the first ``used`` runs of every series and metric.
    values = {name: rows[:, :used] for name, rows in values.items()}
    per_run = {name: numbers[:used] for name, numbers in per_run.items()}
    series = [name for name in task.keep_steps if name in values]
    # Whole tracks of the first runs, for figures.
    tracks, shown = None, task.runs_with_tracks_among(used)
    if shown:
        cov = None if result.cov is None else _first_runs(result.cov, shown)
        clouds = None if result.particles is None else _first_runs(result.particles, shown)
        truth, measurements = _first_runs(data.truth, shown), _first_runs(data.measurements, shown)
        tracks = Tracks(truth, measurements, _first_runs(result.mean, shown), cov, clouds)
    # Sums per step; training runs (index < 0) have none.
    steps = {
        name: known[name] if name in known else step_sums(rows, per_run["lost"])
        for name, rows in values.items()
        if task.index >= 0
    }
    return BlockResult(
        per_run=per_run,
        steps=with_unused(steps),
        run_series={n: np.where(per_run["lost"] == NOT_LOST, values[n], np.nan) for n in series},
        tracks=tracks,
        cpu_s=result.cpu_s,
        width=task.width,
    )


def _first_runs(rows: Array, number: int) -> Array:
    """Return the first runs as a copy, because a view would keep the other runs in memory."""
    return rows if rows.shape[-1] == number else rows[..., :number].copy()


@lru_cache(maxsize=1)
def keep_freed_memory() -> None:
    """Let the arrays of one step reuse the memory of the last, which can halve the time of a step.

    The GNU allocator gives freed memory back to the system, to fetch it again page by page a moment
    later, unless it has once freed a larger block (up to 32 MiB). This one is never touched.
    """
    np.empty(31 << 20, dtype=np.uint8)
