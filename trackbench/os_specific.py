"""System-specific functions: the machine's name and memory, and file locks."""

import os
import platform
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

if sys.platform == "win32":
    import ctypes
    import msvcrt

    _FAR = 1 << 30
    """A byte beyond the content: Windows does not let others read locked bytes."""

    def memory() -> int:
        """Return bytes of memory that the machine has."""
        kilobytes = ctypes.c_ulonglong(0)
        ctypes.windll.kernel32.GetPhysicallyInstalledSystemMemory(ctypes.byref(kilobytes))
        return kilobytes.value * 1024 or sys.maxsize

    def lock(descriptor: int, wait: bool) -> None:
        """Lock an open file against other processes; raises BlockingIOError unless it may wait."""
        while True:
            os.lseek(descriptor, _FAR, os.SEEK_SET)
            try:
                # LK_LOCK gives up after ten seconds.
                msvcrt.locking(descriptor, msvcrt.LK_LOCK if wait else msvcrt.LK_NBLCK, 1)
                return
            except OSError as error:
                if not wait:
                    raise BlockingIOError from error

else:
    import fcntl

    def memory(root: Path = Path("/")) -> int:
        """Return the bytes of memory that the machine has, or its container's limit."""
        return min([os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"), *_limits(root)])

    def _limits(root: Path) -> Iterator[int]:
        """Yield the limits of this process's control groups, version 1 or 2, up to the topmost.

        A container may see its own group as the topmost, under a path that it cannot see.
        """
        groups = root / "proc/self/cgroup"
        for line in groups.read_text().splitlines() if groups.is_file() else ():
            _, controllers, path = line.split(":", 2)
            if controllers and "memory" not in controllers.split(","):
                continue
            name = "memory.limit_in_bytes" if controllers else "memory.max"
            group = root / "sys/fs/cgroup" / ("memory" if controllers else "") / path.lstrip("/")
            for folder in (group, *group.parents):
                with suppress(OSError, ValueError):  # no such group, or "max"
                    yield int((folder / name).read_text())

    def lock(descriptor: int, wait: bool) -> None:
        """Lock an open file against other processes; raises BlockingIOError unless it may wait."""
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))


def identity() -> list[str]:
    """Return the properties of this machine that CPU times depend on."""
    return [platform.node(), platform.platform(), platform.processor(), str(os.cpu_count())]
