"""Tests of the differences between two results folders: a row for each metric, and its verdict.

Numbers are paired on common runs, else they are compared by independent errors.
"""

from collections.abc import Callable, Iterator, Sequence
from math import copysign, inf, nan
from typing import Any, NamedTuple

import numpy as np

from trackbench.core.elementary import log
from trackbench.evaluation.metric_expression import measured
from trackbench.report.mean_or_rms_of_metric import with_statistic
from trackbench.report.primary_metrics import primary_metrics
from trackbench.results.points_json import GridPoint
from trackbench.statistics.comparison import (
    Comparison,
    Sample,
    compare,
    compare_estimates,
    compare_independent,
)
from trackbench.statistics.estimates import RunEstimate, Share
from trackbench.statistics.holm_correction import as_family, two_sided_p_values
from trackbench.statistics.sign_test import sign_test
from trackbench.statistics.significance_rules import ALIKE, BETTER, EQUAL, UNTESTED, WORSE

DIFFERS = "differs"
"""Verdict on a significant difference that is neither better nor worse."""
PAIRED = "paired"
INDEPENDENT = "independent"
COST = "cost"
"""How `trackbench gate` compares operations and CPU times: by a largest ratio, without a test."""
EXACT = "exact"
"""How recorded data are compared if the filter draws no random numbers. Any difference is real."""
INFINITE = " infinite"
"""End of the name of a row: share of the runs in which the metric is infinite."""


class Row(NamedTuple):
    """A metric of a filter in both folders, and how the second folder compares with the first."""

    point: GridPoint
    filter: str
    """label"""
    metric: str
    """``rmse`` of the mean over the runs, else with its statistic; also a share, named by `INFINITE`"""
    how: str
    """how the numbers are compared: equal if there is nothing to compare, as they are equal in every
    common run or in summary.csv; else exact, paired, independent or cost"""
    change: Comparison
    """comparison of the numbers: its a is the second folder's, its b is the first folder's"""
    worse: Comparison
    """comparison of the numbers' distances from the metric's best value, in the order of `change`: its z
    is positive if the second folder is farther, and NaN for a metric without a best value"""
    verdict: str = EQUAL
    """result of the tests: equal, no significant difference, untested, worse, better or differs"""
    left_out: int = 0
    """number of runs with a value in only one folder, which are not compared"""

    @property
    def difference(self) -> RunEstimate:
        """Second folder's number less that of the first."""
        return self.change.difference

    @property
    def is_primary(self) -> bool:
        """True if the metric is an error, a score, a share of runs or the ANEES of whole runs."""
        m = measured(self.metric)
        if m.window:
            return False
        if is_event(self.metric) or self.metric == "anees":
            return True
        return bool(primary_metrics([m.metric]))

    @property
    def fields(self) -> dict[str, Any]:
        """Row for programs, in which a is the first folder, b the second and ``difference = b - a``."""
        # Here a and b are exchanged: the comparison ``change`` has the second folder as its a and the
        # first as its b. It tests the difference of the numbers. The comparison ``worse`` tests the
        # difference of their distances from the metric's best value: its z is positive if the second
        # folder is worse.
        return {
            "point": self.point,
            "filter": self.filter,
            "metric": self.metric,
            "a": self.change.b.value,
            "b": self.change.a.value,
            "runs": self.difference.runs,
            "how": self.how,
            "difference": self.difference.value,
            "stderr": self.difference.stderr,
            "z": self.change.z,
            "z_worse": self.worse.z,
            "p_holm": self.change.p,
            "verdict": self.verdict,
        }


def is_event(metric: str) -> bool:
    """Test whether a metric is a share of runs."""
    return metric.endswith(INFINITE) or measured(metric).definition.is_event


