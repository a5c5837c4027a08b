"""Engines that compute blocks; each is a ``concurrent.futures.Executor``."""

import ast
import multiprocessing
import os
import re
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from queue import SimpleQueue
from typing import Any, Literal, TypeVar, cast

from trackbench.errors import Mark, Problem, RunError, UserError
from trackbench.plugins.interrupts import blocked, postponed

_leave = os._exit  # as it was before any plugin ran
_SAFE = "PYTHONSAFEPATH"
_BLAS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
_PRELOADED = "trackbench.execution.forkserver_preload"  # imports what every worker needs
_ADDRESS_SPACE = 450_000_000  # bytes; with numpy, scipy and pandas loaded a process has 580 MB
T = TypeVar("T")


def start_forkserver(*modules: str) -> None:
    """Start the process that workers are forked from and let it import these modules.

    The first call decides on the modules. Systems without a fork server (Windows) skip this.
    """
    # Each worker has one thread of BLAS, as blocks run side by side.
    for name in _BLAS:
        os.environ.setdefault(name, "1")
    if _can_fork() and not is_worker_bootstrapping():
        from multiprocessing import resource_tracker
        from multiprocessing.forkserver import ensure_running

        with _safe_path():  # imports nothing from the working folder
            # Starting the tracker unblocks SIGINT, so that it starts before SIGINT is blocked.
            resource_tracker.ensure_running()
            _context().set_forkserver_preload([_PRELOADED, *modules])
            with blocked(signal.SIGINT):
                ensure_running()


@contextmanager
def _safe_path() -> Iterator[None]:
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
    first = ({**os.environ}, begun, *arguments)
    processes = _Pool(workers, _context(), _start_worker, first)
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
        if any(process.exitcode == _NO_GUARD for process in children):
            raise UserError(_GUARD) from None
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
            with postponed(), _safe_path():
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


def is_worker_bootstrapping() -> bool:
    """Test whether this process is a worker that still imports its parent's script.

    multiprocessing sets the attribute for that time.
    """
    return bool(getattr(multiprocessing.current_process(), "_inheriting", False))


def check_script_import() -> None:
    """Raise UserError if worker processes cannot import the script that runs.

    Python lets each worker import the script's file first. Without a file, or without a main guard, no
    worker would start. In such a worker this function ends the process.
    """
    if is_worker_bootstrapping():
        print(f"a worker imports the script that starts it; {_GUARD}", file=sys.stderr, flush=True)
        _leave(_NO_GUARD)
    if multiprocessing.current_process().daemon:
        raise UserError(
            "this process is a worker of multiprocessing.Pool, which may start no processes of its own: "
            "run with workers=1"
        )
    main = sys.modules["__main__"]
    file = getattr(main, "__file__", None)
    if file is None or getattr(main, "__spec__", None) is not None:
        return  # workers of an interpreter, a notebook or `python -m` import no script
    if not os.path.isfile(file):
        raise UserError(
            f"{file}: several worker processes import the script from its file, and it has none; "
            "save it as a file, or run it with workers=1"
        )
    line = _line_of_script(file)  # 0 if no line outside of functions is running
    if line and not _is_guarded(file, line):
        raise UserError(Problem(Mark(file, line, 1), "", _GUARD))  # column 1; no path in a config


_GUARD = (
    "several worker processes import this script, and would run it again: put the call under "
    '`if __name__ == "__main__":`, or run it with workers=1'
)
_NO_GUARD = 77
"""Exit code of a worker that was about to run its parent's script again."""


def _line_of_script(file: str) -> int:
    """Return the number of the script's line, outside of functions, that is running; 0 if none is.

    ``file`` is the path of the script, as its code has it.
    """
    frame = sys._getframe(1)
    line = 0
    while frame is not None:
        if frame.f_code.co_name == "<module>" and frame.f_code.co_filename == file:
            line = frame.f_lineno
        frame = frame.f_back  # type: ignore[assignment]
    return line


def _is_guarded(file: str, line: int) -> bool:
    """Test whether a script's line is protected from running again in a worker that imports the script.

    An ``if`` at the top level, with ``__name__`` or ``current_process`` in its condition, must stand
    around the line or before it. A script that cannot be read counts as guarded.
    """
    try:
        statements = ast.parse(Path(file).read_bytes()).body
    except (OSError, SyntaxError, ValueError):
        return True
    for statement in statements:
        if statement.lineno > line:
            break
        if isinstance(statement, ast.If):
            # Names in the condition: of variables (`id`) and of attributes (`attr`).
            names = {
                getattr(node, "id", getattr(node, "attr", "")) for node in ast.walk(statement.test)
            }
            if names & {"__name__", "current_process"}:
                return True
    return False


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
    _leave(1)  # ends the process from a thread, which an exception cannot


Engine = Literal["serial", "processes", "dask"]
OpenEngine = Callable[[], AbstractContextManager[Executor]]
"""Opens the engine, again after it broke."""

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


def check_memory_limit() -> None:
    """Raise RunError if the shell allows a process less memory than the libraries need.

    With less memory, loading the libraries may never end instead of failing.
    """
    if sys.platform == "win32":
        return
    import resource

    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit != resource.RLIM_INFINITY and limit < _ADDRESS_SPACE:
        raise RunError(
            f"a process may have {limit / 1e6:.0f} MB of memory here, and a run needs "
            f"{_ADDRESS_SPACE / 1e6:.0f} MB; raise the limit: ulimit -v unlimited"
        )


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
    if the shell allows a process too little memory, and UserError if processes are wanted that cannot
    import the script that runs.
    """
    check_memory_limit()
    if name == "dask":
        return lambda: _dask(workers, scheduler)
    if name == "serial" or workers == 1:
        return SerialExecutor
    check_script_import()
    return lambda: pool(workers)


@contextmanager
def _dask(workers: int, scheduler: str | None) -> Iterator[Executor]:
    """Connect to a Dask scheduler's address, or start a local cluster of ``workers`` processes."""
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
        with _safe_path():
            client = connect(**settings, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise UserError(f"--scheduler {scheduler}: no scheduler answers there ({reason})") from None
    with client:
        # pure=False: each block is requested once, so that the cluster need not store its result.
        threads: dict[str, int] = client.nthreads()
        executor = client.get_executor(pure=False)
        yield ClusterExecutor(executor, workers=sum(threads.values()))
