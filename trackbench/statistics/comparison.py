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
from trackbench.statistics import rules
from trackbench.statistics.estimates import (
    OfSteps,
    RunEstimate,
    Share,
    as_difference_of_variances,
    linear_combination,
    quotient,
    ratio_interval,
)
from trackbench.statistics.intervals import (
    Events,
    Sides,
    deviations,
    normal_of_t,
    studentized_difference,
    studentized_rows,
)
from trackbench.statistics.over_runs import STATISTICS, influence, mean, without_rounding

Key = TypeVar("Key", bound=Hashable)


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
    def of(cls, values: Array, statistic: str, steps: Array | None = None) -> "Sample":
        """Return the sample of values (M,); of one recording with what each step (T,) adds to it."""
        if steps is None:
            return cls(values, statistic)
        return cls(values, statistic, OfSteps.of(float(values[0]), steps))

    def over(self, runs: Mask) -> "Sample":
        """Return the sample of some of the runs (M,); itself if these are all."""
        if runs.all():
            return self
        return replace(self, values=self.values[runs])

    @cached_property
    def overall(self) -> RunEstimate:
        """Statistic over the runs with a finite value."""
        x = self.values[np.isfinite(self.values)]
        return RunEstimate(*STATISTICS[self.statistic](x), influence(self.statistic, x), len(x))


class Comparison(NamedTuple):
    """Two numbers, of filters on what they have in common, and the test of their difference."""

    a: RunEstimate
    b: RunEstimate
    difference: RunEstimate
    """a - b, with its influences"""
    z: float
    """of no difference; NaN without an error"""
    p: float = np.nan
    """two-sided, by Holm over the family; NaN where nothing decides"""
    tests: int = 1
    """of the family"""

    @property
    def sign(self) -> int:
        """Sign of a significant difference, 0 of any other."""
        return int(np.sign(self.z)) if self.p < rules.LEVEL else 0

    @property
    def is_tested(self) -> bool:
        """True if there are runs enough, and an error, to decide."""
        return not np.isnan(self.p)

    @property
    def is_equal(self) -> bool:
        """True if both have the same value in every common run."""
        of_runs = self.difference.influences
        return self.difference.value == 0.0 and of_runs is not None and not of_runs.any()

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

        The interval is of this pair alone, and the mark is of the whole family at `rules.LEVEL`.
        """
        return self.sign == 0 and abs(self.z) > deviations(0.95)

    def word(self, more_is_better: bool = False) -> str:
        """Return the word on a."""
        if self.is_equal:
            return rules.EQUAL
        if not self.is_tested:
            return rules.UNTESTED
        if self.sign == 0:
            return rules.ALIKE
        is_more = self.sign > 0
        return rules.BETTER if is_more == more_is_better else rules.WORSE

    @property
    def swapped(self) -> "Comparison":
        """Comparison of b with a."""
        opposite = self.difference.scaled(-self.difference.value, -1.0)
        return self._replace(a=self.b, b=self.a, difference=opposite, z=-self.z)


class Family(dict[tuple[str, str], Comparison]):
    """Comparisons of every two filters, a before b; those without common runs are left out."""

    def between(self, a: str, b: str) -> Comparison | None:
        """Return the comparison of a with b in this order; None without common runs."""
        if (a, b) in self:
            return self[a, b]
        if (b, a) in self:
            return self[b, a].swapped
        return None


@np.errstate(all="ignore")
def compare(a: Sample, b: Sample) -> Comparison | None:
    """Return the comparison of two filters alone; None if they have no run in common."""
    # Step 1: a recording is compared step by step.
    if a.steps is not None and b.steps is not None:
        of_steps = a.steps.minus(b.steps)
        if not np.nan_to_num(without_rounding(a.steps.series, b.steps.series)).any():
            of_steps = OfSteps.of(0.0, np.zeros(len(a.steps.series)))
        return Comparison(a.steps, b.steps, of_steps, of_steps.z())
    both = np.isfinite(a.values) & np.isfinite(b.values)
    if not both.any():
        return None
    # Step 2: runs are compared by their influences on the statistic.
    a = a.over(both)
    b = b.over(both)
    difference = _difference_of(a, b)
    if a.statistic == "variance":
        difference = as_difference_of_variances(difference, a.overall, b.overall, 1.0)
    return Comparison(a.overall, b.overall, difference, difference.z())


@np.errstate(all="ignore")
def compare_estimates(a: RunEstimate, b: RunEstimate, other: float = 0.0) -> Comparison:
    """Return the comparison of two numbers, paired if both have influences of the same runs.

    ``other`` is the standard error of their difference that the runs do not show.
    """
    difference = linear_combination(a.value - b.value, a, b, 1.0, -1.0)
    return Comparison(a, b, difference, difference.z(0.0, other))


@np.errstate(all="ignore")
def compare_independent(a: RunEstimate, b: RunEstimate) -> Comparison:
    """Return the comparison of numbers of other runs: by Student's t, of shares by both limits."""
    runs = min(a.runs, b.runs)
    stderr = float(np.hypot(a.stderr, b.stderr))
    difference = RunEstimate(a.value - b.value, stderr, None, runs)
    if isinstance(a, Share) and isinstance(b, Share):
        limits = Sides(Events(a.events, a.runs), Events(b.events, b.runs))
        return Comparison(a, b, difference, studentized_difference(difference.value, limits))
    return Comparison(a, b, difference, normal_of_t(difference.z(), max(runs - 1, 1)))


