"""Kernels of exp, log, cosine and sine, and arctangent; `elementary` is the module to call.

A kernel takes a contiguous float64 piece that fits the cache and writes to ``result``, which may be its
argument, except that of `arctan2`. A line is one elementwise operation, because each is a pass over
memory. The tables that they look up are those of `elementary_tables`.
"""

from collections.abc import Callable

import numpy as np

from trackbench.core import compiled
from trackbench.core.arrays import Array
from trackbench.core.elementary_tables import (
    ANGLES,
    LOGS,
    MANTISSA,
    POWERS,
    SLOPES,
    arctangent_tables,
    arctangents,
    circle,
    constants,
    exp_constants,
    log_table,
    logarithms,
    powers_of_two,
    turn_constants,
)

_PIECE = 8192  # elements at a time: they stay in the processor's cache
_ROUND = 1.5 * 2.0**52  # x + _ROUND has round(x) in its last bits
_LOWEST = -708.0
_HIGHEST = 709.7
"""Arguments of exp between which it gives normal numbers."""
_SMALLEST = float(np.finfo(float).tiny)
_LARGEST = float(np.finfo(float).max)
"""Smallest and largest normal number."""
_LARGEST_REDUCED = 1e6  # rad: angle up to which the reduction is exact
_NARROW = 1.0 / 32.0  # tangent up to which the series of arctan to t^9 needs no table


Elementwise = Callable[[Array, Array], None]


def call_kernel(kernel: Elementwise, flat: Array, result: Array) -> None:
    """Call a kernel on a whole array, or on pieces of it that fit the cache.

    The C kernels need no pieces. The numpy kernels reject an empty array, for which there is no piece.

    Parameters
    ----------
    kernel : callable
        Function of an array and of the array that it writes to, such as `exp`.
    flat : array (size,)
        Contiguous float64 argument.
    result : array (size,)
        Contiguous float64 array that is written to.
    """
    if compiled.kernels or 0 < len(flat) <= _PIECE:
        kernel(flat, result)
    else:
        in_pieces(kernel, flat, result)


def in_pieces(kernel: Callable[..., None], *arrays: Array) -> None:
    """Call a kernel on pieces that fit the cache.

    Parameters
    ----------
    kernel : callable
        Function of as many arrays as there are ``arrays``. It writes to one or more of them.
    *arrays : array (size,)
        Arguments and results of the kernel, contiguous float64 arrays of one length. The kernel
        receives pieces of them, which are views.
    """
    for i in range(0, len(arrays[0]), _PIECE):
        kernel(*[a[i : i + _PIECE] for a in arrays])


def exp(x: Array, result: Array) -> None:
    """Write ``e^x`` to ``result``.

    Parameters
    ----------
    x : array (size,)
        Exponents, contiguous float64.
    result : array (size,)
        Contiguous float64 array that is written to; it may be x. It is zero where x is below -708, and
        infinite where x is above 709.7.
    """
    if compiled.kernels:
        compiled.kernels.exp(powers_of_two(), exp_constants(), x, result)
        return
    if np.minimum.reduce(x) >= _LOWEST and np.maximum.reduce(x) <= _HIGHEST:
        exp_of_moderate(x, result)
        return
    # Beyond these limits the result is 0, also where e^x is a subnormal number, or infinite.
    below = x < _LOWEST
    above = x > _HIGHEST
    exp_of_moderate(np.clip(x, _LOWEST, _HIGHEST), result)
    result[below] = 0.0
    result[above] = np.inf


def exp_of_moderate(x: Array, result: Array) -> None:
    """Write ``e^x`` of moderate x to ``result``, by ``x = (n + f) step``.

    It is a tabulated power of two times a series.

    Parameters
    ----------
    x : array (size,)
        Exponents in [-708, 709] or NaN, contiguous float64. Beyond these limits the result is no normal
        float.
    result : array (size,)
        Contiguous float64 array that is written to; it may be x.
    """
    if compiled.kernels:
        compiled.kernels.exp(powers_of_two(), exp_constants(), x, result)
        return
    const = constants()
    # Step 1: split x / step into a whole number n and a fraction f, |f| <= 1/2. The addition of _ROUND
    # rounds, and leaves n in the last bits of the sum.
    f = x * const.per_power
    rounded = f + _ROUND
    whole = rounded - _ROUND
    f -= whole
    # Step 2: e^(f step) = 1 + f exp_linear + f^2 exp_square. The series is economized (Chebyshev): its
    # cubic term is replaced by a change of the linear one.
    series = np.multiply(f, const.exp_square, out=whole)
    series += const.exp_linear
    series *= f
    series += 1.0
    # Step 3: the low bits of n select 2^(j / POWERS); its high bits go into the exponent. With
    # mode="clip" numpy writes to `out` without a buffer.
    n = rounded.view(np.int64)
    powers_of_two().take(n & (POWERS - 1), out=result, mode="clip")
    n >>= POWERS.bit_length() - 1
    n <<= MANTISSA
    scaled = result.view(np.int64)
    scaled += n
    result *= series


