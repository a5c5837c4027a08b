"""Expected time of a run, of tuning or of a suite: from stored or shipped times, or by trials."""

import csv
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from math import ceil, nan
from pathlib import Path
from typing import NamedTuple

from trackbench.commands.jobs_with_tuned_values import with_tuned_values
from trackbench.commands.prepare_jobs import Job
from trackbench.commands.run_options import Options, most_workers
from trackbench.config.experiment_keys import Settings
from trackbench.config.number_of_runs import fewest_recorded_runs
from trackbench.config.quick_run import FIT
from trackbench.config.resolved_config import as_yaml, resolved
from trackbench.config.shipped_experiments import files as shipped_files
from trackbench.config.shipped_experiments import listed, located
from trackbench.config.tuning import tuned_label
from trackbench.durations import expected_time_in_words
from trackbench.errors import UserError
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.time_by_trial import estimate_cpu_s
from trackbench.execution.cache import BlockStore, cache_folder
from trackbench.execution.plan import Key
from trackbench.plugins.guarded_code import guarded
from trackbench.results.file_names import TIMING
from trackbench.results.manifest import read_manifest
from trackbench.tuning.tuner import StoredTrials, Training, stored_trials
from trackbench.yaml_source import Assembled, read

_SHORT_TUNING_S = 10.0
"""Seconds of tuning below which nothing is said about its time."""
CACHED = "every block is in the cache"
"""Time of a job whose blocks are all kept."""
_SIMILAR_RATIO = 1.2
"""Ratio of two filters' shares of work below which one share stands for both."""
_MOST_TRIED_FILTERS = 40
"""Largest number of filters, over all points of the grid, that a dry run tries.

A trial takes some 0.3 s.
"""
_KEYS_OF_TIME = ("scenario", "filters", "grid", "only")
"""Keys of a config that its time depends on, apart from the runs."""


def expected_time_with_tuning(job: Job, options: Options) -> str:
    """Write how long the filters and their tuning will take, in words."""
    stored = _stored_trials(job, options)
    times = [
        _time_of_filters(job, options, stored, tries=True),
        _time_of_tuning(job, options, stored),
    ]
    return ", ".join(filter(None, times))


def expected_time(job: Job, options: Options, tries: bool = True) -> str:
    """Write how long the filters will take for the missing blocks, in words.

    Each filter may be timed over the beginning of a block if ``tries``.
    """
    return _time_of_filters(job, options, _stored_trials(job, options), tries)


def expected_time_of_tuning(job: Job, options: Options) -> str:
    """Write how long tuning will take at most, in words.

    The text is empty if the time is unknown or too short to matter.
    """
    return _time_of_tuning(job, options, _stored_trials(job, options))


def _stored_trials(job: Job, options: Options) -> dict[str, StoredTrials]:
    """Look up the stored trials of each tuned filter, by its label."""
    return stored_trials(job.experiment, BlockStore(cache_folder()), options.fresh)


def _time_of_filters(
    job: Job, options: Options, stored: Mapping[str, StoredTrials], tries: bool
) -> str:
    """Write how long the filters will take for the missing blocks, in words.

    A missing block is a task of some runs of one filter whose result is not in the cache. The estimate
    is made from stored results of the same scenario and filters. Without such results each filter is
    timed over the beginning of a block, if ``tries``. Simulation, errors, tables and figures take
    further time. ``stored`` has the stored trials of each tuned filter.
    """
    # Step 1: CPU time of the missing blocks. If all trials of tuning are stored, the tuned values follow
    # from them. Otherwise the tuned filters' blocks are unknown, and missing.
    tuned_labels: set[str] = set()
    if any(trials.missing for trials in stored.values()):
        tuned_labels = {tuned_label(label) for label in job.experiment.tuned}
    elif job.experiment.tuned:
        tuning = {label: trials.record for label, trials in stored.items()}
        job = with_tuned_values(job, options, tuning)
    missing = _Missing(
        blocks=set(_missing_blocks(job.plan.unique, options)),
        tuned_labels=tuned_labels,
    )
    if not missing.blocks and not missing.tuned_labels:
        return CACHED
    cost = _cost_in_folder(job, missing) or _cost_of_shipped(job, options, missing)
    basis = ""  # words on how the estimate was made
    if cost is None and tries:
        cost = _cost_by_trial(job, missing)
        basis = ", by a trial of the first steps"
    if cost is None:
        return "time unknown: no results of the same scenario and filters are stored"
    # Step 2: time on all workers, of which a run begins no more than its plan has blocks. The plan has
    # the first batch of runs, and the config's key `until` may continue up to ``job.most_runs``: later
    # batches are taken to miss as many of their blocks. The filters take at least as long as their
    # longest block.
    workers = min(most_workers(options), len(job.plan.unique))
    seconds = cost.cpu_s * job.most_runs / job.experiment.settings.runs / workers
    seconds = max(seconds, cost.longest_block_s)
    about = "at most about" if cost.is_upper_bound else "about"
    return f"{about} {expected_time_in_words(seconds)} of filtering{basis}"


