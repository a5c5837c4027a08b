"""Batches of stacks: what a worker computes with one call, and what it stores."""

from collections.abc import Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.execution.test_resume import write
from tests.papers import merwe_text
from trackbench.config.load import load
from trackbench.evaluation import run_filter
from trackbench.evaluation.block import BlockTask
from trackbench.execution import queue
from trackbench.execution.cache import BlockStore
from trackbench.execution.engines import ClusterExecutor, SerialExecutor
from trackbench.execution.plan import Plan, make_plan
from trackbench.execution.runner import execute


class Counting(Executor):
    """A thread, and the number of stacks in each call."""

    def __init__(self) -> None:
        self.thread, self.stacks = ThreadPoolExecutor(1), list[int]()

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        self.stacks.append(len(args[0]))
        return self.thread.submit(fn, *args, **kwargs)


def outcome_of(plan: Plan, store: BlockStore, executor: Executor) -> dict[Any, bytes]:
    @contextmanager
    def opened() -> Iterator[Executor]:
        yield ClusterExecutor(executor)

    (outcome,) = execute([plan], store, opened, workers=1, progress=False)
    assert not outcome.failures
    return {k: b"".join(v.tobytes() for v in r.per_run.values()) for k, r in outcome.results()}


def test_a_cluster_gets_batches_that_last_and_stores_their_blocks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = "name: many\nruns: 400\nblock: 2\nscenario: SCENE\nfilters: {KF: {kind: ekf}}\n"

    plan = make_plan(load(write(tmp_path, text.replace("SCENE", merwe_text(T=6)))))
    monkeypatch.setattr(queue, "_AHEAD", 2)
    monkeypatch.setattr(queue, "_SCHEDULER_SECONDS", 0.0)
    results = []
    for seconds in (0.0, 1e9):
        monkeypatch.setattr(queue, "_TASK_SECONDS", seconds)
        executor, store = Counting(), BlockStore(tmp_path / str(seconds))
        results.append(outcome_of(plan, store, executor))
        assert all(store.has_file(task) for task in plan.unique)
        assert not list(store.root.glob("shared-*"))
        assert (max(executor.stacks) > 1) == (seconds > 0.0)
        assert executor.stacks[:2] == [1, 1]  # nothing is known yet
    assert results[0] == results[1]


def test_a_larger_cluster_gets_more_tasks_and_longer_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = "name: many\nruns: 400\nblock: 2\nscenario: SCENE\nfilters: {KF: {kind: ekf}}\n"
    plan = make_plan(load(write(tmp_path, text.replace("SCENE", merwe_text(T=6)))))
    found: list[tuple[float, int]] = []

    def drain(self: queue.Queue, _: Executor, least: float, __: object) -> Iterator[Any]:
        found.append((least, self._workers))
        self._waiting.clear()
        yield from ()

    monkeypatch.setattr(queue.Queue, "_drain", drain)
    for workers in (1, 1000):
        tasks = queue.Queue(2, BlockStore(tmp_path))
        tasks.add(plan.unique, ())

        @contextmanager
        def opened(workers: int = workers) -> Iterator[Executor]:
            yield ClusterExecutor(Counting(), workers)

        assert not list(tasks.run(opened))
    assert found == [(1.0, 2), (8.0, 1000)]


def test_a_filter_runs_once_for_points_that_score_it_in_different_ways(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = (
        "name: scored\nruns: 6\nblock: 3\nscenario: SCENE\n"
        "filters: {PF: {kind: pf, N: 5}, EKF: {kind: ekf}}\n"
        "grid: {scenario.score.steps: [[1, 6], [2, 6], [2, 4]]}\n"
    )
    plan = make_plan(load(write(tmp_path, text.replace("SCENE", merwe_text(T=6)))))
    ran = list[BlockTask]()
    filtered = run_filter.run_filter
    monkeypatch.setattr(
        run_filter, "run_filter", lambda task, *rest: (ran.append(task), filtered(task, *rest))[1]
    )
    run_filter.run_filter_cached.cache_clear()
    (outcome,) = execute([plan], BlockStore(tmp_path / "blocks"), SerialExecutor, 1, progress=False)
    assert len(dict(outcome.results())) == 6
    assert sorted(type(task.filter).__name__ for task in ran) == ["EKF", "PF"]
