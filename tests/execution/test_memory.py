"""Memory: what no machine has is refused, and what is measured decides how many workers run."""

import re
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from tests.conftest import PLANE
from tests.papers import banana, merwe_text
from trackbench import api
from trackbench.commands.job_line import announced
from trackbench.config.experiment import Experiment
from trackbench.config.load import load
from trackbench.errors import UserError
from trackbench.evaluation.run_blocks_side_by_side import run_whole_block
from trackbench.execution import memory
from trackbench.execution.block_scheduler import Queue
from trackbench.execution.block_size import block_width
from trackbench.execution.cache import BlockStore
from trackbench.execution.memory import check_memory
from trackbench.execution.plan import make_plan
from trackbench.registry import kinds
from trackbench.results.read_csv import read_columns

pytestmark = pytest.mark.usefixtures("no_report")


def peak(function: Callable[..., object], *args: object) -> int:
    """Bytes that were alive at once."""
    tracemalloc.start()
    try:
        function(*args)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def experiment_of(folder: Path, filters: str, runs: int = 10) -> Experiment:
    (folder / "c.yaml").write_text(
        f"name: c\nruns: {runs}\nscenario: {merwe_text(T=4)}\nfilters: {{{filters}}}\n"
    )
    return load(folder / "c.yaml")


