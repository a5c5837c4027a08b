"""Student's t and the normal distribution: p-values, half widths of intervals, and z from t."""

from math import copysign, sqrt

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.elementary import exp, log


def stderr_of(low: float, high: float) -> float:
    """Return the standard error whose normal 95 % interval has the width ``high - low``."""
    from scipy.special import ndtri

    return (high - low) / (2.0 * float(ndtri(0.975)))


def two_sided(z: float) -> float:
    """Return p-value of a z that is standard normal."""
    from scipy.special import ndtr

    return float(2.0 * ndtr(-abs(z)))


def quantile(level: float, freedom: float) -> float:
    """Return half the width, in standard errors, of a two-sided interval by Student's t."""
    return t_of_normal(deviations(level), freedom)


def deviations(level: float) -> float:
    """Return half the width, in standard deviations, of a two-sided normal interval of this ``level``.

    The level is the probability that the interval covers, such as 0.95.
    """
    from scipy.special import ndtri

    return float(ndtri(0.5 + level / 2.0))


@np.errstate(all="ignore")
def normal_of_t(t: float, freedom: float) -> float:
    """Return the normal z with the tail probability of Student's t (Wallace 1959, Ann. Math. Stat. 30).

    It is accurate to 1 % of z from four degrees of freedom on. Unlike z from distribution functions it
    stays finite for large t.

    Parameters
    ----------
    t
        value of Student's t
    freedom
        degrees of freedom

    Returns
    -------
    float
        z with the sign of t; t itself for infinite degrees of freedom
    """
    if not freedom < np.inf or not abs(t) < np.inf:
        return t
    # z = (8 f + 1) / (8 f + 3) sqrt(f log(1 + t^2 / f))
    z = np.sqrt(freedom * log(1.0 + t * t / freedom)) * (8.0 * freedom + 1.0)
    return float(np.copysign(z / (8.0 * freedom + 3.0), t))


@np.errstate(all="ignore")
def normals_of_t(t: Array, freedom: Array | float) -> Array:
    """Return `normal_of_t` of values (n,) that are not negative; ``freedom`` is one number or (n,)."""
    z = np.sqrt(freedom * log(1.0 + t * t / freedom)) * (8.0 * freedom + 1.0)
    return np.asarray(z / (8.0 * freedom + 3.0))


def t_of_normal(z: float, freedom: float) -> float:
    """Return the inverse of `normal_of_t`.

    Parameters
    ----------
    z
        normal deviate
    freedom
        degrees of freedom

    Returns
    -------
    float
        t with the sign of z; z itself for infinite degrees of freedom
    """
    if not freedom < np.inf or not abs(z) < np.inf:
        return z
    # t = sqrt(f (exp(s^2 / f) - 1)) with s = z (8 f + 3) / (8 f + 1)
    scaled = z * (8.0 * freedom + 3.0) / (8.0 * freedom + 1.0)
    return copysign(sqrt(freedom * (float(exp(scaled * scaled / freedom)) - 1.0)), z)
