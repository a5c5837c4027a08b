"""Tables and constants of the elementary functions: powers of two, logarithms, sines, arctangents.

They come from integer arithmetic alone, so every machine computes the same entries. In that arithmetic
the integer ``v 2^_BITS`` stands for a number v. Entries are rounded correctly (up to ties).
"""

from functools import cache
from itertools import pairwise
from math import isqrt
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.read_only import fixed

POWERS = 1 << 14
LOGS = 1 << 13
ANGLES = 1 << 11
SLOPES = 1 << 8
"""Entries per octave of 2^x, per octave of log, per turn of sin and cos, per unit of arctan."""
_BITS = 160
"""Bits of the fraction of a number that is written as an integer."""
_ONE = 1 << _BITS
"""The number 1, as such an integer."""
MANTISSA = 52
"""Bits of the fraction of a float64."""


class Constants(NamedTuple):
    """Constants of the kernels beside their tables."""

    per_power: float
    """entries of the table of powers of two per unit of x in e^x"""
    exp_linear: float
    """linear coefficient of ``e^(f step) - 1`` in the fraction f of an entry, step the x of an entry"""
    exp_square: float
    """quadratic coefficient of the same"""
    log_2: float
    log_linear: float
    """linear coefficient of ``(log(1 + r) - r) / r^2`` within a cell"""
    log_square: float
    """constant of the same"""
    angles_per_radian: float
    """entries of the table of sines per radian"""
    angle_step: list[float]
    """angle from one entry to the next, rad, in three parts whose sum it is, the leading one first"""
    pi: float


@cache
def constants() -> Constants:
    """Compute the constants, at the first call like the tables."""
    log_2 = (_log_ratio(4, 3) + _log_ratio(3, 2)) / _ONE
    step = log_2 / POWERS  # of the exponent from one entry to the next
    width = 1.0 / LOGS
    # pi as one float.
    (pi,) = parts(pi_bits(), divisor=1, widths=[])
    return Constants(
        per_power=POWERS / log_2,
        # e^r - 1 = r + r^2 / 2 + r^3 / 6 on |r| <= step / 2, economized (Chebyshev) to a square: the
        # cubic term is replaced by a linear one. r = f step with |f| <= 1/2.
        exp_linear=step * (1.0 + step * step / 32.0),
        exp_square=0.5 * step * step,
        log_2=log_2,
        # -1/2 + r/3 - r^2/4 on 0 <= r <= width, economized to a line.
        log_linear=1.0 / 3.0 - width / 4.0,
        log_square=-0.5 + width * width / 32.0,
        angles_per_radian=ANGLES / (2.0 * pi),
        # 2 pi / ANGLES as two parts of 21 bits and a rest. The products of the two with a whole number
        # of up to 32 bits are exact.
        angle_step=parts(2 * pi_bits(), divisor=ANGLES, widths=[21, 21]),
        pi=pi,
    )


@cache
def exp_constants() -> Array:
    """Join the constants of `exp_of_moderate` for the C kernel, in an array that is read-only.

    ``x per_power = n + f`` is x in entries of the table of powers of two: n is a whole number of entries
    and f the rest, at most 1/2. ``exp_linear`` and ``exp_square`` are the coefficients of f and f^2 in
    the series of ``e^(f step) - 1``, step being log(2) / POWERS, the x of an entry.
    """
    const = constants()
    return fixed(np.array([const.per_power, const.exp_linear, const.exp_square]))


@cache
def turn_constants() -> Array:
    """Join the constants of `cos_sin` for the C kernel.

    They are the entries of the table of sines per radian, a whole turn, rad, and the angle from one
    entry to the next in three parts.
    """
    const = constants()
    return fixed(np.array([const.angles_per_radian, 2.0 * const.pi, *const.angle_step]))


@cache
def _pi() -> Array:
    return fixed(np.array([constants().pi]))


@cache
def log_table() -> Array:
    """Join what C kernels need for natural logarithms: four constants, then `logarithms` in pairs."""
    const = constants()
    per_bit = const.log_2 * 2.0**-MANTISSA
    numbers = [const.log_linear, const.log_square, per_bit, const.log_2]
    return fixed(np.concatenate([numbers, np.stack(logarithms(), axis=1).ravel()]))


@cache
def powers_of_two() -> Array:
    """Tabulate ``2^(j / POWERS)``, j = 0 ... POWERS - 1, as floats (POWERS,).

    Integers with `_BITS` bits of fraction give the same digits on every machine, unlike ``numpy.exp2``.
    """
    step = 2 << _BITS
    # 2^(1 / POWERS) by repeated square roots of 2.
    for _ in range(POWERS.bit_length() - 1):
        step = isqrt(step << _BITS)
    entries = []
    power = _ONE
    # Multiply up from 2^0.
    for _ in range(POWERS):
        entries.append(power)
        power = power * step >> _BITS
    return _round_entries(entries)


