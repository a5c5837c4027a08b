"""Queue of blocks in stacks: each runs once, in order; blocks of a dead worker run again."""

import pickle
from collections import Counter, deque
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from dataclasses import replace
from queue import SimpleQueue
from typing import Any, TypeAlias

from trackbench.errors import RunError, in_line
from trackbench.evaluation.block import BlockResult, BlockTask
from trackbench.execution.engines import OpenEngine
from trackbench.execution.plan import stack_limit
from trackbench.execution.worker import compute, environment_digests
from trackbench.plugins.errors import FilterError, message_of, postponed
from trackbench.plugins.load import Plugin

_MOST_DEATHS = 4
"""How often a worker may die over one block before the block is given up."""
_AHEAD = 16
"""Blocks per worker that are handed over: they last while the caller writes an experiment's report."""

Found: TypeAlias = dict[int, BlockResult] | Exception
"""A block's results by the number of runs used, or why there are none."""
Stack: TypeAlias = list[BlockTask]
"""Adjacent blocks of one filter, which a worker filters side by side."""


class Queue:
    """Tasks of one or several plans. After a worker's death blocks run one at a time."""

    def __init__(self, workers: int) -> None:
        self.failed: dict[tuple[Any, ...], str] = {}
        self.deaths: Counter[BlockTask] = Counter()
        self._workers = workers
        self._waiting: deque[Stack] = deque()
        self._running: dict[Future[list[dict[int, BlockResult]]], Stack] = {}
        self._plugins: dict[BlockTask, tuple[Plugin, ...]] = {}

    def add(self, tasks: Sequence[BlockTask], plugins: tuple[Plugin, ...]) -> None:
        """Append the tasks that are new, adjacent blocks of a filter as stacks.

        Several workers get at least two stacks each.
        """
        most = len(tasks) // (2 * self._workers) if self._workers > 1 else len(tasks)
        last: dict[BlockTask, Stack] = {}
        for task in tasks:
            if task in self._plugins:
                continue
            self._plugins[task] = plugins
            of_filter = replace(task, index=0, runs_used=0)
            stack = last.get(of_filter)
            if (
                stack is None
                or len(stack) >= min(most, stack_limit(task))
                or abs(task.index) != abs(stack[-1].index) + 1
            ):
                last[of_filter] = stack = []
                self._waiting.append(stack)
            stack.append(task)

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
        left_out = [t for stack in self._waiting for t in stack if algorithm(t) == lost]
        self._waiting = deque(stack for stack in self._waiting if algorithm(stack[0]) != lost)
        return [task, *left_out]

    def _drain(self, executor: Executor) -> Iterator[tuple[BlockTask, Found]]:
        expected = environment_digests()
        # Not concurrent.futures.wait: a signal within it leaves futures locked, and the pool hangs.
        finished: SimpleQueue[Future[list[dict[int, BlockResult]]]] = SimpleQueue()
        while self._waiting or self._running:
            while self._waiting and len(self._running) < self._limit():
                stack = self._waiting[0]
                plugins = self._plugins[stack[0]]
                future = executor.submit(compute, pickle.dumps(stack), plugins, expected)
                self._running[future] = self._waiting.popleft()
                with postponed():
                    future.add_done_callback(finished.put)
                if not finished.empty():
                    break  # keep a result before more is begun: a serial engine is done already
            future = finished.get()
            results = _results(future)
            stack = self._running.pop(future)
            if not isinstance(results, Exception):
                yield from zip(stack, results, strict=True)
            elif len(stack) == 1:
                yield stack[0], results
            else:  # each alone: only the failing block's runs are at fault
                self._waiting.extendleft([task] for task in reversed(stack))

    def _limit(self) -> int:
        """Return how many tasks may run at once: one while a task is suspected to kill workers."""
        stacks = [*self._running.values(), *list(self._waiting)[:1]]
        suspect = any(self.deaths[task] for stack in stacks for task in stack)
        return 1 if suspect else _AHEAD * self._workers

    def _after_death(self) -> Iterator[tuple[BlockTask, Exception]]:
        # Nothing runs in a pool that never began: its first stack is suspected.
        suspects = [*self._running.values()] or [self._waiting.popleft()]
        for task in (task for stack in suspects for task in stack):
            self.deaths[task] += 1
            if self.deaths[task] < _MOST_DEATHS:
                self._waiting.appendleft([task])
            else:
                times = self.deaths[task]
                yield task, RunError(f"its worker died {times} times (killed, or out of memory?)")
        self._running.clear()


def algorithm(task: BlockTask) -> tuple[Any, ...]:
    """Return the parts of a task that fail together: a filter on a scenario."""
    return task.scenario, task.filter, task.assume, task.reference, task.width


def _results(
    future: Future[list[dict[int, BlockResult]]],
) -> list[dict[int, BlockResult]] | Exception:
    """Return the stack's results or its error; raises if the engine failed."""
    try:
        return future.result()
    except BrokenExecutor:
        raise
    except CancelledError:
        raise RunError("the engine was closed before it was done") from None
    except Exception as error:
        return error
