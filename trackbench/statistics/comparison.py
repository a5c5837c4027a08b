"""Comparison of filters by one statistic, on the runs or recorded steps that they have in common.

`compare_all` tests every two of some filters as one family: Holm's correction is for all of them. So a
filter that is the best of many is compared with its rivals at a level that allows for its choice.
"""

from collections.abc import Mapping
from itertools import combinations
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.statistics import rules
from trackbench.statistics.estimates import (
    OfSteps,
    RunEstimate,
    as_difference_of_variances,
    quotient,
)
from trackbench.statistics.over_runs import STATISTICS, influence, mean, without_rounding


class Sample(NamedTuple):
    """Metric of a filter over the runs, and the statistic that is compared."""

    values: Array
    """of each run (M,), NaN where it is lost"""
    statistic: str = "mean"
    """over the runs: mean, rms, median or variance"""
    steps: OfSteps | None = None
    """the metric of the only run with its steps, if that is a recording"""


class Comparison(NamedTuple):
    """Numbers of two filters on what they have in common, and the test of their difference."""

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
        """Return the sign of a significant difference, 0 of any other."""
        return int(np.sign(self.difference.value)) if self.p < rules.LEVEL else 0

    @property
    def is_tested(self) -> bool:
        """Return whether there are runs enough, and an error, to decide."""
        return not np.isnan(self.p)

    @property
    def is_equal(self) -> bool:
        """Return whether both have the same value in every common run."""
        of_runs = self.difference.influences
        return self.difference.value == 0.0 and of_runs is not None and not of_runs.any()

    @property
    def ratio(self) -> RunEstimate:
        """Return ``a / b``, with its influences."""
        return quotient(self.a, self.b)

    @property
    def swapped(self) -> "Comparison":
        """Return the comparison of b with a."""
        opposite = self.difference.scaled(-self.difference.value, -1.0)
        return self._replace(a=self.b, b=self.a, difference=opposite, z=-self.z)


class Family(dict[tuple[str, str], Comparison]):
    """Comparisons of every two filters, a before b; those without common runs are left out."""

    def between(self, a: str, b: str) -> Comparison | None:
        """Return the comparison of a with b in this order; None without common runs."""
        if (found := self.get((a, b))) is not None:
            return found
        found = self.get((b, a))
        return None if found is None else found.swapped


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
    x, y = a.values[both], b.values[both]
    first, second = (_estimate(a.statistic, values) for values in (x, y))
    difference = difference_of(a.statistic, x, y)
    if a.statistic == "variance":
        difference = as_difference_of_variances(difference, first, second, 1.0)
    return Comparison(first, second, difference, difference.z())


def compare_all(samples: Mapping[str, Sample]) -> Family:
    """Return the comparison of every two filters, as one family of tests."""
    found = {
        (a, b): comparison
        for a, b in combinations(samples, 2)
        if (comparison := compare(samples[a], samples[b])) is not None
    }
    tested = [c.z if rules.is_tested(c.difference) else np.nan for c in found.values()]
    adjusted = rules.adjusted(tested)
    tests = int(np.sum(~np.isnan(adjusted)))
    return Family(
        (pair, comparison._replace(p=float(p), tests=tests))
        for (pair, comparison), p in zip(found.items(), adjusted, strict=True)
    )


def difference_of(statistic: str, a: Array, b: Array) -> RunEstimate:
    """Return the difference of a statistic over common runs (M,), with the runs' influences on it."""
    if statistic == "mean":
        differences = without_rounding(a, b)
        return RunEstimate(*mean(differences), influence("mean", differences), len(a))
    b = np.where(without_rounding(a, b) == 0.0, a, b)
    of = influence(statistic, a) - influence(statistic, b)
    over = STATISTICS[statistic]
    return RunEstimate(over(a).value - over(b).value, mean(of).stderr, of, len(a))


def _estimate(statistic: str, x: Array) -> RunEstimate:
    return RunEstimate(*STATISTICS[statistic](x), influence(statistic, x), len(x))
