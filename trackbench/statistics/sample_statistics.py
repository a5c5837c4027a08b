"""Statistics over runs with their standard errors and intervals: mean, rms, median, variance.

Every estimator takes values per run (M,), lost runs already left out, and returns (value, stderr). With
fewer than two runs the standard error is NaN.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.sums import total
from trackbench.statistics.jackknife import jackknife_influences
from trackbench.statistics.skewness_corrected_t_test import interval_of

# Collapsed particles have an infinite NEES: its mean is infinite, and its standard error is NaN.
_quietly = np.errstate(all="ignore")


class Estimate(NamedTuple):
    """A number and its standard error."""

    value: float
    stderr: float


class Estimates(NamedTuple):
    """Numbers (n,) and their standard errors (n,)."""

    value: Array
    stderr: Array


@_quietly
def mean(x: Array) -> Estimate:
    """Sample mean, ``s / sqrt(M)``."""
    average = _mean(x)
    return Estimate(average, _sd(x, average) / np.sqrt(max(len(x), 1)))


@_quietly
def variance(x: Array) -> Estimate:
    """Return the unbiased variance; standard error by leaving out one run at a time.

    Parameters
    ----------
    x
        values (M,) of the runs, without NaN

    Returns
    -------
    Estimate
        variance in the squared unit of x. The standard error is NaN for fewer than four runs, and both
        are NaN for fewer than two
    """
    M = len(x)
    if M < 2:
        return Estimate(np.nan, np.nan)
    # The square is numpy's, which overflows to infinity without an error.
    squares = np.square(x - _mean(x))
    s2 = total(squares) / (M - 1)
    stderr = np.nan
    if M > 3:
        stderr = mean(_influence_of_squares(squares)).stderr
    return Estimate(float(s2), stderr)


@_quietly
def rms(x: Array) -> Estimate:
    """Return the root mean square, such as of RMSEs per run; the delta method gives its error.

    Parameters
    ----------
    x
        values (M,) of the runs, without NaN

    Returns
    -------
    Estimate
        root mean square in the unit of x
    """
    squares = mean(np.square(x))
    value = float(np.sqrt(squares.value))
    if value == 0.0:
        return Estimate(0.0, 0.0)
    return Estimate(value, squares.stderr / (2.0 * value))


@_quietly
def median(x: Array) -> Estimate:
    """Return the median; standard error from its rank interval (Woodruff 1952).

    Parameters
    ----------
    x
        values (M,) of the runs, without NaN

    Returns
    -------
    Estimate
        median in the unit of x. The standard error is NaN for fewer than two runs
    """
    M = len(x)
    if M < 2:
        return Estimate(_mean(x), np.nan)
    deviations = min(1.96, np.sqrt(M))  # ranks cannot leave the sample
    # Quantiles at 1/2 -+ 1.96 / (2 sqrt(M)) are 2 * 1.96 standard errors apart.
    share = 0.5 * deviations / np.sqrt(M)
    low, middle, high = _quantiles(x, [0.5 - share, 0.5, 0.5 + share])
    return Estimate(middle, (high - low) / (2.0 * deviations))


def _quantiles(x: Array, shares: Sequence[float]) -> list[float]:
    """Return the quantiles of x (M,) below which these shares of the values lie.

    They are linear between two values, bit for bit as those of ``np.quantile``, which takes three times
    as long. Between two infinities, where numpy returns NaN, the quantile is infinite.
    """
    ranks = [float(share) * (len(x) - 1) for share in shares]
    lower = [int(rank) for rank in ranks]
    upper = [min(index + 1, len(x) - 1) for index in lower]
    values = _at_ranks(x, sorted({*lower, *upper}))
    quantiles = []
    for rank, i, j in zip(ranks, lower, upper, strict=True):
        below = float(values[i])
        above = float(values[j])
        fraction = rank - i
        if fraction < 0.5:
            quantile = below + (above - below) * fraction
        else:
            quantile = above - (above - below) * (1.0 - fraction)
        # inf - inf is NaN: between two equal infinities the quantile is this infinity.
        if np.isnan(quantile):
            quantile = below if below == above else float(x.max())
        quantiles.append(quantile)
    return quantiles


_MANY = 2000
"""Number of values above which those in the middle are found faster by a guess of their range."""


def _at_ranks(x: Array, ranks: Sequence[int]) -> dict[int, float]:
    """Return by rank the values of x (M,) that have these ranks if x is in order; ranks count from 0.

    ``ranks`` ascend. They are near each other, as those about a median are.
    """
    M = len(x)
    if M > _MANY:
        # Two of 400 values, taken evenly from x, are probably below and above all values that we need.
        sample = np.sort(x[:: M // 400])
        margin = len(sample) // 16
        low = sample[max(ranks[0] * len(sample) // M - margin, 0)]
        high = sample[min(ranks[-1] * len(sample) // M + margin, len(sample) - 1)]
        # So only the values between these two are put in order.
        below = int(np.count_nonzero(x < low))
        between = x.compress((x >= low) & (x <= high))
        if below <= ranks[0] and ranks[-1] < below + len(between):
            ranks_between = [rank - below for rank in ranks]
            between.partition(ranks_between)
            return {rank: between[i] for rank, i in zip(ranks, ranks_between, strict=True)}
    ordered = np.partition(x, ranks)
    return {rank: ordered[rank] for rank in ranks}


@_quietly
def deviation(x: Array) -> Estimate:
    """Return the standard deviation (divisor M) of x (M,), such as a step's errors; NaN for M < 2."""
    if len(x) < 2:
        return Estimate(np.nan, np.nan)
    stderr = mean(influence("std", x)).stderr
    return Estimate(float(np.sqrt(_mean(np.square(x - _mean(x))))), stderr)


