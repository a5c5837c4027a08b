"""Estimate how long a filter takes over a block, from a trial of the block's first steps."""

import time

import numpy as np

from trackbench.evaluation.block_task import BlockTask, first_steps
from trackbench.evaluation.run_filter import run_filter
from trackbench.filters.external_process import programs_cpu_s
from trackbench.scenarios.base import Simulation

_FIRST_STEPS = 8
"""Steps of the first trial, which also loads what a filter needs; the next have twice as many each."""
_ENOUGH_S = 0.1
"""CPU seconds of a trial that is long enough."""


def estimate_cpu_s(task: BlockTask) -> float:
    """Estimate the CPU seconds that the filter and its scores take over the whole block.

    The block is simulated, and the filter steps through its beginning. A filter that changes its pace
    later, such as one of a growing number of particles, takes another time.

    Parameters
    ----------
    task
        task of the filter

    Returns
    -------
    float
        CPU time in s
    """
    data = task.data
    T = len(task.scenario.steps) - 1
    steps = min(_FIRST_STEPS, T)
    # The first trial also imports modules and fills caches: its time does not count.
    _trial_cpu_s(task, data, steps)
    while True:
        seconds = _trial_cpu_s(task, data, steps)
        if seconds >= _ENOUGH_S or steps == T:
            return seconds * T / steps
        steps = min(2 * steps, T)


def _trial_cpu_s(task: BlockTask, data: Simulation, steps: int) -> float:
    """Measure the CPU seconds in which the filter runs over the first ``steps`` steps of the data.

    If the filter is a program outside of Python, the CPU seconds of its processes count, too.
    """
    trial, first_data = first_steps(task, data, steps)
    started = time.process_time() + programs_cpu_s()
    with np.errstate(all="ignore"):
        run_filter(trial, first_data)
    return time.process_time() + programs_cpu_s() - started
