"""Functions of matrices that compute what does not depend on the data once for all runs."""

from collections.abc import Callable
from functools import lru_cache, wraps
from typing import Any, TypeVar, cast

import numpy as np

from trackbench.core.arrays import Array, fixed

F = TypeVar("F", bound=Callable[..., Any])

_REMEMBERED = 4096  # results per function, a few hundred bytes each: two tracks of 1700 steps
_memories: list[Any] = []


def once(function: F) -> F:
    """Remember what a function made of constant matrices ``(n, m)``; with a batch axis it is called.

    The blocks of a batch, the points of a grid and the steps of a filter that has come to its steady
    state then share one covariance recursion. Results are read-only, and depend on the arguments'
    values only: a matrix is always handed on in C order.
    """

    @lru_cache(maxsize=_REMEMBERED)
    def remembered(*matrices: tuple[str, tuple[int, ...], bytes]) -> Any:
        made = function(*map(_array, matrices))
        return tuple(map(fixed, made)) if isinstance(made, tuple) else fixed(made)

    _memories.append(remembered)

    @wraps(function)
    def call(*matrices: Array) -> Any:
        for A in matrices:
            if A.ndim > 2:
                return function(*matrices)
        return remembered(*[(A.dtype.char, A.shape, A.tobytes()) for A in matrices])

    return cast(F, call)


def forget() -> None:
    """Empty all memories, for measuring what a new process does."""
    for memory in _memories:
        memory.cache_clear()


def _array(matrix: tuple[str, tuple[int, ...], bytes]) -> Array:
    kind, shape, values = matrix
    return np.frombuffer(values, kind).reshape(shape)
