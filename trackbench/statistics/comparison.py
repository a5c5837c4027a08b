"""Comparison of two numbers with their errors, the same record for all that is compared.

`compare` pairs two filters by the runs or recorded steps that they have in common, `compare_estimates`
two numbers by their influences, `compare_independent` numbers of other runs. `as_family` tests several
comparisons together: Holm's correction is for all of them. `compare_all` does so for every two of some
filters, so that the best of many is compared with its rivals at a level that allows for its choice.
"""

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import NamedTuple, TypeVar

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.core.sums import total
from trackbench.statistics import significance_rules as rules
from trackbench.statistics.confidence_intervals import (
    Sides,
    studentized_difference,
    studentized_rows,
)
from trackbench.statistics.estimates import OfSteps, RunEstimate, Share, linear_combination
from trackbench.statistics.ratios import quotient, ratio_interval
from trackbench.statistics.sample_statistics import STATISTICS, Estimate, influence, mean
from trackbench.statistics.share_of_runs import Events
from trackbench.statistics.student_t import normal_of_t, stderr_of

Key = TypeVar("Key", bound=Hashable)
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
        """Return the sample of some steps (T,) of a recording; itself if no other step has a value."""
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
        not significant. ``more_is_better`` is True for a metric of which the larger value is the better
        one.
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


class Family(dict[tuple[str, str], Comparison]):
    """Comparisons of every two filters, a before b; those without common runs or steps are left out."""

    def between(self, a: str, b: str) -> Comparison | None:
        """Return the comparison of a with b in this order; None without common runs or steps."""
        if (a, b) in self:
            return self[a, b]
        if (b, a) in self:
            return self[b, a].swapped
        return None