def _influence_on_rms(x: Array) -> Array:
    """Return the influence (M,) of each run on the rms of x (M,)."""
    M = len(x)
    squares = np.square(x)
    # Mean square of the other runs, from which the jackknife takes the root.
    others = np.maximum(total(squares) - squares, 0.0) / max(M - 1, 1)
    return jackknife_influences(float(np.sqrt(_mean(squares))), np.sqrt(others))


def _influence_on_deviation(x: Array) -> Array:
    """Return the influence (M,) of each of the runs' values on their standard deviation."""
    # ds = ((x - m)^2 - s^2) / (2 s)
    squares = np.square(x - _mean(x))
    return (squares - _mean(squares)) / (2.0 * np.sqrt(_mean(squares)))


def _influence_on_variance(x: Array) -> Array:
    """Return the influence (M,) of each of the runs' values on their variance."""
    return _influence_of_squares(np.square(x - _mean(x)))


def _influence_of_squares(squares: Array) -> Array:
    """Return the jackknife's influences (M,) on a variance, from squared deviations (M,)."""
    M = len(squares)
    # Without run m the variance is (sum d^2 - d_m^2 M / (M - 1)) / (M - 2), d the deviations from the
    # mean. The influence is (M - 1) times the variance less this: M / (M - 2) d_m^2, centered.
    return (squares - _mean(squares)) * (M / max(M - 2.0, 1.0))


def _influence_on_median(x: Array) -> Array:
    """Return ``sign(x - median) / (2 f)``, with the density f at the median from the standard error."""
    value, stderr = median(x)
    return np.sign(x - value) * stderr * np.sqrt(len(x))


class Statistic(NamedTuple):
    """A statistic over runs, with each run's influence on it, and what it is in words."""

    estimate: Callable[[Array], Estimate]
    influence: Callable[[Array], Array]
    help: str
    power: int = 1
    """of the metric's unit, which the statistic has"""

    def __call__(self, x: Array) -> Estimate:
        """Return the value and standard error of values per run (M,)."""
        return self.estimate(x)


STATISTICS = {
    "mean": Statistic(mean, lambda x: x - _mean(x), "mean over the runs"),
    "variance": Statistic(
        variance, _influence_on_variance, "unbiased variance over the runs", power=2
    ),
    "rms": Statistic(rms, _influence_on_rms, "root mean square over the runs"),
    "median": Statistic(median, _influence_on_median, "median over the runs"),
}
"""Those that summary.csv has of every metric per run."""
OVER_RUNS = STATISTICS | {
    "std": Statistic(
        deviation, _influence_on_deviation, "standard deviation over the runs, at a step"
    )
}


