"""Memory of this machine, its container or its shell (`ulimit -v`), and what needs it.

How many workers fit into it, and whether an experiment does.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path

from trackbench.config.experiment import Experiment, Point
from trackbench.errors import Problem, RunError, UserError, counted
from trackbench.evaluation.block_task import BlockTask
from trackbench.execution.block_size import block_width_of
from trackbench.execution.plan import Plan, runs_with_tracks, stored_series
from trackbench.filters.base import AnyFilter

_PER_RUN = 10  # numbers of a run beside its series, at least
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


def note_on_memory(
    plan: Plan, hungriest: tuple[BlockTask, int] | None, fitting: int, workers: int
) -> str:
    """Write that the memory allows ``fitting`` of the ``workers`` only; empty if all fit.

    ``hungriest`` is the block whose worker had the largest memory, and this memory in bytes. It may be a
    block of another plan in the queue.
    """
    if hungriest is None or fitting >= workers:
        return ""
    task, peak = hungriest
    labels = [label for (_, label), tasks in plan.tasks.items() if task in tasks]
    names = " and ".join(labels) or "another experiment"
    return (
        f"{names} took {peak / 1e9:.1f} GB of memory in blocks "
        f"of {counted(task.width, 'run')}, so {fitting} of {workers} workers ran side by side"
    )


def check_memory(experiment: Experiment, save_tracks: bool = False) -> None:
    """Raise UserError if a block of a filter and the stored numbers exceed the machine's memory.

    This is a lower bound: the particles with their weights before and after a step, and the estimates
    of a block. The queue measures how much a block really takes. ``save_tracks`` stores the tracks of
    all runs, with covariances.
    """
    settings = experiment.settings
    series = len(stored_series(experiment))
    shown = runs_with_tracks(experiment, save_tracks)  # number of runs
    for point in experiment.points:
        n_x = len(point.scenario.components)
        steps = len(point.scenario.steps)
        # Numbers that are stored of all runs, and of the tracks that are shown: saved tracks are counted
        # by their covariances, others by their means.
        per_step = n_x * n_x if save_tracks else n_x
        of_runs = settings.runs * (_PER_RUN + series * steps)
        of_tracks = shown * per_step * steps * len(point.filters)
        for label, tracker in point.filters.items():
            # Numbers of one run while its block is filtered.
            particles = tracker.max_particle_count * _kept_states(tracker, point, label)
            of_run = 2 * (n_x + 1) * particles + n_x * steps
            width = block_width_of(settings, tracker, point.scenario)  # runs per block
            needed = 8 * (width * of_run + of_runs + of_tracks)  # bytes, 8 of each number
            if needed > memory():
                message = (
                    f"needs at least {needed / 1e9:.1f} GB of memory and this machine has "
                    f"{memory() / 1e9:.1f} GB: use fewer particles or runs, or a smaller block"
                )
                # Position in the config of the filter's key `N`, or else of the filter.
                mark = experiment.source.mark(("filters", label, "N"))
                raise UserError(Problem(mark, f"filters.{label}", message))


def _kept_states(tracker: AnyFilter, point: Point, label: str) -> int:
    """Return how many states of a run are in memory at once.

    A smoother has those of all steps. A filter that repeats steps for late measurements has the states
    that it may go back to.
    """
    steps = len(point.scenario.steps)
    if tracker.smooths:
        return steps
    late = point.assumed_scenario(label).late
    if late is None or late.kind != "refilter":
        return 1
    # Without a `memory` the filter may go back to the start.
    return min(steps, 1 + point.scenario.longest_delay, 1 + (late.memory or steps))
