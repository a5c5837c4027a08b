"""Comparison of two numbers with their errors, the same record for all that is compared.

`compare` pairs two filters by the runs or recorded steps that they have in common, `compare_estimates`
two numbers by their influences, `compare_independent` numbers of other runs.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.statistics import significance_rules as rules
from trackbench.statistics.estimate_of_recording import OfSteps
from trackbench.statistics.estimates import (
    RunEstimate,
    Share,
    as_difference_of_variances,
    linear_combination,
)
from trackbench.statistics.limits_of_differences import Sides, studentized_difference
from trackbench.statistics.ratios import quotient, ratio_interval
from trackbench.statistics.sample_statistics import STATISTICS, Estimate, influence, mean
from trackbench.statistics.share_of_runs import Events
from trackbench.statistics.student_t import normal_of_t

# Two ways of computing one filter differ by this share at most; a z-score of that means nothing.
_ROUNDING = 1e-11


@dataclass(frozen=True, eq=False)
class Sample:
    """Metric of a filter over the runs, and the statistic that is compared."""

    values: Array
    """of each run (M,), NaN where it is lost"""
    statistic: str = "mean"
    """over the runs: mean, rms, median or variance"""
    steps: OfSteps | None = None
    """the metric of the only run with its steps, if that is a recording"""

    @classmethod
    def from_values(cls, values: Array, statistic: str, steps: Array | None = None) -> "Sample":
        """Return the sample of values per run (M,).

        ``steps`` (T,) is given for the only run of a recording: what each step contributes to its value.
        """
        if steps is None:
            return cls(values, statistic)
        return cls(values, statistic, OfSteps.from_contributions(float(values[0]), steps))

    def over(self, runs: Mask) -> "Sample":
        """Return the sample of some of the runs (M,); itself if these are all."""
        if runs.all():
            return self
        return replace(self, values=self.values[runs])

    def over_steps(self, steps: Mask) -> "Sample":
        """Return the sample of some steps of a recording.

        Parameters
        ----------
        steps
            mask (T,) of the steps

        Returns
        -------
        Sample
            copy with the number over these steps; itself if no other step has a value
        """
        assert self.steps is not None
        chosen = self.steps.over_steps(steps)
        if chosen is self.steps:
            return self
        return replace(self, values=np.array([chosen.value]), steps=chosen)

    @cached_property
    def overall(self) -> RunEstimate:
        """Statistic over the runs with a finite value, with its standard error.

        Its influences are those of these runs only, so that lost runs have none.
        """
        x = self.values[np.isfinite(self.values)]
        # A statistic returns two numbers, the value and its standard error.
        return RunEstimate(*STATISTICS[self.statistic](x), influence(self.statistic, x), len(x))


class Comparison(NamedTuple):
    """Two numbers, of filters on what they have in common, and the test of their difference."""

    a: RunEstimate
    b: RunEstimate
    difference: RunEstimate
    """a - b, with its influences"""
    z: float
    """of the hypothesis of no difference; NaN without a standard error"""
    p: float = np.nan
    """two-sided p-value, by Holm over the family; NaN if there are too few runs, or no standard error"""
    tests: int = 1
    """number of tests of the family"""

    @property
    def sign(self) -> int:
        """Sign of a significant difference, 0 of any other."""
        return int(np.sign(self.z)) if self.p < rules.LEVEL else 0

    @property
    def is_tested(self) -> bool:
        """True if the test has enough runs and a standard error."""
        return not np.isnan(self.p)

    @property
    def is_equal(self) -> bool:
        """True if a and b have the same value in every common run, of which there is at least one.

        It is False for numbers whose influences are unknown (None).
        """
        of_runs = self.difference.influences
        if self.difference.value != 0.0 or of_runs is None:
            return False
        return len(of_runs) > 0 and not of_runs.any()

    @property
    def is_measured(self) -> bool:
        """True if the difference is a number; it is none if a and b have no value in common."""
        return not np.isnan(self.difference.value)

    @property
    def ratio(self) -> RunEstimate:
        """``a / b``, with its influences."""
        return quotient(self.a, self.b)

    @property
    def ratio_interval(self) -> tuple[float, float]:
        """95 % interval of ``a / b`` by the test of the difference; NaN without an error."""
        return ratio_interval(self.a, self.b)

    @property
    def interval_contradicts(self) -> bool:
        """True if the pair's own 95 % interval shows a difference that is not significant.

        The interval is of this pair alone. Significance is that of the whole family at `rules.LEVEL`.
        """
        return rules.interval_contradicts(self.sign, self.z)

    def word(self, more_is_better: bool = False) -> str:
        """Return the word for a as compared with b: equal, untested, alike, better or worse.

        They are equal if they have the same value in every common run, and alike if their difference is
        not significant.

        Parameters
        ----------
        more_is_better
            True for a metric of which the larger value is the better one

        Returns
        -------
        str
            one of the words of `significance_rules`
        """
        if self.is_equal:
            return rules.EQUAL
        if not self.is_tested:
            return rules.UNTESTED
        if self.sign == 0:
            return rules.ALIKE
        is_more = self.sign > 0  # the sign of a - b
        return rules.BETTER if is_more == more_is_better else rules.WORSE

    @property
    def swapped(self) -> "Comparison":
        """Comparison of b with a."""
        # `scaled` changes the sign of the value and of the influences, and leaves the pair as it is.
        opposite = self.difference.scaled(-self.difference.value, factor=-1.0)
        if opposite.pair is not None:
            a, b, factor = opposite.pair  # of the difference a - factor b
            assert factor == 1.0  # as in every comparison of two samples
            opposite = opposite._replace(pair=(b, a, factor))
        return self._replace(a=self.b, b=self.a, difference=opposite, z=-self.z)


@np.errstate(all="ignore")
def compare(a: Sample, b: Sample) -> Comparison | None:
    """Compare the samples of two filters.

    Parameters
    ----------
    a, b
        samples of the same M runs, or of the T steps of one recording. Runs and steps count that both
        have

    Returns
    -------
    Comparison or None
        difference a - b with its z, that of this pair alone. p is NaN: `holm_correction.as_family` sets
        it for several comparisons together. None without a common run or step
    """
    # Step 1: a recording is compared step by step.
    if a.steps is not None and b.steps is not None:
        if not (a.steps.has_value & b.steps.has_value).any():
            return None
        a_steps = a.steps.over_steps(b.steps.has_value)
        b_steps = b.steps.over_steps(a.steps.has_value)
        step_difference = a_steps.minus(b_steps)
        # Series that are equal but for rounding have no difference; steps that one lacks are NaN.
        if not np.nan_to_num(without_rounding(a_steps.series, b_steps.series)).any():
            step_difference = OfSteps.from_contributions(0.0, np.zeros(len(a_steps.series)))
        return Comparison(a_steps, b_steps, step_difference, step_difference.z())
    both = np.isfinite(a.values) & np.isfinite(b.values)
    if not both.any():
        return None
    # Step 2: runs are compared by their influences on the statistic.
    a = a.over(both)
    b = b.over(both)
    difference = _difference_of(a, b)
    # A variance of few runs has a skewed error: its difference is tested by the limits of both
    # variances.
    if a.statistic == "variance":
        difference = as_difference_of_variances(difference, a.overall, b.overall, factor=1.0)
    return Comparison(a.overall, b.overall, difference, difference.z())


@np.errstate(all="ignore")
def compare_estimates(a: RunEstimate, b: RunEstimate, other: float = 0.0) -> Comparison:
    """Compare two numbers, paired by runs if both have influences of the same runs.

    ``other`` is an additional standard error of their difference, independent of the runs.
    """
    difference = linear_combination(a.value - b.value, a, b, 1.0, -1.0)
    return Comparison(a, b, difference, difference.z(0.0, other))


@np.errstate(all="ignore")
def compare_independent(a: RunEstimate, b: RunEstimate) -> Comparison:
    """Compare two numbers from different runs by Student's t; shares by the binomial limits of both.

    The degrees of freedom are one less than the fewer runs of both.

    Parameters
    ----------
    a, b
        numbers with their standard errors

    Returns
    -------
    Comparison
        difference a - b with its z. It has no influences, because no run has an influence on both
        numbers
    """
    runs = min(a.runs, b.runs)
    stderr = float(np.hypot(a.stderr, b.stderr))
    difference = RunEstimate(a.value - b.value, stderr, None, runs)
    if isinstance(a, Share) and isinstance(b, Share):
        limits = Sides(Events(a.events, a.runs), Events(b.events, b.runs))
        return Comparison(a, b, difference, studentized_difference(difference.value, limits))
    return Comparison(a, b, difference, normal_of_t(difference.z(), max(runs - 1, 1)))


def _difference_of(a: Sample, b: Sample) -> RunEstimate:
    """Return the difference of two samples of common runs (M,), with the runs' influences on it."""
    differences = without_rounding(a.values, b.values)
    if a.statistic == "mean":
        # `mean` returns two numbers, the value and its standard error.
        return RunEstimate(*mean(differences), influence("mean", differences), len(differences))
    # Runs in which b differs from a only by rounding get the value of a.
    is_rounding = (differences == 0.0) & (a.values != b.values)
    if is_rounding.any():
        b = replace(b, values=np.where(is_rounding, a.values, b.values))
    assert a.overall.influences is not None
    assert b.overall.influences is not None
    influences = a.overall.influences - b.overall.influences
    return RunEstimate(
        value=a.overall.value - b.overall.value,
        stderr=mean(influences).stderr,
        influences=influences,
        runs=len(influences),
    )


def without_rounding(a: Array, b: Array) -> Array:
    """Return ``a - b`` over common runs; differences within the rounding of b become zero."""
    return np.where(np.abs(a - b) <= _ROUNDING * np.abs(b), 0.0, a - b)


def paired_difference(a: Array, b: Array) -> Estimate:
    """Return the mean of ``a - b`` over common runs."""
    return mean(without_rounding(a, b))
