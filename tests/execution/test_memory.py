"""The memory a run is said to need: never less than a block takes, and not many times more."""

import os
import sys
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import PLANE, make_filter
from tests.papers import banana, maneuver, merwe, merwe_text
from trackbench import api
from trackbench.config.load import load
from trackbench.errors import UserError
from trackbench.evaluation.block import BlockTask
from trackbench.evaluation.run_block import run_stack, run_whole_block
from trackbench.execution import plan
from trackbench.execution.plan import (
    _STEP_ROW,
    _block_bytes,
    block_width,
    check_memory,
    make_plan,
    memory,
)
from trackbench.models.motions.kinematic import ConstantAcceleration, WhiteAcceleration
from trackbench.registry import kinds
from trackbench.results.frames import read_frame

CWNA, CA = WhiteAcceleration(q=0.1), ConstantAcceleration(q=4.0)
SCENARIOS = {"merwe": merwe(T=4, R=1.0), "banana": banana(scans=5)}


def peak(function: Callable[..., object], *args: object) -> int:
    """Bytes that were alive at once."""
    tracemalloc.start()
    try:
        function(*args)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("scenario", SCENARIOS)
@pytest.mark.parametrize(
    ("kind", "keys"),
    [
        ("pf", {}),
        ("rpf", {}),
        ("rpf", {"boost": 4, "boost_scans": 2}),
        ("epf", {}),
        ("epf", {"defensive": 0.2}),
        ("upf", {}),
        ("upf", {"defensive": 0.2, "resampling": "residual"}),
        ("pfde", {}),
        ("hdepf", {"reading": {"select": "greedy"}}),
        ("hdepf", {"reading": {"target": "ratio", "final_weights": "importance"}}),
    ],
)
def test_a_block_takes_no_more_than_estimated(
    kind: str, keys: dict[str, Any], scenario: str
) -> None:
    model, width = SCENARIOS[scenario], 4
    tracker = make_filter(kind, N=5000, **keys)
    task = BlockTask(model, tracker, 0, 0, width, width)
    run_whole_block(replace(task, index=1))  # what only the first block takes
    taken = peak(run_whole_block, task)
    assert taken <= _block_bytes(model, tracker, width, 1) <= 2.5 * taken


def test_the_exact_posterior_takes_no_more_than_estimated() -> None:
    task = BlockTask(SCENARIOS["merwe"], kinds("filters")["grid"](nodes=256), 0, 0, 8, 8)
    run_whole_block(task)  # what only the first block takes
    taken = peak(run_whole_block, replace(task, index=1))
    assert taken <= _block_bytes(task.scenario, task.filter, 8, 1) <= 2.5 * taken


def test_long_tracks_take_no_more_than_estimated() -> None:
    model, tracker = maneuver(duration=400.0, legs=(), score_from=0.0), kinds("filters")["kf"]()
    task = BlockTask(model, tracker, 0, 0, 40, 40)
    run_whole_block(replace(task, index=1))  # what only the first block takes
    taken = peak(run_whole_block, task)
    assert taken <= _block_bytes(model, tracker, 40, 1) <= 2.5 * taken


@pytest.mark.parametrize(
    ("kind", "keys"),
    [("pf", {}), ("rpf", {"boost": 4, "boost_scans": 3}), ("apf", {}), ("enkf", {})],
)
def test_a_smoother_of_draws_takes_no_more_than_estimated(kind: str, keys: dict[str, Any]) -> None:
    model, tracker = merwe(T=60, R=1.0), make_filter(kind, N=2000, smooth=True, **keys)
    task = BlockTask(model, tracker, 0, 0, 4, 4)
    run_whole_block(replace(task, index=1))  # what only the first block takes
    taken = peak(run_whole_block, task)
    assert taken <= _block_bytes(model, tracker, 4, 1) <= 2.5 * taken


def test_a_smoother_of_two_models_takes_no_more_than_estimated() -> None:
    model, motions = maneuver(duration=400.0, legs=(), score_from=0.0), (CWNA, CA)
    keys = {"motions": motions, "transition": ((0.9, 0.1), (0.2, 0.8)), "smooth": True}
    tracker = make_filter("imm", **keys)
    task = BlockTask(model, tracker, 0, 0, 40, 40)
    run_whole_block(replace(task, index=1))  # what only the first block takes
    taken = peak(run_whole_block, task)
    assert taken <= _block_bytes(model, tracker, 40, 1) <= 2.5 * taken


def test_a_stack_of_long_tracks_takes_no_more_than_estimated() -> None:
    model, tracker = maneuver(duration=400.0, legs=(), score_from=0.0), kinds("filters")["kf"]()
    tasks = [BlockTask(model, tracker, 0, i, 20, 20) for i in range(8)]
    run_stack(tasks[:1])  # what only the first block takes
    taken = peak(run_stack, tasks)
    assert taken <= _block_bytes(model, tracker, 20, 8) <= 2.5 * taken


