"""Sums in an order of our own, so that their last bit is the same on every machine and with every numpy.

numpy and BLAS add the elements of a row in an order that follows the processor and the version. Here
rows are added to each other, one after the other: nothing but elementwise sums. A long row is cut into
blocks, which are such rows.
"""

from math import frexp, ldexp, prod

import numpy as np

from trackbench.core.arrays import Array

_SHORT, _LONG = 128, 512  # lengths of a block


def total(a: Array, axis: int = -1) -> Array:
    """Sum over an axis of any length."""
    n = a.shape[axis]
    if axis in (-1, a.ndim - 1) and n >= 2 * _SHORT:
        block = _LONG if n >= 8 * _LONG else _SHORT
        whole = n - n % block
        blocks = a[..., :whole].reshape(*a.shape[:-1], -1, block)
        sums = np.add.reduce(blocks, axis=-2)
        sums[..., : n - whole] += a[..., whole:]
        return _in_order(np.moveaxis(sums, -1, 0))
    return _in_order(np.moveaxis(a, axis, 0))


def dot(a: Array, b: Array) -> Array:
    """``sum_j a_j b_j`` over the last axis."""
    return total(a * b)


def product(A: Array, B: Array) -> Array:
    """``A B`` (r, ..., p) of A (r, ..., n) and B (n, p), n <= 128, to some 45 bits of the largest.

    Each factor is the sum of two with 23 bits (Ozaki et al. 2012). Their products are whole numbers that
    a sum of 128 holds exactly, so that BLAS may add them in any order.
    """
    B1, B2 = _halves(B)
    out = np.empty((*A.shape[:-1], B.shape[1]))
    for rows, found in zip(A, out, strict=True):  # a piece that stays in the cache
        A1, A2 = _halves(rows)
        np.matmul(A1, B2, out=found)
        found += A2 @ B1
        found += A1 @ B1
    return out


def mean(a: Array, axis: int = -1) -> Array:
    """Mean over an axis that is not empty."""
    return total(a, axis) / a.shape[axis]


def _halves(a: Array) -> tuple[Array, Array]:
    """The leading 23 bits of each number, counted from the largest one's, and the next 23."""
    _, exponent = frexp(max(a.max(), -a.min()))
    out, rest = [], a
    for bits in (23, 46):
        rounding = ldexp(1.5, exponent + 52 - bits)  # what is added to it loses its lower bits
        head = rest + rounding
        head -= rounding
        out.append(head)
        rest = rest - head
    return out[0], out[1]


def _in_order(rows: Array) -> Array:
    """Sum over the first axis, from the first to the last."""
    flat = np.ascontiguousarray(rows).reshape(len(rows), prod(rows.shape[1:]))
    if flat.shape[1] == 1 and len(rows):  # numpy would take the column for a row
        return np.add.accumulate(flat[:, 0])[-1].reshape(rows.shape[1:])[()]
    return np.add.reduce(flat, axis=0).reshape(rows.shape[1:])
