"""Text on the run, step and time at which the filter of a block failed, with a search for the run."""

import time
from dataclasses import replace

import numpy as np

from trackbench.evaluation.block import BlockTask, simulate
from trackbench.evaluation.run_filter import run_filter
from trackbench.evaluation.time_by_trial import first_steps
from trackbench.filters.external import ProgramRunError
from trackbench.filters.failed_step import FailedStep, failed_step
from trackbench.plugins.guarded_code import guarded

_SEARCH_S = 5.0
"""Seconds after which the search for the run ends without a result."""


def describe_failed_step(task: BlockTask, error: Exception) -> str:
    """Return ``run 3, step 5, 10 s``, the place of the error with which the block's filter failed.

    The text lacks what is unknown, and may be empty. The run is unknown if several runs fail.
    """
    if isinstance(error, ProgramRunError):  # its message begins with the run and the step
        return ""
    place = failed_step(error)
    run = place.run
    if run is None and place.last is not None and not isinstance(error, MemoryError):
        run = _find_failed_run(task, error, place)
    parts = []
    if run is not None:
        # Training runs count down.
        number = task.first_run + run if task.index >= 0 else task.first_run - run
        parts.append(f"run {number}")
    if place.first is not None and place.last is not None:
        steps = task.scenario.steps
        seconds = task.scenario.times
        if place.last == 0:
            parts.append("first state")
        elif place.first == place.last:
            parts.append(f"step {steps[place.first]}, {seconds[place.first]:.10g} s")
        else:
            parts.append(f"steps {steps[place.first]} to {steps[place.last]}")
    return ", ".join(parts)


def _find_failed_run(task: BlockTask, error: Exception, place: FailedStep) -> int | None:
    """Return the run, counted from the block's first one, if the filter fails in this run only.

    The runs are halved as long as the filter fails in exactly one half. Return None if both halves fail
    or none, as with a filter whose random numbers matter, and if the search takes too long.
    """
    deadline = time.monotonic() + _SEARCH_S
    first = 0
    end = task.width
    # A block of one run needs no search.
    while end - first > 1:
        middle = (first + end) // 2
        fails_before = _fails(task, error, place, range(first, middle))
        fails_after = _fails(task, error, place, range(middle, end))
        if fails_before == fails_after or time.monotonic() > deadline:
            return None
        if fails_before:
            end = middle
        else:
            first = middle
    return first


def _fails(task: BlockTask, error: Exception, place: FailedStep, runs: range) -> bool:
    """Return whether the filter fails in these runs of the block alone, with an error of this type.

    It must fail at the ``place`` of the error, and is not run beyond. The runs are counted from the
    block's first one.
    """
    assert place.last is not None
    step = 1 if task.index >= 0 else -1  # training runs count down
    first_run = task.first_run + step * runs.start
    data = simulate(task.scenario.without_scoring, task.seed, first_run, len(runs))
    beginning, first_data = first_steps(task, data, max(1, place.last))
    try:
        with guarded(), np.errstate(all="ignore"):
            run_filter(replace(beginning, width=len(runs)), first_data)
    except Exception as repeated:
        again = failed_step(repeated)
        return type(repeated) is type(error) and again.last == place.last
    return False
