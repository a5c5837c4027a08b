"""Mean of a series whose steps are correlated, as one recording gives it.

Two filters on one recording are compared by the differences of a number step by step (Diebold and
Mariano 1995, J. Business Econ. Stat. 13, 253). Neighboring differences are alike, so that their spread
over the square root of their number is too small an error. Here the long-run variance is the mean of
the first ``nu`` squared cosine weights of the differences, which are nearly independent and equally
large (Lazarus, Lewis, Stock and Watson 2018, J. Business Econ. Stat. 36, 541), after an autoregression
of first order (Andrews and Monahan 1992, Econometrica 60, 953); the mean over its error then has
Student's t with nu degrees of freedom. ``docs/statistics.md`` has the levels that simulations gave.
"""

from functools import lru_cache
from math import ceil, pi, sqrt
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.elementary import cos_sin
from trackbench.core.sums import dot, total
from trackbench.statistics.intervals import normal_of_t

LEAST_STEPS = 50
"""Steps from which on the test was simulated to hold its level."""
MOST_CORRELATED = 0.97
"""Autocorrelation from which on no series was simulated to hold the level, however long."""


class SeriesMean(NamedTuple):
    """Mean of a series, its standard error, the z with Student's tail probability, and its freedom."""

    value: float
    stderr: float
    z: float
    freedom: float = np.nan
    why: str = ""
    """it has no standard error"""


def series_mean(series: Array) -> SeriesMean:
    """Return the mean of a series (T,), without its NaN.

    It has no error for less than `LEAST_STEPS`, nor if its autocorrelation may be `MOST_CORRELATED`.
    """
    x = series[~np.isnan(series)]
    T = len(x)
    if T < LEAST_STEPS:
        why = f"{T} judged steps, and {LEAST_STEPS} are needed"
        return SeriesMean(float(total(x) / max(T, 1)), np.nan, np.nan, why=why)
    mean = float(total(x)) / T
    d = x - mean
    if not d.any():
        return SeriesMean(mean, 0.0, 0.0 if mean == 0.0 else float(np.copysign(np.inf, mean)))
    # Step 1: autoregression d_k = r d_{k-1} + u_k; r is too small by (1 + 3 r) / T.
    r = float(dot(d[1:], d[:-1])) / float(total(d * d))
    r = max(r + (1.0 + 3.0 * r) / T, -MOST_CORRELATED)
    # Two standard errors of r: a short series of nearly a random walk shows a smaller r by chance.
    most = min(r + 2.0 * sqrt(max(1.0 - r * r, 0.0) / T), 1.0)
    if most >= MOST_CORRELATED:
        most = ceil(1000.0 * most) / 1000.0  # never rounded to the limit
        why = f"autocorrelation of the steps up to {most:g}, and less than {MOST_CORRELATED:g} is needed"
        return SeriesMean(mean, np.nan, np.nan, why=why)
    u = d[1:] - r * d[:-1]
    # Step 2: long-run variance of u by cosines, and of d by 1 / (1 - r)^2.
    nu = max(4, int(0.2 * T ** (2.0 / 3.0)))
    n = len(u)
    weights = sqrt(2.0 / n) * dot(_cosines(nu, n), u)
    variance = float(total(weights * weights)) / nu / (1.0 - r) ** 2
    # Step 3: t = mean / sqrt(variance / T) has Student's distribution of nu degrees of freedom.
    stderr = sqrt(variance / T)
    return SeriesMean(mean, stderr, normal_of_t(mean / stderr, nu), nu)


@lru_cache(maxsize=2)
def _cosines(nu: int, n: int) -> Array:
    """Return ``cos(pi j (k + 1/2) / n)`` (nu, n), which all series of a recording's steps share."""
    middles = np.arange(n) + 0.5
    return np.stack([cos_sin(pi * (j * middles) / n)[0] for j in range(1, nu + 1)])
