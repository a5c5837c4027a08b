"""Plan of an experiment: blocks of runs, each an independent task."""

import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil
from pathlib import Path
from typing import TypeAlias

from trackbench.config.experiment import Experiment, Point, Settings
from trackbench.config.metric_names import max_metrics
from trackbench.config.requested_metrics import requested_contributions, requested_predictions
from trackbench.errors import Problem, UserError, counted
from trackbench.evaluation.block import MOST_STACKED, BlockTask
from trackbench.extension_points import foreign_parts
from trackbench.filters.base import AnyFilter, JoinableFilter
from trackbench.plugins.load import Plugin
from trackbench.scenarios.base import Scenario

_PARTICLES_AT_A_TIME = 32_768
_RUN_STEPS_AT_A_TIME = 200_000  # a long track's series, some thirty of them, stay below 100 MB
_BOOSTED_AT_A_TIME = 330_000  # in the few steps of a boost: below 200 MB
_STACKED = 400_000  # run-steps that are filtered together: their series are made block by block
_WIDEST = 500
_ONE_BY_ONE = 10  # few enough for two workers to share 50 runs, and to compute none in vain
_PROCESS = 150_000_000  # bytes of a worker process before it computes anything
_TEMPORARIES = 14  # arrays of a cloud's size alive at once in the hungriest filter that has no more
_PIECE = 50_000_000  # bytes of a piece of per_run.csv while it is read
_STEP_OBJECTS = 1000  # bytes of Python's own for what is kept of a step, however few its runs
_STEP_ROW = (
    2 * 8 * 8
)  # bytes of a row of per_step.csv: eight columns, twice while they are put together


Key: TypeAlias = tuple[int, str]
"""Number of a grid point and label of a filter."""


@dataclass(frozen=True)
class Plan:
    """Tasks by grid point and filter label, in block order; equal tasks are computed once."""

    tasks: dict[Key, list[BlockTask]]
    plugins: tuple[Plugin, ...] = ()
    """code that a worker has to load before it can read a task"""
    name: str = ""
    """of the experiment"""

    @cached_property
    def unique(self) -> list[BlockTask]:
        """Return the distinct tasks in the order of computation.

        Tasks of the same runs are neighbors and share the simulated data. Among these, tasks that score
        the same estimates in different ways are neighbors, so that the filter runs once for them.
        """
        ranks: dict[BlockTask, int] = {}
        places: dict[BlockTask, tuple[int, int]] = {}
        for tasks in self.tasks.values():
            rank = ranks.setdefault(tasks[0].filtering_key, len(ranks))
            for task in tasks:
                places.setdefault(task, (task.index, rank))
        return [task for task, _ in sorted(places.items(), key=lambda item: item[1])]

    def first(self, runs: int) -> "Plan":
        """Return the plan reduced to its first ``runs`` runs, with the same blocks."""
        tasks = {
            key: [
                replace(task, runs_used=min(task.runs_used, runs - task.first_run))
                for task in blocks
                if task.first_run < runs
            ]
            for key, blocks in self.tasks.items()
        }
        return replace(self, tasks=tasks)


def make_plan(experiment: Experiment, save_tracks: bool = False, looks: Sequence[int] = ()) -> Plan:
    """Split every filter's runs into blocks; ``looks`` are the numbers of runs to stop at."""
    settings = experiment.settings
    shown = settings.runs if save_tracks else min(experiment.shown_runs, settings.runs)
    kept, told = _kept_series(experiment), requested_predictions(experiment)
    tasks = {}
    for i, point in enumerate(experiment.points):
        reference = point.filters.get(settings.reference) if settings.reference else None
        for label, tracker in point.filters.items():
            # Consecutive blocks of this width; the last one may be trimmed.
            width = _width(settings, tracker, point.scenario)
            tasks[i, label] = [
                BlockTask(
                    scenario=point.scenario,
                    filter=tracker,
                    assume=point.assumed.get(label),
                    seed=settings.seed,
                    index=block,
                    width=width,
                    runs_used=min(width, settings.runs - block * width),
                    reference=None if label == settings.reference else reference,
                    runs_with_tracks=shown,
                    keep_covariance=save_tracks or experiment.shown_covariances,
                    keep_steps=kept,
                    extra_run_counts=tuple(
                        n - block * width for n in looks if 0 < n - block * width < width
                    ),
                    predictive_metrics=told,
                    hold_out=settings.hold_out,
                )
                for block in range(ceil(settings.runs / width))
            ]
    return Plan(tasks, experiment.plugins, settings.name)


