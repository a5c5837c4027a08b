"""Run blocks, alone or several side by side: join their tasks and data, filter, cut the output."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np

from trackbench.evaluation.block_result import BlockResult, reduce_to_results
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.cached_filter_outputs import (
    reference_output,
    run_filter_cached,
    run_reference,
)
from trackbench.evaluation.filter_output import FilterOutput
from trackbench.evaluation.freed_memory import keep_freed_memory
from trackbench.filters.base import JoinableFilter
from trackbench.scenarios.base import Simulation


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
    """Filter several blocks side by side, to save calls of numpy.

    The results have the same bytes as if each block were filtered alone. Of the joined task, ``width``
    is the number of runs of one block, ``copies`` the number of filters that get the same runs (1 for
    adjacent blocks), and ``runs`` the number of runs of all blocks together.

    Parameters
    ----------
    blocks
        adjacent blocks of one filter, or the same block of several filters of one structure
        (`JoinableFilter`)

    Returns
    -------
    list of dict
        results of each block, by the number of runs that they are computed from
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
                reference_output(block)
        # If the filter is itself the reference, its output is cached already, without covariances.
        if not covariances:
            cached = [run_reference.cached(block.filtering_task) for block in blocks]
            outputs = [output for output in cached if output is not None]
            if len(outputs) == len(blocks):
                return [
                    reduce_to_results(block, block.data, output)
                    for block, output in zip(blocks, outputs, strict=True)
                ]
        data = stack.data
        output = run_filter_cached(stack.filtering_task, covariances)
        if len(blocks) == 1:
            return [reduce_to_results(stack, data, output)]
        results = []
        for block, first in zip(blocks, range(0, stack.runs, stack.width), strict=True):
            block_data = cut_data(data, first, block.width)
            block_output = cut_output(output, first, block.width)
            results.append(reduce_to_results(block, block_data, block_output))
        return results


def join_blocks(blocks: Sequence[BlockTask]) -> BlockTask:
    """Return one task that filters all blocks side by side.

    Equal filters under several labels have one task, so that several filters are never all equal.

    Parameters
    ----------
    blocks
        adjacent blocks of one filter, or the same block of several filters

    Returns
    -------
    BlockTask
        task of all runs: ``stacked`` blocks of one filter, or ``copies`` of the runs of one block
    """
    first = blocks[0]
    filters = [block.filter for block in blocks]
    # Adjacent blocks of one filter become one long block.
    if len(set(filters)) == 1:
        return replace(first, stacked=len(blocks))
    # Several filters get a copy of the same runs each: `width` runs for each filter.
    joined = cast(JoinableFilter[Any], first.filter).joined(filters, first.width)
    return replace(first, filter=joined, copies=len(blocks))


def cut_data(data: Simulation, first: int, width: int) -> Simulation:
    """Return the data of one block of a stack.

    Parameters
    ----------
    data
        data of the stack, with the runs as last axis
    first
        index of the block's first run in the stack
    width
        number of runs of the block

    Returns
    -------
    Simulation
        copy with the runs of the block. The prior, which only filters need, stays that of the whole
        stack
    """
    cut = data._replace(
        truth=_cut_runs(data.truth, first, width),
        measurements=_cut_runs(data.measurements, first, width),
    )
    if data.arrival is not None:
        cut = cut._replace(arrival=_cut_runs(data.arrival, first, width))
    return cut


def cut_output(output: FilterOutput, first: int, width: int) -> FilterOutput:
    """Return the output for one block of a stack, with its share of the CPU time.

    Parameters
    ----------
    output
        output for the stack, with the runs as last axis
    first
        index of the block's first run in the stack
    width
        number of runs of the block

    Returns
    -------
    FilterOutput
        copies of arrays whose runs are added up, and views of the others
    """
    share = width / output.mean.shape[-1]
    # Arrays whose runs are added up are copied, for equal sums. The others are viewed, or are None.
    return FilterOutput(
        mean=_cut_runs(output.mean, first, width),
        nees=_cut_runs(output.nees, first, width),
        cov=_view_runs(output.cov, first, width),
        diagnostics={
            name: _cut_runs(rows, first, width) for name, rows in output.diagnostics.items()
        },
        cpu_s=output.cpu_s * share,
        refused=_view_runs(output.refused, first, width),
        indefinite=_view_runs(output.indefinite, first, width),
    )


def _cut_runs(rows: Any, first: int, width: int) -> Any:
    """Copy ``width`` runs from run ``first`` on.

    numpy adds up a contiguous copy in the same order as the array of a block that is filtered alone.
    """
    return np.ascontiguousarray(rows[..., first : first + width])


def _view_runs(rows: Any, first: int, width: int) -> Any:
    """Return a view of ``width`` runs from run ``first`` on; None if there are no rows.

    It is for covariances and masks, which are not added up over the runs: the order in memory does not
    matter, and no copy is needed. Arrays that are added up are copied by `_cut_runs`.
    """
    if rows is None:
        return None
    return rows[..., first : first + width]
