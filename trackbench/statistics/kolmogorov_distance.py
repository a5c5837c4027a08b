"""Kolmogorov's test of a uniform distribution, with the band about it for few values."""

import numpy as np

from trackbench.core.arrays import Array, Index


def kolmogorov(pit: Array, places: int = 0) -> float:
    """Return the largest distance of the distribution of transforms from the uniform one.

    For ranks the distance is taken at the ends of their places. Its p-value is then an upper bound
    (Conover 1972).

    Parameters
    ----------
    pit
        transforms (M,) from 0 to 1, without NaN, at least one
    places
        number of possible ranks that the transforms are computed from; 0 for others

    Returns
    -------
    float
        distance from 0 to 1
    """
    M = len(pit)
    if places:
        # Share of the ranks up to each place, less its value for uniform ranks.
        shares = np.bincount(cell_of(pit, places), minlength=places) / M
        ends = np.arange(1, places + 1) / places
        return float(np.abs(np.add.accumulate(shares) - ends).max())
    # Otherwise sup |F_M - u| is reached just before or at one of the sorted values.
    ordered = np.sort(pit)
    F_M = np.arange(M + 1) / M
    return float(np.maximum(F_M[1:] - ordered, ordered - F_M[:-1]).max())


def cell_of(pit: Array, cells: int) -> Index:
    """Return which of ``cells`` equal parts of (0, 1) contains each value (M,), counted from 0."""
    return np.clip(pit * cells, 0, cells - 1).astype(int)


def kolmogorov_band(M: int, level: float = 0.95) -> float:
    """Return the Kolmogorov distance that M uniform values exceed with probability 1 - level.

    It is half the width of a band about the uniform distribution function (Stephens 1970).
    """
    from scipy.special import kolmogi

    return float(kolmogi(1.0 - level) / _stephens(M))


def kolmogorov_p(distance: float, M: int) -> float:
    """Return the probability that M uniform values have a larger Kolmogorov distance.

    The approximation is that of Stephens 1970 (JRSS B 32).
    """
    from scipy.special import kolmogorov as beyond

    return float(beyond(distance * _stephens(M)))


def _stephens(M: int) -> float:
    """Return the factor by which a Kolmogorov distance of M values is multiplied (Stephens 1970).

    The product has nearly the distribution of the limit M -> infinity, also for few values.
    """
    root = np.sqrt(M)
    return root + 0.12 + 0.11 / root
