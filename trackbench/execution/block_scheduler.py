"""Schedule blocks: a queue of stacks, handed to the workers in batches, again if a worker dies."""

import pickle
from collections import Counter, deque
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future
from dataclasses import replace
from itertools import chain, islice
from math import inf, nan
from pathlib import Path
from queue import SimpleQueue
from typing import TypeAlias

from trackbench.errors import RunError, in_line
from trackbench.evaluation.block_result import BlockResult
from trackbench.evaluation.block_task import BlockTask
from trackbench.execution.block_size import stack_limit
from trackbench.execution.cache import BlockStore, announced
from trackbench.execution.compute_batch import Computed, Work, compute_batch, environment_digests
from trackbench.execution.dask_cluster import ClusterExecutor
from trackbench.execution.engines import OpenEngine, SerialExecutor, results_or_error
from trackbench.execution.joined_filters import Stack, algorithm, join_filters
from trackbench.execution.memory import workers_that_fit
from trackbench.execution.process_pool import BATCHES_IN_ADVANCE, WorkerDeathError
from trackbench.execution.worker_death_messages import MOST_DEATHS, death_message
from trackbench.plugins.loaded_and_changed_plugins import restore_modules
from trackbench.plugins.plugin_content import Plugin
from trackbench.plugins.plugin_errors import FilterError, message_of
from trackbench.plugins.stop_signals import postponed

_TASK_SECONDS = 1.0
"""Least time that a task of a cluster should take."""
_SCHEDULER_SECONDS = 0.004
"""Time that a cluster's scheduler takes for a task."""

BlockOutcome: TypeAlias = dict[int, BlockResult] | Exception
"""A block's results by the number of runs used, or its error; empty if the results are stored."""


