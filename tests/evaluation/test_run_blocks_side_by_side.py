"""Blocks that are filtered side by side: each has the bytes that it has alone."""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.conftest import EXPERIMENT_FILES, make_filter, shipped
from tests.papers import maneuver, merwe
from trackbench.component_parts import walk_parts
from trackbench.core.random_streams import SomeRuns, block_stream, side_by_side
from trackbench.evaluation import run_blocks_side_by_side
from trackbench.evaluation.block_result import BlockResult
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.cached_filter_outputs import run_filter_cached
from trackbench.evaluation.filter_output import FilterOutput
from trackbench.evaluation.run_blocks_side_by_side import run_stack, run_whole_block
from trackbench.evaluation.run_filter import run_filter
from trackbench.evaluation.simulated_runs import simulate
from trackbench.execution.block_scheduler import Queue
from trackbench.execution.block_size import stack_limit
from trackbench.execution.cache import BlockStore
from trackbench.execution.compute_batch import Computed
from trackbench.execution.plan import make_plan
from trackbench.filters.particle_smoother import Trajectories
from trackbench.filters.smoother_keys import FixedLag
from trackbench.models.motions.kinematic import ConstantAcceleration, WhiteAcceleration
from trackbench.scenarios.base import Scenario
from trackbench.scenarios.targets.legs import Leg, Legs
from trackbench.scenarios.targets.random_legs import RandomLegs

WIDTH, BLOCKS, STEPS = 4, 3, 25


def shortened(scenario: Any) -> Any:
    """Return the first steps of a scenario, with its first leg and its faults among them."""
    start, *_, end = scenario.steps
    if end - start <= STEPS or isinstance(scenario.target, RandomLegs):
        return scenario
    first, last = int(start) + 5, int(start) + 15
    target = scenario.target
    if isinstance(target, Legs):
        T = scenario.T
        leg = replace(target.legs[0], start=first * T, end=last * T)
        target = replace(target, legs=(leg,), settle=T, edge=T)
    faults = tuple(replace(f, from_=None, to=None, steps=(first, last)) for f in scenario.faults)
    last_step = int(start) + STEPS
    return replace(scenario.without_scoring, last=last_step, target=target, faults=faults)


def of_every_kind() -> Iterator[tuple[str, BlockTask]]:
    """Return a block of each filter class, with its parts, and the experiment where it is cheapest."""
    cheapest: dict[frozenset[type], tuple[int, str, BlockTask]] = {}
    for path in EXPERIMENT_FILES.values():
        for (point, _), tasks in make_plan(shipped(path.stem)).tasks.items():
            task = replace(tasks[0], width=WIDTH, runs_used=WIDTH, extra_run_counts=())
            if point or stack_limit(task) == 1:
                continue
            task = replace(task, scenario=shortened(task.scenario))
            parts = frozenset(type(part) for part in walk_parts((task.filter, task.assume)))
            cost = len(task.scenario.steps) * task.filter.particle_count
            known = cheapest.get(parts)
            if known is None or cost < known[0]:
                cheapest[parts] = cost, path.stem, task
    for _, name, task in cheapest.values():
        yield name, task


@cache
def cases() -> dict[str, list[BlockTask]]:
    """Return the blocks of `of_every_kind` by experiment."""
    found: dict[str, list[BlockTask]] = {}
    for name, task in of_every_kind():
        found.setdefault(name, []).append(task)
    return found


def stacked_and_alone(
    task: BlockTask, compared: Sequence[int] = range(BLOCKS)
) -> Iterator[tuple[BlockResult, BlockResult]]:
    """Return results of adjacent blocks, filtered side by side and one by one."""
    step = 1 if task.index >= 0 else -1
    blocks = [replace(task, index=task.index + step * i, stacked=1) for i in range(BLOCKS)]
    together = run_stack(blocks)
    for i in compared:
        simulate.cache_clear()
        run_filter_cached.cache_clear()
        used = blocks[i].runs_used
        yield together[i][used], run_whole_block(blocks[i])[used]


