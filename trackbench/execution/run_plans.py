"""Run plans of experiments: compute missing blocks, store each, and continue if one filter fails."""

import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.result_over_all_runs import FilterResult
from trackbench.evaluation.run_blocks_side_by_side import run_whole_block
from trackbench.execution.block_file import PackedBlock, pack
from trackbench.execution.block_scheduler import BlockOutcome, Queue
from trackbench.execution.cache import BlockStore, FoundBlocks
from trackbench.execution.engines import OpenEngine
from trackbench.execution.joined_filters import algorithm
from trackbench.execution.memory import note_on_memory
from trackbench.execution.merge_finished_blocks import merge
from trackbench.execution.plan import Key, Plan
from trackbench.progress_bar import progress_bar


@dataclass
class Outcome:
    """Outcome of a plan: counts of blocks, failures, wall time; the results are in the store."""

    plan: Plan
    store: BlockStore
    found: FoundBlocks = field(default_factory=FoundBlocks)
    """stored blocks that are not merged yet"""
    failures: dict[Key, str] = field(default_factory=dict)
    """reasons why filters failed"""
    missing: set[BlockTask] = field(default_factory=set)
    """blocks that are still to be computed"""
    computed: int = 0
    """number of blocks that this run computed"""
    reused: int = 0
    """number of blocks that an earlier run stored"""
    damaged: int = 0
    """number of blocks whose file was damaged"""
    deaths: int = 0
    """number of blocks over which a worker died"""
    crowding: str = ""
    """why some workers had to wait for memory"""
    wall_s: float = 0.0
    least_precise: str = ""
    """the number that is farthest from its requested error, if the runs end by precision"""

    def results(self) -> Iterator[tuple[Key, FilterResult]]:
        """Yield each filter's merged results, so that one filter is in memory at a time."""
        for key, tasks in self.plan.tasks.items():
            if key not in self.failures:
                runs = sum(task.runs_used for task in tasks)
                yield key, merge((self._block(task) for task in tasks), runs)

    def _block(self, task: BlockTask) -> PackedBlock:
        return self.found.take(task) or stored_block(self.store, task)


def stored_block(store: BlockStore, task: BlockTask) -> PackedBlock:
    """Return a finished block from the store; if it was removed meanwhile, compute it again."""
    block = store.get(task)
    if block is None:
        block = pack(run_whole_block(task)[task.runs_used])
    return block


More: TypeAlias = Callable[[int, Outcome], Plan | None]
"""Returns the plan of more runs with which the plan of this number continues; None if it ends."""


def execute(
    plans: Sequence[Plan],
    store: BlockStore,
    open_engine: OpenEngine,
    workers: int,
    fresh: bool = False,
    progress: bool = True,
    more: More = lambda i, outcome: None,
) -> Generator[Outcome]:
    """Compute and store every missing block of the plans; ``fresh`` computes all blocks.

    ``open_engine`` opens the engine with ``workers`` processes, and ``progress`` shows a bar. ``more``
    is called with the number and the outcome of a finished plan. It returns the plan of more runs with
    which this plan continues, or None.

    Yields an outcome per plan, in their order, as soon as its blocks are complete; meanwhile the workers
    compute the next plan. If a filter raises, its other blocks are dropped and the other filters
    continue. Close the iterator to stop the workers.
    """
    store.prepare()
    found = FoundBlocks()  # stored blocks stay in memory until they are merged
    outcomes = [Outcome(plan, store, found) for plan in plans]
    queue = Queue(workers, store)
    for outcome in outcomes:
        _enqueue(outcome, queue, _missing_blocks(outcome, fresh))
    with closing(queue.run(open_engine)) as finished:
        for i, outcome in enumerate(outcomes):
            started = time.perf_counter()
            with _progress_bar(outcome, progress) as bar:
                while True:
                    while outcome.missing:
                        before = len(outcome.missing)
                        # The next finished block of any plan: its results or its error.
                        task, computed = next(finished)
                        _record_result(outcomes, queue, task, computed)
                        bar.update(before - len(outcome.missing))
                    bigger = more(i, outcome)
                    if bigger is None:
                        break
                    _extend_plan(outcome, bigger, queue, bar)
            if outcome is outcomes[-1]:
                next(finished, None)  # all blocks are computed: this closes the engine
            outcome.failures = _failures(outcome.plan, queue)
            # Blocks over which a worker died, and a note if the memory was too small for all workers.
            outcome.deaths = _blocks_with_deaths(outcome.plan, queue)
            outcome.crowding = note_on_memory(outcome.plan, queue.hungriest, queue.fitting, workers)
            outcome.wall_s = time.perf_counter() - started
            yield outcome