def _time_of_tuning(job: Job, options: Options, stored: Mapping[str, StoredTrials]) -> str:
    """Write how long tuning will take at most, in words.

    ``stored`` has the stored trials of each tuned filter. The text is empty if the time is unknown or
    too short to matter, and if so many filters are tuned that their timing would take long. Each tuned
    filter is timed over the beginning of its first trial, unless all of its trials are stored. The
    trials of a filter mostly follow each other, those of several filters run on all workers.
    """
    experiment = job.experiment
    if not experiment.tuned or len(experiment.tuned) > _MOST_TRIED_FILTERS:
        return ""
    workers = most_workers(options)
    all_cpu_s = 0.0
    longest_s = 0.0
    for label, trials in stored.items():
        if not trials.missing:
            continue
        tasks = Training(experiment, label).first_tasks
        # The filter is invalid with the values of the first trial.
        if not tasks:
            continue
        # A program outside of Python is not timed.
        block_s = None
        if not tasks[0].filter.runs_program:
            block_s = _block_s_by_trial(tasks[0])
        if block_s is None:
            return ""
        # The blocks of one trial run on all workers at once, its trials one after the other.
        all_cpu_s += trials.missing * len(tasks) * block_s
        longest_s = max(longest_s, trials.missing * ceil(len(tasks) / workers) * block_s)
    seconds = max(all_cpu_s / workers, longest_s)
    if seconds < _SHORT_TUNING_S:
        return ""
    return f"at most about {expected_time_in_words(seconds)} of tuning"


class _Cost(NamedTuple):
    """CPU seconds of blocks."""

    cpu_s: float
    is_upper_bound: bool
    """whether the blocks may take less than ``cpu_s``, as those that are wider than the stored ones"""
    longest_block_s: float = 0.0
    """CPU seconds of the block that takes longest, if that is known"""


class _Missing(NamedTuple):
    """Blocks that a run would compute."""

    blocks: set[BlockTask]
    """blocks that the cache lacks"""
    tuned_labels: set[str]
    """labels of filters that will be tuned first: the plan has the blocks of their untuned originals"""

    def has(self, label: str, block: BlockTask) -> bool:
        """Test whether a block of the plan of the filter ``label`` would be computed."""
        return label in self.tuned_labels or block in self.blocks


def _cost_in_folder(job: Job, missing: _Missing) -> _Cost | None:
    """Estimate the CPU time of the missing blocks from the times in the results folder.

    Return None if the folder is not of the same scenario and filters. The estimate is an upper bound if
    the stored results have fewer runs than a missing block, as wide blocks take less time per run.
    """
    config = resolved(job.experiment, job.folder)
    grid = job.experiment.settings.grid
    # A folder that lacks a file, or has unreadable ones, gives no estimate.
    with suppress(OSError, UserError, ValueError, LookupError, TypeError):
        # Step 1: the folder must have complete results, of the same scenario and filters.
        read_manifest(job.folder)  # raises if there is no readable manifest, which is written last
        stored_config = read(job.folder / "config.yaml").data
        for key in _KEYS_OF_TIME:
            if as_yaml({key: stored_config.get(key)}) != as_yaml({key: config.get(key)}):
                return None
        # Step 2: the rows of timing.csv, by the grid's values, as texts, and the filter's label.
        with (job.folder / TIMING).open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        if not rows:
            return None
        times = {}
        for row in rows:
            times[(*(row[path] for path in grid), row["filter"])] = row
        # Step 3: scale them to the runs of the missing blocks.
        cpu_s = 0.0
        is_upper_bound = False
        for (point_number, label), task in _filter_passes(job, missing):
            values = job.experiment.points[point_number].values.values()
            # A filter that failed has no time. It will fail again, and counts as 0 s.
            time = times.get((*(str(value) for value in values), label))
            if time is not None:
                computed_runs = int(time["runs"])
                cpu_s += float(time["cpu_s"]) / computed_runs * task.width
                is_upper_bound = is_upper_bound or computed_runs < task.width
        return _Cost(cpu_s=cpu_s, is_upper_bound=is_upper_bound)
    return None


def _filter_passes(job: Job, missing: _Missing) -> Iterator[tuple[Key, BlockTask]]:
    """Yield the missing blocks that need a pass of the filter over its data, with point and filter.

    Several blocks may score the same estimates in different ways, and so share one pass: they have one
    `filtering_task`, and only the first of them is yielded. A filter that will be tuned has the keys of
    its original until then, and yet a pass of its own.
    """
    passes: set[tuple[str, BlockTask]] = set()
    for key, tasks in job.plan.tasks.items():
        _, label = key
        owner = label if label in missing.tuned_labels else ""
        for task in tasks:
            filter_pass = (owner, task.filtering_task)
            if missing.has(label, task) and filter_pass not in passes:
                passes.add(filter_pass)
                yield key, task


