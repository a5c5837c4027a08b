"""A measured number with its error, from one influence per run, and sums and differences of two."""

from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.statistics.limits_of_differences import (
    Sides,
    correlation,
    interval_of_difference,
    of_variances,
    studentized_difference,
)
from trackbench.statistics.sample_statistics import OVER_RUNS, Estimate, influence, mean, z_score
from trackbench.statistics.share_of_runs import (
    Events,
    share_in_words,
    share_interval,
    share_stderr,
    share_z,
)
from trackbench.statistics.skewness_corrected_t_test import interval_of, studentized
from trackbench.statistics.student_t import quantile, stderr_of

# A filter that left the numbers has infinite statistics; they are shown, not warned about.
ignore_float_errors = np.errstate(all="ignore")


class RunEstimate(NamedTuple):
    """A number, its standard error, and each run's influence (M,) if it has one; runs and lost runs."""

    value: float
    stderr: float
    """standard error; NaN if there is none"""
    influences: Array | None
    """centered values (M,) whose mean has the number's error, without the NaN; None if unknown"""
    runs: int
    """number of runs with a value, lost ones left out"""
    lost: int = 0
    """number of lost runs"""
    pair: "tuple[RunEstimate, RunEstimate, float] | None" = None
    """a, b and f of a difference a - f b that is tested by the limits of both"""

    @property
    def estimate(self) -> Estimate:
        """Value and standard error."""
        return Estimate(self.value, self.stderr)

    def scaled(self, value: float, factor: float = 1.0, divisor: float = 1.0) -> "RunEstimate":
        """Return an estimate with the influences of this one times ``factor / divisor``.

        Parameters
        ----------
        value
            value of the new estimate
        factor
            factor of influences and standard error
        divisor
            their divisor, which is positive

        Returns
        -------
        RunEstimate
            estimate of the same runs
        """
        influences = None
        if self.influences is not None:
            influences = self.influences * factor / divisor
        stderr = self.stderr * abs(factor) / divisor
        return self._replace(value=value, stderr=stderr, influences=influences)

    @property
    def has_influences(self) -> bool:
        """True if the influences of the runs are known, so that runs can be left out of the number."""
        return self.influences is not None

    @property
    def is_exact(self) -> bool:
        """True if the test of the number is exact: `verdict_rules.decided` needs fewer deviations."""
        return False

    @property
    def why(self) -> str:
        """Reason why there is no standard error; empty if there is one."""
        return "no standard error" if np.isnan(self.stderr) else ""

    @property
    def losses(self) -> str:
        """Number of lost runs in words; empty for none."""
        if not self.lost:
            return ""
        return share_in_words(self.lost, self.runs + self.lost)

    @property
    def sides(self) -> Sides | None:
        """Confidence limits of both numbers of a difference ``a - factor b``, from ``pair``.

        They are None for any other number. They are also None if one of two variances, or their
        difference, has a standard error of zero. `pair` is set for differences of two variances or of
        two shares of runs (`Share`) only.
        """
        if self.pair is None:
            return None
        a, b, factor = self.pair
        assert a.influences is not None
        assert b.influences is not None
        influences_of_b = factor * b.influences
        # Numbers of a pair that are no shares are variances.
        if not isinstance(a, Share) or not isinstance(b, Share):
            return of_variances(a.influences, influences_of_b)
        return Sides(
            first=Events(a.events, a.runs),
            second=Events(b.events, b.runs, factor),
            correlation=correlation(a.influences, influences_of_b),
        )

    @ignore_float_errors
    def from_other_runs(self, influences: Array) -> "RunEstimate":
        """Return the estimate from other runs.

        To first order the number differs by the mean of their influences on it.

        Parameters
        ----------
        influences
            influences (M',) of the other runs on this number, NaN where a run has none

        Returns
        -------
        RunEstimate
            estimate with the shifted number. It has no `pair`, whose limits are those of the old runs
        """
        x = influences[~np.isnan(influences)]
        shift, stderr = mean(x)
        shifted = self._replace(value=self.value + shift, stderr=stderr, runs=len(x), pair=None)
        return shifted._replace(influences=influences - shift)  # centered again

    def z(self, target: float = 0.0, other: float = 0.0) -> float:
        """Return z of the hypothesis that the true value of the number is a target.

        Parameters
        ----------
        target
            hypothetical value
        other
            standard error of ``target`` itself, independent of the runs

        Returns
        -------
        float
            z, positive if the number is larger; NaN without a standard error
        """
        with np.errstate(all="ignore"):
            if self.influences is None:
                return z_score(Estimate(self.value - target, np.hypot(self.stderr, other)))
            # A difference of two variances or shares is tested by the confidence limits of both.
            sides = self.sides
            if sides is not None:
                return studentized_difference(self.value - target, sides, other)
            return studentized(self.value - target, self.influences, other)

    def interval(self, level: float = 0.95, other: float = 0.0) -> tuple[float, float]:
        """Return the confidence interval: all true values that the test `z` does not reject.

        Parameters
        ----------
        level
            probability that the interval covers
        other
            standard error of what the number is compared with, independent of the runs

        Returns
        -------
        low, high : float
            ends of the interval; NaN without a standard error
        """
        with np.errstate(all="ignore"):
            if self.influences is None:
                # Infinite degrees of freedom: a normal interval.
                width = quantile(level, np.inf) * float(np.hypot(self.stderr, other))
                return self.value - width, self.value + width
            # A difference of two variances or shares has the confidence limits of both.
            sides = self.sides
            if sides is not None:
                return interval_of_difference(self.value, sides, level, other)
            return interval_of(self.value, self.influences, level, other)