def log(x: Array, result: Array) -> None:
    """Write the natural logarithm of x to ``result``, with the same bits on every machine.

    Parameters
    ----------
    x : array (size,)
        Numbers, contiguous float64.
    result : array (size,)
        Contiguous float64 array that is written to; it may be x. It is -inf where x is zero, and NaN
        where x is negative.
    """
    if compiled.kernels:
        compiled.kernels.log(log_table(), x, result)
        return
    if np.minimum.reduce(x) >= _SMALLEST and np.maximum.reduce(x) <= _LARGEST:
        _log_of_normal(x, result)
        return
    # Scale subnormal numbers up by 2^52; let 1 stand for zeros, infinities and NaN.
    normal = (x >= _SMALLEST) & (x <= _LARGEST)
    scaled = np.where(normal, x, 1.0)
    tiny = (x > 0.0) & (x < _SMALLEST)
    scaled[tiny] = x[tiny] * 2.0**MANTISSA
    zero = x == 0.0
    infinite = x == np.inf
    undefined = ~(x >= 0.0)
    # Correct the results of scaled and special numbers afterwards.
    _log_of_normal(scaled, result)
    result[tiny] -= MANTISSA * constants().log_2
    result[zero] = -np.inf
    result[infinite] = np.inf
    result[undefined] = np.nan


def _log_of_normal(x: Array, result: Array) -> None:
    """Write log x of x that are positive and normal floats, not subnormal.

    ``x = 2^e m`` with m in 3/4 to 3/2, and ``m = c (1 + r)`` with c the lower edge of its cell in the
    table of logarithms.
    """
    const = constants()
    at_edge, inverse = logarithms()
    cell = MANTISSA + 1 - LOGS.bit_length()  # bits of a mantissa within a cell
    # Step 1: read exponent e, cell and mantissa m from the bits of x.
    bits = x.view(np.int64)
    e = bits - 0x3FE8000000000000  # the bits of 3/4
    index = e >> cell
    index &= LOGS - 1
    e &= -1 << MANTISSA
    m = bits - e
    edge = (m >> cell) << cell
    # Step 2: r = (m - c) / c; the difference is exact.
    r = m.view(float) - edge.view(float)
    r *= inverse.take(index)
    # Step 3: log(1 + r) = r - r^2 / 2 + r^3 / 3 - r^4 / 4, economized.
    series = const.log_linear * r
    series += const.log_square
    series *= r
    series *= r
    series += r
    # Step 4: log x = e log 2 + (log c + log(1 + r)). With mode="clip" numpy writes to `out` without a
    # buffer.
    at_edge.take(index, out=r, mode="clip")
    series += r
    np.multiply(e, const.log_2 * 2.0**-MANTISSA, out=result)
    result += series


def cos_sin(a: Array, c: Array, s: Array) -> None:
    """Write cosine and sine of angles a to c and s.

    ``a = n d + r``, where d is the angle from one entry of the table to the next. n d is subtracted in
    three parts (Cody & Waite 1980).

    Parameters
    ----------
    a : array (size,)
        Angles, rad, contiguous float64. Angles beyond 1e6 rad first lose multiples of 2 pi as a float,
        whose rounding error is some 4e-17 per radian of the angle.
    c, s : array (size,)
        Two different contiguous float64 arrays that cosine and sine are written to. One of them may be
        a.
    """
    const = constants()
    if compiled.kernels:
        compiled.kernels.cos_sin(*circle(), turn_constants(), a, c, s)
        return
    # The reduction below is exact up to `_LARGEST_REDUCED`: larger angles lose multiples of 2 pi first.
    if not (np.maximum.reduce(a) <= _LARGEST_REDUCED and np.minimum.reduce(a) >= -_LARGEST_REDUCED):
        with np.errstate(invalid="ignore"):  # of an infinite angle
            a = np.where(np.abs(a) <= _LARGEST_REDUCED, a, np.fmod(a, 2.0 * const.pi))
    # Step 1: find the nearest tabulated angle n d and the rest r. The addition of _ROUND rounds, and
    # leaves n in the last bits of the sum.
    rounded = a * const.angles_per_radian
    rounded += _ROUND
    index = rounded.view(np.int64) & (ANGLES - 1)
    rounded -= _ROUND
    r = a - rounded * const.angle_step[0]
    for part in const.angle_step[1:]:
        r -= rounded * part
    # Step 2: cos r - 1 and sin r by their series.
    square = r * r
    cos_less_one = square * (1.0 / 24.0)
    cos_less_one -= 0.5
    cos_less_one *= square
    sine = square * (1.0 / 120.0)
    sine -= 1.0 / 6.0
    sine *= square
    sine *= r
    sine += r
    # Step 3: rotate: cos(A + r) = C + (C (cos r - 1) - S sin r), sin(A + r) likewise.
    cosines, sines = circle()
    C = cosines.take(index)
    S = sines.take(index)
    np.multiply(C, cos_less_one, out=c)
    c -= S * sine
    c += C
    np.multiply(S, cos_less_one, out=s)
    s += C * sine
    s += S


