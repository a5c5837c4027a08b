"""Pool of worker processes, which are forked from one process; an error ends them at once."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from queue import SimpleQueue
from typing import Any, TypeVar, cast

from trackbench.errors import UserError
from trackbench.execution.script_guard import (
    NO_GUARD_CODE,
    is_worker_bootstrapping,
    leave,
    no_guard_message,
)
from trackbench.plugins.stop_signals import blocked, postponed

_SAFE = "PYTHONSAFEPATH"
_BLAS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
_PRELOADED = "trackbench.execution.forkserver_preload"  # imports what every worker needs
T = TypeVar("T")
BATCHES_IN_ADVANCE = 16
"""Batches of blocks per worker that are handed over at once.

They last while the caller writes an experiment's report.
"""


def start_forkserver(*modules: str) -> None:
    """Start the process that workers are forked from and let it import these modules.

    The first call decides on the modules. Systems without a fork server (Windows) skip this.
    """
    # Each worker has one thread of BLAS, as blocks run side by side.
    for name in _BLAS:
        os.environ.setdefault(name, "1")
    # A worker that still imports its parent's script must start no processes.
    if _can_fork() and not is_worker_bootstrapping():
        from multiprocessing import resource_tracker
        from multiprocessing.forkserver import ensure_running

        with safe_path():  # imports nothing from the working folder
            # Starting the tracker unblocks SIGINT, so that it starts before SIGINT is blocked.
            resource_tracker.ensure_running()
            _context().set_forkserver_preload([_PRELOADED, *modules])
            with blocked(signal.SIGINT):
                ensure_running()


@contextmanager
def safe_path() -> Iterator[None]:
    """Let Python processes that start within this context import nothing from the working folder.

    A file there could have the name of a library. Python obeys the environment variable
    PYTHONSAFEPATH, which is then restored. Workers get the search path of this process when they begin.
    """
    before = os.environ.get(_SAFE)
    os.environ[_SAFE] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ[_SAFE]
        else:
            os.environ[_SAFE] = before


class WorkerDeathError(BrokenProcessPool):
    """A worker process has died.

    ``exit_code`` is minus the number of the signal that ended it; None if it is unknown.
    """

    def __init__(self, message: str, exit_codes: set[int]) -> None:
        super().__init__(message)
        self.exit_code = exit_codes.pop() if len(exit_codes) == 1 else None


@contextmanager
def pool(
    workers: int, begun: Callable[..., None] | None = None, *arguments: Any
) -> Iterator[ProcessPoolExecutor]:
    """Open a pool of ``workers`` processes; an error within the context terminates them at once.

    Each process first calls ``begun`` with the ``arguments``. Raises WorkerDeathError if a process died,
    and UserError if the processes would run the user's script again.
    """
    start_forkserver()
    # A fork server has the environment variables of its start: workers get those of now.
    first_arguments = ({**os.environ}, begun, *arguments)
    processes = _Pool(workers, _context(), _start_worker, first_arguments)
    try:
        yield processes
    except BaseException as error:
        # Only the pool's own: the caller may have children, too. Public from Python 3.14 on.
        children = list((processes._processes or {}).values())
        for process in children:
            process.terminate()  # without waiting for the block that it computes
        for process in children:
            process.join()
        # A process that was sending has left half a message, whose reader waits until the pipe closes.
        cast("Any", processes._result_queue)._writer.close()
        # By this exit code a process reports that it was about to run the user's script.
        if any(process.exitcode == NO_GUARD_CODE for process in children):
            raise UserError(no_guard_message()) from None
        if isinstance(error, BrokenProcessPool):
            # The other workers were ended by SIGTERM.
            codes = {process.exitcode for process in children} - {None, 0, -signal.SIGTERM}
            raise WorkerDeathError(str(error), cast("set[int]", codes)) from error
        raise
    finally:
        processes.shutdown(wait=True, cancel_futures=True)


class _Pool(ProcessPoolExecutor):
    """Process pool that knows all its processes: Ctrl-C waits for a starting one."""

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """Submit a call; raises BrokenProcessPool, also if a worker process is killed as it starts.

        The call may start processes. Ctrl-C waits for that, so that no process is forgotten.
        """
        try:
            with postponed(), safe_path():
                return super().submit(fn, *args, **kwargs)
        except (EOFError, ConnectionError) as error:
            raise BrokenProcessPool("a worker died as it was started") from error


def result_of(future: Future[T]) -> T:
    """Wait for a future's result. Unlike ``future.result``, a signal cannot leave the future locked.

    The wait is for a queue, into which the future puts itself when it is done.
    """
    done: SimpleQueue[Future[T]] = SimpleQueue()
    with postponed():  # no signal interrupts the call, which locks the future
        future.add_done_callback(done.put)
    return done.get().result()


def _can_fork() -> bool:
    return "forkserver" in multiprocessing.get_all_start_methods()


def _context() -> Any:
    """Return multiprocessing's context: a fork server where the system can fork, else spawn."""
    method = "forkserver" if _can_fork() else "spawn"
    return multiprocessing.get_context(method)


def _start_worker(
    environment: dict[str, str], begun: Callable[..., None] | None = None, *arguments: Any
) -> None:
    """Ignore Ctrl-C in a worker, and end it with its parent, even if that is killed.

    ``environment`` is that of the parent now, since a fork server has the one of its start. The worker
    then calls ``begun`` with the ``arguments``.
    """
    os.environ.clear()
    os.environ.update(environment)
    # Ctrl-C reaches the workers, too, but only the parent handles it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # The pool ends its workers by SIGTERM; a handler of the parent's would be inherited.
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_exit_after, args=(parent,), daemon=True).start()
    if begun is not None:
        begun(*arguments)


def _exit_after(parent: "multiprocessing.process.BaseProcess") -> None:
    """Wait for the parent process to end, then end this one."""
    # The pool's pipes do not show that the parent has ended: every worker has both of their ends.
    parent.join()
    leave(1)  # ends the process from a thread, which an exception cannot