def _enqueue(outcome: Outcome, queue: Queue, missing: Sequence[BlockTask]) -> None:
    """Queue blocks of the plan and note in its outcome that they are missing."""
    queue.add(missing, outcome.plan.plugins)
    outcome.missing.update(missing)


def _extend_plan(outcome: Outcome, bigger: Plan, queue: Queue, bar: Any) -> None:
    """Continue an experiment with the plan of more runs, of which only the new blocks are computed.

    ``bar`` is the progress bar. The outcome then has the plan ``bigger``.
    """
    before = set(outcome.plan.unique)
    outcome.plan = bigger
    new = [task for task in bigger.unique if task not in before and outcome.store.get(task) is None]
    _enqueue(outcome, queue, new)
    bar.total = len(bigger.unique)
    bar.set_postfix_str(outcome.least_precise)


def _failures(plan: Plan, queue: Queue) -> dict[Key, str]:
    """Return why filters of the plan failed, by grid point and label; filters that ran are left out."""
    failures = {}
    for key, tasks in plan.tasks.items():
        # All blocks of a filter have one `algorithm`.
        reason = queue.failed.get(algorithm(tasks[0]))
        if reason is not None:
            failures[key] = reason
    return failures


def _blocks_with_deaths(plan: Plan, queue: Queue) -> int:
    """Count the blocks of the plan over which a worker died."""
    if not queue.deaths:  # the usual case, in which no task needs to be hashed
        return 0
    return sum(task in queue.deaths for task in plan.unique)


def _missing_blocks(outcome: Outcome, fresh: bool) -> list[BlockTask]:
    """List the blocks to compute: all if ``fresh``, else those that are not stored.

    The stored ones are kept in memory for the merge, and counted in the outcome with the damaged ones.
    """
    if fresh:
        return outcome.plan.unique
    missing = []
    for task in outcome.plan.unique:
        block = outcome.store.get(task)
        if block is not None:
            outcome.found.keep(task, block)
            outcome.reused += 1
        else:
            if outcome.store.has_file(task):
                outcome.damaged += 1
            missing.append(task)
    return missing


def _record_result(
    outcomes: Sequence[Outcome], queue: Queue, task: BlockTask, computed: BlockOutcome
) -> None:
    """Store a finished block for all plans that wait for it, or give up its filter.

    ``computed`` are the block's results, or the error of the filter. ``outcomes`` are those of all
    plans, as a block may be part of several.
    """
    if isinstance(computed, Exception):
        dropped = queue.give_up(task, computed)
        for outcome in outcomes:
            outcome.missing.difference_update(dropped)
        return
    # All plans have one store. Results that a worker has stored itself are empty.
    outcomes[0].store.put(task, computed)
    for outcome in outcomes:
        if task in outcome.missing:
            outcome.missing.remove(task)
            outcome.computed += 1


def _progress_bar(outcome: Outcome, progress: bool) -> Any:
    total = len(outcome.plan.unique)
    begun = total - len(outcome.missing)
    return progress_bar(total, "block", progress, initial=begun, desc=outcome.plan.name)
