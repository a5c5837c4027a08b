"""Engines that compute blocks; each is a ``concurrent.futures.Executor``."""

import os
import sys
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import AbstractContextManager
from typing import Any, Literal

from trackbench.errors import RunError, WriteError
from trackbench.execution.dask_cluster import dask_cluster
from trackbench.execution.memory import check_memory_limit
from trackbench.execution.process_pool import T, pool, start_forkserver
from trackbench.execution.script_guard import check_script_import

Engine = Literal["serial", "processes", "dask"]
OpenEngine = Callable[[], AbstractContextManager[Executor]]
"""Opens the engine, again after it broke."""


class SerialExecutor(Executor):
    """Executor that computes at once, in this process."""

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """Run the function now, in this process, and return a future that is done."""
        future: Future[T] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


def cpu_count() -> int:
    """Count the processors that this process may use."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def begin(name: str, workers: int | None, *modules: str) -> None:
    """Start the fork server of the engine ``name`` early and let it import these modules.

    ``workers`` is the number of worker processes; None stands for one per processor. Raises the errors
    of `engine`.
    """
    # Any engine loads the libraries, which may never end with too little memory.
    check_memory_limit()
    if name == "processes" and (workers or cpu_count()) > 1:
        # Only worker processes import the user's script; a single worker is this process itself.
        check_script_import()
        start_forkserver(*modules)


def engine(name: Engine, workers: int, scheduler: str | None = None) -> OpenEngine:
    """Return a function that opens the engine ``name`` with ``workers`` worker processes.

    ``scheduler`` is the address of a Dask scheduler; None starts a cluster on this machine. The function
    raises UserError if Dask is missing or no scheduler answers. Before that, this call raises RunError
    if the shell allows a process too little memory. For worker processes on this machine it raises
    UserError if they could not import the script that runs.
    """
    check_memory_limit()
    if name == "dask":
        if scheduler is None:
            # Even a single worker of a local cluster is another process.
            check_script_import(without_workers="engine='serial'")
        return lambda: dask_cluster(workers, scheduler)
    if name == "serial" or workers == 1:
        return SerialExecutor
    check_script_import()
    return lambda: pool(workers)


def results_or_error(future: Future[T]) -> T | Exception:
    """Return the results of a batch, or the batch's own error; raises an error if the engine failed."""
    try:
        return future.result()
    except (BrokenExecutor, WriteError):
        raise
    except CancelledError:
        raise RunError("the engine was closed before it was done") from None
    except Exception as error:
        return error
