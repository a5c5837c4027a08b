"""Memory of this machine, its container or its shell (`ulimit -v`), and how many workers fit into it."""

import os
import sys
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path

from trackbench.errors import RunError, counted

_ADDRESS_SPACE = 450_000_000  # bytes; with numpy, scipy and pandas loaded a process has 580 MB

if sys.platform == "win32":
    import ctypes

    def memory() -> int:
        """Return bytes of memory that the machine has."""
        kilobytes = ctypes.c_ulonglong(0)
        ctypes.windll.kernel32.GetPhysicallyInstalledSystemMemory(ctypes.byref(kilobytes))
        return kilobytes.value * 1024 or sys.maxsize

else:

    @cache
    def memory() -> int:
        """Return the bytes of memory that the machine has, or the container if it may use less."""
        of_machine = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
        limits = container_limits(Path("/proc/self/cgroup"), Path("/sys/fs/cgroup"))
        return min([of_machine, *limits])


def container_limits(groups: Path, root: Path) -> Iterator[int]:
    """Yield the limits of memory, in bytes, of this process's control groups and of those around them.

    ``groups`` lists them as ``0::/docker/1a`` (version 2) or ``4:memory:/docker/1a`` (version 1), and
    ``root`` has their files. A container often has the file of its own group at the root.
    """
    try:
        lines = groups.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        return
    for line in lines:
        _, _, rest = line.partition(":")
        controllers, _, path = rest.partition(":")
        if controllers == "":  # version 2
            home = root
            name = "memory.max"
        elif "memory" in controllers.split(","):  # version 1
            home = root / "memory"
            name = "memory.limit_in_bytes"
        else:
            continue
        group = home / path.lstrip("/")
        for folder in (group, *group.parents):
            if not folder.is_relative_to(home):
                break
            with suppress(OSError, ValueError):  # no file, or `max`: no limit
                yield int((folder / name).read_text())


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


def workers_that_fit(workers: int, peak: int) -> int:
    """Return how many workers fit into this machine's memory, at most ``workers`` and at least one.

    ``peak`` is the largest memory of a worker, bytes.
    """
    if peak * workers <= memory():
        return workers
    return max(1, memory() // peak)


def note_on_memory(names: str, peak: int, runs: int, fitting: int, workers: int) -> str:
    """Write that the memory allows ``fitting`` of the ``workers`` only.

    ``names`` are those of the filters whose blocks of so many ``runs`` took ``peak`` bytes.
    """
    return (
        f"{names} took {peak / 1e9:.1f} GB of memory in blocks "
        f"of {counted(runs, 'run')}, so {fitting} of {workers} workers ran side by side"
    )
