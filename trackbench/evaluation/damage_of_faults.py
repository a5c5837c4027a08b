"""Damage of faults: errors of a filter less those of the same filter in the same runs without faults."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.block_task import BlockTask


def task_without_faults(task: BlockTask) -> BlockTask | None:
    """Return the task of the same filter and runs without faults.

    Parameters
    ----------
    task
        task of a filter

    Returns
    -------
    BlockTask or None
        task that only computes the filter's output; None if the scenario has no faults
    """
    scenario = task.scenario.without_faults
    if scenario is task.scenario:
        return None
    assume = task.assume
    if assume is not None:
        # Without faults there are none that the filter may know.
        assume = replace(assume, faults=None)
    # `filtering_task` leaves out what does not change the filter's output, so that tasks that score it
    # in another way share one.
    return replace(task.filtering_task, scenario=scenario.without_scoring, assume=assume)


def damage_series(
    errors: Mapping[str, Array], without_faults: Mapping[str, Array]
) -> dict[str, Array]:
    """Return the length of the error less that without faults.

    Parameters
    ----------
    errors
        squared errors (T + 1, M) with faults, by names such as ``squared_position``
    without_faults
        squared errors (T + 1, M) of the same filter without faults, by names such as ``damage_position``

    Returns
    -------
    dict
        series ``damage_<quantity>`` (T + 1, M), in the unit of the quantity
    """
    damage: dict[str, Array] = {}
    for name, squared_without_faults in without_faults.items():
        squared_with_faults = errors[name.replace("damage", "squared", 1)]
        damage[name] = np.sqrt(squared_with_faults) - np.sqrt(squared_without_faults)
    return damage