class Share(RunEstimate):
    """A share of runs: its z and its interval are those of the binomial distribution."""

    __slots__ = ()

    @property
    def is_exact(self) -> bool:
        """True: of the binomial distribution nothing is estimated."""
        return True

    @property
    def events(self) -> int:
        """Runs that have had the event."""
        return round(self.value * self.runs)

    def z(self, target: float = 0.0, other: float = 0.0) -> float:
        """Return z of the hypothesis that the event has the probability ``target``, by exact tails.

        It is the z of a mean if the target has the standard error ``other``, or without runs.
        """
        if other > 0.0 or not self.runs:
            return super().z(target, other)
        return share_z(self.events, self.runs, target)

    def interval(self, level: float = 0.95, other: float = 0.0) -> tuple[float, float]:
        """Return the interval of Clopper and Pearson; a normal one if the target has an error."""
        if other > 0.0 or not self.runs:
            return super().interval(level, other)
        return share_interval(self.events, self.runs, level)


MISSING = RunEstimate(np.nan, np.nan, None, 0)


def estimate_over_runs(
    name: str, values: Array, is_lost: Mask | None, common: Mask | bool = True
) -> RunEstimate:
    """Estimate a statistic over the runs, with an influence of each run.

    Parameters
    ----------
    name
        statistic, a key of `OVER_RUNS` such as ``mean`` or ``rms``
    values
        values (M,) of the runs, NaN for missing
    is_lost
        mask (M,) of the runs that the filter lost; None if it is unknown: then those without a value
    common
        mask (M,) of the runs that count; True means all

    Returns
    -------
    RunEstimate
        estimate over the runs that count and have a value, with influences (M,). Its number of lost runs
        is that of ``is_lost``
    """
    finite = ~np.isnan(values)
    lost = int((~finite if is_lost is None else is_lost).sum())
    used = finite & common
    x = values[used]
    if not len(x):
        return MISSING._replace(lost=lost)
    influences = np.full(len(values), np.nan)
    influences[used] = influence(name, x)
    estimate = OVER_RUNS[name](x)
    return RunEstimate(
        value=estimate.value,
        stderr=estimate.stderr,
        influences=influences,
        runs=len(x),
        lost=lost,
    )


def estimate_share(values: Array, is_lost: Mask | None, common: Mask | bool = True) -> RunEstimate:
    """Return the share of the runs with a value above zero among those with a value.

    Parameters
    ----------
    values
        values (M,) of the runs, NaN for missing
    is_lost
        mask (M,) of the runs that the filter lost; None if it is unknown: then those without a value
    common
        mask (M,) of the runs that count; True means all

    Returns
    -------
    RunEstimate
        `Share` with influences (M,)
    """
    # 1 in a run with the event, 0 in one without it. A share is their mean, tested as a proportion.
    events = np.where(np.isnan(values), np.nan, values > 0)
    share = Share(*estimate_over_runs("mean", events, is_lost, common))
    if share.stderr != 0.0:
        return share
    # All runs agree: the standard error is that of the exact interval.
    return share._replace(stderr=share_stderr(share.events, share.runs))


