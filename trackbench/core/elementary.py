"""Elementary functions whose last bit is the same on every machine, with every numpy and C library.

numpy takes exp, log, arctan2 and others from the C library or from code of its own for the processor
at hand. These differ in the last bit, which a particle filter makes into another run. Here they are
made of elementwise sums, products, quotients, roots and table look-ups alone, whose results IEEE 754
fixes, in pieces that stay in the processor's cache. Relative errors: 1e-15 of `exp`, and those of
rounding its argument; of `log` 2e-16, or 1e-17 in itself near one; of angles and of sines 3e-16.

Each function takes arrays of any shape, or numbers, and returns float64 of the same shape. Of a float
the value is remembered: a filter asks for the same at every step. Outside of a fast kernel's range
(zeros, infinities, NaN) the value is that of numpy's function of the same name; subnormal results are
zero.
"""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from trackbench.core import _elementary_kernels
from trackbench.core.arrays import Array

_PIECE = 8192


def exp(x: ArrayLike, out: Array | None = None) -> Array:
    """Return ``e^x``; zero below -708. ``out`` may be x itself."""
    return _piecewise(_elementary_kernels.exp, x, out)


def exp_of_moderate(x: Array) -> Array:
    """Compute `exp` in place for a contiguous x that is NaN or in [-708, 709], unchecked."""
    return _piecewise(_elementary_kernels.exp_of_moderate, x, x)


def log(x: ArrayLike, out: Array | None = None) -> Array:
    """Return the natural logarithm. ``out`` may be x itself."""
    return _piecewise(_elementary_kernels.log, x, out)


def cos_sin(a: ArrayLike) -> tuple[Array, Array]:
    """Return the cosine and sine of angles, rad."""
    if isinstance(a, float):
        return _cos_sin_of_number(a)
    a = np.asarray(a, dtype=float)
    flat = np.ascontiguousarray(a).reshape(-1)
    c, s = np.empty(flat.shape), np.empty(flat.shape)
    for i in range(0, len(flat), _PIECE):
        piece = slice(i, i + _PIECE)
        _elementary_kernels.cos_sin(flat[piece], c[piece], s[piece])
    return c.reshape(a.shape)[()], s.reshape(a.shape)[()]


def arctan2(y: Array, x: Array) -> Array:
    """Return the angle of (x, y) in [-pi, pi]; y and x have one shape; arctan2(+-0, -0) is +-0."""
    y, x = np.asarray(y, dtype=float), np.asarray(x, dtype=float)
    flat_y, flat_x = (np.ascontiguousarray(a).reshape(-1) for a in (y, x))
    out = np.empty(flat_y.shape)
    for i in range(0, len(out), _PIECE):
        piece = slice(i, i + _PIECE)
        _elementary_kernels.arctan2(flat_y[piece], flat_x[piece], out[piece])
    return out.reshape(y.shape)[()]


def expm1(x: ArrayLike) -> Array:
    """Return ``e^x - 1`` without the loss of digits near zero."""
    x = np.asarray(x, dtype=float)
    small = np.clip(x, -0.5, 0.5)
    series = np.ones_like(small)
    for n in range(16, 1, -1):
        series = 1.0 + series * small / n
    return np.where(np.abs(x) <= 0.5, small * series, exp(x) - 1.0)[()]


def sinh(x: ArrayLike) -> Array:
    """Return the hyperbolic sine."""
    return 0.5 * (expm1(x) - expm1(-np.asarray(x, dtype=float)))


def logaddexp(a: Array, b: ArrayLike) -> Array:
    """Return ``log(e^a + e^b)``."""
    top, low = np.maximum(a, b), np.minimum(a, b)
    with np.errstate(invalid="ignore"):
        less = np.where(top == low, 0.0, low - top)  # two infinities of one sign are equal
    return top + log(1.0 + exp(less))


def power(x: ArrayLike, y: float) -> Array:
    """Return ``x^y`` for x >= 0; a whole y of up to 16 by multiplication."""
    x = np.asarray(x, dtype=float)
    if y == int(y) and 0 <= y <= 16:
        product = x if y else np.ones_like(x)
        for _ in range(int(y) - 1):
            product = product * x
        return product[()]
    with np.errstate(divide="ignore", invalid="ignore"):
        return exp(y * log(x))


def log_gamma(x: float) -> float:
    """Return log Gamma(x) for x > 0: Stirling's series, with recursion below 10."""
    below = 1.0
    while x < 10.0:
        below *= x
        x += 1.0
    square = 1.0 / (x * x)
    series = -1.0 / 360.0 + square * (1.0 / 1260.0 + square * (-1.0 / 1680.0 + square / 1188.0))
    rest = (1.0 / 12.0 + square * series) / x
    half_log_turn = 0.5 * float(log(2.0 * _elementary_kernels.constants().pi))
    return (x - 0.5) * float(log(x)) - x + half_log_turn + rest - float(log(below))


Elementwise = Callable[[Array, Array], None]


def _piecewise(kernel: Elementwise, x: ArrayLike, out: Array | None) -> Array:
    if isinstance(x, float):
        return _of_number(kernel, x)
    x = np.asarray(x, dtype=float)
    flat = np.ascontiguousarray(x).reshape(-1)
    in_place = out is not None and out.flags.c_contiguous
    target = out.reshape(-1) if out is not None and in_place else np.empty(flat.shape)
    for i in range(0, len(flat), _PIECE):
        piece = slice(i, i + _PIECE)
        kernel(flat[piece], target[piece])
    if out is None:
        return target.reshape(x.shape)[()]
    if not in_place:
        out[...] = target.reshape(x.shape)
    return out


@lru_cache(maxsize=4096)
def _of_number(kernel: Elementwise, x: float) -> Array:
    out = np.empty(1)
    kernel(np.array([x]), out)
    return out[0]


@lru_cache(maxsize=4096)
def _cos_sin_of_number(a: float) -> tuple[Array, Array]:
    c, s = np.empty(1), np.empty(1)
    _elementary_kernels.cos_sin(np.array([a]), c, s)
    return c[0], s[0]
