"""Lock of a results folder, which one run at a time holds."""

import errno
import os
import stat
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from trackbench.errors import WriteError


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
        raise WriteError.from_os_error(path, error) from error
    try:
        yield
    finally:
        # Remove the file while it is locked. A process that waits for it then makes a new one.
        with suppress(PermissionError):  # of Windows, where an open file cannot be removed
            path.unlink(missing_ok=True)
        os.close(descriptor)


_FLAGS = os.O_RDWR | os.O_CREAT
if sys.platform != "win32":
    _FLAGS |= os.O_NOFOLLOW | os.O_NONBLOCK
_DIGITS = 20  # more than a process id has


def _acquire(path: Path, say: Callable[[str], None]) -> int:
    """Open and lock the file ``path``; return its descriptor.

    If another process has locked it, call ``say`` with a line and wait.
    """
    waiting = False
    while True:
        descriptor = os.open(path, _FLAGS, 0o644)
        try:
            holder = _holder(descriptor)
            _lock(descriptor, wait=False)
        except BlockingIOError:
            if not waiting:
                say(f"{path.parent}/ is in use by process {holder}; waiting for it to finish")
            waiting = True
            _lock(descriptor, wait=True)
        except OSError:
            os.close(descriptor)
            raise
        # The file is the lock, unless the process before has removed it. Write the process id to it.
        if _is_current(descriptor, path):
            os.ftruncate(descriptor, 0)
            os.lseek(descriptor, 0, os.SEEK_SET)
            os.write(descriptor, str(os.getpid()).encode())
            return descriptor
        os.close(descriptor)


def _holder(descriptor: int) -> str:
    """Return the process id in a lock file; raises OSError if no run wrote the file.

    The text is ``?`` if the file is empty, as it is until its process has the lock. A results folder may
    come from anywhere. A file with other content or with a second name (a hard link) is left alone.
    """
    status = os.fstat(descriptor)
    text = b"not a file"
    if stat.S_ISREG(status.st_mode):
        text = os.read(descriptor, _DIGITS + 1)
    if status.st_nlink > 1 or len(text) > _DIGITS or not (text.isdigit() or not text):
        raise OSError(errno.EEXIST, "is not a lock of trackbench; remove it by hand")
    return text.decode() or "?"


def _is_current(descriptor: int, path: Path) -> bool:
    """Test whether the open file still has this path: it has not once its holder has removed it."""
    try:
        return os.path.samestat(os.fstat(descriptor), path.lstat())
    except FileNotFoundError:
        return False


if sys.platform == "win32":
    import msvcrt

    _FAR = 1 << 30
    """A byte beyond the content: Windows does not let others read locked bytes."""

    def _lock(descriptor: int, wait: bool) -> None:
        """Lock an open file against other processes; raises BlockingIOError unless it may wait."""
        while True:
            os.lseek(descriptor, _FAR, os.SEEK_SET)
            try:
                # LK_LOCK gives up after ten seconds.
                mode = msvcrt.LK_LOCK if wait else msvcrt.LK_NBLCK
                msvcrt.locking(descriptor, mode, 1)
                return
            except OSError as error:
                if not wait:
                    raise BlockingIOError from error

else:
    import fcntl

    def _lock(descriptor: int, wait: bool) -> None:
        """Lock an open file against other processes; raises BlockingIOError unless it may wait."""
        operation = fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB
        fcntl.flock(descriptor, operation)
