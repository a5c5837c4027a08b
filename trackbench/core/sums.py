"""Sums in a fixed order, so that their last bit is equal on every machine and with every numpy.

numpy and BLAS add the elements of a row in an order that depends on the processor and the version. Here
rows are added to each other in order, by elementwise sums only. A long row is cut into blocks, which
are added as rows, and their sum is cut again into smaller blocks.
"""

from math import prod
from typing import Literal

import numpy as np

from trackbench.core import compiled
from trackbench.core.arrays import Array, Mask

_BLOCKS = ((4096, 512), (256, 128))  # length from which a row is cut, and into what


def total(a: Array, axis: Literal[0, -1] = -1) -> Array:
    """Sum an array over its first or last axis, in an order that is equal on every machine.

    Parameters
    ----------
    a : array (n, ...) or (..., n)
        Numbers.
    axis : {0, -1}
        Axis of the sum.

    Returns
    -------
    array (...)
        Sums, without the axis.
    """
    if axis == 0:
        return _in_order(a.reshape(len(a), prod(a.shape[1:]))).reshape(a.shape[1:])[()]
    n = a.shape[-1]
    if compiled.kernels and a.dtype == np.float64:
        out = np.empty(a.shape[:-1])
        compiled.kernels.total(np.ascontiguousarray(a), out, n)
        return out[()]
    rows = a.reshape(prod(a.shape[:-1]), n)
    # Long rows: sum blocks first.
    for least, block in _BLOCKS:
        if rows.shape[1] >= least:
            rows = _by_blocks(rows, block)
    return _in_order(rows.T).reshape(a.shape[:-1])[()]


def total_of_known(rows: Array) -> Array:
    """Sum over the first axis; NaN is left out.

    Parameters
    ----------
    rows : array (n, ...)
        Numbers.

    Returns
    -------
    array (...)
        Sums, 0 where all numbers are NaN.
    """
    return total(np.where(np.isnan(rows), 0.0, rows), axis=0)


class WindowSums:
    """Sums over the steps of W windows for each of M runs, of values that come in pieces of steps.

    ``total`` (W, M) leaves out NaN, and ``number`` (W, M) counts the other values.

    Parameters
    ----------
    windows : array (W, T)
        True where a step is in a window.
    M : int
        Number of runs.
    """

    def __init__(self, windows: Mask, M: int) -> None:
        self._windows = windows
        self.total, self._gaps = np.zeros((2, len(windows), M))

    def add(self, rows: Array, first: int) -> None:
        """Add the values of some steps that follow each other.

        Parameters
        ----------
        rows : array (S, M)
            Values of S steps in M runs. NaN is left out of the sums.
        first : int
            Index of the first of these steps.
        """
        windows = np.ascontiguousarray(self._windows[:, first : first + len(rows)])
        if compiled.kernels and rows.dtype == np.float64:
            rows = np.ascontiguousarray(rows)
            compiled.kernels.window_sums(windows, rows, self.total, self._gaps, rows.shape[1])
            return
        missing = np.isnan(rows)
        known = np.where(missing, 0.0, rows)
        # Each window has its sums so far (M,), its numbers of NaN (M,), and a mask of the S steps.
        for so_far, gaps, in_window in zip(self.total, self._gaps, windows, strict=True):
            gaps += missing[in_window].sum(axis=0)
            so_far[:] = total(np.vstack([so_far, known[in_window]]), axis=0)

    @property
    def number(self) -> Array:
        """Number of values in each sum, NaN not counted."""
        return self._windows.sum(axis=1)[:, None] - self._gaps


def dot(a: Array, b: Array) -> Array:
    """Compute ``sum_j a_j b_j`` over the last axis.

    Parameters
    ----------
    a, b : array (..., n)
        Factors. One of the two may lack leading axes of the other.

    Returns
    -------
    array (...)
        Sums.
    """
    if compiled.kernels and a.dtype == b.dtype == np.float64:
        if a.ndim < b.ndim:
            return dot(b, a)
        if a.shape[a.ndim - b.ndim :] == b.shape and b.size:
            out = np.empty(a.shape[:-1])
            a = np.ascontiguousarray(a)
            b = np.ascontiguousarray(b)
            compiled.kernels.dot(a, b, out, a.shape[-1])
            return out[()]
    return total(a * b)


def mean(a: Array, axis: Literal[0, -1] = -1) -> Array:
    """Average over the first or the last axis.

    Parameters
    ----------
    a : array (n, ...) or (..., n)
        Numbers, n >= 1.
    axis : {0, -1}
        Axis of the average.

    Returns
    -------
    array (...)
        Averages, without the axis.
    """
    return total(a, axis) / a.shape[axis]


def _by_blocks(rows: Array, block: int) -> Array:
    """Cut each row of (r, n) into blocks of ``block`` numbers, and add these elementwise to (r, block).

    The last block may be shorter.
    """
    n = rows.shape[1]
    whole = n - n % block
    # Add the whole blocks elementwise.
    sums = np.add.reduce(rows[:, :whole].reshape(len(rows), -1, block), axis=1)
    # Add the shorter last block.
    if whole < n:
        sums[:, : n - whole] += rows[:, whole:]
    return sums


def _in_order(rows: Array) -> Array:
    """Sum (m,) of rows (n, m), from the first to the last."""
    if rows.shape[1] == 1 and len(rows):  # numpy would take the column for a row
        return np.add.accumulate(rows[:, 0])[-1:]
    return np.add.reduce(np.ascontiguousarray(rows), axis=0)
