"""Standard error by the jackknife."""

from collections.abc import Sequence

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.sums import mean, total


def jackknife_stderr(without: Sequence[Array]) -> Array:
    """Return the jackknife's standard error of a value from the B values without one batch each.

    ``sqrt((B - 1) / B sum (b_i - mean b)^2)`` (Efron & Stein 1981). It is NaN if there are no batches.
    """
    B = len(without)
    if not B:
        return np.array(np.nan)
    b = np.array(without)
    return np.sqrt((B - 1) / B * total(np.square(b - mean(b, 0)), 0))
