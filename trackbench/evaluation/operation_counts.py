"""Operation counts: likelihoods and covariance updates of a filter at each step."""

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.counted_operations import counting
from trackbench.core.random_streams import block_stream
from trackbench.core.read_only import freeze
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.run_filter import prior_of
from trackbench.evaluation.simulated_runs import simulate

_COUNTED = 2000
"""Steps in which operations are counted, at most."""


def operations(task: BlockTask) -> Array:
    """Count the likelihoods and covariance updates that the filter computes at each step.

    They are those of one run, in its first `_COUNTED` steps, and equal on every machine.

    Parameters
    ----------
    task
        task of the filter

    Returns
    -------
    array (2, S)
        likelihoods and covariance updates at each of the first S steps
    """
    tracker = task.filter
    model = freeze(task.assumed_scenario.model)
    data = simulate(task.scenario.without_scoring, task.seed, 0, 1)  # run 0
    rng = block_stream(task.seed, 0)
    state = tracker.init(model, prior_of(data, model), rng)
    numbers = []
    # Count the operations of the first steps of one run.
    for i, k in enumerate(task.scenario.steps[1 : _COUNTED + 1].tolist()):
        with counting() as counts:
            state = tracker.step(model, state, data.measurements[:, i], k, rng)
        numbers.append([counts["likelihoods"], counts["covariances"]])
    return np.array(numbers, dtype=np.float64).T


def shares_of_steps(counts: Array, T: int) -> Array:
    """Return the share of each step in a run's work.

    Parameters
    ----------
    counts
        likelihoods and covariance updates (2, S) at the first S steps, as `operations` returns them
    T
        number of steps of the run

    Returns
    -------
    array (T,)
        shares. Steps that were not counted have an average share. So have all if a step has no counted
        operation
    """
    weights = np.full(T, 1.0 / T)
    of_step = counts.sum(axis=0)
    if of_step.all():
        weights[: len(of_step)] *= of_step / of_step.mean()
    return weights
