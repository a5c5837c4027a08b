"""Blocks that are filtered side by side: join their tasks and data, and cut their output."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np

from trackbench.evaluation.block import BlockTask
from trackbench.evaluation.run_filter import FilterOutput
from trackbench.filters.base import JoinableFilter
from trackbench.scenarios.base import Simulation

MOST_STACKED = 8
"""Blocks that are filtered side by side at most."""


def join_blocks(blocks: Sequence[BlockTask]) -> BlockTask:
    """Return one task that filters all blocks side by side.

    The blocks are adjacent blocks of one filter, or the same block of several filters. Equal filters
    under several labels have one task, so that several filters are never all equal.
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
    """Return the data of one block of a stack: ``width`` runs from run ``first`` of the stack on.

    The prior, which only filters need, stays that of the whole stack.
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

    The block has ``width`` runs, from run ``first`` of the stack on.
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
