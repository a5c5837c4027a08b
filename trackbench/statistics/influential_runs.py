"""Influential runs: numbers without a batch of runs, or with few runs changed.

They show if a verdict depends on these runs.
"""

import numpy as np

from trackbench.core.arrays import Mask
from trackbench.statistics.estimate_of_recording import OfSteps
from trackbench.statistics.estimates import RunEstimate, Share


def without_each_batch(number: RunEstimate, batches: int) -> list[RunEstimate]:
    """Return estimates of a number that leave out one batch of consecutive runs each.

    The estimates are of first order in the influences, which is exact for means and shares.

    Parameters
    ----------
    number
        number with influences (M,) of the runs
    batches
        number of batches into which the runs are split

    Returns
    -------
    list of RunEstimate
        one estimate for each batch. Empty without influences, for fewer than two batches, and for a
        recording (`OfSteps`): it is a single run, and its influences are those of its steps
    """
    if isinstance(number, OfSteps) or number.influences is None or batches < 2:
        return []
    M = len(number.influences)
    batch_of_run = np.arange(M) * batches // M
    return [_from_runs(number, batch_of_run != i) for i in range(batches)]


def _from_runs(number: RunEstimate, runs: Mask) -> RunEstimate:
    """Return the estimate from some of the runs, given by the mask ``runs`` (M,)."""
    assert number.influences is not None
    term = number.from_other_runs(number.influences[runs])
    if number.pair is None:
        return term
    a, b, factor = number.pair
    return term._replace(pair=(_from_runs(a, runs), _from_runs(b, runs), factor))


def with_few_runs_changed(number: RunEstimate) -> list[RunEstimate]:
    """Return a number under two changes of the runs, to see if its verdict depends on few of them.

    The first is without the run of largest influence, the second with three more runs of twice this
    influence: an event that none of M runs had may have a probability of 3 / M.

    Parameters
    ----------
    number
        number with influences (M,) of the runs

    Returns
    -------
    list of RunEstimate
        both numbers. Empty for shares, whose test counts such events, for a recording, which is a single
        run, without influences and for fewer than three runs
    """
    if isinstance(number, OfSteps):
        return []
    tested = number
    if number.pair is not None:
        # The pair (a, b, factor) is that of a difference a - factor b. a and b are both shares, or both
        # variances.
        tested, _, _ = number.pair
    if number.influences is None or isinstance(tested, Share):
        return []
    x = number.influences[~np.isnan(number.influences)]
    if len(x) < 3:
        return []
    farthest = int(np.argmax(np.abs(x)))
    with_three_more = np.append(x, np.full(3, 2.0 * x[farthest]))
    return [
        number.from_other_runs(np.delete(x, farthest)),
        number.from_other_runs(with_three_more),
    ]
