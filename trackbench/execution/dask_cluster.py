"""Engine `dask`: a cluster's workers, by the address of its scheduler or on this machine."""

import re
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from typing import Any

from trackbench.errors import UserError
from trackbench.execution.process_pool import T, safe_path

_PATIENCE = "5s"
"""How long a scheduler may take to answer."""
_ADDRESS = re.compile(r"((tcp|tls|wss?)://)?(\[[^\s\]]+\]|[^\s:/]+):[0-9]{1,5}")


class ClusterExecutor(Executor):
    """Executor on a cluster's workers, and how many they are."""

    def __init__(self, executor: Executor, workers: int = 1) -> None:
        self._executor = executor
        self.workers = workers

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """Submit a call to a worker of the cluster."""
        return self._executor.submit(fn, *args, **kwargs)


@contextmanager
def dask_cluster(workers: int, scheduler: str | None) -> Iterator[Executor]:
    """Connect to a Dask scheduler's address, or start a local cluster of ``workers`` processes.

    The cluster is local if ``scheduler`` is None. Raises UserError if Dask is missing, for a text that
    is no address, if no scheduler answers within `_PATIENCE`, and if a local cluster does not start.
    """
    try:
        from distributed import Client
    except ImportError:
        raise UserError(
            "--engine dask needs an extra package: in a clone pip install '.[dask]'"
        ) from None
    if scheduler is not None and not _ADDRESS.fullmatch(scheduler):
        raise UserError(f"--scheduler {scheduler}: write tcp://host:port")
    settings: dict[str, Any] = {"address": scheduler}
    if scheduler is None:  # the cluster has no dashboard, and no other machine reaches it
        settings = {
            "n_workers": workers,
            "threads_per_worker": 1,
            "dashboard_address": None,
            "host": "127.0.0.1",
        }
    connect: Any = Client  # has no types
    try:
        with safe_path():  # processes of a local cluster import nothing from the working folder
            client = connect(**settings, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError, RuntimeError) as error:
        lines = str(error).splitlines() or [type(error).__name__]
        if scheduler is None:
            message = f"--engine dask: the cluster on this machine does not start ({lines[0]})"
        else:
            message = f"--scheduler {scheduler}: no scheduler answers there ({lines[0]})"
        raise UserError(message) from None
    with client:
        # pure=False: each block is requested once, so that the cluster need not store its result.
        threads: dict[str, int] = client.nthreads()
        executor = client.get_executor(pure=False)
        yield ClusterExecutor(executor, workers=sum(threads.values()))
