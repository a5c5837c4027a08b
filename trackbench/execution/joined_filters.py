"""Stacks of blocks: join filters that differ only in numbers, so that they are computed together."""

from collections.abc import Hashable, Sequence
from dataclasses import replace
from typing import Any, TypeAlias, cast

from trackbench.evaluation.block_task import BlockTask
from trackbench.execution.block_size import stack_limit
from trackbench.filters.base import JoinableFilter

Stack: TypeAlias = list[BlockTask]
"""Adjacent blocks of one filter, or one block of several, which a worker filters side by side."""


def algorithm(task: BlockTask) -> tuple[object, ...]:
    """Return the fields of a task that are equal for all blocks of a filter on a scenario.

    They are the key of the filter's failures and times. If one block fails, all blocks with these fields
    are given up.
    """
    return task.scenario, task.filter, task.assume, task.reference, task.width


def join_filters(stacks: Sequence[Stack], most: int) -> list[Stack]:
    """Join stacks of one block each whose filters differ only in numbers; other stacks stay as they are.

    A joined stack has the same runs of several filters, such as one filter with several values of a key.
    ``most`` is the largest number of blocks of a stack.
    """
    joined: list[Stack] = []
    # Stacks that may get another block, by what their blocks have in common.
    open_stacks: dict[tuple[Hashable, BlockTask], Stack] = {}
    for stack in stacks:
        task = stack[0]
        if len(stack) > 1 or not isinstance(task.filter, JoinableFilter):
            joined.append(stack)
            continue
        # Blocks are joined if all is equal but the filters' numbers and the runs used of each block.
        # Filters that differ only in numbers have one structure.
        structure = task.filter.structure(task.assumed_scenario)
        without_filter = replace(task, filter=cast(Any, None), runs_used=0)
        key = (structure, without_filter)
        limit = min(most, stack_limit(task))
        if key not in open_stacks or len(open_stacks[key]) >= limit:
            open_stacks[key] = []
            joined.append(open_stacks[key])
        open_stacks[key].append(task)
    return joined
