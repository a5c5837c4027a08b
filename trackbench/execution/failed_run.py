"""Text on the run, step and time at which the filter of a block failed, with a search for the run."""

import time
from dataclasses import replace

import numpy as np

from trackbench.evaluation.block_task import BlockTask, first_steps
from trackbench.evaluation.run_filter import run_filter
from trackbench.evaluation.simulated_runs import simulate
from trackbench.filters.external import ProgramRunError
from trackbench.filters.failed_step import failed_step
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
    # Memory is short in the block as a whole, and not in one of its runs.
    if run is None and place.last is not None and not isinstance(error, MemoryError):
        run = _find_failed_run(task, error, place.last)
    parts = []
    if run is not None:
        parts.append(f"run {task.run_number(run)}")
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


def _find_failed_run(task: BlockTask, error: Exception, last_step: int) -> int | None:
    """Return the run, counted from the block's first one, if the filter fails in this run only.

    ``last_step`` is the last step that the filter was making, as an index of `Scenario.steps`. The runs
    are halved as long as the filter fails in exactly one half. Return None if both halves fail or none,
    as with a filter whose random numbers matter, and if the search takes too long.
    """
    deadline = time.monotonic() + _SEARCH_S
    first = 0
    end = task.width
    # A block of one run needs no search.
    while end - first > 1:
        middle = (first + end) // 2
        fails_before = _fails(task, error, last_step, range(first, middle))
        fails_after = _fails(task, error, last_step, range(middle, end))
        if fails_before == fails_after or time.monotonic() > deadline:
            return None
        if fails_before:
            end = middle
        else:
            first = middle
    return first


def _fails(task: BlockTask, error: Exception, last_step: int, runs: range) -> bool:
    """Test whether the filter fails in these runs of the block alone, with an error of this type.

    It must fail at ``last_step``, and is not run beyond. The runs are counted from the block's first
    one.
    """
    first_run = task.run_number(runs.start)
    data = simulate(task.scenario.without_scoring, task.seed, first_run, len(runs))
    beginning, first_data = first_steps(task, data, max(1, last_step))
    try:
        with guarded(), np.errstate(all="ignore"):
            run_filter(replace(beginning, width=len(runs)), first_data)
    except Exception as repeated:
        return type(repeated) is type(error) and failed_step(repeated).last == last_step
    return False
