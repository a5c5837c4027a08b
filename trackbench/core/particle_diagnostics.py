"""Diagnostics of particle sets: effective sample size, share of distinct particles, spread."""

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.sums import dot, mean, total


def effective_sample_size(w: Array) -> Array:
    """Return 1 / sum w^2 (M,), between 1 and N."""
    return np.asarray(1.0 / dot(w, w))


def distinct_share(x: Array) -> Array:
    """Return the share (M,) of distinct values in x (M, N), whose copies stand side by side."""
    # Copies are neighbors: count the changes from one particle to the next.
    return np.asarray((1 + (x[:, 1:] != x[:, :-1]).sum(axis=-1)) / x.shape[-1])


def spread(x: Array) -> Array:
    """Compute the root mean square distance from the center (M,)."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.sqrt(total(mean(np.square(x - mean(x)[..., None])), axis=0))
