"""Heavy tails: whether a few runs decide a number, by Hill's index of the tail."""

from math import inf, sqrt

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.elementary import log
from trackbench.core.sums import total


def has_heavy_tail(influences: Array) -> bool:
    """Test whether a few runs decide a number: the 95 % limit of the tail's index is below 2.

    Then the runs' influences have no variance, and the number's interval may miss what rarer runs would
    contribute. For Pareto's law with the true index alpha and the estimated index a, ``2 k alpha / a``
    is chi-square of 2 k degrees of freedom.

    Parameters
    ----------
    influences
        influences (M,) of the runs on the number, NaN left out

    Returns
    -------
    bool
        False also if the index cannot be estimated
    """
    from scipy.special import gammaincinv

    index, k = tail_index(influences)
    return bool(k and index * float(gammaincinv(k, 0.95)) / k < 2.0)


def tail_index(influences: Array) -> tuple[float, int]:
    """Return the tail index of the runs' influences, and the number of influences that it is from.

    Moments of a lower order than the index exist. The index is estimated from the k = sqrt(M) / 2
    largest influences (Hill 1975, Ann. Statist. 3, 1163).

    Parameters
    ----------
    influences
        influences (M,) of the runs on a number, NaN left out

    Returns
    -------
    index : float
        tail index; infinite where it cannot be estimated, as for fewer than about a hundred runs, which
        show no tail
    k : int
        number of influences; 0 where the index cannot be estimated
    """
    x = np.sort(np.abs(influences[~np.isnan(influences)]))[::-1]
    k = round(sqrt(len(x)) / 2.0)
    # Hill's estimate needs finite and positive influences, the largest of which are not all equal.
    if k < 5 or not inf > x[0] > x[k] > 0.0:
        return inf, 0
    return float(k / total(log(x[:k] / x[k]))), k
