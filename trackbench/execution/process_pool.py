"""Worker processes of this machine: begun before they are needed, and gone with who began them."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any, TypeVar

from trackbench.plugins.interrupts import postponed

_leave = os._exit  # as it was before any plugin ran
_BLAS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
_FORKED = "trackbench.execution.forkserver_preload"
T = TypeVar("T")


def start_forkserver(*modules: str) -> None:
    """Start the process that workers are forked from; it imports the modules they need meanwhile.

    The first call decides on the modules. Where a system has no such process (Windows) nothing happens.
    """
    for name in _BLAS:  # blocks are what runs side by side
        os.environ.setdefault(name, "1")
    if _can_fork() and not is_worker_bootstrapping():
        from multiprocessing import resource_tracker
        from multiprocessing.forkserver import ensure_running

        resource_tracker.ensure_running()  # now, since it ends by hearing interrupts again
        _context().set_forkserver_preload([_FORKED, *modules])
        with _block_sigint():
            ensure_running()


@contextmanager
def pool(
    workers: int, begun: Callable[..., None] | None = None, *arguments: Any
) -> Iterator[ProcessPoolExecutor]:
    """So many processes, which first call ``begun``; after an error none of them is waited for."""
    start_forkserver()
    first = (begun, *arguments)
    processes = _Pool(workers, _context(), _start, first)
    try:
        yield processes
    except BaseException:
        # Only the pool's own: the caller may have children, too. Public from Python 3.14 on.
        for process in list((processes._processes or {}).values()):
            process.terminate()  # what is being computed is not waited for
        raise
    finally:
        processes.shutdown(wait=True, cancel_futures=True)


class _Pool(ProcessPoolExecutor):
    """One whose processes are all known to it: Ctrl-C waits until one that is being started is."""

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """Submit a call; raises BrokenProcessPool also where a process is killed as it starts."""
        try:
            with postponed():
                return super().submit(fn, *args, **kwargs)
        except (EOFError, ConnectionError) as error:
            raise BrokenProcessPool("a worker died as it was started") from error


def is_worker_bootstrapping() -> bool:
    """Whether this is a worker that still imports the script it was asked for by."""
    return bool(getattr(multiprocessing.current_process(), "_inheriting", False))


@contextmanager
def _block_sigint() -> Iterator[None]:
    """What is started meanwhile leaves Ctrl-C to this process, which hears of it afterwards."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _can_fork() -> bool:
    return "forkserver" in multiprocessing.get_all_start_methods()


def _context() -> Any:
    return multiprocessing.get_context("forkserver" if _can_fork() else "spawn")


def _start(begun: Callable[..., None] | None = None, *arguments: Any) -> None:
    """Leave Ctrl-C to the parent, and end when the parent is gone, even by kill -9."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_follow, args=(parent,), daemon=True).start()
    if begun is not None:
        begun(*arguments)


def _follow(parent: "multiprocessing.process.BaseProcess") -> None:
    # The pool's pipes do not tell: every worker holds both of their ends.
    parent.join()
    _leave(1)
