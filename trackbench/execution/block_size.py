"""Size of a block: the number of its runs, and how many blocks a worker filters side by side."""

from math import ceil

from trackbench.component_parts import foreign_parts
from trackbench.config.experiment_keys import Settings
from trackbench.evaluation.block_task import MOST_STACKED, BlockTask
from trackbench.filters.base import AnyFilter
from trackbench.scenarios.base import Scenario

_PARTICLES_AT_A_TIME = 32_768
_RUN_STEPS_AT_A_TIME = 200_000  # a long track's series, some thirty of them, stay below 100 MB
_BOOSTED_AT_A_TIME = 330_000  # in the few steps of a boost: below 200 MB
_STACKED = 400_000  # run-steps that are filtered together: their series are made block by block
_WIDEST = 500
_ONE_BY_ONE = 10  # few enough for two workers to share 50 runs, and to compute none in vain


def block_width_of(settings: Settings, tracker: AnyFilter, scenario: Scenario) -> int:
    """Return the number of runs per block, as the config's key `block` requests it.

    The key is a number of runs, or `fit`, or its default.
    """
    if isinstance(settings.block, int):
        return settings.block
    width = block_width(tracker, scenario)
    if settings.block == "fit":
        # As many blocks, of nearly equal numbers of runs: no run is computed in vain.
        return ceil(settings.runs / ceil(settings.runs / width))
    return width


def block_width(tracker: AnyFilter, scenario: Scenario) -> int:
    """Choose the number of runs per block.

    A block has about 32 000 particles, so that the cost of numpy's calls is small, and at most 500 runs.
    Blocks of filters that loop over runs have at most ten. A block is in memory as a whole. So blocks of
    long tracks have fewer runs, and so have those of filters that take more particles at some steps.
    """
    widest = _ONE_BY_ONE if tracker.loops_over_runs else _WIDEST
    most = min(widest, _RUN_STEPS_AT_A_TIME // len(scenario.steps))
    return max(1, min(most, _run_limit(tracker)))


def stack_limit(task: BlockTask) -> int:
    """Return how many blocks a worker may filter side by side without changing their numbers.

    Some blocks run alone. The last digits of a run may depend on the other runs (`Filter.mixes_runs`).
    Plugins may draw or sum over all runs that they are given. Held-out measurements are predicted with
    draws that depend on the block. numpy adds up the sums of a block of one run in another order.
    """
    alone = task.filter.mixes_runs or task.filter.loops_over_runs or task.hold_out
    if alone or task.width == 1 or foreign_parts((task.scenario, task.filter, task.assume)):
        return 1
    # The blocks' particles fit in the cache, and their tracks in memory.
    most = min(_run_limit(task.filter), _STACKED // len(task.scenario.steps))
    return max(1, min(MOST_STACKED, most // task.width))


def _run_limit(tracker: AnyFilter) -> int:
    """Return how many runs may be filtered together: their particles fit in the processor's cache.

    Some filters take more particles in a few steps (a boost), which need only fit in the memory.
    """
    usual = _PARTICLES_AT_A_TIME // tracker.particle_count
    boosted = _BOOSTED_AT_A_TIME // tracker.max_particle_count
    return min(usual, boosted)