def equal_bytes(one: BlockResult, other: BlockResult) -> bool:
    """Return whether both have the same metrics, sums, series and tracks."""
    pairs = [(one.per_run[name], other.per_run[name]) for name in one.per_run]
    pairs += [
        (a, b)
        for name in one.steps
        for a, b in zip(one.steps[name], other.steps[name], strict=True)
    ]
    pairs += [(one.run_series[name], other.run_series[name]) for name in one.run_series]
    if one.tracks is not None and other.tracks is not None:
        pairs += [(a, b) for a, b in zip(one.tracks, other.tracks, strict=True) if a is not None]
    same_names = one.per_run.keys() == other.per_run.keys() and (one.tracks is None) == (
        other.tracks is None
    )
    return same_names and all(a.tobytes() == b.tobytes() for a, b in pairs)


# By experiment: a list of the cases would load all experiments whenever tests are collected.
@pytest.mark.parametrize("name", [*EXPERIMENT_FILES])
def test_a_block_has_the_same_bytes_beside_others(name: str) -> None:
    for task in cases().get(name, []):
        # The middle block has neighbors on both sides.
        ((together, alone),) = stacked_and_alone(replace(task, runs_with_tracks=6), [1])
        assert equal_bytes(together, alone), task.filter
        values = together.per_run.values()
        assert any(np.isfinite(value).any() for value in values), task.filter


def test_filters_of_every_kind_are_compared() -> None:
    assert sum(map(len, cases().values())) > 40


@pytest.mark.parametrize("lag", [None, 3])
@pytest.mark.parametrize("kind", ["pf", "rpf", "apf", "enkf", "imm", "ekf"])
def test_smoothers_have_the_same_bytes_beside_others(kind: str, lag: int | None) -> None:
    scenario: Scenario = merwe(T=8)
    keys: dict[str, Any] = {"smooth": True if lag is None else FixedLag(lag=lag)}
    if kind in ("pf", "rpf", "apf"):
        keys["smooth"] = Trajectories(trajectories=20, lag=lag)
    if kind == "imm":
        scenario = maneuver(duration=20.0, legs=(), score_from=0.0)
        motions = (WhiteAcceleration(q=0.1), ConstantAcceleration(q=4.0))
        keys |= {"motions": motions, "transition": ((0.9, 0.1), (0.2, 0.8))}
    task = BlockTask(scenario, make_filter(kind, **keys), 3, 2, WIDTH, 3, runs_with_tracks=6)
    results = list(stacked_and_alone(task))
    assert all(equal_bytes(*pair) for pair in results)
    error = "rmse_position" if kind == "imm" else "rmse"
    assert all(np.isfinite(together.per_run[error]).all() for together, _ in results)


@pytest.mark.parametrize("kind", ["kf", "hdepf"])
def test_training_blocks_have_the_same_bytes_beside_others(kind: str) -> None:
    scenario = maneuver(duration=60.0, legs=(), score_from=0.0) if kind == "kf" else merwe(T=10)
    task = BlockTask(scenario, make_filter(kind), 3, -2, WIDTH, 3)
    assert all(equal_bytes(*pair) for pair in stacked_and_alone(task))


@pytest.mark.parametrize(
    ("kind", "keys"),
    [
        ("ekf", {"fading": 1.1, "smooth": True}),
        ("ckf", {"fading": 1.1}),
        ("ekf", {"order": 2, "smooth": True}),
        ("ekf", {"order": 2, "form": "square-root"}),
        ("ukf", {"form": "square-root", "smooth": True}),
        ("enkf", {"form": "etkf", "rotation": True, "N": 6}),
    ],
)
def test_forms_of_a_filter_have_the_same_bytes_beside_others(
    kind: str, keys: dict[str, Any]
) -> None:
    task = BlockTask(merwe(T=10), make_filter(kind, **keys), 3, 0, WIDTH, WIDTH)
    results = list(stacked_and_alone(task))
    assert all(equal_bytes(*pair) for pair in results)
    assert np.isfinite(results[0][0].per_run["rmse"]).all()