@_quietly
def mean_from_sums(total: Array, squares: Array, count: Array) -> Estimates:
    """Return the mean and standard error from sums, sums of squares and numbers of values, each (n,)."""
    value = total / count
    # s^2 = (sum x^2 - M m^2) / (M - 1), and the mean's variance s^2 / M
    spread = np.maximum(squares - count * np.square(value), 0.0) / (count - 1)
    return Estimates(value, np.where(count < 2, np.nan, np.sqrt(spread / count)))


@_quietly
def deviation_from_sums(total: Array, squares: Array, count: Array) -> Estimates:
    """Return standard deviations from sums, sums of squares and numbers of values, each (n,).

    The standard errors are those of normal values. Both are NaN for fewer than two values.
    """
    # s = sqrt(E x^2 - (E x)^2), and its standard error s / sqrt(2 M)
    std = np.sqrt(np.maximum(squares / count - np.square(total / count), 0.0))
    std = np.where(count < 2.0, np.nan, std)
    return Estimates(std, std / np.sqrt(2.0 * count))


@_quietly
def rooted(estimates: Estimates) -> Estimates:
    """Return square roots of estimates; delta method."""
    value = np.sqrt(estimates.value)
    # d sqrt(x) = dx / (2 sqrt(x)); a zero keeps its error.
    stderr = np.where(value > 0, estimates.stderr / (2.0 * value), estimates.stderr)
    return Estimates(value, stderr)


@_quietly
def influence(name: str, x: Array) -> Array:
    """Return each run's influence on a statistic: centered values whose mean has its error.

    The standard error of a smooth combination of statistics on common runs is that of the mean of the
    same combination of influences (the infinitesimal jackknife).

    Parameters
    ----------
    name
        statistic, a key of `OVER_RUNS`
    x
        values (M,) of the runs, without NaN

    Returns
    -------
    array (M,)
        centered influences, in the unit of the statistic

    Raises
    ------
    ValueError
        for another name
    """
    if name not in OVER_RUNS:
        raise ValueError(f"no influence of {name!r}")
    return np.asarray(OVER_RUNS[name].influence(x))


@_quietly
def z_score(estimate: Estimate) -> float:
    """Return the value over its standard error; NaN if both are zero, as for equal filters."""
    return float(np.divide(estimate.value, estimate.stderr))


@_quietly
def interval(name: str, x: Array, level: float = 0.95) -> tuple[float, float]:
    """Return the confidence interval of a statistic from the influences of the runs on it.

    `skewness_corrected_t_test` computes it. A median has the exact rank interval, which covers at least
    ``level`` for any distribution. A bootstrap only comes near that level. It also needs random numbers,
    and equal data would not give equal bytes.

    Parameters
    ----------
    name
        statistic, a key of `STATISTICS`
    x
        values (M,) of the runs, without NaN
    level
        probability that the interval covers

    Returns
    -------
    low, high : float
        ends of the interval; NaN for fewer than two runs, and for a median of too few runs
    """
    if len(x) < 2:
        return np.nan, np.nan
    if name == "median":
        return _rank_interval(x, level)
    return interval_of(STATISTICS[name](x).value, influence(name, x), level)


def _rank_interval(x: Array, level: float) -> tuple[float, float]:
    """Return the ends of the median's interval: the k-th smallest and k-th largest of x (M,).

    NaN for too few values (Conover 1999, section 3.2). k follows from the confidence ``level``.
    scipy's ``quantile_test`` gives the same, half a second of imports later.
    """
    from scipy.special import bdtr

    n = len(x)
    tail = 0.5 - level / 2.0
    first = max(0, int(n / 2.0 - 20.0 * np.sqrt(n)))  # forty standard deviations below the middle
    # k - 1 is the largest j with P(X <= j) below the tail, X binomial (n, 1/2).
    below = bdtr(np.arange(first, n // 2 + 1), n, 0.5)
    k = first + int(np.searchsorted(below, tail))
    if k == 0:
        return np.nan, np.nan
    ordered = np.sort(x)
    return float(ordered[k - 1]), float(ordered[n - k])


def _mean(x: Array) -> float:
    """Return the mean of values (M,); NaN of none."""
    if len(x) == 0:
        return np.nan
    return float(total(x) / len(x))


def _sd(x: Array, average: float) -> float:
    """Return the standard deviation of values (M,) with this mean; NaN of fewer than two."""
    if len(x) < 2:
        return np.nan
    return float(np.sqrt(total(np.square(x - average)) / (len(x) - 1)))
