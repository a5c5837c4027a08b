"""Mean of a series whose steps are correlated, as one recording gives it.

Two filters on one recording are compared by the differences of a number step by step (Diebold and
Mariano 1995, J. Business Econ. Stat. 13, 253). Neighboring differences are alike, so that their spread
over the square root of their number is too small an error. The differences may also have a slow part,
which the autocorrelation of neighbors does not show, below white noise.

The mean and the lowest cosine weights of the differences are nearly independent, and their variances
are the spectrum at low frequencies (Mueller and Watson 2008, Econometrica 76, 979). The spectrum at
frequency zero, which is the variance of the mean, is extrapolated from them by a set of models: white
noise plus an autoregression of first order, with many coefficients and shares of the variance. Each
model gives the mean a Student's t distribution. They are weighed by the likelihood of the cosine
weights, so that the tail probability of the mean counts every slow part that the differences could
have without showing it. ``docs/statistics.md`` has the levels and the power that simulations gave.
"""

from functools import lru_cache
from math import copysign, frexp, inf, isfinite, ldexp, log, pi, sqrt
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.elementary import cos_sin, exp
from trackbench.core.elementary import log as elementwise_log
from trackbench.core.sums import dot, total
from trackbench.errors import counted
from trackbench.statistics.student_t import deviations, normals_of_t

LEAST_STEPS = 50
"""Steps from which on the test was simulated to hold its level."""
MOST_CORRELATED = 0.97
"""Autocorrelation of neighbors from which on no series was simulated to hold the level."""
_MOST_COSINES = 64
_COEFFICIENTS = (0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 0.99, 0.995, 0.998)
"""Of the autoregressions; a series of more than 10 000 steps has slower ones, too."""
_LONGEST_TABULATED = 2.5
"""Longest correlation time 1 / (1 - r) of the tabulated models, over the length of the series.

A model with a longer time gets this time. So the models change gradually with the length of the series:
if a model were left out of short series, the series at which it begins to count would have less power
than shorter ones.
"""
_LONGEST_ADDED = 0.1
"""The same for the slower models that are added for a long series."""
_SHARES = (0.01, 0.02, 0.05, 0.1, 0.2, 0.4, 0.7, 1.0)
"""Shares of the variance that are the autoregression's."""
_SMALLEST_SQUARED = 1e-100
_LARGEST_SQUARED = 1e100
"""Sizes between which the square of a difference can be computed."""
_WHITE = 0.4
"""Prior probability of white noise; the other models are equally probable."""


class SeriesMean(NamedTuple):
    """Mean of a series, the z with its tail probability, and the distribution of its error."""

    value: float
    z: float
    distribution: "ErrorDistribution | None" = None
    why: str = ""
    """reason why the mean has no standard error; empty if it has one"""

    @property
    def stderr(self) -> float:
        """Half the width of the mean's 68.3 % interval, as of a normal one of one standard deviation."""
        if self.why:
            return np.nan
        if self.distribution is None:  # the steps are equal but for rounding
            return 0.0
        return self.distribution.half_width(1.0)

    def half_width(self, level: float) -> float:
        """Return half the width of the mean's confidence interval.

        Parameters
        ----------
        level
            probability that the interval covers, such as 0.95

        Returns
        -------
        float
            half width, in the unit of the series; NaN without a standard error
        """
        if self.why:
            return np.nan
        if self.distribution is None:  # the steps are equal but for rounding
            return 0.0
        return self.distribution.half_width(deviations(level))


class ErrorDistribution(NamedTuple):
    """Distribution of a mean's error: a mixture of Student's t distributions, one for each model.

    A model is an assumption on the autocorrelation of the series. All t have the same degrees of
    freedom.
    """

    log_weights: Array
    """logarithms of the models' probabilities (m,)"""
    scales: Array
    """of the mean's t distribution by each model (m,)"""
    freedom: int

    def z(self, error: float) -> float:
        """Return the normal deviate with the tail probability that an error of the mean has.

        Parameters
        ----------
        error
            error of the mean, in the unit of the series

        Returns
        -------
        float
            deviate with the sign of the error; infinite for too large an error
        """
        from scipy.special import log_ndtr, ndtri_exp

        # P(error) = sum over the models of the weight times the tail probability of t
        zs = normals_of_t(abs(error) / self.scales, self.freedom)
        logs = self.log_weights + log_ndtr(-zs)
        most = float(logs.max())
        # The error is infinite, or too large a multiple of all scales.
        if not isfinite(most):
            return copysign(inf, error)
        if error == 0.0:
            return 0.0
        tail = most + log(float(total(exp(logs - most))))
        # Rounding may bring the tail probability above its largest value, one half.
        return float(copysign(ndtri_exp(min(tail, log(0.5))), error))

    def half_width(self, z: float) -> float:
        """Return the error of the mean that has a normal deviate, by bisection.

        Parameters
        ----------
        z
            normal deviate, positive

        Returns
        -------
        float
            error of the mean, in the unit of the series
        """
        # Step 1: bracket it. Step 2: halve the bracket to eight digits.
        low = 0.0
        high = float(self.scales.max())
        while self.z(high) < z:
            low = high
            high = 2.0 * high
        while high - low > 1e-8 * high:
            middle = 0.5 * (low + high)
            if not low < middle < high:  # no number lies between two subnormal ones
                break
            if self.z(middle) < z:
                low = middle
            else:
                high = middle
        return high


