"""Run plans: compute missing blocks, store each, and continue if one filter fails."""

import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from math import inf, isfinite
from typing import Any, TypeAlias

from trackbench.config.experiment import Experiment
from trackbench.errors import counted
from trackbench.evaluation.block import BlockResult, BlockTask
from trackbench.evaluation.consistency_and_calibration import sizes
from trackbench.evaluation.precision_check import (
    PrecisionCheck,
    PrecisionTarget,
    check_precision,
    checkpoints,
)
from trackbench.evaluation.run_block import run_whole_block
from trackbench.evaluation.summary import FilterResult, merge
from trackbench.execution.block_file import decode, encode
from trackbench.execution.cache import BlockStore
from trackbench.execution.engines import OpenEngine
from trackbench.execution.plan import Key, Plan
from trackbench.execution.queue import BlockOutcome, Queue, algorithm, progress_bar


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
    """blocks over which a worker died"""
    crowding: str = ""
    """why some workers had to wait for memory"""
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
        return stored_block(self.store, task)


def stored_block(store: BlockStore, task: BlockTask) -> BlockResult:
    """Return a finished block; computes it again if it was removed meanwhile."""
    block = store.get(task)
    if block is None:
        block = decode(encode(run_whole_block(task)[task.runs_used], ""), "")
    assert block is not None
    return block


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

    Yields an outcome per plan, in their order, as soon as its blocks are complete; meanwhile the workers
    compute the next plan. If a filter raises, its other blocks are dropped and the other filters
    continue. Close the iterator to stop the workers.
    """
    store.prepare()
    outcomes = [Outcome(plan, store) for plan in plans]
    queue = Queue(workers, store)
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
            outcome.deaths = sum(task in queue.deaths for task in outcome.plan.unique)
            outcome.crowding = _crowding(outcome.plan, queue, workers)
            outcome.wall_s = time.perf_counter() - started
            yield outcome


def _enqueue(outcome: Outcome, queue: Queue, tasks: Iterable[BlockTask]) -> None:
    """Queue missing blocks of the plan."""
    missing = list(tasks)
    queue.add(missing, outcome.plan.plugins)
    outcome.missing.update(missing)


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


def _crowding(plan: Plan, queue: Queue, workers: int) -> str:
    """Return which filter's memory lets fewer workers run side by side."""
    if queue.hungriest is None or queue.fitting >= workers:
        return ""
    task, peak = queue.hungriest
    labels = [key[1] for key, tasks in plan.tasks.items() if task in tasks]
    return (
        f"{' and '.join(labels) or 'another experiment'} took {peak / 1e9:.1f} GB of memory in blocks "
        f"of {counted(task.width, 'run')}, so {queue.fitting} of {workers} workers ran side by side"
    )


def _missing(outcome: Outcome, fresh: bool) -> Iterator[BlockTask]:
    for task in outcome.plan.unique:
        if not fresh and outcome.store.get(task) is not None:
            outcome.reused += 1
            continue
        outcome.damaged += not fresh and outcome.store.has_file(task)
        yield task


def _record_result(
    outcomes: Sequence[Outcome], queue: Queue, task: BlockTask, computed: BlockOutcome
) -> None:
    """Store a finished block for all plans that wait for it, or give up its filter."""
    if isinstance(computed, Exception):
        gone = queue.give_up(task, computed)
    else:
        outcomes[0].store.put(task, computed)
        gone = [task]
    for outcome in outcomes:
        finished = outcome.missing.intersection(gone)
        outcome.missing -= finished
        outcome.computed += 0 if isinstance(computed, Exception) else len(finished)


def _bar(outcome: Outcome, progress: bool) -> Any:
    total = len(outcome.plan.unique)
    begun = total - len(outcome.missing)
    return progress_bar(total, "block", progress, initial=begun, desc=outcome.plan.name)


def with_runs(experiment: Experiment, runs: int) -> Experiment:
    """Return the experiment with another number of runs."""
    return replace(experiment, settings=replace(experiment.settings, runs=runs))


def first_batch(experiment: Experiment) -> Experiment:
    """Return the experiment with the runs of the first checkpoint; all runs without `until`."""
    settings = experiment.settings
    if not settings.until:
        return experiment
    return with_runs(experiment, next(checkpoints(settings.min_runs, settings.runs)))


def next_batch(experiment: Experiment, most: int, outcome: Outcome) -> Experiment | None:
    """Return the experiment with the runs of the next checkpoint.

    Returns None after two good checkpoints in a row, or after the last. Writes the least precise number
    into the outcome, for the progress bar.
    """
    settings = experiment.settings
    if not settings.until:
        return None
    stops = list(checkpoints(settings.min_runs, most))
    done = [runs for runs in stops if runs <= settings.runs]
    if len(done) == len(stops):
        return None

    def share(check: PrecisionCheck) -> float:
        return check.share if isfinite(check.share) else inf

    left, *earlier = [[*imprecise(experiment, outcome, runs)] for runs in done[:-3:-1]]
    if not left and earlier and not earlier[0]:
        return None
    worst = max((check for _, check in left), key=share, default=None)
    outcome.still = f"{worst.wanted.metric}: {worst.share:.2g} x the error wanted" if worst else ""
    return with_runs(experiment, stops[len(done)])


def imprecise(
    experiment: Experiment, outcome: Outcome, runs: int | None = None
) -> Iterator[tuple[Key, PrecisionCheck]]:
    """Yield the numbers that are not precise enough after ``runs`` runs, by default all."""
    targets = [PrecisionTarget.read(*item) for item in experiment.settings.until.items()]
    for key, result in outcome.results():
        scenario = experiment.points[key[0]].scenario
        for check in check_precision(targets, result, sizes(scenario), scenario.windows, runs):
            if not check.enough:
                yield key, check


def stop_reason(experiment: Experiment, most: int, outcome: Outcome) -> Iterator[str]:
    """Yield why the runs ended, if the config has `until`."""
    if not experiment.settings.until:
        return
    runs, left = experiment.settings.runs, list(imprecise(experiment, outcome))
    if not left:
        yield f"{runs} of at most {most} runs: every number is as exact as `until` asks"
    for key, check in left:
        target = check.wanted
        error = f"{target.error:.3g}" if not target.relative else f"{100 * target.error:g} %"
        yield (
            f"note: {experiment.title_of(key)}: after all {runs} runs the standard error of "
            f"{target.metric} is {check.share:.3g} times the {error} that `until` asks"
        )
