"""Run plans: compute missing blocks, store each, and continue if one filter fails."""

import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from trackbench.evaluation.block import BlockResult, BlockTask
from trackbench.evaluation.block_metrics import run_whole_block
from trackbench.evaluation.merge import FilterResult, merge
from trackbench.execution.cache import BlockStore
from trackbench.execution.codec import decode, encode
from trackbench.execution.engines import OpenEngine
from trackbench.execution.plan import Key, Plan
from trackbench.execution.progress import progress_bar
from trackbench.execution.queue import Found, Queue, algorithm


@dataclass
class Outcome:
    """Outcome of a plan: counts of blocks, failures, wall time; the results are in the store."""

    plan: Plan
    store: BlockStore
    failures: dict[Key, str] = field(default_factory=dict)
    missing: set[BlockTask] = field(default_factory=set)
    """blocks that are still to be computed"""
    computed: int = 0
    reused: int = 0
    damaged: int = 0
    deaths: int = 0
    wall_s: float = 0.0
    still: str = ""
    """what it goes on for, if its runs end by precision: the number that is farthest from it"""

    def results(self) -> Iterator[tuple[Key, FilterResult]]:
        """Yield each filter's merged results, so that one filter is in memory at a time.

        Blocks are always decoded from their bytes, whether this run or an earlier one computed
        them.
        """
        for key, tasks in self.plan.tasks.items():
            if key not in self.failures:
                yield key, merge(self._block(task) for task in tasks)

    def _block(self, task: BlockTask) -> BlockResult:
        found = self.store.get(task)
        if found is None:  # removed while we were computing
            found = decode(encode(run_whole_block(task)[task.runs_used], ""), "")
        assert found is not None
        return found


More: TypeAlias = Callable[[int, Outcome], Plan | None]
"""The plan that the one of this number goes on with when its blocks are there, if it does."""


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

    Yields an outcome per plan, in their order, as soon as its blocks are complete; meanwhile the
    workers
    compute the next plan. If a filter raises, its other blocks are dropped and the other filters
    continue. Close the iterator to stop the workers.
    """
    store.prepare()
    outcomes = [Outcome(plan, store) for plan in plans]
    queue = Queue(workers)
    for outcome in outcomes:
        _enqueue(outcome, queue, _missing(outcome, fresh))
    with closing(queue.run(open_engine)) as finished:
        for i, outcome in enumerate(outcomes):
            started = time.perf_counter()
            with _bar(outcome, progress) as bar:
                going_on = True
                while going_on:
                    while outcome.missing:
                        before = len(outcome.missing)
                        _record_result(outcomes, queue, *next(finished))
                        bar.update(before - len(outcome.missing))
                    bigger = more(i, outcome)
                    going_on = bigger is not None
                    if bigger is not None:
                        _extend_plan(outcome, bigger, queue, bar)
            if outcome is outcomes[-1]:
                next(finished, None)  # nothing comes any more: the workers may go
            outcome.failures = _failures(outcome.plan, queue)
            outcome.deaths = sum(queue.deaths[task] for task in outcome.plan.unique)
            outcome.wall_s = time.perf_counter() - started
            yield outcome


def _enqueue(outcome: Outcome, queue: Queue, tasks: Iterable[BlockTask]) -> None:
    """Queue missing blocks of the plan."""
    for task in tasks:
        queue.add(task, outcome.plan.plugins)
        outcome.missing.add(task)


def _extend_plan(outcome: Outcome, bigger: Plan, queue: Queue, bar: Any) -> None:
    """Continue with more runs; blocks computed a moment ago are not computed again."""
    before = set(outcome.plan.unique)
    outcome.plan = bigger
    new = (task for task in bigger.unique if task not in before)
    _enqueue(outcome, queue, (task for task in new if outcome.store.get(task) is None))
    bar.total = len(bigger.unique)
    bar.set_postfix_str(outcome.still)


def _failures(plan: Plan, queue: Queue) -> dict[Key, str]:
    """Return why filters of the plan failed."""
    reasons = {key: queue.failed.get(algorithm(tasks[0])) for key, tasks in plan.tasks.items()}
    return {key: why for key, why in reasons.items() if why is not None}


def _missing(outcome: Outcome, fresh: bool) -> Iterator[BlockTask]:
    for task in outcome.plan.unique:
        if not fresh and outcome.store.get(task) is not None:
            outcome.reused += 1
            continue
        outcome.damaged += not fresh and outcome.store.has_file(task)
        yield task


def _record_result(
    outcomes: Sequence[Outcome], queue: Queue, task: BlockTask, found: Found
) -> None:
    """Store a finished block for all plans that wait for it, or give up its filter."""
    if isinstance(found, Exception):
        gone = queue.give_up(task, found)
    else:
        outcomes[0].store.put(task, found)
        gone = [task]
    for outcome in outcomes:
        there = outcome.missing.intersection(gone)
        outcome.missing -= there
        outcome.computed += 0 if isinstance(found, Exception) else len(there)


def _bar(outcome: Outcome, progress: bool) -> Any:
    total = len(outcome.plan.unique)
    begun = total - len(outcome.missing)
    return progress_bar(total, "block", progress, initial=begun, desc=outcome.plan.name)