def series_mean(series: Array) -> SeriesMean:
    """Return the mean of a series of correlated steps, and its standard error.

    The mean has no standard error for fewer steps than `LEAST_STEPS`, nor if the autocorrelation of
    neighbors may be as large as `MOST_CORRELATED`.

    The mean's error is a mixture of Student's t distributions over models of the autocorrelation
    (`_models`), which are weighed by the likelihood of the series' lowest cosine weights (Mueller and
    Watson 2008, Econometrica 76, 979).

    Parameters
    ----------
    series
        values (T,) of the steps. NaN is left out

    Returns
    -------
    SeriesMean
        mean, z of the hypothesis that it is zero, and the distribution of its error. The mean is NaN for
        a series without a number
    """
    x = series[~np.isnan(series)]
    T = len(x)
    if T < LEAST_STEPS:
        why = f"{counted(T, 'judged step')}, and {LEAST_STEPS} are needed"
        mean_of_few = float(total(x)) / T if T else np.nan
        return SeriesMean(mean_of_few, np.nan, why=why)
    mean = float(total(x)) / T
    differences = x - mean
    if not differences.any():
        return _mean_without_spread(mean)
    unit = _unit_of(differences)
    d = differences / unit
    if why := _refused_autocorrelation(d):
        return SeriesMean(mean, np.nan, why=why)
    # Step 1: cosine weights Y_j = sqrt(2 / T) sum_k cos(pi j (k + 1/2) / T) d_k, j = 1 ... q.
    q = min(T // 2, _MOST_COSINES)
    weights = sqrt(2.0 / T) * dot(_cosines(q, T), d)
    # Step 2: by a model with variances v_j up to a factor, Q = sum Y_j^2 / v_j, and the mean over
    # sqrt(v_0 Q / (q T)) has Student's t distribution of q degrees of freedom (unknown factor).
    models = _models(q, T)
    quadratic = dot(1.0 / models.of_cosines, weights * weights)
    # All cosine weights may be rounded to zero.
    if not (quadratic > 0.0).all():
        return _mean_without_spread(mean)
    scales = unit * np.sqrt(models.of_mean * quadratic / (q * T))
    if not (scales > 0.0).all():  # smaller than the smallest number
        return _mean_without_spread(mean)
    # Step 3: likelihood of the cosine weights, prod v_j^(-1/2) Q^(-q/2), times the prior.
    logs = models.log_prior - 0.5 * models.log_determinant - 0.5 * q * elementwise_log(quadratic)
    logs -= logs.max()
    logs -= log(float(total(exp(logs))))
    distribution = ErrorDistribution(log_weights=logs, scales=scales, freedom=q)
    return SeriesMean(mean, z=distribution.z(mean), distribution=distribution)


def _unit_of(differences: Array) -> float:
    """Return a power of two, such that the squares of differences (T,) over it can be computed.

    It is 1 for differences of ordinary size.
    """
    largest = float(np.abs(differences).max())
    if _SMALLEST_SQUARED < largest < _LARGEST_SQUARED or not isfinite(largest):
        return 1.0
    return ldexp(1.0, frexp(largest)[1] - 1)


def _mean_without_spread(mean: float) -> SeriesMean:
    """Return the mean of steps that are all equal: any value but zero differs from zero for certain."""
    if mean == 0.0:
        return SeriesMean(mean, z=0.0)
    return SeriesMean(mean, z=copysign(inf, mean))


def _refused_autocorrelation(d: Array) -> str:
    """Explain why the autocorrelation of centered values d (T,) is too high; empty if it is not."""
    # r = sum d_k d_{k-1} / sum d_k^2 is too small by (1 + 3 r) / T.
    T = len(d)
    r = float(dot(d[1:], d[:-1])) / float(total(d * d))
    r += (1.0 + 3.0 * r) / T
    # Two standard errors of r: a short series of nearly a random walk shows a smaller r by chance.
    most = min(r + 2.0 * sqrt(max(1.0 - r * r, 0.0) / T), 1.0)
    if most < MOST_CORRELATED:
        return ""
    return f"the autocorrelation of neighboring steps may be {MOST_CORRELATED:g} or more"


class _Models(NamedTuple):
    """Variances of the mean and of the cosine weights by each of m models, and their prior."""

    of_mean: Array
    """times the number of steps (m,)"""
    of_cosines: Array
    """(m, q)"""
    log_determinant: Array
    """sum of the logarithms of the latter (m,)"""
    log_prior: Array


@lru_cache(maxsize=4)
def _models(q: int, T: int) -> _Models:
    """Return the models of series of T steps: the variances of the mean and of q cosine weights.

    A cosine weight j is the projection of the series on cos(pi j (t + 1/2) / T). All models have the
    variance 1 per step. The first model is white noise, of which each cosine weight and sqrt(T) times
    the mean have the variance 1. Each other one is a mixture of white noise and an autoregression.
    """
    # The correlation time of an autoregression with the coefficient r is 1 / (1 - r) steps.
    slowest = 1.0 - 1.0 / (_LONGEST_TABULATED * T)
    coefficients = [min(r, slowest) for r in _COEFFICIENTS]
    # Long series have slower ones, each with twice the correlation time of the one before.
    while 2.0 / (1.0 - coefficients[-1]) <= _LONGEST_ADDED * T:
        coefficients.append(1.0 - 0.5 * (1.0 - coefficients[-1]))
    variances = [np.ones(q + 1)]
    for coefficient in coefficients:
        # Of sqrt(T) times the mean (index 0), and of the first q cosine weights.
        of_autoregression = _variances(coefficient, T)[: q + 1]
        variances += [1.0 - share + share * of_autoregression for share in _SHARES]
    every = np.stack(variances)
    prior = np.full(len(every), (1.0 - _WHITE) / (len(every) - 1.0))
    prior[0] = _WHITE
    of_cosines = np.ascontiguousarray(every[:, 1:])
    return _Models(
        of_mean=every[:, 0],
        of_cosines=of_cosines,
        log_determinant=total(elementwise_log(of_cosines)),
        log_prior=elementwise_log(prior),
    )


def _variances(r: float, T: int) -> Array:
    """Return the variances (T,) of the T cosine weights of an autoregression of unit variance.

    The weights are the coefficients of the series in the orthonormal cosine basis; that of index 0 is
    sqrt(T) times the mean. ``r`` is the autoregression's coefficient, 0 < r < 1.

    The inverse of its covariance, times 1 - r^2, is tridiagonal. The cosines
    diagonalize this matrix except for its two corners. The eigenvalues are
    ``l_j = 1 + r^2 - 2 r cos(pi j / T)``, and each corner adds r (1 - r). The corners change the even
    and the odd cosines by a matrix of rank one each, which Sherman and Morrison's formula inverts.
    """
    j = np.arange(T)
    cosine = cos_sin(pi * j / T)[0]
    eigenvalues = 1.0 + r * r - 2.0 * r * cosine
    # Squares of the first element of each cosine vector: 2 / T cos^2(pi j / (2 T)); 1 / T of the mean.
    first = np.square(cos_sin(0.5 * pi * j / T)[0]) * (2.0 / T)
    first[0] = 1.0 / T
    variances = np.empty(T)
    for parity in (0, 1):
        part = slice(parity, None, 2)
        inverse = 1.0 / eigenvalues[part]
        corner = 2.0 * first[part] * inverse
        denominator = 1.0 / (r * (1.0 - r)) + float(total(corner))
        variances[part] = (1.0 - r * r) * (inverse - corner * inverse / denominator)
    return variances


@lru_cache(maxsize=2)
def _cosines(q: int, n: int) -> Array:
    """Return ``cos(pi j (k + 1/2) / n)`` (q, n), which all series of a recording's steps share."""
    middles = np.arange(n) + 0.5
    return np.stack([cos_sin(pi * (j * middles) / n)[0] for j in range(1, q + 1)])