class Queue:
    """Tasks of one or several plans. After a worker's death blocks run one at a time.

    Worker processes that see the folder of the store write their blocks there.
    """

    def __init__(self, workers: int, store: BlockStore) -> None:
        """Begin without tasks; ``workers`` is the number of processes that compute them.

        The results are stored in ``store``. Blocks that a worker filters side by side are a stack, and
        the stacks that are submitted in one call a batch. `algorithm` of a block is equal for all blocks
        of one filter on one scenario.
        """
        self.failed: dict[tuple[object, ...], str] = {}
        """reasons why filters failed, by `algorithm`"""
        self._first_failed: dict[tuple[object, ...], int] = {}
        """first run of the failed block with the lowest runs, by `algorithm`"""
        self.deaths: Counter[BlockTask] = Counter()
        """number of workers that died over each block"""
        self.hungriest: tuple[BlockTask, int] | None = None
        """block of the worker with the largest memory, and its bytes"""
        self._exit_code: int | None = None
        """exit code of the worker that died last; None if it is unknown"""
        self._workers = workers
        self._store = store
        self._remote = False
        """True if the workers are those of a cluster, perhaps on other machines"""
        self._waiting: deque[Stack] = deque()
        """stacks that are not submitted yet, in order"""
        self._running: dict[Future[list[Computed]], list[Stack]] = {}
        """stacks of each submitted batch"""
        self._seconds: dict[tuple[object, ...], float] = {}
        """seconds that a block takes, by `algorithm`"""
        self._plugins: dict[BlockTask, tuple[Plugin, ...]] = {}
        """plugins of every task that was ever added"""

    def add(self, tasks: Sequence[BlockTask], plugins: tuple[Plugin, ...]) -> None:
        """Append the tasks that are new to the queue, in stacks; ``plugins`` is the code they need.

        A stack has blocks that a worker filters side by side. Stacks are so small that each of several
        workers gets at least two.
        """
        most = len(tasks)  # largest number of blocks of a stack
        if self._workers > 1:
            most = len(tasks) // (2 * self._workers)
        last_stack: dict[BlockTask, Stack] = {}  # by filter
        stacks: list[Stack] = []
        for task in tasks:
            if task in self._plugins:  # it was added before
                continue
            self._plugins[task] = plugins
            # Blocks of one filter differ in their index and in the number of used runs.
            of_filter = replace(task, index=0, runs_used=0)
            stack = last_stack.get(of_filter)
            # A stack has adjacent blocks of one filter: begin a new one if it is full, or after a gap.
            # Blocks of training runs, on which filters are tuned, count down from -1. They never come
            # with other blocks, so that sizes of indices may be compared.
            if (
                stack is None
                or len(stack) >= min(most, stack_limit(task))
                or abs(task.index) != abs(stack[-1].index) + 1
            ):
                stack = []
                last_stack[of_filter] = stack
                stacks.append(stack)
            stack.append(task)
        # Blocks that are alone in their stacks are joined with those of similar filters.
        self._waiting.extend(join_filters(stacks, most))

    def run(self, open_engine: OpenEngine) -> Generator[tuple[BlockTask, BlockOutcome]]:
        """Yield tasks with their results as they finish.

        The engine is opened again after a worker has died. Raises RunError if no worker starts.
        """
        unstarted = 0
        while self._waiting:
            try:
                with open_engine() as executor, announced(self._store.root) as token:
                    # Worker processes that find this file store blocks; a serial engine leaves it to the
                    # caller.
                    shared = None if isinstance(executor, SerialExecutor) else token
                    least_seconds = 0.0  # of a batch: one stack
                    if isinstance(executor, ClusterExecutor):
                        self._workers = max(self._workers, executor.workers)
                        self._remote = True
                        # Batches are so long that the scheduler is idle half of the time.
                        least_seconds = max(_TASK_SECONDS, 2.0 * _SCHEDULER_SECONDS * self._workers)
                    yield from self._drain(executor, least_seconds, shared)
            except BrokenExecutor as error:
                # An engine that broke without a running block has not started.
                self._exit_code = error.exit_code if isinstance(error, WorkerDeathError) else None
                unstarted = 0 if self._running else unstarted + 1
                if unstarted == MOST_DEATHS:
                    raise RunError(f"no worker process could be started ({error})") from error
                yield from self._after_death()

    def give_up(self, task: BlockTask, error: Exception) -> list[BlockTask]:
        """Record the error with which a task's filter failed, and drop the filter's waiting blocks.

        These are all blocks of this filter on this scenario, which have one `algorithm`. Return the
        dropped blocks, the failed one included.
        """
        failed = algorithm(task)
        place = f"runs {task.first_run} to {task.run_number(task.runs_used - 1)}"
        if isinstance(error, FilterError):
            reason = str(error)
            if error.place.startswith("run "):
                place = error.place
            elif error.place:
                place = f"{error.place}; {place}"
        else:
            reason = message_of(error)
        # Report the block of the lowest runs, whichever fails first.
        if abs(task.first_run) <= self._first_failed.get(failed, inf):
            self._first_failed[failed] = abs(task.first_run)
            self.failed[failed] = in_line(f"{reason} ({place})")
        dropped = [task]
        waiting: deque[Stack] = deque()
        for stack in self._waiting:
            others = []
            for block in stack:
                if algorithm(block) == failed:
                    dropped.append(block)
                else:
                    others.append(block)
            if others:
                waiting.append(others)
        self._waiting = waiting
        return dropped

    def _drain(
        self, executor: Executor, least_seconds: float, shared: Path | None
    ) -> Iterator[tuple[BlockTask, BlockOutcome]]:
        """Submit batches and yield each block with its results, until all are done.

        A batch is a list of stacks that is submitted as one call, and ``least_seconds`` the least time
        that it should take. ``shared`` is a file in the store's folder by which a worker detects that it
        shares the folder; None if the caller stores all blocks. Raises BrokenExecutor if a worker died.
        """
        expected = environment_digests()  # a worker must have the same code and arithmetic
        # Not concurrent.futures.wait: a signal within it leaves futures locked, and the pool hangs.
        finished: SimpleQueue[Future[list[Computed]]] = SimpleQueue()
        while self._waiting or self._running:
            while self._waiting and len(self._running) < self._limit():
                batch = self._next_batch(least_seconds)
                first_task = batch[0][0]  # all tasks of a batch have the same plugins
                plugins = self._plugins[first_task]
                restore_modules(plugins)  # pickle looks for the tasks' classes in these modules
                works = []
                for stack in batch:
                    # The files to which a worker writes the results of each block.
                    files = [self._store.files(task) for task in stack]
                    works.append(Work(stack=pickle.dumps(stack), files=files))
                future = executor.submit(compute_batch, works, plugins, expected, shared)
                self._running[future] = [self._waiting.popleft() for _ in batch]
                with postponed():  # Ctrl-C waits: within the call it would leave the future locked
                    future.add_done_callback(finished.put)
                if not finished.empty():
                    break  # store a result first: a serial engine computes in `submit`
            future = finished.get()
            if future not in self._running:
                continue  # `_take_back` has canceled it
            outcomes = results_or_error(future)
            batch = self._running.pop(future)
            if isinstance(outcomes, Exception):
                # A batch that failed as a whole is repeated with each stack alone.
                if len(batch) > 1:
                    self._waiting.extendleft(reversed(batch))
                    least_seconds = 0.0
                    continue
                # `_finish` reports the error, which stands in place of results.
                outcomes = [Computed(results=outcomes, seconds=nan, memory=0)]
            for stack, computed in zip(batch, outcomes, strict=True):
                yield from self._finish(stack, computed)
            # The limit falls if a worker has died or takes much memory.
            if len(self._running) > self._limit():
                self._take_back()

    def _take_back(self) -> None:
        """Cancel the submitted batches that no worker has begun; their stacks wait again, in order."""
        # The last one first, as each is put before the others.
        for future in reversed(list(self._running)):
            with postponed():  # Ctrl-C waits: within the call it would leave the future locked
                taken_back = future.cancel()
            if taken_back:
                self._waiting.extendleft(reversed(self._running.pop(future)))

    def _finish(self, stack: Stack, computed: Computed) -> Iterator[tuple[BlockTask, BlockOutcome]]:
        """Yield a stack's blocks with their results; queue each block alone if the stack failed.

        A stack of one block that failed is yielded with its error. The memory and the time that the
        stack took are recorded.
        """
        # The measured memory of a worker is its largest so far, which never falls. Only an increase by
        # more than 5 % is due to this stack.
        if self.hungriest is None or computed.memory > 1.05 * self.hungriest[1]:
            self.hungriest = (stack[0], computed.memory)
        if not isinstance(computed.results, Exception):
            for task in stack:
                self._seconds[algorithm(task)] = computed.seconds / len(stack)
            yield from zip(stack, computed.results, strict=True)
        elif len(stack) == 1:
            yield stack[0], computed.results
        else:
            # The error is that of some block: each one runs again alone.
            self._waiting.extendleft([task] for task in reversed(stack))

    def _next_batch(self, least_seconds: float) -> list[Stack]:
        """Return the next stacks: so many that they take ``least_seconds``, and at least one.

        They keep waiting until the caller removes them. A batch has stacks of the same plugins. It is so
        small that every worker gets at least two batches of the waiting stacks.
        """
        most = 1  # after a worker's death, as one block may be the cause
        if not self.deaths:
            most = max(len(self._waiting) // (2 * self._workers), 1)
        batch: list[Stack] = []
        seconds = 0.0
        for stack in islice(self._waiting, most):
            if batch and self._plugins[stack[0]] != self._plugins[batch[0][0]]:
                break
            batch.append(stack)
            # A stack whose filter has not been timed yet ends the batch.
            seconds += self._seconds.get(algorithm(stack[0]), inf) * len(stack)
            if seconds >= least_seconds:
                break
        return batch

    def _limit(self) -> int:
        """Return how many batches may be submitted at once.

        It is one while a block is suspected to kill workers. Otherwise every worker has batches in
        advance, unless the memory is too small for all workers.
        """
        # To look a task up hashes its whole filter and scenario: leave it out as long as no worker died.
        if self.deaths:
            submitted_or_next = list(chain.from_iterable(self._running.values()))
            if self._waiting:
                submitted_or_next.append(self._waiting[0])
            if any(self.deaths[task] for task in chain.from_iterable(submitted_or_next)):
                return 1
        # `fitting` is the number of workers whose memory suffices. If it is too small, the number of
        # batches limits that of the busy workers, so that none is submitted in advance.
        if self.fitting == self._workers:
            return BATCHES_IN_ADVANCE * self._workers
        return self.fitting

    @property
    def fitting(self) -> int:
        """Number of workers that fit into this machine's memory; those of a cluster have their own."""
        peak = 0  # largest memory of a worker, bytes
        if self.hungriest is not None:
            _, peak = self.hungriest
        if self._remote:
            return self._workers
        return workers_that_fit(self._workers, peak)

    def _after_death(self) -> Iterator[tuple[BlockTask, Exception]]:
        """After a worker's death, queue the submitted blocks again, each alone.

        Yield the blocks over which too many workers have died, with an error.
        """
        # Any of the submitted blocks may have been the cause.
        suspects = list(chain.from_iterable(self._running.values()))
        if not suspects:
            # No block ran, as the pool never began: its first stack is suspected.
            suspects = [self._waiting.popleft()]
        for task in chain.from_iterable(suspects):
            self.deaths[task] += 1
            if self.deaths[task] < MOST_DEATHS:
                self._waiting.appendleft([task])
            else:
                yield task, RunError(death_message(task, self._exit_code))
        self._running.clear()
