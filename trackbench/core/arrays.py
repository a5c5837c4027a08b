"""The two array types of the package, and what a batch axis is.

A state is ``(n_x, *batch)``, a covariance ``(n_x, n_x, *batch)``; ``batch`` is ``(M,)`` for M runs
and ``(M, N)`` for N particles in each of M runs. ``px, vx, py, vy = x`` then is a line of code.
"""

from collections.abc import Iterable
from types import ModuleType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.intp]
T = TypeVar("T")


def with_trailing(a: Array, batch_ndim: int, leading: int = 1) -> Array:
    """``a`` with axes of length one appended until it has ``batch_ndim`` batch axes.

    ``leading`` is the number of component axes (1 for a vector, 2 for a matrix).
    """
    return a.reshape(a.shape + (1,) * (batch_ndim + leading - a.ndim))


def with_axes_of(like: Array, a: Array) -> Array:
    """``a`` with axes of length one appended until it has as many as ``like``, so that the two add."""
    return with_trailing(a, like.ndim, leading=0)


def fixed(a: Array) -> Array:
    """``a`` itself, made read-only, for arrays that are kept and handed out again."""
    a.flags.writeable = False
    return a


def frozen(whole: T) -> T:
    """``whole`` itself, every array in its collections and attributes made read-only."""
    waiting: list[Any] = [whole]
    seen: set[int] = set()
    while waiting:
        part = waiting.pop()
        if isinstance(part, np.ndarray):
            fixed(part)
        elif id(part) not in seen:  # parts may refer to each other
            seen.add(id(part))
            waiting += _parts_of(part)
    return whole


def _parts_of(whole: Any) -> Iterable[Any]:
    if isinstance(whole, tuple | list):
        return whole
    if isinstance(whole, dict):
        return whole.values()
    if isinstance(whole, type | ModuleType):
        return ()
    names = {*getattr(whole, "__dict__", ()), *getattr(whole, "__dataclass_fields__", ())}
    return [getattr(whole, name, None) for name in names]
