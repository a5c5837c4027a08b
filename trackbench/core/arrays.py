"""Array types, and the convention for batch axes.

A state is ``(n_x, *batch)``, a covariance ``(n_x, n_x, *batch)``; ``batch`` is ``(M,)`` for M runs
and ``(M, N)`` for N particles in each of M runs. ``px, vx, py, vy = x`` then is a line of code.
"""

from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from trackbench.core import compiled

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.intp]
T = TypeVar("T")
A = TypeVar("A", bound=np.ndarray[Any, Any])


def with_trailing(a: Array, batch_ndim: int, leading: int = 1) -> Array:
    """Append axes of length one to ``a`` until it has ``batch_ndim`` batch axes.

    ``leading`` is the number of component axes (1 for a vector, 2 for a matrix).
    """
    missing = batch_ndim + leading - a.ndim
    if missing <= 0:
        return a
    return a.reshape(a.shape + (1,) * missing)


def with_axes_of(model: Array, a: Array) -> Array:
    """Append axes of length one to ``a`` until it has as many as ``model``."""
    return with_trailing(a, model.ndim, leading=0)


def as_slice(rows: Sequence[int]) -> slice | Sequence[int]:
    """Turn evenly spaced row numbers into a slice, which needs no copy, and others into a list."""
    if len(rows) == 0:
        return []
    step = rows[1] - rows[0] if len(rows) > 1 else 1
    is_even = step > 0 and list(rows) == list(range(rows[0], rows[-1] + 1, step))
    if is_even:
        return slice(rows[0], rows[-1] + 1, step)
    return list(rows)


def any_nan(a: Array) -> bool:
    """Test whether any entry is NaN."""
    if compiled.kernels:
        has_nan = compiled.kernels.any_nan(a)
        if has_nan is not None:  # an array that the kernel can read
            return bool(has_nan)
    return bool(np.isnan(a).any())


def all_finite(a: Array) -> bool:
    """Test whether all entries are finite numbers."""
    if compiled.kernels:
        has_not_finite = compiled.kernels.any_not_finite(a)
        if has_not_finite is not None:  # an array that the kernel can read
            return not has_not_finite
    return bool(np.isfinite(a).all())


def is_float64(a: Array, shape: tuple[int, ...]) -> bool:
    """Test whether an array has this shape and the type float64, as a C kernel needs it."""
    return a.shape == shape and a.dtype == np.float64


def choose(mask: Mask, a: Array, b: Array) -> Array:
    """Take a where the mask (*batch) is True, else b, for arrays (n, *batch) or (*batch)."""
    alike = a.shape == b.shape and a.shape[a.ndim - mask.ndim :] == mask.shape
    if compiled.kernels and alike and a.dtype == b.dtype == np.float64 and mask.dtype == np.bool_:
        out = np.empty(a.shape)
        mask = np.ascontiguousarray(mask)
        compiled.kernels.choose(mask, np.ascontiguousarray(a), np.ascontiguousarray(b), out)
        return out
    return np.where(mask, a, b)
