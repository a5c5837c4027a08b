"""What an experiment will compute: blocks of runs, each a task that stands alone."""

import os
from dataclasses import dataclass
from math import ceil

from trackbench.evaluation.block import BlockTask
from trackbench.experiment.config import Experiment, Point
from trackbench.experiment.problems import UserError
from trackbench.filters.base import AnyFilter

_PARTICLES_AT_A_TIME = 32_768
_WIDEST = 500
_TEMPORARIES = 14  # arrays of a cloud's size alive at once in the hungriest filter


@dataclass(frozen=True)
class Plan:
    """Tasks by point and filter label, in block order; equal tasks are computed once."""

    tasks: dict[tuple[int, str], list[BlockTask]]

    @property
    def unique(self) -> list[BlockTask]:
        """Every different task, all filters of a block together so that its data are shared."""
        return sorted(
            dict.fromkeys(t for tasks in self.tasks.values() for t in tasks),
            key=lambda task: task.index,
        )


def make_plan(experiment: Experiment, save_tracks: bool = False) -> Plan:
    """Cut every filter's runs into blocks of its width."""
    settings = experiment.settings
    shown = settings.runs if save_tracks else min(experiment.shown_runs, settings.runs)
    tasks = {}
    for i, point in enumerate(experiment.points):
        reference = point.filters.get(settings.reference) if settings.reference else None
        for label, tracker in point.filters.items():
            width = settings.block or block_width(tracker)
            tasks[i, label] = [
                BlockTask(
                    scenario=point.scenario,
                    filter=tracker,
                    seed=settings.seed,
                    index=block,
                    width=width,
                    used=min(width, settings.runs - block * width),
                    reference=None if label == settings.reference else reference,
                    shown=shown,
                    keep_covariance=save_tracks or experiment.shown_covariances,
                    keep_steps=tuple(settings.medians),
                )
                for block in range(ceil(settings.runs / width))
            ]
    return Plan(tasks)


def block_width(tracker: AnyFilter) -> int:
    """Runs per block: about 32 000 particles, so that numpy's calls cost little, at most 500."""
    return max(1, min(_WIDEST, _PARTICLES_AT_A_TIME // particle_count(tracker)))


def particle_count(tracker: AnyFilter) -> int:
    """The filter's N, or 1 for a filter without particles."""
    return int(getattr(tracker, "N", 1))


def memory_needed(plan: Plan, workers: int) -> int:
    """Bytes that the largest blocks and the merged results take, roughly and rather too much."""
    largest = max(_block_bytes(task) for task in plan.unique)
    kept = sum(
        8 * task.used * (60 + len(task.keep_steps) * len(task.scenario.steps)) + _track_bytes(task)
        for task in plan.unique
    )
    return 150_000_000 * workers + largest * workers + kept


def check_memory(plan: Plan, workers: int) -> int:
    """Bytes needed; raises UserError if the machine does not have them."""
    needed = memory_needed(plan, workers)
    there = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if needed > 0.9 * there:
        raise UserError(
            f"this needs about {needed / 1e9:.1f} GB of memory and the machine has "
            f"{there / 1e9:.1f} GB: use fewer particles, a smaller block or fewer workers"
        )
    return needed


def describe(experiment: Experiment, plan: Plan, workers: int, needed: int) -> str:
    """One line on what is about to be done."""
    settings = experiment.settings
    steps = max(len(p.scenario.steps) - 1 for p in experiment.points)
    points = f"{len(experiment.points)} points x " if len(experiment.points) > 1 else ""
    filters = len(experiment.points[0].filters)
    return (
        f"{settings.name}: {points}{filters} filters x {settings.runs} runs x {steps} steps, "
        f"{len(plan.unique)} blocks on {workers} worker{'s' if workers > 1 else ''}, "
        f"about {needed / 1e6:.0f} MB"
    )


def cautions(point: Point) -> list[str]:
    """What filters say about this scenario that is no mistake but should be known."""
    out = []
    for label, tracker in point.filters.items():
        warn = getattr(tracker, "cautions", None)
        out += [f"{label}: {text}" for text in (warn(point.scenario) if warn else [])]
    return out


def _block_bytes(task: BlockTask) -> int:
    n_x = len(task.scenario.model.motion.components)
    cloud = particle_count(task.filter) * n_x * _TEMPORARIES
    return 8 * task.width * (cloud + len(task.scenario.steps) * (6 * n_x + 20))


def _track_bytes(task: BlockTask) -> int:
    n_x = len(task.scenario.model.motion.components)
    shown = max(0, min(task.shown - task.first_run, task.used))
    per_step = 2 * n_x + 2 + (n_x * n_x if task.keep_covariance else 0)
    return 8 * shown * per_step * len(task.scenario.steps)
