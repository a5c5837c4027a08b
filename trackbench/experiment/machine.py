"""What differs between systems: the machine's name and memory, and how a file is locked."""

import os
import platform
import sys

if sys.platform == "win32":
    import ctypes
    import msvcrt

    _FAR = 1 << 30
    """A byte behind what is written: the system keeps others from reading what is locked."""

    def memory() -> int:
        """Bytes of memory that the machine has."""
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

    def memory() -> int:
        """Bytes of memory that the machine has."""
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")

    def lock(descriptor: int, wait: bool) -> None:
        """Lock an open file against other processes; raises BlockingIOError unless it may wait."""
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))


def identity() -> list[str]:
    """Return what tells this machine from others, as far as CPU times are concerned."""
    return [platform.node(), platform.platform(), platform.processor(), str(os.cpu_count())]
