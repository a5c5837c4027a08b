"""Plan of an experiment: blocks of runs, each an independent task."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

from trackbench.config.computed_on_request import (
    requested_predictions,
    shown_runs,
    shows_covariances,
)
from trackbench.config.experiment import Experiment, Point
from trackbench.config.stored_metrics import requested_contributions
from trackbench.evaluation.block import BlockTask
from trackbench.execution.block_size import block_width_of
from trackbench.plugins.plugin_content import Plugin

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
        """Distinct tasks in the order of computation.

        Tasks of the same runs are neighbors and share the simulated data. Among these, tasks that score
        the same estimates in different ways are neighbors, so that the filter runs once for them.
        """
        ranks: dict[BlockTask, int] = {}
        places: dict[BlockTask, tuple[int, int]] = {}
        for tasks in self.tasks.values():
            # Filters that compute the same estimates, as at several points of the grid, have one rank.
            rank = ranks.setdefault(tasks[0].filtering_task, len(ranks))
            for task in tasks:
                places.setdefault(task, (task.index, rank))
        return [task for task, _ in sorted(places.items(), key=lambda item: item[1])]

    def first(self, runs: int) -> "Plan":
        """Return the plan of the first ``runs`` runs only, with the same blocks.

        Later blocks are left out, and of the last one fewer runs are used.
        """
        tasks: dict[Key, list[BlockTask]] = {}
        for key, blocks in self.tasks.items():
            tasks[key] = []
            for block in blocks:
                if block.first_run < runs:
                    used = min(block.runs_used, runs - block.first_run)
                    tasks[key].append(replace(block, runs_used=used))
        return replace(self, tasks=tasks)

    def of_shard(self, shard: int, shards: int) -> "Plan":
        """Return the plan of one shard of ``shards``, counted from 1.

        A shard has consecutive blocks in the order of computation, so that it has blocks of all filters.
        """
        n = len(self.unique)
        in_shard = set(self.unique[n * (shard - 1) // shards : n * shard // shards])
        tasks: dict[Key, list[BlockTask]] = {}
        for key, blocks in self.tasks.items():
            chosen = [block for block in blocks if block in in_shard]
            if chosen:
                tasks[key] = chosen
        return replace(self, tasks=tasks)


def make_plan(experiment: Experiment, save_tracks: bool = False, stops: Sequence[int] = ()) -> Plan:
    """Split every filter's runs into blocks.

    ``save_tracks`` records the tracks of all runs. ``stops`` are the numbers of runs after which the
    experiment may stop, so that results of that many runs are needed.
    """
    settings = experiment.settings
    kept_series = stored_series(experiment)
    predictions = requested_predictions(experiment)
    tasks: dict[Key, list[BlockTask]] = {}
    for i, point in enumerate(experiment.points):
        reference = point.filters.get(settings.reference) if settings.reference else None
        for label, tracker in point.filters.items():
            # Consecutive blocks of this width; the last one may be trimmed.
            width = block_width_of(settings, tracker, point.scenario)
            first = BlockTask(
                scenario=point.scenario,
                filter=tracker,
                assume=point.assumed.get(label),
                seed=settings.seed,
                index=0,
                width=width,
                runs_used=width,
                # The reference has no distance to itself.
                reference=None if label == settings.reference else reference,
                reference_assume=point.assumed.get(settings.reference or ""),
                runs_with_tracks=runs_with_tracks(experiment, save_tracks),
                keep_covariance=shows_covariances(experiment) or save_tracks,
                keep_steps=kept_series,
                predictive_metrics=predictions,
                hold_out=settings.hold_out,
            )
            tasks[i, label] = []
            for begin in range(0, settings.runs, width):
                # Numbers of the block's runs after which the experiment may stop.
                stops_in_block = tuple(n - begin for n in stops if 0 < n - begin < width)
                used = min(width, settings.runs - begin)
                block = replace(
                    first,
                    index=begin // width,
                    runs_used=used,
                    extra_run_counts=stops_in_block,
                )
                tasks[i, label].append(block)
    return Plan(tasks, experiment.plugins, settings.name)


def runs_with_tracks(experiment: Experiment, save_tracks: bool) -> int:
    """Return the number of first runs whose whole tracks are stored: all, or those that figures show."""
    if save_tracks:
        return experiment.settings.runs
    return min(shown_runs(experiment), experiment.settings.runs)


def stored_series(experiment: Experiment) -> tuple[str, ...]:
    """Name the series that are stored per run and step, for medians and for runs' shares of averages."""
    names = [*experiment.settings.medians, *requested_contributions(experiment).series]
    return tuple(dict.fromkeys(names))


def cautions(points: Sequence[Point]) -> list[str]:
    """Return the cautions of scenarios and filters, each once.

    Before a caution of filters stand the labels of all filters that have it.
    """
    # Imported here, as results are read without the code of scenarios.
    from trackbench.scenarios.shared_start import note_on_shared_start

    labels_by_text: dict[str, list[str]] = {}
    for point in points:
        for text in point.scenario.cautions:
            labels_by_text[text] = []
        for label, tracker in point.filters.items():
            scenario = point.assumed_scenario(label)
            for text in [*scenario.cautions_on_assumptions, *tracker.cautions(scenario)]:
                labels = labels_by_text.setdefault(text, [])
                if label not in labels:
                    labels.append(label)
    lines = []
    for text, labels in labels_by_text.items():
        lines.append(f"{', '.join(labels)}: {text}" if labels else text)
    return lines + note_on_shared_start(point.scenario for point in points)
