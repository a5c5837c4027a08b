"""Cache of the results of functions of constant matrices, such as a gain in its steady state."""

from collections.abc import Callable
from functools import wraps
from itertools import chain
from typing import Any, TypeVar, cast

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.read_only import fixed, memory_owner

F = TypeVar("F", bound=Callable[..., Any])


_LIMIT = 4096  # results per function, a few hundred bytes each: two tracks of 1700 steps
_caches: list[dict[Any, Any]] = []
results_by_identity: list[dict[tuple[int, ...], tuple[tuple[Array, ...], Any]]] = []


def cached_if_constant(function: F) -> F:
    """Cache the results of a function of constant matrices; call it if a matrix has a batch axis.

    The blocks of a batch, the points of a grid and the steps of a filter in its steady state then share
    one covariance recursion. Results depend on the arguments' values only: the function always receives
    constant matrices in C order, since the order of a sum can depend on the layout. Arrays of `fixed`,
    which nothing can change, are first looked up by identity, in a quarter of the time that a look-up by
    value takes.

    Parameters
    ----------
    function : callable
        Function of one or more matrices (n, m[, *batch]), which are positional arguments. It returns an
        array or a tuple of arrays.

    Returns
    -------
    callable
        Function of the same arguments. Its results are read-only if every matrix has two axes. If a
        matrix has a batch axis, they are those of ``function`` itself.
    """
    cache: dict[Any, Any] = {}
    by_identity: dict[tuple[int, ...], tuple[tuple[Array, ...], Any]] = {}
    _caches.append(cache)
    results_by_identity.append(by_identity)

    @wraps(function)
    def call(*matrices: Array) -> Any:
        """Return the stored result of equal matrices, or call the function and store its result."""
        if matrices[0].ndim > 2:  # has a batch axis, so it is not constant
            return function(*matrices)
        # Look up by identity first, then by value.
        identities = tuple([id(A) for A in matrices])
        entry = by_identity.get(identities)
        if entry is not None:
            return entry[1]
        if any(A.ndim > 2 for A in matrices):
            return function(*matrices)
        # The key is the content of all matrices.
        key = tuple([(A.dtype.char, A.shape, A.tobytes()) for A in matrices])
        result = cache.get(key)
        if result is None:
            computed = function(*map(np.ascontiguousarray, matrices))
            result = tuple(map(fixed, computed)) if isinstance(computed, tuple) else fixed(computed)
            _store(cache, key, result)
        # Only arrays whose memory is immutable bytes, as `fixed` makes them, keep their content: others
        # may be written to, and then have another result. The entry keeps the matrices alive, so that no
        # other array gets their identities.
        if all(isinstance(memory_owner(A), bytes) for A in matrices):
            _store(by_identity, identities, (matrices, result))
        return result

    return cast(F, call)


def _store(cache: dict[Any, Any], key: Any, value: Any) -> None:
    """Store a value in a cache that keeps the latest results."""
    if len(cache) >= _LIMIT:
        del cache[next(iter(cache))]  # the oldest
    cache[key] = value


def cached_results() -> list[Any]:
    """List all cached results."""
    return [*chain.from_iterable(cache.values() for cache in _caches)]


def clear_caches() -> None:
    """Empty all caches, to measure what a new process does."""
    for cache in (*_caches, *results_by_identity):
        cache.clear()