@cache
def logarithms() -> tuple[Array, Array]:
    """Tabulate ``log c`` and ``1 / c`` of the lower edges c of LOGS cells from 3/4 to 3/2.

    Half of the cells lie below one; the cells above it are twice as wide, as floats are. The logarithms
    are added up as integers with `_BITS` bits of fraction, and then rounded to floats. `fixed` makes an
    array read-only.
    """
    below = [3 * LOGS // 2 + j for j in range(LOGS // 2 + 1)]  # numerators over 2 LOGS, up to one
    above = [LOGS + j for j in range(LOGS // 2)]  # numerators over LOGS
    # Sum the logarithms of neighbors' ratios, up and down from log 1 = 0.
    up = [0]
    for a, b in pairwise(above):
        up.append(up[-1] + _log_ratio(b, a))
    down = [0]
    for b, a in pairwise(reversed(below)):
        down.append(down[-1] - _log_ratio(b, a))
    # One is the last edge below and the first above, and is taken once.
    edges = np.array([n / (2 * LOGS) for n in below[:-1]] + [n / LOGS for n in above])
    return _round_entries([*down[:0:-1], *up]), fixed(1.0 / edges)


@cache
def circle() -> tuple[Array, Array]:
    """Tabulate cosine and sine, (ANGLES,) each, of ``2 pi j / ANGLES``, j = 0 ... ANGLES - 1.

    They are computed as integers with `_BITS` bits of fraction. `fixed` makes an array read-only.
    """
    # Step 1: rotate by one entry at a time through a quarter of the circle.
    angle = 2 * pi_bits() // ANGLES
    step_c = _series(angle, first=0)  # the cosine
    step_s = _series(angle, first=1)  # the sine
    cosines = []
    sines = []
    c = _ONE
    s = 0
    for _ in range(ANGLES // 4 + 1):
        cosines.append(c)
        sines.append(s)
        next_c = (c * step_c - s * step_s) >> _BITS
        next_s = (s * step_c + c * step_s) >> _BITS
        c = next_c
        s = next_s
    # Step 2: make the wave from its first octant by symmetry.
    quarter = sines[: ANGLES // 8 + 1] + cosines[ANGLES // 8 - 1 :: -1]
    half = quarter[:-1] + quarter[:0:-1]
    wave = _round_entries(half + [-s for s in half])
    # The cosine is the sine a quarter of a turn later.
    return fixed(np.roll(wave, -ANGLES // 4)), wave


def arctangent_tables() -> tuple[Array, Array]:
    """Return the arctangents and pi, with which the C kernels compute `arctan2`."""
    return arctangents(), _pi()


@cache
def arctangents() -> Array:
    """Tabulate ``arctan(j / SLOPES)``, j = 0 ... SLOPES."""
    # arctan b - arctan a = arctan((b - a) / (1 + a b)), with a = j / SLOPES and b = (j + 1) / SLOPES.
    entries = [0]
    for j in range(SLOPES):
        entries.append(entries[-1] + _arctan(SLOPES, SLOPES * SLOPES + j * (j + 1)))
    return _round_entries(entries)


@cache
def pi_bits() -> int:
    """Compute ``pi 2^160`` (Machin 1706)."""
    return 4 * (4 * _arctan(1, 5) - _arctan(1, 239))


def parts(bits: int, divisor: int, widths: list[int]) -> list[float]:
    """Split the number ``bits / divisor / _ONE`` into floats whose sum it is.

    Parameters
    ----------
    bits : int
        Number with `_BITS` bits of fraction, as an integer.
    divisor : int
        Positive number by which it is divided first.
    widths : list of int
        Number of leading bits of each float but the last.

    Returns
    -------
    list of float
        A float of so many leading bits for each of ``widths``, in order, and one for the rest, which
        is rounded to a float.
    """
    rest = bits // divisor
    result = []
    for width in widths:
        drop = max(rest.bit_length() - width, 0)
        # Keep the leading bits of the rest; the remaining ones go to the next part.
        head = rest >> drop << drop
        result.append(head / _ONE)
        rest -= head
    return [*result, rest / _ONE]


def _log_ratio(b: int, a: int) -> int:
    """Compute ``log(b / a) = 2 artanh((b - a) / (b + a))`` for b >= a.

    The result is an integer with `_BITS` bits of fraction. (For b < a the sum would not end, since
    ``>>`` rounds negative terms down to -1.)
    """
    term = ((b - a) << _BITS) // (b + a)
    square = term * term >> _BITS
    total = 0
    n = 1
    while term:
        total += term // n
        term = term * square >> _BITS
        n += 2
    return 2 * total


def _arctan(b: int, a: int) -> int:
    """Compute ``arctan(b / a)`` by its series, as an integer with `_BITS` bits of fraction."""
    term = (b << _BITS) // a
    square = term * term >> _BITS
    total = 0
    n = 1
    sign = 1
    while term:
        total += sign * (term // n)
        term = term * square >> _BITS
        n += 2
        sign = -sign
    return total


def _series(angle: int, first: int) -> int:
    """Sum the series of the cosine (first = 0) or sine (1) of a small angle.

    ``angle`` and the result are integers with `_BITS` bits of fraction.
    """
    term = angle if first else _ONE
    square = angle * angle >> _BITS
    total = 0
    n = first
    # The next term is -term angle^2 / ((n + 1) (n + 2)).
    while term:
        total += term
        term = -(term * square >> _BITS) // ((n + 1) * (n + 2))
        n += 2
        if term == -1:  # a negative term below the last bit, which `>>` rounds down
            break
    return total


def _round_entries(entries: list[int]) -> Array:
    return fixed(np.array([entry / _ONE for entry in entries]))
