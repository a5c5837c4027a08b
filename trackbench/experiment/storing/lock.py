"""One run at a time in a results folder."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from trackbench.experiment.machine import lock
from trackbench.experiment.problems import WriteError


@contextmanager
def locked(folder: Path, say: Callable[[str], None]) -> Iterator[None]:
    """Hold ``folder``; if another process holds it, say so and wait for it.

    The system frees the lock of a process that dies, so nothing has to be cleaned up by hand.
    """
    path = folder / ".lock"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        descriptor = _acquire(path, say)
    except OSError as error:
        raise WriteError(path, error) from error
    try:
        yield
    finally:
        with suppress(PermissionError):  # of Windows, where an open file cannot be removed
            path.unlink(missing_ok=True)
        os.close(descriptor)


def _acquire(path: Path, say: Callable[[str], None]) -> int:
    waiting = False
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            lock(descriptor, wait=False)
        except BlockingIOError:
            if not waiting:
                os.lseek(descriptor, 0, os.SEEK_SET)
                holder = os.read(descriptor, 20).decode() or "?"
                say(f"{path.parent}/ is in use by process {holder}; waiting for it to finish")
            waiting = True
            lock(descriptor, wait=True)
        if _is_current(descriptor, path):
            os.ftruncate(descriptor, 0)
            os.lseek(descriptor, 0, os.SEEK_SET)
            os.write(descriptor, str(os.getpid()).encode())
            return descriptor
        os.close(descriptor)  # its holder removed it when done: this is no longer the folder's lock


def _is_current(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except FileNotFoundError:
        return False
