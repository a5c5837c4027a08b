"""Bands of a consistent filter's ANEES, ANIS and autocorrelation; the word on a filter."""

from dataclasses import dataclass
from math import isfinite, nan

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.sums import total
from trackbench.statistics.sample_statistics import influence, mean
from trackbench.statistics.significance_rules import NEAR
from trackbench.statistics.skewness_corrected_t_test import studentized


def anees_band(n_x: int, runs: float, level: float = 0.95) -> tuple[float, float]:
    """Return the band that contains a consistent filter's ANEES with some probability.

    The ANEES has the law ``chi2(n_x M) / (n_x M)`` with the mean 1, for n_x components and M runs
    (Bar-Shalom, Li and Kirubarajan 2001, section 5.4). It is valid at one step, where runs are
    independent.

    Parameters
    ----------
    n_x
        number of components of the state
    runs
        number of runs, M. An effective number of runs need not be whole
    level
        probability

    Returns
    -------
    low, high : float
        ends of the band
    """
    from scipy.special import gammaincinv

    # The chi-square quantile of n M degrees of freedom is 2 P^-1(n M / 2, p), P incomplete gamma.
    shares = [0.5 - level / 2.0, 0.5 + level / 2.0]
    low, high = 2.0 * gammaincinv(n_x * runs / 2.0, shares) / (n_x * runs)
    return float(low), float(high)


def largest_anees_of_one_run(n_x: int, probability: float) -> float:
    """Return what the ANEES of one run of a consistent filter exceeds with at most this probability.

    The errors of its steps may depend on each other in any way. A mean of variables of one law is below
    this law in the convex order, whatever their dependence. So Markov's inequality above the quantile
    q of the law bounds the mean by the expected shortfall ``E[x | x > q]``. For the law
    ``chi2(n) / n`` this is ``P(chi2(n + 2) > n q) / P(chi2(n) > n q)``.

    Parameters
    ----------
    n_x
        number of components of the state
    probability
        probability with which the limit is exceeded at most

    Returns
    -------
    float
        the limit, 5.6 for two components and the probability 0.01
    """
    from scipy.special import chdtrc, chdtri

    quantile = chdtri(n_x, probability)
    return float(chdtrc(n_x + 2, quantile) / probability)


@dataclass(frozen=True)
class AcceptedNis:
    """Law of the NIS per component of the measurements that a consistent filter's gate accepts.

    A gate at the quantile q of the chi-square law F_n cuts its tail off. The rest has the mean
    ``n F_{n+2}(q) / F_n(q)`` and the mean square ``n (n + 2) F_{n+4}(q) / F_n(q)`` (Johnson, Kotz &
    Balakrishnan 1994, chapter 18). Of several sensors any may measure at a step. One gate then has the
    law of one to all of them. With a gate each, sensors that measure together have innovations that
    depend on each other, and the mean is between that of the sensors' laws and 1.
    """

    gate: float
    """probability of a good measurement within the gate"""
    sizes: tuple[int, ...]
    """number of components of each sensor's measurement"""
    each: bool = False
    """each sensor has a gate of its own"""

    @property
    def mean(self) -> tuple[float, float]:
        """Least and largest mean NIS per component of a consistent filter: equal for one sensor.

        Which of them holds depends on the sensors that measure together.
        """
        means = []
        for n in self._judged_components:
            mean, _ = self._moments(n)
            means.append(mean)
        # Several sensors with a gate each: each gate cuts the tail of its sensor's innovation off. If
        # sensors measure together, the part of one innovation that the others do not determine may be
        # hardly cut, and has a mean up to 1.
        if self._mean_may_reach_one:
            return min(means), 1.0
        return min(means), max(means)

    def band(self, components: float, level: float = 0.95) -> tuple[float, float]:
        """Return the band that contains a consistent filter's mean NIS per component.

        A gate judges the n components of one sensor, or of several at once. For each possible n the mean
        has another law. The band spans the bands of all these laws.

        Parameters
        ----------
        components
            number of components in all measurements that the mean is over
        level
            probability of each law's band

        Returns
        -------
        low, high : float
            ends of the band
        """
        lows = []
        highs = []
        for n in self._judged_components:
            # The mean's law is taken as that of m chi2(f) / f, with m and the variance of NIS / n.
            mean, variance = self._moments(n)
            freedom = 2.0 * mean * mean * components / (n * variance)
            low, high = anees_band(1, freedom, level)
            lows.append(mean * low)
            highs.append(mean * high)
        # Several sensors, each with a gate, may measure together: the mean is up to 1.
        if self._mean_may_reach_one:
            _, high_of_mean_one = anees_band(1, components, level)
            highs.append(high_of_mean_one)
        return min(lows), max(highs)

    @property
    def _judged_components(self) -> set[int]:
        """Numbers of components that one gate may judge at a step.

        If each sensor has a gate, they are those of each sensor. One gate for all sensors may also judge
        the components of all.
        """
        if self.each:
            return set(self.sizes)
        return {*self.sizes, sum(self.sizes)}

    @property
    def _mean_may_reach_one(self) -> bool:
        """True if the mean may be up to 1: several sensors with a gate each may measure together."""
        return self.each and len(self.sizes) > 1

    def _moments(self, n: int) -> tuple[float, float]:
        """Return mean and variance of NIS / n of a measurement of n components that a gate accepts."""
        from scipy.special import chdtr, chdtri

        # NIS is a chi-square of n degrees, below the quantile with the gate's probability.
        quantile = chdtri(n, 1.0 - self.gate)
        mean = chdtr(n + 2, quantile) / self.gate
        square = (n + 2.0) / n * chdtr(n + 4, quantile) / self.gate
        return float(mean), float(square - mean * mean)


