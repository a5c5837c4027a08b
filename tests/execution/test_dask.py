"""The dask engine on a cluster of this machine's loopback."""

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from tests.execution.test_resume import same_results, small, write
from trackbench import api
from trackbench.errors import UserError
from trackbench.execution import dask_cluster
from trackbench.execution.engines import engine

distributed = pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    with distributed.LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        host="127.0.0.1",
        dashboard_address=":0",
        silence_logs=50,
    ) as cluster:
        yield cluster


def run(folder: Path, config: Path, **options: Any) -> Path:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TRACKBENCH_CACHE", str(folder / "cache"))
        return api.run(config, out=folder / "out", quiet=True, formats=(), **options).folder


def test_the_same_bytes_as_serial(cluster: Any, tmp_path: Path) -> None:
    config = small(tmp_path)
    serial = run(tmp_path / "serial", config, engine="serial")
    address = cluster.scheduler_address
    dask = run(tmp_path / "dask", config, engine="dask", scheduler=address, workers=2)
    same_results(dask, serial)


def test_a_killed_dask_worker_costs_nothing_but_time(cluster: Any, tmp_path: Path) -> None:
    config = write(tmp_path)
    serial = run(tmp_path / "serial", config, engine="processes", workers=2)
    killed = []

    def kill_one() -> None:
        while not list((tmp_path / "dask" / "cache").rglob("*.block")):
            time.sleep(0.01)
        worker = next(iter(cluster.workers.values()))
        killed.append(worker.pid)
        os.kill(worker.pid, signal.SIGKILL)

    killer = threading.Thread(target=kill_one)
    killer.start()
    address = cluster.scheduler_address
    dask = run(tmp_path / "dask", config, engine="dask", scheduler=address, workers=2)
    killer.join()
    assert killed
    same_results(dask, serial)


def test_no_scheduler_answers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dask_cluster, "_PATIENCE", "1s")
    with pytest.raises(UserError, match=":9: no scheduler answers"):
        run(tmp_path, small(tmp_path), engine="dask", scheduler="tcp://127.0.0.1:9")


def test_without_the_extra_one_sentence_says_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(UserError, match=r"pip install '\.\[dask\]'"):
        run(tmp_path, small(tmp_path), engine="dask")


@pytest.mark.parametrize("workers", [1, 2])
def test_workers_of_a_local_cluster_import_the_script(
    workers: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A script that they cannot import is a line; it is not imported on a cluster elsewhere."""
    script = ModuleType("__main__")
    script.__file__ = "<stdin>"
    monkeypatch.setitem(sys.modules, "__main__", script)
    with pytest.raises(UserError, match=r"<stdin>: several worker processes .* engine='serial'"):
        engine("dask", workers)
    engine("dask", workers, scheduler="tcp://127.0.0.1:9")


@pytest.mark.parametrize(
    ("error", "reason"),
    [(RuntimeError("Nanny failed to start."), "Nanny failed"), (TimeoutError(), "TimeoutError")],
)
def test_a_local_cluster_that_does_not_start_is_no_scheduler(
    error: Exception, reason: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(**settings: Any) -> None:
        raise error

    monkeypatch.setattr(distributed, "Client", fail)
    message = rf"--engine dask: the cluster on this machine does not start \({reason}"
    with pytest.raises(UserError, match=message), dask_cluster.dask_cluster(2, None):
        pass
