"""Cache for functions of matrices: what does not depend on the data is computed once for all runs."""

from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar, cast

import numpy as np

from trackbench.core.arrays import Array, fixed

F = TypeVar("F", bound=Callable[..., Any])

_LIMIT = 4096  # results per function, a few hundred bytes each: two tracks of 1700 steps
_caches: list[dict[Any, Any]] = []


def once(function: F) -> F:
    """Cache the results of a function of constant matrices; call it if a matrix has a batch axis.

    The blocks of a batch, the points of a grid and the steps of a filter in its steady state then share
    one covariance recursion. Results are read-only. They depend on the arguments' values only, because
    the function always receives matrices in C order.
    """
    cache: dict[Any, Any] = {}
    _caches.append(cache)

    @wraps(function)
    def call(*matrices: Array) -> Any:
        # A matrix with a batch axis is not constant: compute directly.
        for A in matrices:
            if A.ndim > 2:
                return function(*matrices)
        # The key is the content of all matrices.
        key = tuple([(A.dtype.char, A.shape, A.tobytes()) for A in matrices])
        result = cache.get(key)
        if result is None:
            computed = function(*map(np.ascontiguousarray, matrices))
            result = tuple(map(fixed, computed)) if isinstance(computed, tuple) else fixed(computed)
            if len(cache) >= _LIMIT:
                del cache[next(iter(cache))]  # the oldest
            cache[key] = result
        return result

    return cast(F, call)


def cached_results() -> list[Any]:
    """Return all cached results."""
    return [result for cache in _caches for result in cache.values()]


def clear_caches() -> None:
    """Empty all caches, to measure what a new process does."""
    for cache in _caches:
        cache.clear()
