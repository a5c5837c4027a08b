"""Tables of the elementary functions, made of integers alone, so that every machine makes the same.

A number v in here is the integer ``v 2^_BITS``; a table's entries are correctly rounded, but for ties
that so many bits cannot tell.
"""

from functools import cache
from itertools import pairwise
from math import isqrt

import numpy as np

from trackbench.core.arrays import Array, fixed

POWERS, LOGS, TURNS, SLOPES = 1 << 14, 1 << 13, 1 << 11, 1 << 8
"""Entries per octave of 2^x, per octave of log, per turn of sin and cos, per unit of arctan."""
_BITS = 160
_ONE = 1 << _BITS


@cache
def powers_of_two() -> Array:
    """Return ``2^(j / POWERS)``, j = 0 ... POWERS - 1."""
    step = 2 << _BITS
    for _ in range(POWERS.bit_length() - 1):
        step = isqrt(step << _BITS)
    entries, power = [], _ONE
    for _ in range(POWERS):
        entries.append(power)
        power = power * step >> _BITS
    return _rounded(entries)


@cache
def logarithms() -> tuple[Array, Array]:
    """Return ``log c`` and ``1 / c`` of the lower edges c of LOGS cells from 3/4 to 3/2.

    As of floats in their order: LOGS / 2 cells below one, and as many above it that are twice as wide.
    """
    below = [3 * LOGS // 2 + j for j in range(LOGS // 2 + 1)]  # numerators over 2 LOGS, up to one
    above = [LOGS + j for j in range(LOGS // 2)]  # numerators over LOGS
    up = [0]
    for a, b in pairwise(above):
        up.append(up[-1] + _log_ratio(b, a))
    down = [0]
    for b, a in pairwise(reversed(below)):
        down.append(down[-1] - _log_ratio(b, a))
    edges = np.array([n / (2 * LOGS) for n in below[:-1]] + [n / LOGS for n in above])
    return _rounded([*down[:0:-1], *up]), fixed(1.0 / edges)


@cache
def circle() -> tuple[Array, Array]:
    """Return the cosine and sine of ``2 pi j / TURNS``, j = 0 ... TURNS - 1."""
    angle = 2 * pi_bits() // TURNS
    step_c, step_s = _series(angle, 0), _series(angle, 1)
    cosines, sines, c, s = [], [], _ONE, 0
    for _ in range(TURNS // 4 + 1):
        cosines.append(c)
        sines.append(s)
        c, s = (c * step_c - s * step_s) >> _BITS, (s * step_c + c * step_s) >> _BITS
    quarter = sines[: TURNS // 8 + 1] + cosines[TURNS // 8 - 1 :: -1]
    half = quarter[:-1] + quarter[:0:-1]
    wave = _rounded(half + [-s for s in half])
    return fixed(np.roll(wave, -TURNS // 4)), wave


@cache
def arctangents() -> Array:
    """Return ``arctan(j / SLOPES)``, j = 0 ... SLOPES."""
    entries = [0]
    for j in range(SLOPES):  # arctan b - arctan a = arctan((b - a) / (1 + a b))
        entries.append(entries[-1] + _arctan(SLOPES, SLOPES * SLOPES + j * (j + 1)))
    return _rounded(entries)


@cache
def pi_bits() -> int:
    """Return ``pi 2^160`` (Machin 1706)."""
    return 4 * (4 * _arctan(1, 5) - _arctan(1, 239))


@cache
def log_2_bits() -> int:
    """Return ``log(2) 2^160``."""
    return _log_ratio(4, 3) + _log_ratio(3, 2)


def parts(bits: int, divisor: int, widths: list[int]) -> list[float]:
    """Return ``bits / divisor`` as a sum of floats of so many bits each, and one more for the rest."""
    rest, out = bits // divisor, []
    for width in widths:
        drop = max(rest.bit_length() - width, 0)
        head = rest >> drop << drop
        out.append(head / _ONE)
        rest -= head
    return [*out, rest / _ONE]


def _log_ratio(b: int, a: int) -> int:
    """Return ``log(b / a) = 2 artanh((b - a) / (b + a))``."""
    term = ((b - a) << _BITS) // (b + a)
    square, total, n = term * term >> _BITS, 0, 1
    while term:
        total += term // n
        term, n = term * square >> _BITS, n + 2
    return 2 * total


def _arctan(b: int, a: int) -> int:
    """Return ``arctan(b / a)``."""
    term = (b << _BITS) // a
    square, total, n, sign = term * term >> _BITS, 0, 1, 1
    while term:
        total += sign * (term // n)
        term, n, sign = term * square >> _BITS, n + 2, -sign
    return total


def _series(angle: int, first: int) -> int:
    """Return the cosine (first = 0) or sine (1) of a small angle."""
    term = angle if first else _ONE
    square, total, n = angle * angle >> _BITS, 0, first
    while term:
        total += term
        term = -(term * square >> _BITS) // ((n + 1) * (n + 2))
        n += 2
        if term == -1:
            break
    return total


def _rounded(entries: list[int]) -> Array:
    return fixed(np.array([entry / _ONE for entry in entries]))