def judge_rows(rows: Sequence[Row]) -> list[Row]:
    """Return the rows with their verdicts, by the rule for differences between filters.

    A row has two comparisons: `change` of the numbers of both folders, and `worse` of their distances
    from the metric's best value, which decides between better and worse. The rows of a metric are a
    family of tests for each of the two. Exact differences are significant without a test.
    """
    row_by_index = dict(enumerate(rows))
    for metric in dict.fromkeys(row.metric for row in rows):
        metric_rows = {i: row for i, row in row_by_index.items() if row.metric == metric}
        # The comparisons with p corrected for the number of tests.
        changes = as_family({i: row.change for i, row in metric_rows.items()})
        worse = as_family({i: row.worse for i, row in metric_rows.items()})
        for i, row in metric_rows.items():
            if row.how == EXACT:
                change = _with_exact_p(row.change)
                row_by_index[i] = row._replace(change=change, worse=_with_exact_p(row.worse))
            else:
                row_by_index[i] = row._replace(change=changes[i], worse=worse[i])
    return [row._replace(verdict=_verdict(row)) for row in row_by_index.values()]


def _with_exact_p(comparison: Comparison) -> Comparison:
    """Return an exact comparison with p-value 0 of an infinite z, 1 of z = 0 and NaN of z = NaN."""
    return comparison._replace(p=float(two_sided_p_values([comparison.z])[0]))


def _verdict(row: Row) -> str:
    """Return the word on a row whose p-values are corrected for the number of tests."""
    if row.how == EQUAL:
        return EQUAL
    if not row.change.sign:
        return ALIKE if row.change.is_tested else UNTESTED
    # The sign is positive if the second folder is significantly farther from the best value.
    if row.worse.sign > 0:
        return WORSE
    if row.worse.sign < 0:
        return BETTER
    # Neither direction is better, or both numbers are as far from the best value.
    return DIFFERS


@np.errstate(all="ignore")
def rows_of(
    key: tuple[GridPoint, str, str],
    a: Sample | RunEstimate,
    b: Sample | RunEstimate,
    paired: bool,
    is_exact: bool,
) -> Iterator[Row]:
    """Yield the row that compares a metric of two folders.

    There is no row if one of the folders does not measure the metric, or if the folders have no run in
    common: nothing can be compared then, and two empty columns are not equal numbers.

    If the folders differ in which runs have infinite values, a row with the share of these runs comes
    before it.

    Paired numbers are those of the runs that have a value in both folders. If the values of these runs
    are equal, so are the numbers. A run that only one folder loses counts in the share of lost runs.

    In a row, `change` compares the numbers of both folders, the second with the first. `worse` compares
    in the same order their distances from the metric's best value: its difference and z are positive if
    the second folder's number is farther. For equal numbers both are one comparison, without a test.

    Parameters
    ----------
    key
        point, filter and metric
    a, b
        the metric in the first and in the second folder
    paired
        True if run i of both folders has the same truth and measurements
    is_exact
        True if the numbers have no randomness
    """
    point, label, metric = key
    number_a = a.overall if isinstance(a, Sample) else a
    number_b = b.overall if isinstance(b, Sample) else b
    if _is_unmeasured(a) or _is_unmeasured(b):
        return
    # Step 1: test equality, of samples value by value.
    left_out = 0
    if isinstance(a, Sample) and isinstance(b, Sample):
        is_equal = np.array_equal(a.values, b.values, equal_nan=True)
        if paired and not is_equal:
            in_both = np.isfinite(a.values) & np.isfinite(b.values)
            left_out = int((np.isfinite(a.values) | np.isfinite(b.values)).sum() - in_both.sum())
            if in_both.any() and np.array_equal(a.values[in_both], b.values[in_both]):
                is_equal = True
                number_a = a.over(in_both).overall
                number_b = b.over(in_both).overall
        infinite_a = np.isinf(a.values) * 1.0
        infinite_b = np.isinf(b.values) * 1.0
        has_infinite = infinite_a.any() or infinite_b.any()
        if has_infinite and not np.array_equal(infinite_a, infinite_b) and not is_event(metric):
            infinite_key = (point, label, metric + INFINITE)
            yield from rows_of(
                infinite_key, Sample(infinite_a), Sample(infinite_b), paired, is_exact
            )
        row_metric = with_statistic(a.statistic, metric)
    else:
        row_metric = metric
        numbers_a = (*number_a.estimate, number_a.runs)
        numbers_b = (*number_b.estimate, number_b.runs)
        is_equal = np.array_equal(numbers_a, numbers_b, equal_nan=True)
    # Step 2: compare numbers that differ. The first number of a comparison, its a, is that of the second
    # folder, here ``b``.
    if is_equal:
        how = EQUAL
        runs = min(number_a.runs, number_b.runs)
        no_difference = RunEstimate(value=0.0, stderr=0.0, influences=None, runs=runs)
        change = Comparison(a=number_b, b=number_a, difference=no_difference, z=nan)
        worse = change
    elif paired and isinstance(a, Sample) and isinstance(b, Sample):
        how = EXACT if is_exact else PAIRED
        on_common_runs = compare(b, a)
        if on_common_runs is None:
            return
        change = on_common_runs
        if is_exact:
            change = _with_infinite_z(change)
            worse = _compare_distances(row_metric, change, _compare_exactly)
        elif is_event(row_metric):  # a larger share of runs is worse
            change = change._replace(z=sign_test(b.values, a.values))
            worse = change
        else:
            worse = _compare_distances(row_metric, change, compare_estimates)
    else:
        how = INDEPENDENT
        if is_event(row_metric):
            number_a = Share(*number_a)
            number_b = Share(*number_b)
        change = compare_independent(number_b, number_a)
        worse = _compare_distances(row_metric, change, compare_independent)
    yield Row(
        point=point,
        filter=label,
        metric=row_metric,
        how=how,
        change=change,
        worse=worse,
        left_out=left_out,
    )


