"""Truth outside a filter's own region: a NEES that a consistent filter exceeds with probability 1e-6."""

from functools import cache

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.singular_nees import by_rank


def outside_region(nees: Array, n: int, rank: Array | None) -> Array:
    """Return where the truth is outside the filter's own region.

    It is outside if the NEES is beyond what a consistent filter exceeds with the probability 1e-6.

    Parameters
    ----------
    nees
        normalized errors squared (T + 1, M) of states of n components
    n
        number of components
    rank
        ranks (T + 1, M) of the covariances; None if they are n everywhere

    Returns
    -------
    array (T + 1, M)
        1 outside, else 0; NaN where the NEES is
    """

    def is_outside_region(squared: Array, r: int) -> Array:
        """Return 1 where a NEES of rank r exceeds its quantile of 1 - 1e-6, else 0."""
        # A NEES of rank r is stored times n / r.
        return np.asarray(squared * (r / n) > _limit_of_region(r), dtype=float)

    outside = by_rank(is_outside_region, nees, n, rank)
    return np.where(np.isnan(nees), np.nan, outside)


@cache
def _limit_of_region(n_x: int) -> float:
    """Return the value that a chi-square variable of n_x degrees exceeds with probability 1e-6."""
    from scipy.special import chdtri

    return float(chdtri(n_x, 1e-6))