def arctan2(y: Array, x: Array, result: Array) -> None:
    """Write the angle of the point (x, y) to ``result``.

    Parameters
    ----------
    y, x : array (size,)
        Coordinates, contiguous float64.
    result : array (size,)
        Contiguous float64 array that the angles in [-pi, pi], rad, are written to. It must be another
        array than y and x, from which the numpy code reads after it has written.
    """
    if compiled.kernels:
        compiled.kernels.arctan2(*arctangent_tables(), y, x, result)
        return
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        t = y / x
        widest = max(np.maximum.reduce(t), -np.minimum.reduce(t))
        # All angles are narrow: the series suffices.
        if widest <= _NARROW and np.minimum.reduce(x) > 0.0:
            _arctan_of_narrow(t, result)
            return
        _arctan2_by_table(y, x, result)
        # Use the series for narrow angles here as well: a value must not depend on its neighbors.
        narrow = (np.abs(t) <= _NARROW) & (x > 0.0)
        if narrow.any():
            near = np.empty_like(t)
            _arctan_of_narrow(t, near)
            np.copyto(result, near, where=narrow)


def _arctan_of_narrow(t: Array, result: Array) -> None:
    """Write the arctangent of t, |t| <= `_NARROW` = 1/32, to ``result``: Gregory's series to t^9.

    Both arrays are (size,). The next term, t^11 / 11, is less than half of the last bit there.
    """
    # t - t^3 / 3 + t^5 / 5 - t^7 / 7 + t^9 / 9 by Horner's rule in t^2
    square = t * t
    series = square * (1.0 / 9.0)
    series -= 1.0 / 7.0
    series *= square
    series += 1.0 / 5.0
    series *= square
    series -= 1.0 / 3.0
    series *= square
    series *= t
    np.add(t, series, out=result)


def _arctan2_by_table(y: Array, x: Array, result: Array) -> None:
    """Write ``arctan t = arctan c + arctan((t - c) / (1 + t c))`` in an octant, then turn it.

    It is for any (x, y); `arctan2` then replaces the narrow angles. The caller ignores numpy's warnings
    of 0 / 0.
    """
    const = constants()
    # Step 1: t = small / large in the first octant, c the nearest tabulated slope.
    ax = np.abs(x)
    ay = np.abs(y)
    large = np.maximum(ax, ay)
    small = np.minimum(ax, ay)
    infinite = large == np.inf
    if infinite.any():
        # Two infinities lie on the diagonal, and one of them on its axis.
        small[infinite] = small[infinite] == np.inf
        large[infinite] = 1.0
    rounded = small / large * SLOPES + _ROUND  # has the whole number in its last bits
    # A t that is NaN has an arbitrary index, which may be beyond the table: hence mode="clip" below.
    index = rounded.view(np.int64) & (2 * SLOPES - 1)
    slope = (rounded - _ROUND) * (1.0 / SLOPES)
    # Step 2: arctan c from the table, the rest by r - r^3 / 3 + r^5 / 5.
    r = (small - slope * large) / (large + slope * small)
    square = r * r
    result[:] = arctangents().take(index, mode="clip") + (
        r + r * square * (square * (1.0 / 5.0) - 1.0 / 3.0)
    )
    result[large == 0.0] = 0.0
    # Step 3: reflect into the octant of (x, y).
    np.copyto(result, 0.5 * const.pi - result, where=ay > ax)
    np.copyto(result, const.pi - result, where=x < 0.0)
    np.copysign(result, y, out=result)
