"""Queue of blocks: each runs once, in order; blocks of a dead worker run again."""

import pickle
from collections import Counter, deque
from collections.abc import Generator, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    wait,
)
from typing import Any, TypeAlias

from trackbench.errors import RunError, in_line
from trackbench.evaluation.block import BlockResult, BlockTask
from trackbench.execution.engines import OpenEngine
from trackbench.execution.worker import compute, environment_digests
from trackbench.plugins.errors import FilterError, message_of
from trackbench.plugins.load import Plugin

_MOST_DEATHS = 4
"""How often a worker may die over one block before the block is given up."""
_AHEAD = 16
"""Blocks per worker that are handed over: they last while the caller writes an experiment's report."""

Found: TypeAlias = dict[int, BlockResult] | Exception
"""A block's results by the number of runs used, or why there are none."""


class Queue:
    """Tasks of one or several plans. After a worker's death tasks run one at a time."""

    def __init__(self, workers: int) -> None:
        self.failed: dict[tuple[Any, ...], str] = {}
        self.deaths: Counter[BlockTask] = Counter()
        self._workers = workers
        self._waiting: deque[BlockTask] = deque()
        self._running: dict[Future[dict[int, BlockResult]], BlockTask] = {}
        self._plugins: dict[BlockTask, tuple[Plugin, ...]] = {}

    def add(self, task: BlockTask, plugins: tuple[Plugin, ...]) -> None:
        """Append the task unless an equal one is queued."""
        if task not in self._plugins:
            self._plugins[task] = plugins
            self._waiting.append(task)

    def run(self, open_engine: OpenEngine) -> Generator[tuple[BlockTask, Found]]:
        """Yield tasks with their results as they finish."""
        while self._waiting:
            try:
                with open_engine() as executor:
                    yield from self._drain(executor)
            except BrokenExecutor:
                yield from self._after_death()

    def give_up(self, task: BlockTask, error: Exception) -> list[BlockTask]:
        """Record why a task's filter failed; return the filter's blocks that are dropped."""
        lost = algorithm(task)
        last = task.first_run + (task.runs_used - 1) * (1 if task.index >= 0 else -1)
        runs = f"runs {task.first_run} to {last}"
        why = str(error) if isinstance(error, FilterError) else message_of(error)
        self.failed.setdefault(lost, in_line(f"{why} ({runs})"))
        left_out = [t for t in self._waiting if algorithm(t) == lost]
        self._waiting = deque(t for t in self._waiting if algorithm(t) != lost)
        return [task, *left_out]

    def _drain(self, executor: Executor) -> Iterator[tuple[BlockTask, Found]]:
        expected = environment_digests()
        while self._waiting or self._running:
            while self._waiting and len(self._running) < self._limit():
                task = self._waiting[0]
                future = executor.submit(compute, pickle.dumps(task), self._plugins[task], expected)
                self._running[future] = self._waiting.popleft()
                if future.done():
                    break  # a serial engine: keep each block before the next is begun
            finished, _ = wait(self._running, return_when=FIRST_COMPLETED)
            for future in finished:
                result = _result(future)
                yield self._running.pop(future), result

    def _limit(self) -> int:
        """Return how many tasks may run at once: one while a task is suspected to kill workers."""
        suspect = self._waiting and self.deaths[self._waiting[0]]
        suspect = suspect or any(self.deaths[task] for task in self._running.values())
        return 1 if suspect else _AHEAD * self._workers

    def _after_death(self) -> Iterator[tuple[BlockTask, Exception]]:
        suspects = [*self._running.values()] or [
            self._waiting.popleft()
        ]  # of a pool that never began
        for task in suspects:
            self.deaths[task] += 1
            if self.deaths[task] < _MOST_DEATHS:
                self._waiting.appendleft(task)
            else:
                times = self.deaths[task]
                yield task, RunError(f"its worker died {times} times (killed, or out of memory?)")
        self._running.clear()


def algorithm(task: BlockTask) -> tuple[Any, ...]:
    """Return the parts of a task that fail together: a filter on a scenario."""
    return task.scenario, task.filter, task.assume, task.reference, task.width


def _result(future: Future[dict[int, BlockResult]]) -> Found:
    """Return the task's result or its error; raises if the engine failed."""
    try:
        return future.result()
    except BrokenExecutor:
        raise
    except CancelledError:
        raise RunError("the engine was closed before it was done") from None
    except Exception as error:
        return error