def test_streams_side_by_side_draw_what_each_draws_alone() -> None:
    alone = [block_stream(5, block) for block in range(3)]
    together = side_by_side([block_stream(5, block) for block in range(3)], width=4)
    for draw in ("standard_normal", "random"):
        rows = [getattr(stream, draw)((2, 4, 7)) for stream in alone]
        np.testing.assert_array_equal(getattr(together, draw)((2, 12, 7)), np.hstack(rows))
    with pytest.raises(ValueError, match="is not for 3 blocks of 4 runs"):
        together.random((11, 7))
    # Run 9 of the stack is run 1 of the third block.
    few, one = SomeRuns(together, 6, [0, 9]), SomeRuns(alone[2], 6, [1])
    np.testing.assert_array_equal(few.random((2, 5))[1:], one.random((1, 5)))


def test_filters_that_mix_runs_and_plugins_are_filtered_alone() -> None:
    task = BlockTask(merwe(), make_filter("pf", N=10), 1, 0, 50, 50)
    assert stack_limit(task) == 8
    assert stack_limit(replace(task, width=1)) == stack_limit(replace(task, hold_out=4)) == 1
    assert stack_limit(replace(task, filter=make_filter("grid"))) == 1
    foreign = type("Mine", (type(make_filter("pf")),), {"__module__": "mine"})
    assert stack_limit(replace(task, filter=foreign())) == 1
    # 32 768 particles and 400 000 steps are filtered side by side.
    assert stack_limit(replace(task, filter=make_filter("pf", N=300), width=50)) == 2
    assert stack_limit(replace(task, scenario=maneuver(), filter=make_filter("kf"))) == 4


_NUMBERS: list[tuple[str, dict[str, Any], list[dict[str, Any]]]] = [
    (
        "adaptive-kf",
        {"nmf": {"q": 0.0}, "mf": {"q": 1e-3}, "detector": {"kind": "fading-ie", "eta": 20.0}},
        [
            {"nmf": {"q": 0.5}, "dlw": {"n": 5}},
            {"mf": {"q": 0.1}, "detector": {"kind": "fading-ie", "gamma": 0.79, "alpha": 1e-4}},
            {"exit": {"Ta": 20.0, "hold_s": 9.0}},
        ],
    ),
    (
        "adaptive-kf",
        {
            "nmf": {"q": 0.0},
            "mf": {"q": 1e-3},
            "detector": {"kind": "ie", "eta": 15.0, "window_s": 20.0},
        },
        [
            {"nmf": {"q": 0.2, "noise_gain": "printed"}, "mf": {"q": 0.1}},
            {"detector": {"kind": "ie", "eta": 9.0, "window_s": 20.0, "min_window_s": 5.0}},
        ],
    ),
    (
        "vdf",
        {"nmf": {"q": 0.0}, "mf": {"q": 1e-3}, "eta": 25.0},
        [{"mf": {"q": 0.1}}, {"nmf": {"q": 0.3}, "eta": 20.0, "Ta": 30.0}],
    ),
]


@pytest.mark.parametrize(("index", "metrics"), [(0, ("score", "prediction")), (-2, ())])
@pytest.mark.parametrize(("kind", "keys", "others"), _NUMBERS)
def test_filters_that_differ_in_numbers_have_the_same_bytes_side_by_side(
    kind: str,
    keys: dict[str, Any],
    others: list[dict[str, Any]],
    index: int,
    metrics: tuple[str, ...],
) -> None:
    turn = Leg(start=80.0, end=140.0, ax=2.0, ay=-2.0)
    scenario = maneuver(duration=200.0, legs=(turn,), score_from=0.0)
    filters = [make_filter(kind, **{**keys, **other}) for other in ({}, *others)]
    shown: dict[str, Any] = {"runs_with_tracks": 2, "keep_covariance": True}
    task = BlockTask(scenario, filters[0], 3, index, WIDTH, 3, keep_steps=("nees",), **shown)
    blocks = [replace(task, filter=f, predictive_metrics=metrics) for f in filters]
    (stack,) = stacks_of(blocks)
    assert stack == blocks
    alone = []
    for block, result in zip(blocks, run_stack(blocks), strict=True):
        run_filter_cached.cache_clear()
        alone.append(run_whole_block(block))
        assert result.keys() == alone[-1].keys()
        assert all(equal_bytes(result[used], alone[-1][used]) for used in result)
    runs = [result[WIDTH].per_run for result in alone]
    assert all(values["alarm"].any() for values in runs)
    assert len({values["rmse_position"].tobytes() for values in runs}) == len(filters)