@ignore_float_errors
def linear_combination(
    value: float, a: RunEstimate, b: RunEstimate, factor_a: float, factor_b: float
) -> RunEstimate:
    """Return the estimate of ``factor_a a + factor_b b``, paired by runs if both have influences.

    Parameters
    ----------
    value
        value of this combination, or of the function that it linearizes, such as a ratio. The caller has
        computed it
    a, b
        numbers. The lost runs are those of a, the filter that the number is about; b is what it is
        compared with
    factor_a, factor_b
        factors of both

    Returns
    -------
    RunEstimate
        ``value`` with its standard error, and influences (M,) if they are known
    """
    influences = _combined_influences(a, b, factor_a, factor_b)
    if influences is not None:
        known = influences[~np.isnan(influences)]
        return RunEstimate(value, mean(known).stderr, influences, len(known), a.lost)
    stderr = float(np.hypot(factor_a * a.stderr, factor_b * b.stderr))
    return RunEstimate(value, stderr, None, min(a.runs, b.runs), a.lost)


def _combined_influences(
    a: RunEstimate, b: RunEstimate, factor_a: float, factor_b: float
) -> Array | None:
    """Return the influences on ``factor_a a + factor_b b``; None if they are unknown.

    They are unknown if a number with a standard error has no influences, or if a and b have influences
    of different numbers of runs.
    """
    of_a = a.influences
    of_b = b.influences
    if of_a is None and of_b is not None and a.stderr == 0.0:
        return factor_b * of_b
    if of_b is None and of_a is not None and b.stderr == 0.0:
        return factor_a * of_a
    if of_a is None or of_b is None or len(of_a) != len(of_b):
        return None
    return factor_a * of_a + factor_b * of_b


@np.errstate(all="ignore")
def difference_of_measures(
    a: RunEstimate, b: RunEstimate, factor: float = 1.0, are_variances: bool = False
) -> RunEstimate:
    """Return ``a - factor b``, paired by runs, with the confidence limits that its test needs.

    The difference of two variances has the limits of both variances, and the difference of two shares
    of runs has the limits of a difference of proportions.

    Parameters
    ----------
    a, b
        numbers of the same runs
    factor
        multiple of b
    are_variances
        True if a and b are two variances over the runs, and False for other numbers, such as ratios of
        variances

    Returns
    -------
    RunEstimate
        difference with its standard error
    """
    term = linear_combination(a.value - factor * b.value, a, b, 1.0, -factor)
    if are_variances:
        return as_difference_of_variances(term, a, b, factor)
    # A negative factor adds the shares, and the limits of a difference would be wrong for a sum.
    if isinstance(a, Share) and isinstance(b, Share) and factor >= 0.0:
        return _as_difference_of_proportions(term, a, b, factor)
    return term


def as_difference_of_variances(
    term: RunEstimate, a: RunEstimate, b: RunEstimate, factor: float
) -> RunEstimate:
    """Return ``term``, the difference ``a - factor b`` of variances, with its `pair` set.

    The confidence limits of both variances, a's and b's, then test the difference. Without influences of
    all three, ``term`` is returned as it is.
    """
    if term.influences is None or a.influences is None or b.influences is None:
        return term
    return term._replace(pair=(a, b, factor))


def _as_difference_of_proportions(
    term: RunEstimate, a: Share, b: Share, factor: float
) -> RunEstimate:
    """Return ``term``, the difference ``a - factor b`` of shares of the same runs, with its `pair` set.

    The binomial confidence limits of both shares, a's and b's, then test the difference. They need the
    correlation of the shares. Without influences, which give it, ``term`` is returned as it is. A
    standard error of zero, as of two shares 0 or 1, is replaced by that of the interval.
    """
    if a.influences is None or b.influences is None:
        return term
    with_pair = term._replace(pair=(a, b, factor))
    return with_pair._replace(stderr=term.stderr or stderr_of(*with_pair.interval()))