def _is_unmeasured(number: Sample | RunEstimate) -> bool:
    """Test whether a metric has no value: NaN in every run, or NaN as a number of summary.csv."""
    if isinstance(number, Sample):
        return bool(np.isnan(number.values).all())
    return bool(np.isnan(number.value))


def _with_infinite_z(comparison: Comparison) -> Comparison:
    """Return a comparison of numbers without randomness, with its z.

    z is infinite with the sign of the difference, however small that is, or 0 without a difference.
    """
    difference = comparison.difference.value
    z = difference * inf if difference else 0.0
    return comparison._replace(z=z)


def _compare_exactly(a: RunEstimate, b: RunEstimate) -> Comparison:
    """Compare two numbers without randomness, whose difference is real however small it is."""
    return _with_infinite_z(compare_estimates(a, b))


def _compare_distances(
    metric: str, change: Comparison, compare_numbers: Callable[..., Comparison]
) -> Comparison:
    """Compare the distances of both folders' numbers from the metric's best value; positive is worse.

    ``change`` compares the numbers themselves. z is NaN for a metric without a best value.
    ``compare_numbers`` compares two numbers as the change does: on common runs, or independent.

    A distance is a function of the number. Its influences are those of the number, times the derivative
    of this function.
    """
    best = measured(metric).definition.better
    # If the lower number is better, as of a share of runs, a positive change is worse: the comparison of
    # the distances is the change itself.
    if best == "lower" or is_event(metric) or change.is_equal:
        return change
    if best == "higher":
        return change.swapped  # positive if the second folder's number is lower
    if best == "zero":
        # The distance is |x|, whose derivative is the sign of x.
        distances = []
        for number in (change.a, change.b):
            sign = copysign(1.0, number.value)
            distances.append(number.scaled(abs(number.value), factor=sign))
        return compare_numbers(*distances)
    if best == "one" and change.a.value > 0.0 < change.b.value:
        # The distance is |log x|, whose derivative is the sign of log x over x.
        distances = []
        for number in (change.a, change.b):
            logarithm = float(log(number.value))
            sign = copysign(1.0, logarithm)
            distances.append(number.scaled(abs(logarithm), factor=sign, divisor=number.value))
        return compare_numbers(*distances)
    return change._replace(z=nan)
