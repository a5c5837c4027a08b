"""Normal and chi-square probabilities, right to 1e-14 of one and equal on every machine."""

from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from trackbench.core import elementary_tables
from trackbench.core.arrays import Array
from trackbench.core.elementary import exp

_FAR = 8.5  # standard deviations beyond which the tail is below the last bit of one
_HALF_A_BIT = 2.0**-55


def normal_density(z: ArrayLike) -> Array:
    """Compute ``exp(-z^2 / 2) / sqrt(2 pi)``."""
    z = np.asarray(z, dtype=float)
    return exp(-0.5 * (z * z)) * _normal_factor()


def normal_cdf(z: ArrayLike) -> Array:
    """Compute the probability that a standard normal variate is below z.

    ``1/2 + density(z) (z + z^3 / 3 + z^5 / (3 5) + ...)`` (Marsaglia 2004, J. Statist. Softw. 11(4)).

    Parameters
    ----------
    z : array or float
        Numbers of standard deviations from the mean, in any shape.

    Returns
    -------
    array
        Probabilities in the shape of z, or a number if z is one; NaN where z is.
    """
    z = np.asarray(z, dtype=float)
    a = np.minimum(np.abs(z), _FAR)
    square = a * a
    term = a
    series = a
    odd = 1.0
    # Add terms until all are below the last bit; further terms change no element that has converged.
    while (term > _HALF_A_BIT * series).any():
        odd += 2.0
        term = term * square / odd
        series = series + term
    beyond = np.where(a == _FAR, 0.0, 0.5 - normal_density(a) * series)
    return np.where(z < 0.0, beyond, 1.0 - beyond)[()]


def chi_square_cdf(x: ArrayLike, n: int) -> Array:
    """Compute the distribution function of chi-square.

    It is a finite sum (Abramowitz & Stegun 1964, eqs. 26.4.4 and 26.4.5).

    Parameters
    ----------
    x : array or float
        Values from zero on, in any shape.
    n : int
        Degrees of freedom, at least 1.

    Returns
    -------
    array
        Probability of a variate below x, in the shape of x, or a number if x is one; NaN where x is.
    """
    x = np.asarray(x, dtype=float)
    near = np.minimum(x, 1400.0)  # exp(-near / 2) does not underflow
    # Step 1: the distribution function of one or of two degrees, and the first term of the sum.
    if n % 2:
        root = np.sqrt(near)
        below = 2.0 * normal_cdf(root) - 1.0
        term = 2.0 * normal_density(root) * root
        first = 3
    else:
        above = exp(-0.5 * near)
        below = 1.0 - above
        term = 0.5 * near * above
        first = 4
    # Step 2: subtract a term for every two further degrees.
    for divisor in range(first, n + 1, 2):
        below = below - term
        term = term * near / divisor
    return np.clip(below, 0.0, 1.0)[()]


@cache
def _normal_factor() -> float:
    return float(1.0 / np.sqrt(2.0 * elementary_tables.constants().pi))
