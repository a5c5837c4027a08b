"""Measured CPU times of an experiment's filters, cached beside its blocks."""

import hashlib
import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

from trackbench.atomic_files import record_writes, write_text
from trackbench.config.experiment import Experiment
from trackbench.config.requested_metrics import takes_times
from trackbench.errors import WriteError, in_line
from trackbench.evaluation.timing import Measured, measure
from trackbench.execution.block_key import block_key
from trackbench.execution.cache import times_folder
from trackbench.execution.plan import Key
from trackbench.execution.runner import Outcome
from trackbench.os_specific import identity
from trackbench.plugins.errors import guarded


class Times(NamedTuple):
    """Measured times by grid point and filter, and by filter the reason why others have none."""

    measured: Mapping[Key, Measured]
    failed: Mapping[str, str]


def times_of(experiment: Experiment, outcome: Outcome, fresh: bool) -> Times:
    """Measure the filters' CPU times if the config or a published row uses them.

    They are measured in this process. Cached times are reused unless code, machine or a filter
    changed, or ``fresh``.
    """
    if not takes_times(experiment):
        return Times({}, {})
    tasks = {
        key: replace(blocks[0].filtering_key, predictive_metrics=(), hold_out=None)
        for key, blocks in outcome.plan.tasks.items()
        if key not in outcome.failures
    }
    unique = list(dict.fromkeys(tasks.values()))
    digests = [block_key(task, 0) for task in unique]
    name = hashlib.sha256(json.dumps([identity(), digests]).encode()).hexdigest()
    file = times_folder() / f"{name}.json"
    if not fresh:
        with suppress(OSError, ValueError, TypeError):
            kept = [Measured(*row) for row in json.loads(file.read_bytes())]
            return Times({key: kept[unique.index(task)] for key, task in tasks.items()}, {})
    found = dict(zip(unique, measure(unique, guarded), strict=True))
    good = {key: m for key, task in tasks.items() if isinstance(m := found[task], Measured)}
    failed = {key[1]: in_line(str(found[task])) for key, task in tasks.items() if key not in good}
    if not failed:
        with (
            record_writes(),
            suppress(OSError, WriteError),
        ):  # it is none of the results folder's files
            file.parent.mkdir(parents=True, exist_ok=True)
            write_text(file, json.dumps([*found.values()]) + "\n")
    return Times(good, failed)
