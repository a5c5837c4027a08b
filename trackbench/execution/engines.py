"""Engines that compute blocks; each is a ``concurrent.futures.Executor``."""

import os
import re
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import AbstractContextManager, contextmanager
from typing import Any, Literal, TypeVar

from trackbench.errors import UserError
from trackbench.execution import process_pool

Engine = Literal["serial", "processes", "dask"]
OpenEngine = Callable[[], AbstractContextManager[Executor]]
"""Opens the engine, again after it broke."""
T = TypeVar("T")

_PATIENCE = "5s"
"""How long a scheduler may take to answer."""
_ADDRESS = re.compile(r"((tcp|tls|wss?)://)?(\[[^\s\]]+\]|[^\s:/]+):[0-9]{1,5}")


class SerialExecutor(Executor):
    """Executor that computes at once, in this process."""

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """Run the function now."""
        future: Future[T] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


def cpu_count() -> int:
    """Return the number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def begin(name: str, workers: int | None, *modules: str) -> None:
    """Start the engine's helper process early and let it import these modules."""
    if name == "processes" and (workers or cpu_count()) > 1:
        process_pool.start_forkserver(*modules)


def engine(name: Engine, workers: int, scheduler: str | None = None) -> OpenEngine:
    """Return a function that opens the engine; raises UserError if it is missing or unreachable."""
    if name == "dask":
        return lambda: _dask(workers, scheduler)
    if name == "serial" or workers == 1:
        return SerialExecutor
    if process_pool.is_worker_bootstrapping():
        raise RuntimeError(
            "a script that runs an experiment on several processes is imported by each of them: "
            'put the call under `if __name__ == "__main__":`, or use engine="serial"'
        )
    return lambda: process_pool.pool(workers)


@contextmanager
def _dask(workers: int, scheduler: str | None) -> Iterator[Executor]:
    """Connect to the Dask scheduler at an address, or start a local cluster of ``workers``
    processes.
    """
    try:
        from distributed import Client
    except ImportError:
        raise UserError(
            "--engine dask needs an extra package: pip install 'trackbench[dask]'"
        ) from None
    if scheduler is not None and not _ADDRESS.fullmatch(scheduler):
        raise UserError(f"--scheduler {scheduler}: write tcp://host:port")
    settings: dict[str, Any] = {"address": scheduler}
    if scheduler is None:
        settings = {
            "n_workers": workers,
            "threads_per_worker": 1,
            "dashboard_address": None,
            "host": "127.0.0.1",
        }
    connect: Any = Client  # has no types
    try:
        client = connect(**settings, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise UserError(f"--scheduler {scheduler}: no scheduler answers there ({reason})") from None
    with client:
        # pure=False: a block is asked for once, and its result is not to stay in the cluster.
        yield client.get_executor(pure=False)
