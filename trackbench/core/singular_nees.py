"""NEES of a covariance that may be singular: squared distance and degrees of freedom."""

from collections.abc import Callable

import numpy as np

from trackbench.core import linalg
from trackbench.core.arrays import Array, with_trailing
from trackbench.core.linalg import distance, whiten_in_range
from trackbench.core.sums import total

_OF_STATE = 1e-12  # share of a component's size below which a standard deviation is rounding
_WITHIN_ROUNDING = 100.0  # squared error, in units of rounding, of a state without spread


@np.errstate(all="ignore")  # the root of a singular matrix is not finite
def distance_in_range(e: Array, P: Array, size: Array) -> tuple[Array, Array | None]:
    """Compute ``e' P^+ e`` of a covariance that may be singular.

    The distance of an error in the range of P is a chi-square of as many degrees of freedom as P has
    directions with spread; that of an error outside is infinite.

    Parameters
    ----------
    e : array (n, *batch)
        Errors.
    P : array (n, n) or (n, n, *batch)
        Covariances.
    size : array (n, *batch)
        Sizes of the components, see `component_size`. A standard deviation below `_OF_STATE` times the
        size counts as rounding.

    Returns
    -------
    squared : array (*batch)
        Squared distances.
    rank : array (*batch) or None
        Rank of P; None if it is full everywhere.
    """
    squared = distance(e, P)
    variance = linalg.diagonal(P)
    pivots = np.square(linalg.diagonal(linalg.cholesky(P)))
    # Step 1: has every direction spread? A quick test, by the largest sizes.
    largest = np.fmax.reduce(size, axis=tuple(range(1, size.ndim)))
    rounding_of_largest = np.square(_OF_STATE * np.nan_to_num(largest))
    rounding_of_largest = with_trailing(rounding_of_largest, pivots.ndim - 1)
    if (pivots > linalg.SINGULAR * variance + rounding_of_largest).all():
        return squared, None
    # Step 2: the root of P without the variances that are rounding.
    variance = with_trailing(variance, e.ndim - 1)
    pivots = with_trailing(pivots, e.ndim - 1)
    L = root_without_rounding(with_trailing(P, e.ndim - 1, leading=2), size)
    # Step 3: L y = e; what a row without spread leaves of e must be rounding.
    y = whiten_in_range(L, e)
    spread = linalg.diagonal(L) > 0.0
    rounding_of_size = np.square(_OF_STATE * size)
    rounding = rounding_of_size + linalg.SINGULAR * variance
    left = np.square(e - linalg.matvec(L, y))
    inside = spread | (left <= _WITHIN_ROUNDING * rounding)
    # Singular: the error is in the range, P has a root, and some pivot of P is rounding.
    has_root = np.isfinite(L).all(axis=(0, 1))
    singular = inside.all(axis=0) & has_root & ~(pivots > rounding).all(axis=0)
    rank = np.where(singular, spread.sum(axis=0), len(P))
    # Outside the range the distance is infinite. `distance` finds that of a Cholesky factor with zeros.
    # That of particles which are equal but for rounding is finite until here.
    equal = variance <= rounding_of_size
    outside = (equal & ~spread & (left > _WITHIN_ROUNDING * rounding)).any(axis=0)
    squared = np.where(outside, np.inf, squared)
    return np.where(singular, total(np.square(y), axis=0), squared), rank


def component_size(truth: Array, estimate: Array) -> Array:
    """Return the larger of the magnitudes of a truth and of its estimate, by component.

    Each is rounded in proportion to its size, so their difference has the rounding of the larger one.

    Parameters
    ----------
    truth : array (n, *batch)
        True states.
    estimate : array (n, *batch)
        Estimated states. A component that is not finite is left out.

    Returns
    -------
    array (n, *batch)
        Sizes, in the components' units.
    """
    size = np.abs(estimate)
    return np.fmax(np.abs(truth), np.where(np.isfinite(size), size, np.nan))


def root_without_rounding(P: Array, size: Array) -> Array:
    """Factor P, with zeros for components whose spread is rounding.

    Parameters
    ----------
    P : array (n, n, *batch)
        Covariances, with as many batch axes as ``size``.
    size : array (n, *batch)
        Sizes of the components, see `component_size`.

    Returns
    -------
    array (n, n, *batch)
        Lower triangle L, as `root_in_range` of linalg returns it.
    """
    known = linalg.diagonal(P) <= np.square(_OF_STATE * size)
    return linalg.root_in_range(np.where(known[:, None] | known[None], 0.0, P))


def by_rank(
    function: Callable[[Array, int], Array], squared: Array, n: int, rank: Array | None
) -> Array:
    """Apply a function to squared distances and their degrees of freedom.

    Parameters
    ----------
    function : callable
        Function of squared distances (*batch) and one number of degrees of freedom. Its values are
        (*batch).
    squared : array (*batch)
        Squared distances.
    n : int
        Number of components, the largest rank.
    rank : array (*batch) or None
        Degrees of freedom of each distance; None if they are n for all.

    Returns
    -------
    array (*batch)
        Values of the function, NaN where the rank is 0.
    """
    value = function(squared, n)
    if rank is None:
        return value
    # The values of rank n are computed already; those of rank 0 have no distance.
    for r in range(1, n):
        if (rank == r).any():
            value = np.where(rank == r, function(squared, r), value)
    return np.where(rank == 0, np.nan, value)