def _cost_of_shipped(job: Job, options: Options, missing: _Missing) -> _Cost | None:
    """Estimate the CPU time of the missing blocks from the known time of a shipped experiment.

    Return None if the config is no shipped experiment, or is changed by options. The known time is that
    of all filters together. It is scaled by the largest ratio, over filters and points of the grid, of
    the number of missing blocks to the number of blocks of the shipped experiment. The estimate is an
    upper bound unless the ratios are similar.
    """
    # `--quick` sets FIT, the override block=fit, which changes no filter.
    is_changed = options.grid or options.only or any(word != FIT for word in options.set)
    # A config from Python, or of a suite's problem, is no file.
    if isinstance(job.config, Mapping | Assembled) or is_changed:
        return None
    with suppress(UserError):  # the word names no file
        path = located(Path(job.config), note=lambda line: None)  # prints no note
        shipped_file = shipped_files().get(path.stem)
        if shipped_file is None or not path.samefile(shipped_file):
            return None
        cpu_s_by_name = {shipped.name: shipped.cpu_s for shipped in listed()}
        cpu_s = cpu_s_by_name.get(path.stem)
        if cpu_s is None:
            return None
        # Without a number in its file an experiment has all recorded runs, or the default number.
        shipped_runs = read(path).data.get("runs") or fewest_recorded_runs(job.experiment.points)
        shipped_runs = int(shipped_runs or Settings.runs)
        ratios = []
        # The blocks of one filter at one point of the grid.
        for (_, label), tasks in job.plan.tasks.items():
            shipped_blocks = ceil(shipped_runs / tasks[0].width)
            missing_blocks = {task for task in tasks if missing.has(label, task)}
            ratios.append(len(missing_blocks) / shipped_blocks)
        # A filter without missing blocks has the ratio 0, which is similar to no other.
        is_upper_bound = max(ratios) > _SIMILAR_RATIO * min(ratios)
        return _Cost(cpu_s=cpu_s * max(ratios), is_upper_bound=is_upper_bound)
    return None


def _cost_by_trial(job: Job, missing: _Missing) -> _Cost | None:
    """Estimate the CPU time of the missing blocks by a trial of each filter's first missing block.

    A trial runs the filter over the first steps of its block. Return None if there are too many filters
    for a short trial, if a filter fails, or if it is a program outside of Python.
    """
    # The missing blocks that need a pass of a filter, by grid point and filter.
    blocks_by_key: dict[Key, list[BlockTask]] = {}
    for key, task in _filter_passes(job, missing):
        blocks_by_key.setdefault(key, []).append(task)
    if len(blocks_by_key) > _MOST_TRIED_FILTERS:
        return None
    cpu_s = 0.0
    longest_block_s = 0.0
    for tasks in blocks_by_key.values():
        if tasks[0].filter.runs_program:
            return None
        block_s = _block_s_by_trial(tasks[0])
        if block_s is None:
            return None
        cpu_s += block_s * len(tasks)
        longest_block_s = max(longest_block_s, block_s)
    return _Cost(cpu_s=cpu_s, is_upper_bound=False, longest_block_s=longest_block_s)


def cpu_s_of_filter(job: Job, label: str, options: Options, tries: bool) -> tuple[float, float]:
    """Estimate the CPU seconds that one filter takes for its missing blocks, and the size of its work.

    The size is the number of runs times steps of the missing blocks. The seconds are estimated by a
    trial of the first block if ``tries``. They are NaN without a trial, or if the filter fails in it.
    """
    tasks: list[BlockTask] = []
    for (_, name), tasks_of_point in job.plan.tasks.items():
        if name == label:
            tasks += tasks_of_point
    missing = _missing_blocks(tasks, options)
    if not missing:
        return 0.0, 0.0
    size = sum(task.width * len(task.scenario.steps) for task in missing)
    block_s = None
    if tries:
        block_s = _block_s_by_trial(missing[0])
    if block_s is None:
        return nan, size
    return block_s * len(missing), size


def _missing_blocks(tasks: Sequence[BlockTask], options: Options) -> list[BlockTask]:
    """List the blocks that a run with these options would compute: those that the cache lacks.

    With the option ``fresh`` these are all.
    """
    if options.fresh:
        return list(tasks)
    store = BlockStore(cache_folder())
    return [task for task in tasks if not store.has_file(task)]


def _block_s_by_trial(task: BlockTask) -> float | None:
    """Estimate the CPU seconds of a block by a trial of its first steps; None if the filter fails."""
    try:
        with guarded():
            return estimate_cpu_s(task)
    except Exception:  # of a plugin: the run itself, or tuning, will report it
        return None


def trials_per_run(job: Job) -> float:
    """Return the ratio of a filter's work in tuning, at most, to the work of the experiment's runs.

    Tuning runs ``tuning.evaluations`` trials, each over ``tuning.runs`` training runs.
    """
    settings = job.experiment.settings
    tuning = settings.tuning
    return tuning.evaluations * (tuning.runs or settings.runs) / settings.runs
