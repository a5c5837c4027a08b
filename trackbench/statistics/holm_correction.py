"""Holm's correction of the p-values of a family of tests."""

import numpy as np

from trackbench.core.arrays import Array


def holm(p: Array, tests: int = 0) -> Array:
    """Return p-values (n,) adjusted for a family of tests (Holm 1979); a NaN is no test and stays NaN.

    ``tests`` is the size of a family that has more tests than these.
    """
    adjusted = np.full(len(p), np.nan)
    # The smallest p counts n times, the next n - 1 times, ...; none is less than the one before.
    order = np.argsort(p)[: int((~np.isnan(p)).sum())]
    stepped = p[order] * (max(tests, len(order)) - np.arange(len(order)))
    adjusted[order] = np.minimum(np.maximum.accumulate(stepped), 1.0)
    return adjusted
