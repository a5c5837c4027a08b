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
from trackbench.evaluation import cached_filter_outputs
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.filter_output import FilterOutput
from trackbench.execution import block_scheduler, cache
from trackbench.execution.block_file import PackedBlock
from trackbench.execution.cache import BlockStore
from trackbench.execution.dask_cluster import ClusterExecutor
from trackbench.execution.engines import SerialExecutor
from trackbench.execution.plan import Plan, make_plan
from trackbench.execution.run_plans import execute


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
    monkeypatch.setattr(block_scheduler, "BATCHES_IN_ADVANCE", 2)
    monkeypatch.setattr(block_scheduler, "_SCHEDULER_SECONDS", 0.0)
    results = []
    for seconds in (0.0, 1e9):
        monkeypatch.setattr(block_scheduler, "_TASK_SECONDS", seconds)
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

    def drain(self: block_scheduler.Queue, _: Executor, least: float, __: object) -> Iterator[Any]:
        found.append((least, self._workers))
        self._waiting.clear()
        yield from ()

    monkeypatch.setattr(block_scheduler.Queue, "_drain", drain)
    for workers in (1, 1000):
        tasks = block_scheduler.Queue(2, BlockStore(tmp_path))
        tasks.add(plan.unique, ())

        @contextmanager
        def opened(workers: int = workers) -> Iterator[Executor]:
            yield ClusterExecutor(Counting(), workers)

        assert not list(tasks.run(opened))
    assert found == [(1.0, 2), (8.0, 1000)]


@pytest.fixture
def ran(monkeypatch: pytest.MonkeyPatch) -> list[BlockTask]:
    """Tasks whose filters are run from now on."""
    found, filtered = list[BlockTask](), cached_filter_outputs.run_filter

    def recorded(task: BlockTask, *rest: Any) -> FilterOutput:
        found.append(task)
        return filtered(task, *rest)

    monkeypatch.setattr(cached_filter_outputs, "run_filter", recorded)
    cached_filter_outputs.run_filter_cached.cache_clear()
    cached_filter_outputs.run_reference.cache_clear()
    return found


def results_of(text: str, folder: Path) -> dict[Any, Any]:
    plan = make_plan(load(write(folder, text.replace("SCENE", merwe_text(T=6)))))
    (outcome,) = execute([plan], BlockStore(folder / "blocks"), SerialExecutor, 1, progress=False)
    return dict(outcome.results())


def test_a_filter_runs_once_for_points_that_score_it_in_different_ways(
    tmp_path: Path, ran: list[BlockTask]
) -> None:
    text = (
        "name: scored\nruns: 6\nblock: 3\nscenario: SCENE\n"
        "filters: {PF: {kind: pf, N: 5}, EKF: {kind: ekf}}\n"
        "grid: {scenario.score.steps: [[1, 6], [2, 6], [2, 4]]}\n"
    )
    assert len(results_of(text, tmp_path)) == 6
    assert sorted(type(task.filter).__name__ for task in ran) == ["EKF", "PF"]


def test_a_reference_runs_once_a_block(tmp_path: Path, ran: list[BlockTask]) -> None:
    text = (
        "name: exact\nruns: 6\nblock: 3\nscenario: SCENE\nreference: EKF\n"
        "filters: {PF: {kind: pf, N: 5}, UKF: {kind: ukf}, EKF: {kind: ekf}}\n"
        "metrics: [rmse, rmsd, coverage_90]\n"
    )
    with_others = results_of(text, tmp_path)
    assert sorted(type(task.filter).__name__ for task in ran) == ["EKF", "EKF", "PF", "UKF"]
    # As the reference it has the numbers that it has alone.
    alone = results_of(text.replace("reference: EKF\n", "").replace("rmsd, ", ""), tmp_path)
    for name, values in alone[0, "EKF"].per_run.items():
        assert values.tobytes() == with_others[0, "EKF"].per_run[name].tobytes()


TWO_FILTERS = (
    "name: kept\nruns: 6\nblock: 2\nscenario: SCENE\n"
    "filters: {PF: {kind: pf, N: 5}, EKF: {kind: ekf}}\n"
)


def merged_again(folder: Path) -> tuple[dict[Any, Any], int]:
    """Merge the stored blocks of `TWO_FILTERS`, and count how often a block is read."""
    config = write(folder, TWO_FILTERS.replace("SCENE", merwe_text(T=6)))
    plan = make_plan(load(config))
    store = CountingStore(folder / "blocks")
    (outcome,) = execute([plan], store, SerialExecutor, 1, progress=False)
    return dict(outcome.results()), store.reads


class CountingStore(BlockStore):
    """A store of blocks that counts how many it has read."""

    reads = 0

    def get(self, task: BlockTask) -> PackedBlock | None:
        CountingStore.reads += 1
        return super().get(task)


def test_stored_blocks_are_read_once_if_there_is_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(CountingStore, "reads", 0)
    first, _ = merged_again(tmp_path)
    monkeypatch.setattr(CountingStore, "reads", 0)
    kept, reads = merged_again(tmp_path)
    assert reads == 6
    # Without room each file is read when it is found, and once more when it is merged.
    monkeypatch.setattr(CountingStore, "reads", 0)
    monkeypatch.setattr(cache, "_KEPT_BYTES", 0)
    not_kept, reads = merged_again(tmp_path)
    assert reads == 12
    for results in (kept, not_kept):
        assert results.keys() == first.keys()
        for key, result in results.items():
            for name, values in result.per_run.items():
                assert values.tobytes() == first[key].per_run[name].tobytes()
