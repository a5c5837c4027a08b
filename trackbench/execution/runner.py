"""Run plans: compute missing blocks, store each, and continue if one filter fails."""

import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from math import inf, isfinite
from typing import Any, NamedTuple, TypeAlias

from trackbench.config.experiment import Experiment
from trackbench.errors import counted
from trackbench.evaluation.block import BlockTask
from trackbench.evaluation.consistency_and_calibration import sizes
from trackbench.evaluation.precision_check import (
    PrecisionCheck,
    PrecisionTarget,
    check_precision,
    checkpoints,
)
from trackbench.evaluation.run_block import run_whole_block
from trackbench.evaluation.summary import FilterResult
from trackbench.execution.block_file import PackedBlock, pack
from trackbench.execution.cache import BlockStore
from trackbench.execution.engines import OpenEngine
from trackbench.execution.merge_blocks import merge
from trackbench.execution.plan import Key, Plan
from trackbench.execution.queue import BlockOutcome, Queue, algorithm
from trackbench.progress_bar import progress_bar


@dataclass
class Outcome:
    """Outcome of a plan: counts of blocks, failures, wall time; the results are in the store."""

    plan: Plan
    store: BlockStore
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
                yield key, merge(stored_block(self.store, task) for task in tasks)


def stored_block(store: BlockStore, task: BlockTask) -> PackedBlock:
    """Return a finished block; computes it again if it was removed meanwhile."""
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

    ``more`` is called with the number and the outcome of a finished plan. It returns the plan of more
    runs with which this plan continues, or None.

    Yields an outcome per plan, in their order, as soon as its blocks are complete; meanwhile the workers
    compute the next plan. If a filter raises, its other blocks are dropped and the other filters
    continue. Close the iterator to stop the workers.
    """
    store.prepare()
    outcomes = [Outcome(plan, store) for plan in plans]
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
            outcome.deaths = sum(task in queue.deaths for task in outcome.plan.unique)
            outcome.crowding = _crowding(outcome.plan, queue, workers)
            outcome.wall_s = time.perf_counter() - started
            yield outcome


def _enqueue(outcome: Outcome, queue: Queue, missing: Sequence[BlockTask]) -> None:
    """Queue missing blocks of the plan."""
    queue.add(missing, outcome.plan.plugins)
    outcome.missing.update(missing)


def _extend_plan(outcome: Outcome, bigger: Plan, queue: Queue, bar: Any) -> None:
    """Continue with the plan of more runs; blocks of the former plan are not computed again."""
    before = set(outcome.plan.unique)
    outcome.plan = bigger
    new = [task for task in bigger.unique if task not in before and outcome.store.get(task) is None]
    _enqueue(outcome, queue, new)
    bar.total = len(bigger.unique)
    bar.set_postfix_str(outcome.least_precise)


def _failures(plan: Plan, queue: Queue) -> dict[Key, str]:
    """Return why filters of the plan failed."""
    failures = {}
    for key, tasks in plan.tasks.items():
        # All blocks of a filter have one `algorithm`.
        reason = queue.failed.get(algorithm(tasks[0]))
        if reason is not None:
            failures[key] = reason
    return failures


def _crowding(plan: Plan, queue: Queue, workers: int) -> str:
    """Describe the filter whose memory allows fewer than ``workers`` workers; empty if all fit."""
    if queue.hungriest is None or queue.fitting >= workers:
        return ""
    task, peak = queue.hungriest
    labels = [label for (_, label), tasks in plan.tasks.items() if task in tasks]
    names = " and ".join(labels) or "another experiment"
    return (
        f"{names} took {peak / 1e9:.1f} GB of memory in blocks "
        f"of {counted(task.width, 'run')}, so {queue.fitting} of {workers} workers ran side by side"
    )


def _missing_blocks(outcome: Outcome, fresh: bool) -> list[BlockTask]:
    """List the blocks to compute; count the stored and the damaged ones in the outcome."""
    if fresh:
        return outcome.plan.unique
    missing = []
    for task in outcome.plan.unique:
        if outcome.store.get(task) is not None:
            outcome.reused += 1
        else:
            if outcome.store.has_file(task):
                outcome.damaged += 1
            missing.append(task)
    return missing


def _record_result(
    outcomes: Sequence[Outcome], queue: Queue, task: BlockTask, computed: BlockOutcome
) -> None:
    """Store a finished block for all plans that wait for it, or give up its filter."""
    if isinstance(computed, Exception):
        dropped = queue.give_up(task, computed)
        for outcome in outcomes:
            outcome.missing.difference_update(dropped)
        return
    outcomes[0].store.put(task, computed)  # the store of all plans
    for outcome in outcomes:
        if task in outcome.missing:
            outcome.missing.remove(task)
            outcome.computed += 1


def _progress_bar(outcome: Outcome, progress: bool) -> Any:
    total = len(outcome.plan.unique)
    begun = total - len(outcome.missing)
    return progress_bar(total, "block", progress, initial=begun, desc=outcome.plan.name)


def with_runs(experiment: Experiment, runs: int) -> Experiment:
    """Return the experiment with another number of runs."""
    return replace(experiment, settings=replace(experiment.settings, runs=runs))


def first_batch(experiment: Experiment) -> Experiment:
    """Return the experiment with the runs of the first checkpoint; itself without the key `until`."""
    settings = experiment.settings
    if not settings.until:
        return experiment
    return with_runs(experiment, next(checkpoints(settings.min_runs, settings.runs)))


class NextBatch(NamedTuple):
    """Experiment with the runs of the next checkpoint."""

    experiment: Experiment
    least_precise: str
    """the number that is farthest from its requested error, for the progress bar"""


def next_batch(experiment: Experiment, most: int, outcome: Outcome) -> NextBatch | None:
    """Return the experiment with the runs of the next checkpoint.

    Returns None after two good checkpoints in a row, or after the last. ``experiment`` has the runs made
    so far, which are at least those of the first checkpoint. ``most`` is the largest number of runs.
    """
    settings = experiment.settings
    if not settings.until:
        return None
    stops = list(checkpoints(settings.min_runs, most))
    passed = [runs for runs in stops if runs <= settings.runs]
    if len(passed) == len(stops):
        return None
    # Stop if no number was imprecise at the last checkpoint, nor at the one before.
    last = [check for _, check in imprecise(experiment, outcome, passed[-1])]
    if not last and len(passed) > 1:
        before_last = list(imprecise(experiment, outcome, passed[-2]))
        if not before_last:
            return None
    least_precise = ""
    if last:
        worst = max(last, key=lambda check: check.share if isfinite(check.share) else inf)
        least_precise = f"{worst.wanted.metric}: {worst.share:.2g} x the error wanted"
    bigger = with_runs(experiment, stops[len(passed)])
    return NextBatch(experiment=bigger, least_precise=least_precise)


def imprecise(
    experiment: Experiment, outcome: Outcome, runs: int | None = None
) -> Iterator[tuple[Key, PrecisionCheck]]:
    """Yield the numbers whose standard error exceeds that of `until` after ``runs``, or all, runs."""
    targets = []
    for metric, error in experiment.settings.until.items():
        targets.append(PrecisionTarget.read(metric, error))
    for key, result in outcome.results():
        point, _ = key
        scenario = experiment.points[point].scenario
        for check in check_precision(targets, result, sizes(scenario), scenario.windows, runs):
            if not check.enough:
                yield key, check


def stop_reason(experiment: Experiment, most: int, outcome: Outcome) -> Iterator[str]:
    """Yield why the runs ended, if the config has `until`; ``most`` is the largest number of runs."""
    if not experiment.settings.until:
        return
    runs = experiment.settings.runs
    checks = list(imprecise(experiment, outcome))
    if not checks:
        yield f"{runs} of at most {most} runs: every number is as exact as `until` asks"
    for key, check in checks:
        target = check.wanted
        error = f"{target.error:.3g}"
        if target.relative:
            error = f"{100 * target.error:g} %"
        yield (
            f"note: {experiment.title_of(key)}: after all {runs} runs the standard error of "
            f"{target.metric} is {check.share:.3g} times the {error} that `until` asks"
        )