def stacks_of(tasks: list[BlockTask], workers: int = 1) -> list[list[BlockTask]]:
    """Return the stacks of a queue with these tasks."""
    queue = Queue(workers, BlockStore(Path("unused")))
    queue.add(tasks, ())
    return [*queue._waiting]


def test_only_lone_blocks_of_one_structure_are_joined() -> None:
    scenario = maneuver(duration=60.0, legs=(), score_from=0.0)
    keys: dict[str, Any] = {"nmf": {"q": 0.0}, "mf": {"q": 1e-3}}
    made = [
        make_filter("adaptive-kf", **keys, detector={"kind": "ie", "eta": float(eta), **other})
        for eta in (10, 20)
        for other in ({}, {"window_s": 30.0}, {"onset": "window"})
    ]
    tasks = [BlockTask(scenario, f, 3, 0, WIDTH, WIDTH) for f in made]
    assert stacks_of(tasks) == [[tasks[i], tasks[i + 3]] for i in range(3)]
    assert stacks_of(tasks, workers=2) == [[task] for task in tasks]
    # Other data, and adjacent blocks of one filter, which need no numbers per run.
    assert len(stacks_of([tasks[0], replace(tasks[3], seed=4)])) == 2
    assert len(stacks_of([tasks[0], replace(tasks[3], index=1)])) == 2
    both = [replace(task, index=i) for i in (0, 1) for task in (tasks[0], tasks[3])]
    assert stacks_of(both) == [both[0::2], both[1::2]]
    # A Kalman filter's constants would become arrays.
    kalman = [replace(tasks[0], filter=make_filter("kf", fading=a)) for a in (1.0, 1.1)]
    assert len(stacks_of(kalman)) == 2


def test_a_filter_that_fails_is_given_up_alone() -> None:
    scenario = maneuver(duration=60.0, legs=(), score_from=0.0)
    keys: dict[str, Any] = {"nmf": {"q": 0.0}, "mf": {"q": 1e-3}}
    made = [make_filter("vdf", **keys, eta=eta) for eta in (10.0, 20.0, 30.0)]
    tasks = [BlockTask(scenario, f, 3, 0, WIDTH, WIDTH) for f in made]
    queue = Queue(1, BlockStore(Path("unused")))
    queue.add(tasks, ())
    failed = Computed(ValueError("no"), 1.0, 0)
    assert not list(queue._finish(queue._waiting.popleft(), failed))
    assert [*queue._waiting] == [[task] for task in tasks]
    # Side by side again, the filters that did not fail stay.
    queue._waiting = deque([tasks])
    assert queue.give_up(tasks[0], ValueError("no")) == [tasks[0], tasks[0]]
    assert [*queue._waiting] == [tasks[1:]]


def test_blocks_of_a_stack_share_its_time(monkeypatch: pytest.MonkeyPatch) -> None:
    def in_six_seconds(task: BlockTask, covariances: int) -> FilterOutput:
        return run_filter(task, task.data, covariances)._replace(cpu_s=6.0)

    monkeypatch.setattr(run_blocks_side_by_side, "run_filter_cached", in_six_seconds)
    blocks = [BlockTask(merwe(T=4), make_filter("ukf"), 1, i, WIDTH, WIDTH) for i in range(3)]
    assert [found[WIDTH].cpu_s for found in run_stack(blocks)] == [2.0, 2.0, 2.0]
    assert run_stack(blocks[:1])[0][WIDTH].cpu_s == 6.0