def test_saved_tracks_and_numbers_of_all_filters_are_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of so many runs, and filters, that nothing else is of any size."""
    monkeypatch.setattr(plan, "memory", lambda: 1e15)
    runs, filters = 1_000_000, "".join(f"  F{i}: {{kind: kf}}\n" for i in range(8))
    (tmp_path / "b.yaml").write_text(f"name: b\nruns: {runs}\n{PLANE}filters:\n{filters}")
    experiment = api.prepare(tmp_path / "b.yaml", api.Options())
    (task, *_) = make_plan(experiment, save_tracks=True).tasks[0, "F0"]
    result = run_whole_block(replace(task, width=2, runs_used=2))[2]
    assert result.tracks is not None
    tracks = sum(x.nbytes for x in result.tracks if x is not None) / 2
    numbers = sum(x.nbytes for x in result.per_run.values()) / 2
    taken = runs * (8 * tracks + numbers)
    assert taken <= plan.check_memory(experiment, 1, save_tracks=True) <= 1.2 * taken


def test_what_is_about_to_be_done_is_announced(tmp_path: Path) -> None:
    (tmp_path / "b.yaml").write_text(
        f"name: b\nruns: 7\nblock: 4\n{PLANE}filters: {{A: {{kind: kf}}, B: {{kind: pf, N: 9}}}}\n"
    )
    experiment = api.prepare(tmp_path / "b.yaml", api.Options())
    line = plan.announced(experiment, make_plan(experiment), 2, 3_400_000)
    assert line == "b: 2 filters x 7 runs x 8 steps, 4 blocks on 2 workers, about 3 MB"


def test_a_filter_is_asked_what_it_notes_with_few_particles(tmp_path: Path) -> None:
    """Before anything is known of the memory that its own number would take."""
    config = tmp_path / "large.yaml"
    config.write_text(
        f"name: large\nscenario: {merwe_text(T=5)}\n"
        "filters: {UPF: {kind: upf, N: 300000}}\n"
        "tables: {t: {kind: metrics, columns: {d: mean(collapsed_steps)}}}\n"
    )
    assert peak(api.prepare, config, api.Options()) < 20_000_000


@pytest.mark.parametrize(
    ("N", "boost", "scans", "width"), [(10_000, 10, 8, 3), (2000, 1, 0, 16), (2000, 20, 3, 8)]
)
def test_a_boosted_cloud_makes_a_narrower_block(N: int, boost: int, scans: int, width: int) -> None:
    tracker = kinds("filters")["rpf"](N=N, boost=boost, boost_scans=scans)
    assert block_width(tracker, banana()) == width


GB = 2**30


@pytest.mark.skipif(sys.platform == "win32", reason="has no control groups")
@pytest.mark.parametrize(
    ("groups", "files", "limit"),
    [
        ("0::/user/job\n", {"user/job/memory.max": f"{GB}\n", "user/memory.max": "max\n"}, GB),
        ("0::/user/job\n", {"user/job/memory.max": "max\n", "user/memory.max": f"{GB}\n"}, GB),
        ("0::/user/job\n", {"user/job/memory.max": f"{GB}", "user/memory.max": "9"}, 9),
        ("0::/\n", {"memory.max": f"{GB}\n"}, GB),
        ("0::/host/path/unseen\n", {"memory.max": f"{GB}\n"}, GB),
        (
            "9:name=systemd:/\n5:cpu,memory:/docker/1\n0::/\n",
            {"memory/docker/1/memory.limit_in_bytes": f"{GB}\n"},
            GB,
        ),
        ("4:memory:/a:b\n", {"memory/memory.limit_in_bytes": f"{GB}\n"}, GB),
        ("4:memory:/\n", {"memory/memory.limit_in_bytes": f"{2**63 - 4096}\n"}, None),
        ("4:cpu:/\n", {"memory/memory.limit_in_bytes": "1", "cpu/memory.max": "1"}, None),
        ("0::/job\n", {"job/memory.max": "max\n"}, None),
        ("0::/job\n", {}, None),
        (None, {"memory.max": "1"}, None),
    ],
)
def test_a_containers_limit_is_the_memory_that_there_is(
    groups: str | None, files: dict[str, str], limit: int | None, tmp_path: Path
) -> None:
    if groups is not None:
        (tmp_path / "proc/self").mkdir(parents=True)
        (tmp_path / "proc/self/cgroup").write_text(groups)
    for name, content in files.items():
        path = tmp_path / "sys/fs/cgroup" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content)
    machines = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    assert memory(tmp_path) == (machines if limit is None else limit)


def test_a_run_that_a_container_would_kill_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "c.yaml").write_text(
        f"name: c\nruns: 10\nscenario: {merwe_text(T=4)}\nfilters:\n  PF: {{kind: pf, N: 50}}\n"
    )
    experiment = load(tmp_path / "c.yaml")
    needed = check_memory(experiment, 1)
    monkeypatch.setattr(plan, "memory", lambda: needed)
    with pytest.raises(UserError, match=r"this machine or container has .* GB: use fewer"):
        check_memory(experiment, 1)


def test_a_long_track_of_few_runs_takes_no_more_than_estimated() -> None:
    scenario, tracker = banana(scans=3000), kinds("filters")["ekf"]()
    task = BlockTask(scenario, tracker, 0, 0, 1, 1)
    run_whole_block(replace(task, scenario=banana(scans=5)))  # what only the first block takes
    taken = peak(run_whole_block, task)
    assert taken <= _block_bytes(scenario, tracker, 1, 1) <= 2.5 * taken


def test_a_file_is_read_in_little_more_than_its_numbers_take(tmp_path: Path) -> None:
    """A row of per_step.csv has seven columns."""
    path, rows = tmp_path / "per_step.csv", 30_000
    lines = (f"KF,{k},{k / 7},rmse_position,{k / 3},0.{k},20\n" for k in range(rows))
    path.write_text("filter,step,time,metric,value,stderr,runs\n" + "".join(lines))
    read = peak(read_frame, path)
    assert 7 * 8 * rows < read < _STEP_ROW * rows + 6_000_000
