"""Run a plan: compute the blocks that are not kept yet, keep each, go on when one filter fails."""

import pickle
import time
from collections import Counter, deque
from collections.abc import Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    wait,
)
from dataclasses import dataclass, field
from typing import Any

from trackbench.evaluation.block import BlockResult, BlockTask, run_whole_block
from trackbench.evaluation.merge import FilterResult, merge
from trackbench.experiment.cache import BlockStore
from trackbench.experiment.codec import decode, encode
from trackbench.experiment.digest import code_digest
from trackbench.experiment.engines import OpenEngine
from trackbench.experiment.plan import Key, Plan
from trackbench.experiment.plugins import Plugin
from trackbench.experiment.problems import RunError
from trackbench.experiment.worker import compute

_MOST_DEATHS = 4
"""How often a worker may die over one block before the block is given up."""


@dataclass
class Outcome:
    """What was computed and reused, what failed and why, wall time; the results are in the store."""

    plan: Plan
    store: BlockStore
    failures: dict[Key, str] = field(default_factory=dict)
    computed: int = 0
    reused: int = 0
    damaged: int = 0
    deaths: int = 0
    wall_s: float = 0.0

    def results(self) -> Iterator[tuple[Key, FilterResult]]:
        """Each filter's merged results, one after the other, so that one is in memory at a time.

        Blocks always come from their bytes, whether they were computed now or by an earlier run.
        """
        for key, tasks in self.plan.tasks.items():
            if key not in self.failures:
                yield key, merge(self._block(task) for task in tasks)

    def _block(self, task: BlockTask) -> BlockResult:
        found = self.store.get(task)
        if found is None:  # removed while we were computing
            found = decode(encode(run_whole_block(task)[task.used], ""), "")
        assert found is not None
        return found


def execute(
    plan: Plan,
    store: BlockStore,
    open_engine: OpenEngine,
    workers: int,
    plugins: tuple[Plugin, ...] = (),
    fresh: bool = False,
    progress: bool = True,
) -> Outcome:
    """Compute and keep every block of the plan that is not kept yet; ``fresh`` computes them all.

    A filter that raises is reported and its other blocks are left out; the others go on.
    """
    started = time.perf_counter()
    store.prepare()
    outcome = Outcome(plan, store)
    queue = _Queue(_missing(outcome, fresh), plugins, workers)
    for task, result in _with_progress(queue.run(open_engine), len(plan.unique), outcome, progress):
        if isinstance(result, Exception):
            queue.give_up(task, result)
        else:
            store.put(task, result)
            outcome.computed += 1
    for key, tasks in plan.tasks.items():
        why = queue.failed.get(_algorithm(tasks[0]))
        if why is not None:
            outcome.failures[key] = why
    outcome.deaths = sum(queue.deaths.values())
    outcome.wall_s = time.perf_counter() - started
    return outcome


def _missing(outcome: Outcome, fresh: bool) -> list[BlockTask]:
    missing = []
    for task in outcome.plan.unique:
        if not fresh and outcome.store.get(task) is not None:
            outcome.reused += 1
            continue
        outcome.damaged += not fresh and outcome.store.has_file(task)
        missing.append(task)
    return missing


def _with_progress(
    results: Iterator[tuple[BlockTask, Any]], total: int, outcome: Outcome, progress: bool
) -> Iterator[tuple[BlockTask, Any]]:
    from tqdm import tqdm

    # disable=None: silent when stderr is no terminal
    hidden = None if progress else True
    with tqdm(total=total, initial=outcome.reused, unit="block", disable=hidden) as bar:
        for item in results:
            yield item
            bar.update()


def _algorithm(task: BlockTask) -> tuple[Any, ...]:
    """What fails together: a filter on a scenario."""
    return task.scenario, task.filter, task.reference, task.width


class _Queue:
    """Tasks that wait and run; a dead worker's tasks are run again, one at a time."""

    def __init__(self, tasks: list[BlockTask], plugins: tuple[Plugin, ...], workers: int) -> None:
        self.waiting = deque(tasks)
        self.running: dict[Future[dict[int, BlockResult]], BlockTask] = {}
        self.plugins = plugins
        self.workers = workers
        self.deaths: Counter[BlockTask] = Counter()
        self.failed: dict[tuple[Any, ...], str] = {}

    def run(
        self, open_engine: OpenEngine
    ) -> Iterator[tuple[BlockTask, dict[int, BlockResult] | Exception]]:
        """Tasks as they finish, each with its results or its error."""
        while self.waiting:
            try:
                with open_engine() as executor:
                    yield from self._drain(executor)
            except BrokenExecutor:
                yield from self._after_death()

    def give_up(self, task: BlockTask, error: Exception) -> None:
        """Remember why the task's filter fails, and leave out its other blocks."""
        lost = _algorithm(task)
        runs = f"runs {task.first_run} to {task.first_run + task.used - 1}"
        self.failed.setdefault(lost, f"{type(error).__name__}: {error} ({runs})")
        self.waiting = deque(t for t in self.waiting if _algorithm(t) != lost)

    def _drain(self, executor: Executor) -> Iterator[tuple[BlockTask, Any]]:
        code = code_digest()
        while self.waiting or self.running:
            while self.waiting and len(self.running) < self._limit():
                payload = pickle.dumps(self.waiting[0])
                future = executor.submit(compute, payload, self.plugins, code)
                self.running[future] = self.waiting.popleft()
                if future.done():
                    break  # a serial engine: keep each block before the next is begun
            finished, _ = wait(self.running, return_when=FIRST_COMPLETED)
            for future in finished:
                result = _result(future)
                yield self.running.pop(future), result

    def _limit(self) -> int:
        """A few at a time, so that Ctrl-C is felt at once; one at a time when one may be deadly."""
        suspect = self.waiting and self.deaths[self.waiting[0]]
        suspect = suspect or any(self.deaths[task] for task in self.running.values())
        return 1 if suspect else 3 * self.workers

    def _after_death(self) -> Iterator[tuple[BlockTask, Exception]]:
        for task in self.running.values():
            self.deaths[task] += 1
            if self.deaths[task] < _MOST_DEATHS:
                self.waiting.appendleft(task)
            else:
                times = self.deaths[task]
                yield task, RunError(f"its worker died {times} times (killed, or out of memory?)")
        self.running.clear()


def _result(future: Future[dict[int, BlockResult]]) -> dict[int, BlockResult] | Exception:
    """What the task gave or why it failed; raises if not the task failed but the engine."""
    try:
        return future.result()
    except BrokenExecutor:
        raise
    except CancelledError:
        raise RunError("the engine was closed before it was done") from None
    except Exception as error:
        return error
