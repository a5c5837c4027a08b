"""Kernels of the elementary functions on a piece of contiguous float64 that fits the cache.

See `elementary`, which is what to call. Each kernel writes its result into ``out``, which may be its
argument; the lines are one elementwise operation each, since every one is a pass over memory.
"""

from functools import cache
from typing import NamedTuple

import numpy as np

from trackbench.core import _elementary_tables
from trackbench.core.arrays import Array

_ROUND = 1.5 * 2.0**52  # x + _ROUND has round(x) in its last bits
_LOWEST, _HIGHEST = -708.0, 709.7  # arguments of exp that give normal numbers
_SMALLEST, _LARGEST = float(np.finfo(float).tiny), float(np.finfo(float).max)
_FEW_TURNS = 1e6  # angle up to which the reduction is exact
_NARROW = 1.0 / 32.0  # tangent up to which the series of arctan needs no table
_MANTISSA = 52


class Constants(NamedTuple):
    """Constants of the kernels beside their tables."""

    per_power: float
    step: float
    step_squared: float
    log_2: float
    log_linear: float
    log_square: float
    per_turn: float
    turn: list[float]
    pi: float


@cache
def constants() -> Constants:
    """Return the constants, computed at the first call like the tables."""
    log_2 = _elementary_tables.log_2_bits() / (1 << 160)
    step = log_2 / _elementary_tables.POWERS  # of the exponent from one entry to the next
    width = 1.0 / _elementary_tables.LOGS
    (turn,) = _elementary_tables.parts(_elementary_tables.pi_bits(), 1, [])[:1]
    return Constants(
        per_power=_elementary_tables.POWERS / log_2,
        # e^r - 1 = r + r^2 / 2 + r^3 / 6 on |r| <= step / 2, economised (Chebyshev) to a square.
        step=step * (1.0 + step * step / 32.0),
        step_squared=0.5 * step * step,
        log_2=log_2,
        # -1/2 + r/3 - r^2/4 on 0 <= r <= width, economised to a line.
        log_linear=1.0 / 3.0 - width / 4.0,
        log_square=-0.5 + width * width / 32.0,
        per_turn=_elementary_tables.TURNS / (2.0 * turn),
        turn=_elementary_tables.parts(
            2 * _elementary_tables.pi_bits(), _elementary_tables.TURNS, [21, 21]
        ),
        pi=turn,
    )


def exp(x: Array, out: Array) -> None:
    """Write ``e^x`` to ``out``."""
    if np.minimum.reduce(x) >= _LOWEST and np.maximum.reduce(x) <= _HIGHEST:
        exp_of_moderate(x, out)
        return
    below, above = x < _LOWEST, x > _HIGHEST
    exp_of_moderate(np.clip(x, _LOWEST, _HIGHEST), out)
    out[below], out[above] = 0.0, np.inf


def exp_of_moderate(x: Array, out: Array) -> None:
    """Write ``e^x``: ``x = (n + f) step``, a tabulated power of two times a series."""
    known = constants()
    f = x * known.per_power
    rounded = f + _ROUND
    series = rounded - _ROUND
    f -= series
    np.multiply(f, known.step_squared, out=series)
    series += known.step
    series *= f
    series += 1.0
    n = rounded.view(np.int64)
    _elementary_tables.powers_of_two().take(
        n & (_elementary_tables.POWERS - 1), out=out, mode="clip"
    )
    n >>= (
        _elementary_tables.POWERS.bit_length() - 1
    )  # whole powers of two, and bits that are shifted out
    n <<= _MANTISSA
    scaled = out.view(np.int64)
    scaled += n
    out *= series


def log(x: Array, out: Array) -> None:
    """Write the natural logarithm to ``out``."""
    if np.minimum.reduce(x) >= _SMALLEST and np.maximum.reduce(x) <= _LARGEST:
        _log_of_normal(x, out)
        return
    normal = (x >= _SMALLEST) & (x <= _LARGEST)
    scaled = np.where(normal, x, 1.0)
    tiny = (x > 0.0) & (x < _SMALLEST)
    scaled[tiny] = x[tiny] * 2.0**_MANTISSA
    zero, infinite, undefined = x == 0.0, x == np.inf, ~(x >= 0.0)
    _log_of_normal(scaled, out)
    out[tiny] -= _MANTISSA * constants().log_2
    out[zero], out[infinite], out[undefined] = -np.inf, np.inf, np.nan