@pytest.mark.parametrize(
    "filters",
    ["PF: {kind: pf, N: 10000}", "S: {kind: pf, N: 3000, smooth: true}", "KF: {kind: ukf}"],
)
def test_nothing_is_refused_that_a_block_does_not_need(
    filters: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    experiment = experiment_of(tmp_path, filters)
    ((task, *_),) = make_plan(experiment).tasks.values()
    run_whole_block(replace(task, index=1))  # what only the first block takes
    monkeypatch.setattr(memory, "memory", lambda: peak(run_whole_block, task))
    check_memory(experiment)


@pytest.mark.parametrize(
    ("filters", "runs"),
    [
        ("PF: {kind: pf, N: 2000000000}", 10),
        ("S: {kind: pf, N: 400000000, smooth: true}", 10),
        ("RPF: {kind: rpf, N: 20000000, boost: 100, boost_scans: 1}", 10),
        ("KF: {kind: ukf}", 200_000_000),
    ],
)
def test_what_no_machine_has_is_refused(
    filters: str, runs: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(memory, "memory", lambda: 10**10)
    with pytest.raises(UserError, match=r"needs at least .* GB of memory and this machine has 10"):
        check_memory(experiment_of(tmp_path, filters, runs))


def test_saved_tracks_of_all_filters_are_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    experiment = experiment_of(tmp_path, "A: {kind: ukf}, B: {kind: ukf}", 10_000_000)
    monkeypatch.setattr(memory, "memory", lambda: 1_100_000_000)
    check_memory(experiment)
    with pytest.raises(UserError, match="needs at least"):
        check_memory(experiment, save_tracks=True)


def test_fewer_workers_run_side_by_side_where_memory_is_short(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    experiment_of(tmp_path, "PF: {kind: pf, N: 100}, UKF: {kind: ukf}", 40)
    options = api.Options(workers=2, out=tmp_path / "wide", formats=())
    monkeypatch.setenv("TRACKBENCH_CACHE", str(tmp_path / "cache"))
    wide = api.run(tmp_path / "c.yaml", options, set=["block=4"]).folder
    assert "side by side" not in capsys.readouterr().err
    monkeypatch.setattr(memory, "memory", lambda: 10_000_000)  # less than any process takes
    monkeypatch.setattr(Queue, "_limit", limits := Limits(Queue._limit))
    narrow = api.run(tmp_path / "c.yaml", options, set=["block=4"], out=tmp_path / "n", fresh=True)
    note = r"note: (PF|UKF) took 0\.[0-9] GB of memory in blocks of 4 runs, so 1 of 2 workers ran"
    assert re.search(note, capsys.readouterr().err)
    assert (limits.found[0], min(limits.found)) == (32, 1)
    assert (wide / "per_run.csv").read_bytes() == (narrow.folder / "per_run.csv").read_bytes()


class Limits:
    """Numbers of tasks that the queue let run at once."""

    def __init__(self, limit: Callable[[Queue], int]) -> None:
        self.found: list[int] = []
        self._limit = limit

    def __get__(self, queue: Queue, kind: type) -> Callable[[], int]:
        def limit() -> int:
            self.found.append(self._limit(queue))
            return self.found[-1]

        return limit


def test_a_filter_whose_worker_is_killed_is_named_with_the_key_to_lower(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "killed.py").write_text(KILLED)
    (tmp_path / "c.yaml").write_text(
        f"name: c\nruns: 4\nblock: 2\nplugins: [killed.py]\nscenario: {merwe_text(T=4)}\n"
        "filters: {UKF: {kind: ukf}, Big: {kind: killed, N: 9}}\n"
    )
    monkeypatch.setenv("TRACKBENCH_CACHE", str(tmp_path / "cache"))
    options = api.Options(workers=2, out=tmp_path / "out", formats=(), allow_plugins=True)
    (failed,) = api.run(tmp_path / "c.yaml", options).failed
    assert failed.startswith(
        "Big failed: its worker died 4 times (killed, or out of memory?) over a block of 2 runs; "
        "a lower `block` or `N` takes less memory (runs "
    )
    again = re.search(r"a worker died; (\d+) blocks? w\w+ started again", capsys.readouterr().err)
    assert again is not None
    assert 1 <= int(again[1]) <= 4  # as many as there are, though one worker died four times


@pytest.mark.parametrize(
    ("way_to_end", "expected"),
    [
        (
            "os.kill(os.getpid(), 11)",
            "Big failed: its worker was ended 4 times by SIGSEGV over a block of 2 runs: a segmentation "
            "fault: an index beyond an array, or too deep a recursion. This is a fault of the compiled "
            "code that the filter calls (runs ",
        ),
        (
            "__import__('ctypes').CDLL(None)._exit(3)",
            "Big failed: its worker ended 4 times with exit code 3 over a block of 2 runs: the filter's "
            "code ends the process, in place of raising an exception (runs ",
        ),
    ],
)
def test_a_filter_that_ends_its_worker_is_told_how(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, way_to_end: str, expected: str
) -> None:
    """A fault of compiled code is not one of memory."""
    (tmp_path / "killed.py").write_text(KILLED.replace("os.kill(os.getpid(), 9)", way_to_end))
    (tmp_path / "c.yaml").write_text(
        f"name: c\nruns: 4\nblock: 2\nplugins: [killed.py]\nscenario: {merwe_text(T=4)}\n"
        "filters: {UKF: {kind: ukf}, Big: {kind: killed, N: 9}}\n"
    )
    monkeypatch.setenv("TRACKBENCH_CACHE", str(tmp_path / "cache"))
    options = api.Options(workers=2, out=tmp_path / "out", formats=(), allow_plugins=True)
    (failed,) = api.run(tmp_path / "c.yaml", options).failed
    assert failed.startswith(expected)


KILLED = """
import os
from dataclasses import dataclass

from trackbench.filters.bootstrap_pf import PF
from trackbench.registry import register


@register("filters", "killed")
@dataclass(frozen=True, kw_only=True)
class Killed(PF):
    \"\"\"A filter that takes too much memory.\"\"\"

    def step(self, model, state, z, k, rng):
        os.kill(os.getpid(), 9)
"""


def test_what_is_about_to_be_done_is_announced(tmp_path: Path) -> None:
    (tmp_path / "b.yaml").write_text(
        f"name: b\nruns: 7\nblock: 4\n{PLANE}filters: {{A: {{kind: kf}}, B: {{kind: pf, N: 9}}}}\n"
    )
    experiment = api.prepare(tmp_path / "b.yaml", api.Options())
    line = announced(experiment, make_plan(experiment), 2)
    assert line == "b: 2 filters x 7 runs x 8 steps, 4 blocks on 2 workers"


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


def test_a_file_is_read_in_little_more_than_its_numbers_take(tmp_path: Path) -> None:
    """A row of per_step.csv has seven columns."""
    path, rows = tmp_path / "per_step.csv", 30_000
    lines = (f"KF,{k},{k / 7},rmse_position,{k / 3},0.{k},20\n" for k in range(rows))
    path.write_text("filter,step,time,metric,value,stderr,runs\n" + "".join(lines))
    read = peak(read_columns, path)
    assert 7 * 8 * rows < read < 2 * 8 * 8 * rows + 6_000_000


@pytest.mark.parametrize(
    ("groups", "files", "limits"),
    [
        ("0::/\n", {"memory.max": "512\n"}, [512]),
        ("0::/\n", {"memory.max": "max\n"}, []),
        ("0::/a/b\n", {"a/b/memory.max": "max\n", "a/memory.max": "64\n"}, [64]),
        ("0::/docker/1a\n", {"memory.max": "32\n"}, [32]),  # seen from within the container
        (
            "3:cpu:/\n4:hugetlb,memory:/docker/1a\n0::/\n",
            {"memory/memory.limit_in_bytes": "128\n", "cpu/memory.max": "1\n"},
            [128],
        ),
        (None, {"memory.max": "512\n"}, []),
    ],
)
def test_the_limit_of_a_container_counts(
    groups: str | None, files: dict[str, str], limits: list[int], tmp_path: Path
) -> None:
    if groups is not None:
        (tmp_path / "cgroup").write_text(groups)
    for name, text in files.items():
        (tmp_path / "fs" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "fs" / name).write_text(text)
    assert [*memory.container_limits(tmp_path / "cgroup", tmp_path / "fs")] == limits


@pytest.mark.parametrize(("peak_of_one", "fitting"), [(2, 4), (3, 3), (4, 2), (7, 1), (12, 1)])
def test_as_many_workers_run_as_the_memory_has_room_for(
    peak_of_one: int, fitting: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(memory, "memory", lambda: 10)
    ((task, *_),) = make_plan(experiment_of(tmp_path, "KF: {kind: ukf}")).tasks.values()
    mine = Queue(4, BlockStore(tmp_path))
    assert mine.fitting == 4
    mine.hungriest = task, peak_of_one
    assert mine.fitting == fitting
