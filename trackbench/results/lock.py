"""The lock that lets one run at a time write into a results folder."""

import errno
import os
import stat
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from trackbench.errors import WriteError
from trackbench.os_specific import lock


@contextmanager
def locked(folder: Path, say: Callable[[str], None]) -> Iterator[None]:
    """Lock ``folder`` against other processes; if it is locked, call ``say`` with a line and wait.

    The system frees the lock of a process that dies.
    """
    path = folder / ".lock"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        descriptor = _acquire(path, say)
    except OSError as error:
        raise WriteError.of(path, error) from error
    try:
        yield
    finally:
        with suppress(PermissionError):  # of Windows, where an open file cannot be removed
            path.unlink(missing_ok=True)
        os.close(descriptor)


_FLAGS = os.O_RDWR | os.O_CREAT
if sys.platform != "win32":
    _FLAGS |= os.O_NOFOLLOW | os.O_NONBLOCK
_DIGITS = 20  # more than a process id has


def _acquire(path: Path, say: Callable[[str], None]) -> int:
    waiting = False
    while True:
        descriptor = os.open(path, _FLAGS, 0o644)
        try:
            holder = _holder(descriptor)
            lock(descriptor, wait=False)
        except BlockingIOError:
            if not waiting:
                say(f"{path.parent}/ is in use by process {holder}; waiting for it to finish")
            waiting = True
            lock(descriptor, wait=True)
        except OSError:
            os.close(descriptor)
            raise
        if _is_current(descriptor, path):
            os.ftruncate(descriptor, 0)
            os.lseek(descriptor, 0, os.SEEK_SET)
            os.write(descriptor, str(os.getpid()).encode())
            return descriptor
        os.close(descriptor)  # the process before removed the file: it is no longer the lock


def _holder(descriptor: int) -> str:
    """Return the process id in a lock file; raises OSError if no run wrote the file.

    A results folder may come from anywhere. A file with other content or with a second name (a hard
    link) is left alone.
    """
    status = os.fstat(descriptor)
    text = os.read(descriptor, _DIGITS + 1) if stat.S_ISREG(status.st_mode) else b"not a file"
    if status.st_nlink > 1 or len(text) > _DIGITS or not (text.isdigit() or not text):
        raise OSError(errno.EEXIST, "is not a lock of trackbench; remove it by hand")
    return text.decode() or "?"


def _is_current(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), path.lstat())
    except FileNotFoundError:
        return False
