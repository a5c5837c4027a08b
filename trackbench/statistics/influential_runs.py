"""Influential runs: numbers with few runs changed, which show if a verdict depends on them."""

import numpy as np

from trackbench.statistics.estimates import OfSteps, RunEstimate, Share


def with_few_runs_changed(number: RunEstimate) -> list[RunEstimate]:
    """Return the number under two changes of the runs, to see if its verdict depends on few of them.

    The first is without the run of largest influence, the second with three more runs of twice this
    influence: an event that none of M runs had may have a probability of 3 / M. The list is empty for
    shares, whose test counts such events, for a recording, which has no other runs, without influences
    and for fewer than three runs.
    """
    if isinstance(number, OfSteps):
        return []
    tested = number
    if number.pair is not None:
        # Both numbers of a pair are shares, or both are variances.
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