@np.errstate(all="ignore")
def compare(a: Sample, b: Sample) -> Comparison | None:
    """Compare the samples of two filters; None without a common run or step.

    z is of this pair alone, and p is NaN: `as_family` sets it for several comparisons together.
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
        difference = _as_difference_of_variances(difference, a.overall, b.overall, factor=1.0)
    return Comparison(a.overall, b.overall, difference, difference.z())


@np.errstate(all="ignore")
def compare_estimates(a: RunEstimate, b: RunEstimate, other: float = 0.0) -> Comparison:
    """Compare two numbers, paired by runs if both have influences of the same runs.

    ``other`` is an additional standard error of their difference, independent of the runs.
    """
    difference = linear_combination(a.value - b.value, a, b, 1.0, -1.0)
    return Comparison(a, b, difference, difference.z(0.0, other))


@np.errstate(all="ignore")
def difference_of_measures(
    a: RunEstimate, b: RunEstimate, factor: float = 1.0, are_variances: bool = False
) -> RunEstimate:
    """Return ``a - factor b``, paired by runs, with the confidence limits that its test needs.

    The difference of two variances has the limits of both variances, and the difference of two shares
    of runs has the limits of a difference of proportions. ``are_variances`` is true if a and b are two
    variances over the runs, and false for other numbers, such as ratios of variances.
    """
    term = linear_combination(a.value - factor * b.value, a, b, 1.0, -factor)
    if are_variances:
        return _as_difference_of_variances(term, a, b, factor)
    # A negative factor adds the shares, and the limits of a difference would be wrong for a sum.
    if isinstance(a, Share) and isinstance(b, Share) and factor >= 0.0:
        return _as_difference_of_proportions(term, a, b, factor)
    return term


def _as_difference_of_variances(
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


@np.errstate(all="ignore")
def compare_independent(a: RunEstimate, b: RunEstimate) -> Comparison:
    """Compare two numbers from different runs by Student's t; shares by the binomial limits of both.

    The degrees of freedom are one less than the fewer runs of both. The difference has no influences,
    because no run has an influence on both numbers.
    """
    runs = min(a.runs, b.runs)
    stderr = float(np.hypot(a.stderr, b.stderr))
    difference = RunEstimate(a.value - b.value, stderr, None, runs)
    if isinstance(a, Share) and isinstance(b, Share):
        limits = Sides(Events(a.events, a.runs), Events(b.events, b.runs))
        return Comparison(a, b, difference, studentized_difference(difference.value, limits))
    return Comparison(a, b, difference, normal_of_t(difference.z(), max(runs - 1, 1)))


def as_family(comparisons: Mapping[Key, Comparison], tests: int = 0) -> dict[Key, Comparison]:
    """Return the comparisons with p-values by Holm as one family.

    ``tests`` is the number of tests of the family; 0 for those of the comparisons that can be tested.
    """
    zs = []
    for comparison in comparisons.values():
        z = np.nan  # no test
        if rules.is_tested(comparison.difference):
            z = comparison.z
        zs.append(z)
    adjusted = rules.adjusted(zs, tests)
    tests = tests or int(np.sum(~np.isnan(adjusted)))
    return {
        key: comparison._replace(p=float(p), tests=tests)
        for (key, comparison), p in zip(comparisons.items(), adjusted, strict=True)
    }


def compare_all(samples: Mapping[str, Sample]) -> Family:
    """Compare every two filters, whose samples are given by label, as one family of tests."""
    compared_in_arrays = _compare_side_by_side(samples)
    comparisons = {}
    for a, b in combinations(samples, 2):
        comparison = compared_in_arrays.get((a, b))
        if comparison is None:
            comparison = compare(samples[a], samples[b])
        if comparison is not None:
            comparisons[a, b] = comparison
    return Family(as_family(comparisons))


_NUMBERS_AT_ONCE = 1_000_000
"""Numbers of the arrays of `_compare_side_by_side`, which are pairs of filters times runs."""


@np.errstate(all="ignore")
def _compare_side_by_side(samples: Mapping[str, Sample]) -> dict[tuple[str, str], Comparison]:
    """Compare many pairs of filters in one computation on arrays, with the bits of `compare`.

    Only pairs of filters that lost no run are compared, by a mean, rms or median, and only if their
    difference has a standard error. All other pairs are left out.
    """
    # Samples with `steps`, those of a recording, have correlated values and another test. So has a
    # variance.
    complete = [
        label
        for label, sample in samples.items()
        if sample.steps is None
        and sample.statistic != "variance"
        and len(sample.values) > 1
        and np.isfinite(sample.values).all()
    ]
    # Only samples of one statistic and one number of runs fit into one array.
    statistics_and_runs = {
        (samples[label].statistic, len(samples[label].values)) for label in complete
    }
    if len(complete) < 2 or len(statistics_and_runs) != 1:
        return {}
    (statistic, runs), *_ = statistics_and_runs
    pairs = [*combinations(range(len(complete)), 2)]
    values = np.array([samples[label].values for label in complete])
    if statistic != "mean":
        overall = [samples[label].overall for label in complete]
        numbers = np.array([estimate.value for estimate in overall])
        influences = np.array([estimate.influences for estimate in overall])
    compared = {}
    at_once = max(1, _NUMBERS_AT_ONCE // runs)
    for start in range(0, len(pairs), at_once):
        pairs_of_piece = pairs[start : start + at_once]
        first = [i for i, _ in pairs_of_piece]
        second = [j for _, j in pairs_of_piece]
        # Step 1: the P differences of the statistic (P,), and the runs' influences on them (P, M).
        difference_of_runs = without_rounding(values[first], values[second])
        if statistic == "mean":
            difference_of_pair = total(difference_of_runs) / runs
            influences_of_pair = difference_of_runs - difference_of_pair[:, None]
            centered = influences_of_pair
            is_compared = np.full(len(pairs_of_piece), True)
        else:
            # `compare` removes differences that are only rounding; it compares such pairs itself.
            is_rounding = (difference_of_runs == 0.0) & (values[first] != values[second])
            is_compared = ~is_rounding.any(axis=1)
            difference_of_pair = numbers[first] - numbers[second]
            influences_of_pair = influences[first] - influences[second]
            centered = influences_of_pair - (total(influences_of_pair) / runs)[:, None]
        deviation = np.sqrt(total(np.square(centered)) / (runs - 1))
        stderr = deviation / np.sqrt(runs)
        # Step 2: test the hypothesis that each difference is zero.
        z = studentized_rows(difference_of_pair, influences_of_pair)
        is_compared &= ~np.isnan(z)
        for p in np.flatnonzero(is_compared).tolist():
            a = complete[first[p]]
            b = complete[second[p]]
            difference = RunEstimate(
                value=float(difference_of_pair[p]),
                stderr=stderr[p],
                influences=influences_of_pair[p],
                runs=runs,
            )
            compared[a, b] = Comparison(
                samples[a].overall, samples[b].overall, difference, float(z[p])
            )
    return compared


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