def _log_of_normal(x: Array, out: Array) -> None:
    """Write log x: ``x = 2^e m``, m in 3/4 to 3/2, and ``m = c (1 + r)``, c its cell's edge."""
    known = constants()
    at_edge, inverse = _elementary_tables.logarithms()
    cell = _MANTISSA + 1 - _elementary_tables.LOGS.bit_length()  # bits of a mantissa within a cell
    bits = x.view(np.int64)
    e = bits - 0x3FE8000000000000  # the bits of 3/4
    index = e >> cell
    index &= _elementary_tables.LOGS - 1
    e &= -1 << _MANTISSA
    m = bits - e
    edge = (m >> cell) << cell
    r = m.view(float) - edge.view(float)  # exact
    r *= inverse.take(index)
    series = known.log_linear * r
    series += known.log_square
    series *= r
    series *= r
    series += r
    at_edge.take(index, out=r, mode="clip")
    series += r
    np.multiply(e, known.log_2 * 2.0**-_MANTISSA, out=out)
    out += series


def cos_sin(a: Array, c: Array, s: Array) -> None:
    """Write cosine and sine: ``a = n turn + r``, r reduced in three parts (Cody & Waite 1980)."""
    known = constants()
    if not (np.maximum.reduce(a) <= _FEW_TURNS and np.minimum.reduce(a) >= -_FEW_TURNS):
        with np.errstate(invalid="ignore"):  # of an infinite angle
            a = np.fmod(a, 2.0 * known.pi)
    rounded = a * known.per_turn
    rounded += _ROUND
    index = rounded.view(np.int64) & (_elementary_tables.TURNS - 1)
    rounded -= _ROUND
    r = a - rounded * known.turn[0]
    for part in known.turn[1:]:
        r -= rounded * part
    square = r * r
    little = square * (1.0 / 24.0)  # cos r - 1
    little -= 0.5
    little *= square
    sine = square * (1.0 / 120.0)
    sine -= 1.0 / 6.0
    sine *= square
    sine *= r
    sine += r
    cosines, sines = _elementary_tables.circle()
    C, S = cosines.take(index), sines.take(index)
    np.multiply(C, little, out=c)
    c -= S * sine
    c += C
    np.multiply(S, little, out=s)
    s += C * sine
    s += S


def arctan2(y: Array, x: Array, out: Array) -> None:
    """Write the angle of (x, y) to ``out``."""
    with np.errstate(divide="ignore", invalid="ignore"):
        t = y / x
        widest = max(np.maximum.reduce(t), -np.minimum.reduce(t))
        if widest <= _NARROW and np.minimum.reduce(x) > 0.0:
            _arctan_of_narrow(t, out)
            return
        _arctan2_anywhere(y, x, out)
        narrow = (np.abs(t) <= _NARROW) & (x > 0.0)
        if narrow.any():  # a value does not depend on those beside it
            near = np.empty_like(t)
            _arctan_of_narrow(t, near)
            np.copyto(out, near, where=narrow)


def _arctan_of_narrow(t: Array, out: Array) -> None:
    """Write Gregory's series to the ninth power."""
    square = t * t
    series = square * (1.0 / 9.0)
    series -= 1.0 / 7.0
    series *= square
    series += 1.0 / 5.0
    series *= square
    series -= 1.0 / 3.0
    series *= square
    series *= t
    np.add(t, series, out=out)


def _arctan2_anywhere(y: Array, x: Array, out: Array) -> None:
    """Write ``arctan t = arctan c + arctan((t - c) / (1 + t c))`` in an octant, then turn it."""
    known = constants()
    ax, ay = np.abs(x), np.abs(y)
    large, small = np.maximum(ax, ay), np.minimum(ax, ay)
    rounded = small / large * _elementary_tables.SLOPES + _ROUND
    index = rounded.view(np.int64) & (2 * _elementary_tables.SLOPES - 1)
    slope = (rounded - _ROUND) * (1.0 / _elementary_tables.SLOPES)
    r = (small - slope * large) / (large + slope * small)
    square = r * r
    out[:] = _elementary_tables.arctangents().take(index, mode="clip") + (
        r + r * square * (square * (1.0 / 5.0) - 1.0 / 3.0)
    )
    out[large == 0.0] = 0.0
    np.copyto(out, 0.5 * known.pi - out, where=ay > ax)
    np.copyto(out, known.pi - out, where=x < 0.0)
    np.copysign(out, y, out=out)
