"""CPU times of an experiment: measured in turns after its runs, or read from the cache."""

import hashlib
import json
import os
import platform
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from trackbench.atomic_files import record_writes, write_text
from trackbench.config.computed_on_request import takes_times
from trackbench.config.experiment import Experiment
from trackbench.errors import WriteError, in_line
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.measure_cpu_times import REPEATS, Measured, measure
from trackbench.execution.block_key import block_key
from trackbench.execution.cache import times_folder
from trackbench.execution.plan import Key
from trackbench.execution.run_plans import Outcome
from trackbench.plugins.guarded_code import guarded
from trackbench.progress_bar import progress_bar
from trackbench.readable_files import require_regular_file


class Times(NamedTuple):
    """CPU times of the filters of an experiment."""

    measured: Mapping[Key, Measured]
    """times by grid point and filter"""
    failed: Mapping[str, str]
    """reasons, by filter, why a time could not be measured"""


def measure_times(
    experiment: Experiment, outcome: Outcome, fresh: bool, progress: bool = False
) -> Times:
    """Measure the filters' CPU times, one filter after the other in turns, if anything uses them.

    A table, a figure, a published number or a claim may use them. They are measured in this process.
    Cached times are reused unless the code, the machine or a filter has changed, or ``fresh`` is set.
    Filters that failed in the runs, by the ``outcome``, are left out. ``progress`` shows a progress bar.
    """
    if not takes_times(experiment):
        return Times({}, {})
    # Step 1: a block of each filter, with as many runs as a computed block, or with the only run.
    tasks = {}
    for key, blocks in outcome.plan.tasks.items():
        if key in outcome.failures:
            continue
        width = 1 if experiment.settings.runs == 1 else blocks[0].width
        # Only the filter is timed. `filtering_task` is the block's task without what concerns scores
        # alone: filters that compute the same estimates then have equal tasks, and are timed once.
        tasks[key] = replace(
            blocks[0].filtering_task, width=width, predictive_metrics=(), hold_out=None
        )
    unique_tasks = list(dict.fromkeys(tasks.values()))
    # Step 2: stored times.
    file = _times_file(unique_tasks)
    if not fresh:
        # A damaged file may lack times of some tasks.
        with suppress(OSError, ValueError, TypeError, IndexError):
            stored_times = _read_times(file)
            measured = {key: stored_times[unique_tasks.index(task)] for key, task in tasks.items()}
            return Times(measured=measured, failed={})
    # Step 3: measure them.
    # The bar counts a pass of each filter through its block, then the turns of all filters.
    description = f"{experiment.settings.name}: CPU times"
    with progress_bar(len(unique_tasks) + REPEATS, "turn", progress, desc=description) as bar:
        # `guarded` keeps plugin code from ending the program.
        times = measure(unique_tasks, guarded, bar.update)
    time_by_task = dict(zip(unique_tasks, times, strict=True))
    # Step 4: separate the filters that failed.
    measured = {}
    failed = {}
    for key, task in tasks.items():
        time = time_by_task[task]
        if isinstance(time, Measured):
            measured[key] = time
        else:
            _, label = key
            failed[label] = in_line(str(time))
    # A failed filter is tried again by the next run.
    if not failed:
        _store_times(file, list(time_by_task.values()))
    return Times(measured=measured, failed=failed)


def _times_file(tasks: Sequence[BlockTask]) -> Path:
    """Return the path of the file in the cache that has the times of these tasks on this machine.

    Its name is a digest of all that the times depend on. The file may not exist.
    """
    # A key is a digest of the task and of the code. The number of used runs changes no time.
    digests = [block_key(task, 0) for task in tasks]
    # The properties of this machine that CPU times depend on.
    machine = [platform.node(), platform.platform(), platform.processor(), str(os.cpu_count())]
    name = hashlib.sha256(json.dumps([machine, digests]).encode()).hexdigest()
    return times_folder() / f"{name}.json"


def _read_times(file: Path) -> list[Measured]:
    """Read stored times in the order of their tasks.

    Raises OSError, ValueError or TypeError if there are none.
    """
    return [Measured(*row) for row in json.loads(require_regular_file(file).read_bytes())]


def _store_times(file: Path, times: Sequence[object]) -> None:
    """Store times, in the order of their tasks, in the cache, if it can be written."""
    # The caller's record of written files is of the results folder, and this file is in the cache. An
    # inner record keeps it out.
    with record_writes(), suppress(OSError, WriteError):
        file.parent.mkdir(parents=True, exist_ok=True)
        write_text(file, json.dumps(times) + "\n")
