"""Queue of blocks in stacks: each runs once, in order, blocks of a dead worker again; progress bar."""

import pickle
import sys
import time
from collections import Counter, deque
from collections.abc import Generator, Hashable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from dataclasses import replace
from importlib.util import find_spec
from itertools import chain, islice
from math import inf, nan
from pathlib import Path
from queue import SimpleQueue
from typing import Any, TypeAlias, cast

from trackbench.errors import RunError, WriteError, counted, in_line
from trackbench.evaluation.block import BlockResult, BlockTask
from trackbench.execution.cache import BlockStore, announced
from trackbench.execution.engines import ClusterExecutor, OpenEngine, SerialExecutor
from trackbench.execution.plan import memory, stack_limit
from trackbench.execution.worker import Computed, Work, compute_batch, environment_digests
from trackbench.extension_points import field_values
from trackbench.filters.base import JoinableFilter
from trackbench.plugins.errors import FilterError, message_of, postponed
from trackbench.plugins.load import Plugin, restore_modules

_MOST_DEATHS = 4
"""How often a worker may die over one block before the block is given up."""
_AHEAD = 16
"""Blocks per worker that are handed over: they last while the caller writes an experiment's report."""
_TASK_SECONDS = 1.0
"""Least time that a task of a cluster should take."""
_LONG_S = 10.0
"""Seconds from which progress is printed where stderr is no terminal."""
_SCHEDULER_SECONDS = 0.004
"""Time that a cluster's scheduler takes for a task."""

BlockOutcome: TypeAlias = dict[int, BlockResult] | Exception
"""A block's results by the number of runs used, or why there are none; empty if they are stored."""
Stack: TypeAlias = list[BlockTask]
"""Adjacent blocks of one filter, or one block of several, which a worker filters side by side."""


