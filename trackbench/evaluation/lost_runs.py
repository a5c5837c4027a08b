"""Lost runs: why a run does not count in the averages."""

import re

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.scenarios.base import Scenario

_ERROR_OF_TRUTH = re.compile(r"squared(?!_(?:predicted|held)_)")
"""Series of squared errors against the truth, as `squared_position`; not `squared_predicted_range`, of
a measurement"""
NOT_LOST = 0.0
NOT_FINITE = 1.0
TOO_FAR = 2.0
NO_TRUTH = 3.0
LOST_BECAUSE = {
    NOT_FINITE: "the estimate left the numbers",
    TOO_FAR: "the error passed the limit",
    NO_TRUTH: "the scenario's true state left the numbers",
}


def lost_runs(
    scenario: Scenario,
    values: dict[str, Array],
    finite: Mask,
    finite_truth: Mask | None = None,
) -> Array:
    """Return why each run is lost.

    A run is lost if an estimate or an error is not finite, if the error exceeds the scenario's
    ``lost_beyond``, or if the simulated truth is not finite. An error that is NaN, as at a step without
    a truth, loses no run.

    Parameters
    ----------
    scenario
        scenario, whose ``lost_beyond`` is the limit of its first error, in the unit of this error
    values
        series (T + 1, M) by name, of which the squared errors against the truth count
    finite
        mask (M,) of the runs with finite estimates
    finite_truth
        mask (M,) of the runs with a finite truth; None for a recorded truth

    Returns
    -------
    array (M,)
        key of `LOST_BECAUSE`, or `NOT_LOST`
    """
    # Squared errors against the truth, and not those of predicted measurements.
    squared_errors = [rows for name, rows in values.items() if _ERROR_OF_TRUTH.match(name)]
    # Without a truth only estimates that are not finite count as lost.
    if not squared_errors:
        return np.where(finite, NOT_LOST, NOT_FINITE)
    infinite = np.logical_or.reduce([np.isinf(rows).any(axis=0) for rows in squared_errors])
    lost = np.where(finite & ~infinite, NOT_LOST, NOT_FINITE)
    # The limit is on the first error that the scenario names, such as that of the position.
    limit = scenario.lost_beyond
    if limit is not None:
        too_far = (squared_errors[0] > limit * limit).any(axis=0)
        lost = np.where((lost == NOT_LOST) & too_far, TOO_FAR, lost)
    if finite_truth is not None:
        lost = np.where(finite_truth, lost, NO_TRUTH)
    return lost


def stayed_finite(mean: Array) -> Mask:
    """Return which runs of an estimate are finite at every step.

    Parameters
    ----------
    mean
        estimates (n_x, T + 1, M)

    Returns
    -------
    array (M,)
        mask of the finite runs. Components that the filter never estimates, such as the velocity of a
        converted measurement, are left out
    """
    # A finite sum has finite terms: then no term needs a test, which saves time.
    if np.isfinite(np.add.reduce(mean, axis=None)):
        return np.ones(mean.shape[-1], dtype=np.bool_)
    finite = np.isfinite(mean)
    estimated = finite.any(axis=(1, 2))
    return np.asarray(finite[estimated].all(axis=(0, 1)) & estimated.any())


def has_finite_truth(scenario: Scenario, truth: Array) -> Mask | None:
    """Return which runs of a simulated truth are finite.

    Parameters
    ----------
    scenario
        scenario of the truth
    truth
        true states (n_x, T + 1, M). NaN is allowed where a target may be gone

    Returns
    -------
    array (M,) or None
        mask of the finite runs; None if the truth is recorded
    """
    # An unknown truth of a recording is NaN, which is no failure.
    if scenario.recorded_runs is not None:
        return None
    bad_truth = np.isinf(truth)
    # Elsewhere NaN stands for the state of a target that is gone.
    if scenario.exists_always:
        bad_truth |= np.isnan(truth)
    return ~np.asarray(bad_truth.any(axis=(0, 1)))
