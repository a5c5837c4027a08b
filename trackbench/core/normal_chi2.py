"""Distribution functions of the normal and the chi-square, whose last bit is the same on every machine.

Right to 1e-14 of one, which is less of a small tail: they tell where in a distribution a value lies.
"""

from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from trackbench.core import _elementary_kernels
from trackbench.core.arrays import Array
from trackbench.core.elementary import exp

_FAR = 8.5  # beyond it the tail is below the last bit of one
_HALF_A_BIT = 2.0**-55


def normal_density(z: ArrayLike) -> Array:
    """Return ``exp(-z^2 / 2) / sqrt(2 pi)``."""
    z = np.asarray(z, dtype=float)
    return exp(-0.5 * (z * z)) * _norm()


def normal_cdf(z: ArrayLike) -> Array:
    """Return the probability that a standard normal is below z; NaN where z is.

    ``1/2 + density(z) (z + z^3 / 3 + z^5 / (3 5) + ...)`` (Marsaglia 2004, J. Statist. Softw. 11(4)).
    """
    z = np.asarray(z, dtype=float)
    a = np.minimum(np.abs(z), _FAR)
    square = a * a
    term, series, odd = a, a, 1.0
    # Terms are positive, and those after the loop too small for any sum: it may go on for others.
    while (term > _HALF_A_BIT * series).any():
        odd += 2.0
        term = term * square / odd
        series = series + term
    beyond = np.where(a == _FAR, 0.0, 0.5 - normal_density(a) * series)
    return np.where(z < 0.0, beyond, 1.0 - beyond)[()]


def chi_square_cdf(x: ArrayLike, n: int) -> Array:
    """Return the chi-square distribution function of n degrees of freedom at x >= 0, maybe infinite.

    By its finite sum (Abramowitz & Stegun 1964, eqs. 26.4.4 and 26.4.5).
    """
    x = np.asarray(x, dtype=float)
    near = np.minimum(x, 1400.0)  # whose exponential is still a number
    if n % 2:
        root = np.sqrt(near)
        below = 2.0 * normal_cdf(root) - 1.0
        term, first = 2.0 * normal_density(root) * root, 3
    else:
        above = exp(-0.5 * near)
        below, term, first = 1.0 - above, 0.5 * near * above, 4
    for divisor in range(first, n + 1, 2):
        below = below - term
        term = term * near / divisor
    return np.clip(below, 0.0, 1.0)[()]


@cache
def _norm() -> float:
    return float(1.0 / np.sqrt(2.0 * _elementary_kernels.constants().pi))
