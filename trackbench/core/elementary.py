"""Elementary functions with the same last bit on every machine, numpy and C library.

numpy takes exp, log and arctan2 from the C library or from processor-specific code. These differ in
the last bit, and a different last bit gives a particle filter a different run. This module uses only
elementwise sums, products, quotients, roots and table look-ups, which IEEE 754 defines exactly.
Relative errors: `exp` 1e-15 plus the rounding of its argument; `log` 2e-16, or an absolute 1e-17 near
one; angles and sines 3e-16, of angles beyond 1e6 rad more (`cos_sin`).

Each function takes arrays of any shape, or numbers, and returns float64 of the same shape. Values of
Python floats are cached. Zeros, infinities and NaN give what numpy's function gives; subnormal results
are zero.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from trackbench.core import elementary_tables, exp_log_sin_arctan
from trackbench.core.arrays import Array
from trackbench.core.exp_log_sin_arctan import Elementwise

_MOST_FACTORS = 16  # of a power by multiplication


def exp(x: ArrayLike, out: Array | None = None) -> Array:
    """Compute ``e^x``.

    Parameters
    ----------
    x : array or float
        Exponents in any shape.
    out : array, optional
        Array of the shape of x that the result is written to. It may be x itself. If x is a float, it
        stays unchanged.

    Returns
    -------
    array
        ``e^x`` in the shape of x, or a number if x is one; ``out`` if an array x is written to it. It
        is zero below -708 and infinite above 709.7.
    """
    return _call_on_any_shape(exp_log_sin_arctan.exp, x, out)


def exp_tables() -> tuple[Array, Array]:
    """Return the powers of two and the constants with which the C kernels compute `exp`."""
    return elementary_tables.powers_of_two(), elementary_tables.exp_constants()


def exp_of_moderate(x: Array) -> Array:
    """Compute `exp` in place for a contiguous float64 x that is NaN or in [-708, 709], unchecked."""
    return _call_on_any_shape(exp_log_sin_arctan.exp_of_moderate, x, x)


def log(x: ArrayLike, out: Array | None = None) -> Array:
    """Compute the natural logarithm.

    Parameters
    ----------
    x : array or float
        Numbers in any shape.
    out : array, optional
        Array of the shape of x that the result is written to. It may be x itself. If x is a float, it
        stays unchanged.

    Returns
    -------
    array
        ``log x`` in the shape of x, or a number if x is one; ``out`` if an array x is written to it. It
        is -inf at zero and NaN below zero.
    """
    return _call_on_any_shape(exp_log_sin_arctan.log, x, out)


def cos_sin(a: ArrayLike) -> tuple[Array, Array]:
    """Compute the cosine and sine of angles.

    Parameters
    ----------
    a : array or float
        Angles, rad, in any shape. Beyond 1e6 rad the error grows by some 4e-17 per radian.

    Returns
    -------
    cos, sin : array
        Cosine and sine in the shape of a, or two numbers if a is one.
    """
    if isinstance(a, float):
        return _cos_sin_of_number(a)
    a = np.asarray(a, dtype=float)
    flat = np.ascontiguousarray(a).reshape(-1)
    c = np.empty(flat.shape)
    s = np.empty(flat.shape)
    exp_log_sin_arctan.in_pieces(exp_log_sin_arctan.cos_sin, flat, c, s)
    return c.reshape(a.shape)[()], s.reshape(a.shape)[()]


def arctan2(y: Array, x: Array) -> Array:
    """Compute the angle of the point (x, y).

    Parameters
    ----------
    y, x : array
        Coordinates, both in the same shape.

    Returns
    -------
    array
        Angles in [-pi, pi], rad, in the shape of y, or a number if y is one; arctan2(+-0, -0) is +-0.
    """
    y = np.asarray(y, dtype=float)
    x = np.asarray(x, dtype=float)
    flat_y = np.ascontiguousarray(y).reshape(-1)
    flat_x = np.ascontiguousarray(x).reshape(-1)
    out = np.empty(flat_y.shape)
    exp_log_sin_arctan.in_pieces(exp_log_sin_arctan.arctan2, flat_y, flat_x, out)
    return out.reshape(y.shape)[()]


def expm1(x: ArrayLike) -> Array:
    """Compute ``e^x - 1`` without the loss of digits near zero.

    Like all functions here it gives the same bits on every machine, unlike ``numpy.expm1``.

    Parameters
    ----------
    x : array or float
        Exponents in any shape.

    Returns
    -------
    array
        ``e^x - 1`` in the shape of x, or a number if x is one. It is infinite above 709.7.
    """
    x = np.asarray(x, dtype=float)
    small = np.clip(x, -0.5, 0.5)
    series = np.ones_like(small)
    # Horner's scheme for 1 + x/2 (1 + x/3 (1 + ...)), to x^15 / 16!.
    for n in range(16, 1, -1):
        series = 1.0 + series * small / n
    return np.where(np.abs(x) <= 0.5, small * series, exp(x) - 1.0)[()]


def sinh(x: ArrayLike) -> Array:
    """Compute the hyperbolic sine.

    Parameters
    ----------
    x : array or float
        Numbers in any shape.

    Returns
    -------
    array
        ``(e^x - e^-x) / 2`` in the shape of x, or a number if x is one.
    """
    x = np.asarray(x, dtype=float)
    value = 0.5 * (expm1(x) - expm1(-x))
    # e^|x| is infinite from 709.7 on, but half of it only from 710.5 on.
    large = np.isinf(value)
    if large.any():
        root = exp(0.5 * np.abs(x))
        with np.errstate(over="ignore"):
            value = np.where(large, np.copysign(0.5 * root * root, x), value)
    return value[()]


def logaddexp(a: Array, b: ArrayLike) -> Array:
    """Compute ``log(e^a + e^b)``.

    Parameters
    ----------
    a, b : array
        Logarithms, -inf for the logarithm of zero. Their shapes are broadcast against each other.

    Returns
    -------
    array
        Logarithms of the sums, in the common shape of a and b; NaN where either of them is.
    """
    larger = np.maximum(a, b)
    smaller = np.minimum(a, b)
    with np.errstate(invalid="ignore"):
        # Two infinities of one sign have the difference zero.
        difference = np.where(larger == smaller, 0.0, smaller - larger)
    return larger + log(1.0 + exp(difference))


def power(x: ArrayLike, y: ArrayLike) -> Array:
    """Compute ``x^y``.

    If y is a single whole number from 0 to 16, x is multiplied by itself.

    Parameters
    ----------
    x, y : array or float
        Bases and exponents, whose shapes are broadcast against each other.

    Returns
    -------
    array
        Powers in the common shape of x and y, or a number if both are. They are NaN for a finite x < 0
        unless y is whole or infinite.
    """
    if isinstance(x, float) and isinstance(y, float) and 0.0 < x < np.inf and y != np.floor(y):
        return exp(y * float(log(x)))  # as below, without the arrays
    x = np.asarray(x, dtype=float)
    y = np.asarray(y, dtype=float)
    if y.ndim == 0 and 0 <= y <= _MOST_FACTORS and y == np.floor(y):
        product = x.copy() if y else np.ones_like(x)
        for _ in range(int(y) - 1):
            product = product * x
        return product[()]
    with np.errstate(divide="ignore", invalid="ignore"):
        # x^y = exp(y log |x|), with the sign of a whole power of a negative number.
        value = exp(y * log(np.abs(x)))
        negative = np.signbit(x)
        if negative.any():
            is_odd = np.mod(y, 2.0) == 1.0
            value = np.where(negative & is_odd, -value, value)
            # Powers of zero and infinity are numbers, and so are infinite powers.
            is_undefined = (y != np.floor(y)) & np.isfinite(x) & (x != 0.0)
            value = np.where(negative & is_undefined, np.nan, value)
        # 1^y = 1 and (-1)^(+-inf) = 1, where y log |x| is infinity times zero.
        is_one = (x == 1.0) | ((x == -1.0) & np.isinf(y))
        if is_one.any():
            value = np.where(is_one, 1.0, value)
        if y.ndim and (y == 0.0).any():
            value = np.where(y == 0.0, 1.0, value)
    return value[()]


def log_gamma(x: float) -> float:
    """Compute log Gamma(x) for x > 0 by Stirling's series, with recursion below 10.

    It gives the same bits on every machine, unlike ``math.lgamma``.

    Parameters
    ----------
    x : float
        One number above zero.

    Returns
    -------
    float
        Natural logarithm of Gamma(x).
    """
    # Step 1: Gamma(x) = Gamma(x + n) / (x (x + 1) ... (x + n - 1)) moves the argument above 10.
    divisor = 1.0
    while x < 10.0:
        divisor *= x
        x += 1.0
    # Step 2: log Gamma(x) = (x - 1/2) log x - x + log(2 pi) / 2 + 1 / (12 x) - 1 / (360 x^3) + ...
    square = 1.0 / (x * x)
    series = -1.0 / 360.0 + square * (1.0 / 1260.0 + square * (-1.0 / 1680.0 + square / 1188.0))
    rest = (1.0 / 12.0 + square * series) / x
    half_log_two_pi = 0.5 * float(log(2.0 * elementary_tables.constants().pi))
    return (x - 0.5) * float(log(x)) - x + half_log_two_pi + rest - float(log(divisor))


def _call_on_any_shape(kernel: Elementwise, x: ArrayLike, result: Array | None) -> Array:
    """Call a kernel on an array of any shape, or a number; write to the result if there is one."""
    if isinstance(x, float):
        return _of_number(kernel, x)
    x = np.asarray(x, dtype=float)
    flat = np.ascontiguousarray(x).reshape(-1)
    # Write into the result directly if its memory is in order, else copy at the end.
    if result is not None and result.flags.c_contiguous and result.dtype == np.float64:
        exp_log_sin_arctan.call_kernel(kernel, flat, result.reshape(-1))
        return result
    values = np.empty(flat.shape)
    exp_log_sin_arctan.call_kernel(kernel, flat, values)
    if result is None:
        return values.reshape(x.shape)[()]  # a number if x is one
    result[...] = values.reshape(x.shape)
    return result


@lru_cache(maxsize=4096)
def _of_number(kernel: Elementwise, x: float) -> Array:
    """Compute a function of one number by its kernel."""
    out = np.empty(1)
    kernel(np.array([x]), out)
    return out[0]


@lru_cache(maxsize=4096)
def _cos_sin_of_number(a: float) -> tuple[Array, Array]:
    """Compute cosine and sine of one number by their kernel."""
    c = np.empty(1)
    s = np.empty(1)
    exp_log_sin_arctan.cos_sin(np.array([a]), c, s)
    return c[0], s[0]
