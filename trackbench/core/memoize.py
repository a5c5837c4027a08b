"""Functions of matrices that compute what does not depend on the data once for all runs."""

from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar, cast

import numpy as np

from trackbench.core.arrays import Array, fixed

F = TypeVar("F", bound=Callable[..., Any])

_REMEMBERED = 4096  # results per function, a few hundred bytes each: two tracks of 1700 steps
_memories: list[dict[Any, Any]] = []


def once(function: F) -> F:
    """Remember the new arrays that a function made of constant matrices; with a batch axis it is called.

    The blocks of a batch, the points of a grid and the steps of a filter that has come to its steady
    state then share one covariance recursion. Results are read-only, and depend on the arguments'
    values only: a matrix is always handed on in C order.
    """

    memory: dict[Any, Any] = {}
    _memories.append(memory)

    @wraps(function)
    def call(*matrices: Array) -> Any:
        for A in matrices:
            if A.ndim > 2:
                return function(*matrices)
        key = tuple([(A.dtype.char, A.shape, A.tobytes()) for A in matrices])
        found = memory.get(key)
        if found is None:
            made = function(*map(np.ascontiguousarray, matrices))
            found = tuple(map(fixed, made)) if isinstance(made, tuple) else fixed(made)
            if len(memory) >= _REMEMBERED:
                del memory[next(iter(memory))]  # the oldest
            memory[key] = found
        return found

    return cast(F, call)


def cached_results() -> list[Any]:
    """Return all results in memory."""
    return [made for memory in _memories for made in memory.values()]


def clear_caches() -> None:
    """Empty all memories, for measuring what a new process does."""
    for memory in _memories:
        memory.clear()