def nis_band(components: float, accepted: AcceptedNis | None) -> tuple[float, float]:
    """Return the 95 % band of a mean of a consistent filter's normalized squares, NIS or NEES.

    The squares are per component, and ``components`` is the number of components in all of them.
    ``accepted`` is the distribution of what a filter's gate accepts; None without a gate.
    """
    if accepted is None:
        return anees_band(1, components)
    return accepted.band(components)


def components(numbers: Array) -> float:
    """Return the number N of components of which one average varies as much as the mean over runs.

    Run i averages n_i components: chi2(n_i) / n_i, of variance 2 / n_i. The mean over runs has the
    variance sum(2 / n_i) / M^2, and so has chi2(N) / N with N = M^2 / sum(1 / n_i) (Satterthwaite 1946,
    Biometrics Bull. 2, 110).

    Parameters
    ----------
    numbers
        numbers n_i (M,) of components of the runs. Runs without any do not count

    Returns
    -------
    float
        N, which is M n for equal n_i, and 0 without any component
    """
    positive = numbers[numbers > 0]
    if not len(positive):
        return 0.0
    least = positive.min()  # divided out, so that equal numbers give M n without rounding
    # N = M^2 / sum(1 / n_i)
    return float(len(positive) * least * (len(positive) / total(least / positive)))


def anis_band(numbers: Array, accepted: AcceptedNis | None = None) -> tuple[float, float]:
    """Return the 95 % band of the mean ANIS over runs; wide for few measurements.

    ``numbers`` (M,) are those of the measured components of each run. ``accepted`` is the distribution
    of what a filter's gate accepts; None without a gate.
    """
    return nis_band(components(numbers), accepted)


def autocorrelation_band(numbers: Array) -> float:
    """Return the 95 % half-width of the mean autocorrelation over runs; infinite without measurements.

    The autocorrelation is that of a consistent filter's whitened innovations, at any lag. In a run of n
    measured components it has the mean 0 and the variance 1 / n. ``numbers`` (M,) are these n.
    """
    # Number of components in one run whose autocorrelation varies as much as the mean over the runs.
    number = components(numbers)
    if not number:
        return np.inf
    return 1.96 / float(np.sqrt(number))


def credibility(low: float, high: float, sign: int, mean: tuple[float, float] = (1.0, 1.0)) -> str:
    """Return the word on a filter from its ANEES or ANIS.

    It is calibrated if the 95 % interval is within `NEAR` of the mean of a consistent filter. Otherwise
    the sign of a significant difference from this mean decides.

    Parameters
    ----------
    low, high
        ends of the 95 % interval
    sign
        sign of a difference that is significant by Holm at `LEVEL` over the filters of a table; 0 of any
        other
    mean
        least and largest mean of a consistent filter

    Returns
    -------
    str
        ``calibrated``, ``overconfident`` or ``underconfident``; empty if undecided or without an
        interval
    """
    least, largest = mean
    if not isfinite(low + high):
        return ""
    if low >= least * (1.0 - NEAR) and high <= largest * (1.0 + NEAR):
        return "calibrated"
    return {1: "overconfident", -1: "underconfident"}.get(sign, "")


def z_of_mean(values: Array, expected_range: tuple[float, float]) -> float:
    """Return z of the difference of a mean from that of a consistent filter.

    Parameters
    ----------
    values
        values (M,) of the runs, without NaN
    expected_range
        least and largest mean of a consistent filter

    Returns
    -------
    float
        z of the difference from the nearest such mean; NaN for fewer than two runs, and if a value is
        infinite
    """
    if len(values) < 2 or not np.isfinite(values).all():
        return nan
    # Compare with the nearest mean that a consistent filter may have.
    least, largest = expected_range
    measured_mean = mean(values).value
    nearest_mean = min(max(measured_mean, least), largest)
    return studentized(measured_mean - nearest_mean, influence("mean", values))
