"""Diagnostics of particle sets: effective sample size, share of distinct particles, spread."""

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.sums import dot, mean, total


def effective_sample_size(w: Array) -> Array:
    """Return ``1 / sum w^2``, between 1 and N.

    Parameters
    ----------
    w : array (M, N)
        Normalized weights.

    Returns
    -------
    array (M,)
        Effective sample size of each run.
    """
    return np.asarray(1.0 / dot(w, w))


def distinct_share(x: Array) -> Array:
    """Return the share (M,) of distinct values in x (M, N), whose copies stand side by side."""
    # Copies are neighbors: count the changes from one particle to the next.
    return np.asarray((1 + (x[:, 1:] != x[:, :-1]).sum(axis=-1)) / x.shape[-1])


def effective_share(w: Array) -> Array:
    """Return the effective sample size of weights w (M, N) as a share of N (M,): diagnostic ``ess``."""
    return effective_sample_size(w) / w.shape[-1]


def spread_ratio(x: Array, before: Array) -> Array:
    """Return the spread of particles as a share of their spread before.

    The spread is the root mean square distance of particles, by equal weights, from their center.

    Parameters
    ----------
    x : array (n, M, N)
        Particles.
    before : array (n, M, N)
        Particles before a step of the filter.

    Returns
    -------
    array (M,)
        Ratio of the two spreads in each run.
    """
    return _spread(x) / _spread(before)


def _spread(x: Array) -> Array:
    """Compute the root mean square distance from the center (M,)."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.sqrt(total(mean(np.square(x - mean(x)[..., None])), axis=0))