def as_family(comparisons: Mapping[Key, Comparison], tests: int = 0) -> dict[Key, Comparison]:
    """Return comparisons with p-values by Holm over all of them, or over so many ``tests``."""
    zs = []
    for comparison in comparisons.values():
        zs.append(comparison.z if rules.is_tested(comparison.difference) else np.nan)
    adjusted = rules.adjusted(zs, tests)
    tests = tests or int(np.sum(~np.isnan(adjusted)))
    return {
        key: comparison._replace(p=float(p), tests=tests)
        for (key, comparison), p in zip(comparisons.items(), adjusted, strict=True)
    }


def compare_all(samples: Mapping[str, Sample]) -> Family:
    """Return the comparison of every two filters, as one family of tests."""
    together = _compare_side_by_side(samples)
    comparisons = {}
    for a, b in combinations(samples, 2):
        comparison = together.get((a, b))
        if comparison is None:
            comparison = compare(samples[a], samples[b])
        if comparison is not None:
            comparisons[a, b] = comparison
    return Family(as_family(comparisons))


_NUMBERS_AT_ONCE = 1_000_000
"""Numbers of the arrays of `_compare_side_by_side`, which are pairs of filters times runs."""


@np.errstate(all="ignore")
def _compare_side_by_side(samples: Mapping[str, Sample]) -> dict[tuple[str, str], Comparison]:
    """Return `compare` of the pairs that arrays of all pairs can have, which are the same bits.

    These are pairs of filters that lost no run, of a mean, rms or median, whose difference has an error.
    """
    whole = [
        label
        for label, sample in samples.items()
        if sample.steps is None
        and sample.statistic != "variance"
        and len(sample.values) > 1
        and np.isfinite(sample.values).all()
    ]
    alike = {(samples[label].statistic, len(samples[label].values)) for label in whole}
    if len(whole) < 2 or len(alike) != 1:
        return {}
    (statistic, runs), *_ = alike
    pairs = [*combinations(range(len(whole)), 2)]
    values = np.array([samples[label].values for label in whole])
    if statistic != "mean":
        overall = [samples[label].overall for label in whole]
        numbers = np.array([estimate.value for estimate in overall])
        influences = np.array([estimate.influences for estimate in overall])
    compared = {}
    at_once = max(1, _NUMBERS_AT_ONCE // runs)
    for start in range(0, len(pairs), at_once):
        piece = pairs[start : start + at_once]
        first = [i for i, _ in piece]
        second = [j for _, j in piece]
        # Step 1: the differences (P,) with the runs' influences on them (P, M).
        of_runs = without_rounding(values[first], values[second])
        if statistic == "mean":
            number = total(of_runs) / runs
            of_runs = of_runs - number[:, None]
            centered = of_runs
            is_known = np.full(len(piece), True)
        else:
            # What is rounding in the second is no difference, and `compare` counts it so.
            is_known = ~((of_runs == 0.0) & (values[first] != values[second])).any(axis=1)
            number = numbers[first] - numbers[second]
            of_runs = influences[first] - influences[second]
            centered = of_runs - (total(of_runs) / runs)[:, None]
        deviation = np.sqrt(total(np.square(centered)) / (runs - 1))
        stderr = deviation / np.sqrt(runs)
        # Step 2: their tests.
        z = studentized_rows(number, of_runs)
        is_known &= ~np.isnan(z)
        for p in np.flatnonzero(is_known).tolist():
            a = whole[first[p]]
            b = whole[second[p]]
            difference = RunEstimate(float(number[p]), stderr[p], of_runs[p], runs)
            compared[a, b] = Comparison(
                samples[a].overall, samples[b].overall, difference, float(z[p])
            )
    return compared


def _difference_of(a: Sample, b: Sample) -> RunEstimate:
    """Return the difference of two samples of common runs (M,), with the runs' influences on it."""
    differences = without_rounding(a.values, b.values)
    if a.statistic == "mean":
        return RunEstimate(*mean(differences), influence("mean", differences), len(differences))
    # What is rounding in b is no difference.
    rounded = (differences == 0.0) & (a.values != b.values)
    if rounded.any():
        b = replace(b, values=np.where(rounded, a.values, b.values))
    assert a.overall.influences is not None
    assert b.overall.influences is not None
    influences = a.overall.influences - b.overall.influences
    return RunEstimate(
        value=a.overall.value - b.overall.value,
        stderr=mean(influences).stderr,
        influences=influences,
        runs=len(influences),
    )