class Queue:
    """Tasks of one or several plans. After a worker's death blocks run one at a time.

    Worker processes that see the folder of the store write their blocks there.
    """

    def __init__(self, workers: int, store: BlockStore) -> None:
        self.failed: dict[tuple[object, ...], str] = {}
        self._first_failed: dict[tuple[object, ...], int] = {}
        self.deaths: Counter[BlockTask] = Counter()
        self.hungriest: tuple[BlockTask, int] | None = None
        """block of the worker with the largest memory, and its bytes"""
        self._workers = workers
        self._store = store
        self._remote = False
        self._waiting: deque[Stack] = deque()
        self._running: dict[Future[list[Computed]], list[Stack]] = {}
        self._seconds: dict[tuple[object, ...], float] = {}  # of a block, by filter
        self._plugins: dict[BlockTask, tuple[Plugin, ...]] = {}

    def add(self, tasks: Sequence[BlockTask], plugins: tuple[Plugin, ...]) -> None:
        """Append the tasks that are new, as stacks.

        Several workers get at least two stacks each.
        """
        most = len(tasks) // (2 * self._workers) if self._workers > 1 else len(tasks)
        last: dict[BlockTask, Stack] = {}
        stacks: list[Stack] = []
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
                stacks.append(stack)
            stack.append(task)
        self._waiting.extend(_joined(stacks, most))

    def run(self, open_engine: OpenEngine) -> Generator[tuple[BlockTask, BlockOutcome]]:
        """Yield tasks with their results as they finish; raises RunError if no worker starts."""
        unstarted = 0
        while self._waiting:
            try:
                with open_engine() as executor, announced(self._store.root) as token:
                    shared = None if isinstance(executor, SerialExecutor) else token
                    least_seconds = 0.0
                    if isinstance(executor, ClusterExecutor):
                        self._workers, self._remote = max(self._workers, executor.workers), True
                        # The scheduler is idle half of the time.
                        least_seconds = max(_TASK_SECONDS, 2.0 * _SCHEDULER_SECONDS * self._workers)
                    yield from self._drain(executor, least_seconds, shared)
            except BrokenExecutor as error:
                unstarted = 0 if self._running else unstarted + 1
                if unstarted == _MOST_DEATHS:
                    raise RunError(f"no worker process could be started ({error})") from error
                yield from self._after_death()

    def give_up(self, task: BlockTask, error: Exception) -> list[BlockTask]:
        """Record why a task's filter failed; return the filter's blocks that are dropped."""
        lost = algorithm(task)
        last = task.first_run + (task.runs_used - 1) * (1 if task.index >= 0 else -1)
        runs = f"runs {task.first_run} to {last}"
        why = str(error) if isinstance(error, FilterError) else message_of(error)
        # Report the block of the lowest runs, whichever fails first.
        if abs(task.first_run) <= self._first_failed.get(lost, inf):
            self._first_failed[lost] = abs(task.first_run)
            self.failed[lost] = in_line(f"{why} ({runs})")
        left_out = []
        for _ in range(len(self._waiting)):
            stack = self._waiting.popleft()
            left_out += [t for t in stack if algorithm(t) == lost]
            if others := [t for t in stack if algorithm(t) != lost]:
                self._waiting.append(others)
        return [task, *left_out]

    def _drain(
        self, executor: Executor, least_seconds: float, shared: Path | None
    ) -> Iterator[tuple[BlockTask, BlockOutcome]]:
        expected = environment_digests()
        # Not concurrent.futures.wait: a signal within it leaves futures locked, and the pool hangs.
        finished: SimpleQueue[Future[list[Computed]]] = SimpleQueue()
        while self._waiting or self._running:
            while self._waiting and len(self._running) < self._limit():
                batch = self._batch(least_seconds)
                plugins, files = self._plugins[batch[0][0]], self._store.files
                restore_modules(plugins)  # in which pickle looks for the classes of the tasks
                works = [Work(pickle.dumps(stack), [*map(files, stack)]) for stack in batch]
                future = executor.submit(compute_batch, works, plugins, expected, shared)
                self._running[future] = [self._waiting.popleft() for _ in batch]
                with postponed():
                    future.add_done_callback(finished.put)
                if not finished.empty():
                    break  # keep a result before more is begun: a serial engine is done already
            future = finished.get()
            if future not in self._running:
                continue  # taken back
            outcomes = _results(future)
            batch = self._running.pop(future)
            if isinstance(outcomes, Exception):
                if len(batch) > 1:  # each stack alone
                    self._waiting.extendleft(reversed(batch))
                    least_seconds = 0.0
                    continue
                outcomes = [Computed(outcomes, nan, 0)]
            for stack, computed in zip(batch, outcomes, strict=True):
                yield from self._finish(stack, computed)
            if len(self._running) > self._limit():
                self._take_back()

    def _take_back(self) -> None:
        """Let tasks that no worker has begun wait again, in their order."""
        for future in [*self._running][::-1]:
            with postponed():
                taken_back = future.cancel()
            if taken_back:
                self._waiting.extendleft(reversed(self._running.pop(future)))

    def _finish(self, stack: Stack, computed: Computed) -> Iterator[tuple[BlockTask, BlockOutcome]]:
        # Memory that a worker has taken once stays with it: the first block of a filter counts.
        if self.hungriest is None or computed.memory > 1.05 * self.hungriest[1]:
            self.hungriest = stack[0], computed.memory
        if not isinstance(computed.results, Exception):
            self._seconds |= {algorithm(t): computed.seconds / len(stack) for t in stack}
            yield from zip(stack, computed.results, strict=True)
        elif len(stack) == 1:
            yield stack[0], computed.results
        else:  # each alone: only the failing block's runs are at fault
            self._waiting.extendleft([task] for task in reversed(stack))

    def _batch(self, least_seconds: float) -> list[Stack]:
        """Return the next stack, or as many of the same plugins as take so many seconds.

        Every worker gets at least two batches of what waits.
        """
        most = 1 if self.deaths else max(len(self._waiting) // (2 * self._workers), 1)
        batch: list[Stack] = []
        seconds = 0.0
        for stack in islice(self._waiting, most):
            if batch and self._plugins[stack[0]] != self._plugins[batch[0][0]]:
                break
            batch.append(stack)
            seconds += self._seconds.get(algorithm(stack[0]), inf) * len(stack)
            if seconds >= least_seconds:
                break
        return batch

    def _limit(self) -> int:
        """Return how many tasks may run at once: one while a task is suspected to kill workers.

        Every worker has tasks in advance, unless the memory is too small for all of them.
        """
        stacks = [*chain(*self._running.values()), *list(self._waiting)[:1]]
        if any(self.deaths[task] for task in chain.from_iterable(stacks)):
            return 1
        return _AHEAD * self._workers if self.fitting == self._workers else self.fitting

    @property
    def fitting(self) -> int:
        """Number of workers of this machine that have memory side by side; all of a cluster's."""
        peak = self.hungriest[1] if self.hungriest else 0
        if self._remote or peak * self._workers <= memory():
            return self._workers
        return max(1, memory() // peak)

    def _after_death(self) -> Iterator[tuple[BlockTask, Exception]]:
        # Nothing runs in a pool that never began: its first stack is suspected.
        suspects = [*chain(*self._running.values())] or [self._waiting.popleft()]
        for task in chain.from_iterable(suspects):
            self.deaths[task] += 1
            if self.deaths[task] < _MOST_DEATHS:
                self._waiting.appendleft([task])
            else:
                yield task, RunError(_why_dead(task))
        self._running.clear()


def _why_dead(task: BlockTask) -> str:
    keys = "`block` or `N`" if "N" in field_values(task.filter) else "`block`"
    return (
        f"its worker died {_MOST_DEATHS} times (killed, or out of memory?) over "
        f"a block of {counted(task.width, 'run')}; a lower {keys} takes less memory"
    )


def algorithm(task: BlockTask) -> tuple[object, ...]:
    """Return the parts of a task that fail together: a filter on a scenario."""
    return task.scenario, task.filter, task.assume, task.reference, task.width


def _joined(stacks: Sequence[Stack], most: int) -> list[Stack]:
    """Return the stacks, lone blocks of filters that differ in numbers only as one stack."""
    out: list[Stack] = []
    alike: dict[tuple[Hashable, BlockTask], Stack] = {}
    for stack in stacks:
        task = stack[0]
        if len(stack) > 1 or not isinstance(task.filter, JoinableFilter):
            out.append(stack)
            continue
        without_filter = replace(task, filter=cast(Any, None), runs_used=0)
        key = task.filter.structure(task.assumed_scenario), without_filter
        if len(alike.get(key, ())) not in range(1, min(most, stack_limit(task))):
            alike[key] = []
            out.append(alike[key])
        alike[key].append(task)
    return out


def _results(future: Future[list[Computed]]) -> list[Computed] | Exception:
    """Return the stacks' results or the task's error; raises if the engine failed."""
    try:
        return future.result()
    except (BrokenExecutor, WriteError):
        raise
    except CancelledError:
        raise RunError("the engine was closed before it was done") from None
    except Exception as error:
        return error


def progress_bar(total: int, unit: str, wanted: bool, **keys: Any) -> Any:
    """Return a progress bar of ``total`` units; ``keys`` are tqdm's. Off a terminal it prints lines."""
    if wanted and not sys.stderr.isatty() and not _in_notebook():
        return _Lines(total, unit, **keys)
    return _kind()(total=total, unit=unit, disable=not wanted, **keys)


class _Lines:
    """Progress into a file: a line each tenth of what takes long."""

    def __init__(self, total: int, unit: str, initial: int = 0, desc: str = "") -> None:
        self.total, self._unit, self._n, self._what = total, unit, initial, desc
        self._began, self._tenths = time.monotonic(), 10 * initial // max(total, 1)

    def __enter__(self) -> "_Lines":
        return self

    def __exit__(self, *_: object) -> None:
        return

    def update(self, n: int = 1) -> None:
        """Count units as done."""
        self._n += n
        tenths, seconds = 10 * self._n // max(self.total, 1), time.monotonic() - self._began
        if tenths > self._tenths and seconds >= _LONG_S:
            self._tenths = tenths
            units = f"{self._n} of {counted(self.total, self._unit)}"
            print(f"{self._what}: {units}, {seconds:.0f} s", file=sys.stderr, flush=True)

    def set_postfix_str(self, text: str) -> None:
        """Leave out what a bar shows beside the count."""


def _kind() -> Any:
    """Return the bar's class: the notebook's where it can be shown."""
    import tqdm

    if not (_in_notebook() and find_spec("ipywidgets")):
        return tqdm.tqdm
    import tqdm.notebook

    return tqdm.notebook.tqdm


def _in_notebook() -> bool:
    """Test whether an IPython kernel runs this process."""
    return "ipykernel" in sys.modules and sys.modules["IPython"].get_ipython() is not None
