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

    Parameters
    ----------
    a : array
        Vector or matrix: its component axes, then its batch axes, if it has any.
    batch_ndim : int
        Number of batch axes of the result.
    leading : int
        Number of component axes: 1 for a vector, 2 for a matrix.

    Returns
    -------
    array
        A view of ``a``, or ``a`` itself if it has as many batch axes or more.
    """
    missing = batch_ndim + leading - a.ndim
    if missing <= 0:
        return a
    return a.reshape(a.shape + (1,) * missing)


def with_axes_of(model: Array, a: Array) -> Array:
    """Append axes of length one to ``a`` until it has as many axes as ``model``.

    Parameters
    ----------
    model : array
        Array whose number of axes counts. Its entries have no effect.
    a : array
        Array with as many component axes as ``model``, and as many batch axes or fewer.

    Returns
    -------
    array
        A view of ``a``, or ``a`` itself if it has as many axes or more.
    """
    return with_trailing(a, model.ndim, leading=0)


def as_slice(rows: Sequence[int]) -> slice | Sequence[int]:
    """Turn evenly spaced row numbers into a slice, which needs no copy, and others into a list.

    Parameters
    ----------
    rows : sequence of int
        Row numbers, none of them negative.

    Returns
    -------
    slice or list of int
        Index of the rows in their order. It is a slice if they rise in equal steps.
    """
    if len(rows) == 0:
        return []
    step = rows[1] - rows[0] if len(rows) > 1 else 1
    is_even = step > 0 and list(rows) == list(range(rows[0], rows[-1] + 1, step))
    if is_even:
        return slice(rows[0], rows[-1] + 1, step)
    return list(rows)


def any_nan(a: Array) -> bool:
    """Test whether any entry is NaN.

    Parameters
    ----------
    a : array
        Floats in any shape.

    Returns
    -------
    bool
        False for an empty array.
    """
    if compiled.kernels:
        has_nan = compiled.kernels.any_nan(a)
        if has_nan is not None:  # an array that the kernel can read
            return bool(has_nan)
    return bool(np.isnan(a).any())


def all_finite(a: Array) -> bool:
    """Test whether all entries are finite numbers.

    Parameters
    ----------
    a : array
        Floats in any shape.

    Returns
    -------
    bool
        False if an entry is NaN or infinite, and True for an empty array.
    """
    if compiled.kernels:
        has_not_finite = compiled.kernels.any_not_finite(a)
        if has_not_finite is not None:  # an array that the kernel can read
            return not has_not_finite
    return bool(np.isfinite(a).all())


def is_float64(a: Array, shape: tuple[int, ...]) -> bool:
    """Test whether an array has this shape and the type float64, as a C kernel needs it."""
    return a.shape == shape and a.dtype == np.float64


def choose(mask: Mask, a: Array, b: Array) -> Array:
    """Take ``a`` where the mask is True, else ``b``.

    Parameters
    ----------
    mask : array (*batch) of bool
        Choice for each batch member. It applies to all its components.
    a, b : array (n, *batch) or (*batch)
        Values to choose from, whose shapes are broadcast against each other.

    Returns
    -------
    array (n, *batch) or (*batch)
        Chosen values, a new array.
    """
    alike = a.shape == b.shape and a.shape[a.ndim - mask.ndim :] == mask.shape
    if compiled.kernels and alike and a.dtype == b.dtype == np.float64 and mask.dtype == np.bool_:
        out = np.empty(a.shape)
        mask = np.ascontiguousarray(mask)
        compiled.kernels.choose(mask, np.ascontiguousarray(a), np.ascontiguousarray(b), out)
        return out
    return np.where(mask, a, b)