def _kept_series(experiment: Experiment) -> tuple[str, ...]:
    """Return the series stored per run and step, for medians and shares of time averages."""
    return tuple(
        dict.fromkeys([*experiment.settings.medians, *requested_contributions(experiment).series])
    )


def _width(settings: Settings, tracker: AnyFilter, scenario: Scenario) -> int:
    if isinstance(settings.block, int):
        return settings.block
    width = block_width(tracker, scenario)
    if settings.block == "fit":
        return ceil(settings.runs / ceil(settings.runs / width))
    return width


def block_width(tracker: AnyFilter, scenario: Scenario) -> int:
    """Return the number of runs per block.

    About 32 000 particles, so that the cost of numpy's calls is small, at most 500 runs. Filters that
    loop over runs get ten. Long tracks and filters with boosted particle counts get fewer, because a
    block is in memory as a whole.
    """
    widest = _ONE_BY_ONE if tracker.loops_over_runs else _WIDEST
    most = min(widest, _RUN_STEPS_AT_A_TIME // len(scenario.steps))
    return max(1, min(most, _run_limit(tracker)))


def stack_limit(task: BlockTask) -> int:
    """Return how many blocks a worker may filter side by side, for the same numbers.

    Plugins may draw or sum over all runs they are given, and held-out measurements are predicted with
    draws that depend on the block: such blocks run alone, and so does a block of one run, whose sums
    numpy adds in another order.
    """
    alone = task.filter.mixes_runs or task.filter.loops_over_runs or task.hold_out
    if alone or task.width == 1 or foreign_parts((task.scenario, task.filter, task.assume)):
        return 1
    return _largest_stack(task.filter, task.scenario, task.width)


def _largest_stack(tracker: AnyFilter, scenario: Scenario, width: int) -> int:
    """Return how many blocks' particles fit in the cache, and their tracks in memory."""
    most = min(_run_limit(tracker), _STACKED // len(scenario.steps))
    return max(1, min(MOST_STACKED, most // width))


def _run_limit(tracker: AnyFilter) -> int:
    """Return how many runs' particles fit in the cache."""
    N, boosted = tracker.particle_count, tracker.max_particle_count
    return min(_PARTICLES_AT_A_TIME // N, _BOOSTED_AT_A_TIME // boosted)


if sys.platform == "win32":
    import ctypes

    def memory() -> int:
        """Return bytes of memory that the machine has."""
        kilobytes = ctypes.c_ulonglong(0)
        ctypes.windll.kernel32.GetPhysicallyInstalledSystemMemory(ctypes.byref(kilobytes))
        return kilobytes.value * 1024 or sys.maxsize

else:

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


def check_memory(experiment: Experiment, workers: int, save_tracks: bool = False) -> int:
    """Return an upper estimate of the bytes of the workers' largest blocks and results.

    Raises UserError at the responsible filter if the machine has less memory.
    """
    settings = experiment.settings
    there = memory()
    most, read_back, series = 0, _read_bytes(experiment), len(_kept_series(experiment))
    for point in experiment.points:
        merged = max(_merged_bytes(experiment, point, series, save_tracks), read_back)
        for label, tracker in point.filters.items():
            width = _width(settings, tracker, point.scenario)
            reference = point.filters.get(settings.reference or "", tracker)
            # Blocks of one filter, or of several that differ in numbers, that are computed as one stack.
            stacked = _largest_stack(tracker, point.scenario, width)
            if not isinstance(tracker, JoinableFilter):
                stacked = min(stacked, ceil(settings.runs / width))
            block = max(
                _block_bytes(point.assumed_scenario(label), f, width, blocks)
                for f, blocks in ((tracker, stacked), (reference, 1))
            )
            # Each worker has a stack; the parent has the merged results.
            needed = workers * (_PROCESS + block) + merged
            most = max(most, needed)
            if needed > 0.9 * there:
                what = (
                    f"needs about {needed / 1e9:.1f} GB of memory and this machine or container has "
                    f"{there / 1e9:.1f} GB: use fewer particles, runs or workers, or a smaller block"
                )
                where = ("filters", label, "N")
                raise UserError(Problem(experiment.source.mark(where), f"filters.{label}", what))
    return most


def announced(experiment: Experiment, plan: Plan, workers: int, needed: int) -> str:
    """Return one line that announces the run."""
    settings = experiment.settings
    steps = max(len(p.scenario.steps) - 1 for p in experiment.points)
    most, tuning = "up to " if settings.until else "", settings.tuning
    tuned = f"tunes {', '.join(experiment.tuned)} by {tuning.evaluations} trials on {tuning.runs} runs, "
    counts = [counted(len(experiment.points), "point")] if len(experiment.points) > 1 else []
    counts += [
        counted(len(experiment.points[0].filters), "filter"),
        most + counted(settings.runs, "run"),
        counted(steps, "step"),
    ]
    return (
        f"{settings.name}: {tuned if experiment.tuned else ''}{' x '.join(counts)}, "
        f"{counted(len(plan.unique), 'block')} on {counted(workers, 'worker')}, "
        f"about {needed / 1e6:.0f} MB"
    )


def cautions(points: Iterable[Point]) -> list[str]:
    """Return the cautions of scenarios and filters, each once with the labels of its filters."""
    said: dict[str, dict[str, None]] = {}
    for point in points:
        said |= {text: {} for text in point.scenario.cautions}
        for label, tracker in point.filters.items():
            for text in tracker.cautions(point.assumed_scenario(label)):
                said.setdefault(text, {})[label] = None
    return [f"{', '.join(labels)}: {text}" if labels else text for text, labels in said.items()]


def _block_bytes(scenario: Scenario, tracker: AnyFilter, width: int, blocks: int) -> int:
    """Return the bytes of stacked blocks as they are filtered, and of one as it is reduced."""
    n_x, steps = len(scenario.components), len(scenario.steps)
    cloud = tracker.max_particle_count * n_x * _TEMPORARIES
    per_run = cloud + tracker.extra_memory(scenario.model) + steps * (3 * n_x + 6)
    if tracker.smooths:
        per_run += tracker.smoother_memory(scenario.model, steps)
    reduced = steps * (3 * n_x + 14)
    return 8 * width * (blocks * per_run + reduced) + _STEP_OBJECTS * steps


def _read_bytes(experiment: Experiment) -> int:
    """Return the bytes of all values per run and step that tables and figures read."""
    settings, point = experiment.settings, experiment.points[0]
    metrics = sum(
        max_metrics(settings, point.scenario, label, tracker, "per_run.csv")
        for label, tracker in point.filters.items()
    )
    asked, steps = requested_contributions(experiment), point.scenario.steps.tolist()
    metrics += sum(2 * len(asked.of(label, steps)) for label in point.filters)  # in batches, too
    rows = sum(
        max_metrics(settings, p.scenario, label, tracker, "per_step.csv") * len(p.scenario.steps)
        for p in experiment.points
        for label, tracker in p.filters.items()
    )
    return 8 * settings.runs * metrics * len(experiment.points) + _STEP_ROW * rows + _PIECE


def _merged_bytes(experiment: Experiment, point: Point, series: int, save_tracks: bool) -> int:
    """Return the bytes of one filter's merged values and of the stored tracks of all filters."""
    settings, steps = experiment.settings, len(point.scenario.steps)
    n_x = len(point.scenario.components)
    per_run = 60 + series * steps
    shown = settings.runs if save_tracks else min(experiment.shown_runs, settings.runs)
    per_track = (2 * n_x + 2 + (n_x * n_x if save_tracks else 0)) * steps
    filters = len(point.filters) * len(experiment.points)
    return 8 * (3 * settings.runs * per_run + shown * per_track * filters)
