"""Damage of faults: errors of a filter less those of the same filter in the same runs without faults."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.block_task import BlockTask


def task_without_faults(task: BlockTask) -> BlockTask | None:
    """Return the task of the same filter and runs without faults; None if the scenario has no faults."""
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
    """Return series ``damage_<quantity>`` (T + 1, M): length of the error less that without faults.

    ``errors`` has the squared errors with faults, such as ``squared_position``. ``without_faults`` has
    those of the same filter without faults, by the name of the damage.
    """
    damage: dict[str, Array] = {}
    for name, squared_without_faults in without_faults.items():
        squared_with_faults = errors[name.replace("damage", "squared", 1)]
        damage[name] = np.sqrt(squared_with_faults) - np.sqrt(squared_without_faults)
    return damage
