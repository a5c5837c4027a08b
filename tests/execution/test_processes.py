"""Worker processes import nothing from the working folder; where none can start, a run ends."""

import os
import subprocess
import sys
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.conftest import PLANE
from trackbench.config.load import load
from trackbench.errors import RunError
from trackbench.execution import process_pool
from trackbench.execution.block_scheduler import Queue
from trackbench.execution.cache import BlockStore
from trackbench.execution.plan import make_plan

CONFIG = f"""name: c
runs: 4
block: 2
{PLANE}
filters:
  KF: {{kind: kf}}
figures:
  f: {{kind: rmse-vs-time, metric: rmse_position}}
  g: {{kind: rmse-vs-time, metric: rmse_velocity}}
"""
PROGRAM = "import sys; from trackbench.__main__ import main; sys.exit(main())"
NAMES = ("numpy", "random", "trackbench", "threading", "signal", "scipy", "matplotlib", "pandas")


def _command(folder: Path, *words: str, **environment: str) -> "subprocess.CompletedProcess[str]":
    """The program as its script starts it: without the working folder on its path."""
    return subprocess.run(
        [sys.executable, "-P", "-c", PROGRAM, *words],
        cwd=folder,
        env={**os.environ, "TRACKBENCH_CACHE": str(folder / "cache"), **environment},
        capture_output=True,
        text=True,
        timeout=120,
    )


def test_no_process_runs_a_file_of_the_working_folder(tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text(CONFIG)
    for name in NAMES:
        (tmp_path / f"{name}.py").write_text(
            f"open({str(tmp_path / 'ran')!r}, 'a').write('{name} ')"
        )
    for words in (["run", "c.yaml", "--workers", "2"], ["verify", "results/c"]):
        done = _command(tmp_path, *words)
        assert not (tmp_path / "ran").exists(), (tmp_path / "ran").read_text()
        assert done.returncode == 0, done.stderr


def test_workers_have_the_path_and_the_variables_of_their_parent(tmp_path: Path) -> None:
    """Those of now: the process that they are forked from may be older."""
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "helper.py").write_text(
        "import os\ndef read():\n    return dict(os.environ)\n"
    )
    script = (
        "import os\nfrom trackbench.execution.engines import pool\n"
        "import helper\n"
        "for value in '12':\n"
        "    os.environ['GAIN'] = value\n"
        "    with pool(1) as processes:\n"
        "        seen = processes.submit(helper.read).result()\n"
        "        assert seen['GAIN'] == value and 'PYTHONSAFEPATH' not in seen, seen\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script],
        env={k: v for k, v in os.environ.items() if k != "PYTHONSAFEPATH"}
        | {"PYTHONPATH": str(tmp_path / "lib")},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.skipif(sys.platform == "win32", reason="no limit of memory for a process")
@pytest.mark.parametrize("workers", ["1", "2"])
def test_too_little_memory_for_a_process_is_one_line(workers: str, tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text(CONFIG)
    limited = (
        f"import resource; resource.setrlimit(resource.RLIMIT_AS, 2 * (204_800_000,)); {PROGRAM}"
    )
    done = subprocess.run(
        [sys.executable, "-P", "-c", limited, "run", "c.yaml", "--workers", workers],
        cwd=tmp_path,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 1
    assert done.stderr.splitlines()[0] == (
        "error: a process may have 205 MB of memory here, and a run needs 450 MB; raise the limit: "
        "ulimit -v unlimited"
    )


def test_a_pool_that_never_starts_is_given_up(tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text(CONFIG)
    opened = []

    @contextmanager
    def broken():  # type: ignore[no-untyped-def]
        opened.append(1)
        raise BrokenProcessPool("a worker died as it was started")
        yield

    store = BlockStore(tmp_path / "cache")
    store.prepare()
    queue = Queue(2, store)
    queue.add(make_plan(load(tmp_path / "c.yaml")).unique, ())
    with pytest.raises(RunError, match=r"no worker process could be started \(a worker died"):
        list(queue.run(broken))
    assert len(opened) == 4


def test_the_path_of_new_processes_is_restored(monkeypatch: pytest.MonkeyPatch) -> None:
    for before in ("", None):
        if before is None:
            monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
        else:
            monkeypatch.setenv("PYTHONSAFEPATH", before)
        with process_pool.safe_path():
            assert os.environ["PYTHONSAFEPATH"] == "1"
        assert os.environ.get("PYTHONSAFEPATH") == before
