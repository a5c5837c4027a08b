"""Distance of measured from printed numbers: the root mean square of the logarithms of their ratios."""

from math import inf, isfinite, nan
from typing import NamedTuple

import numpy as np

from trackbench.config.published_numbers_and_claims import PublishedNumber
from trackbench.core import elementary
from trackbench.report.expressions import Evaluator
from trackbench.statistics.estimates import RunEstimate
from trackbench.statistics.sample_statistics import mean
from trackbench.statistics.significance_rules import NEAR


class Number(NamedTuple):
    """A printed number of a filter, and what is measured for it."""

    label: str
    printed: float
    measured: RunEstimate
    is_variance: bool = False

    @property
    def power(self) -> float:
        """Power to which both numbers are raised for comparison: the root is taken of a variance."""
        if self.is_variance:
            return 0.5
        return 1.0


class Distance(NamedTuple):
    """Root mean square of log(measured / printed), and how many numbers are within 10 %."""

    estimate: RunEstimate
    """its error covers the runs, not the choice among interpretations"""
    near: int
    """number of the measured numbers within 10 % of the printed ones"""
    loses_most: bool = False
    """True if the distance is infinite because a filter loses most of its runs"""


def distance(numbers: list[Number]) -> Distance:
    """Return the distance of the measured numbers from the printed ones.

    The distance is the root mean square of ``log(measured / printed)``. Of variances the square roots
    are compared. The distance is infinite if a number is not positive or not finite. It is also infinite
    if a number has lost most of its runs, as the few others do not represent the filter.

    The result also has the number of measured numbers within 10 % of the printed ones, which is 0 for an
    infinite distance.
    """
    terms = [number.measured for number in numbers]
    # All runs, and the most lost runs of any of the numbers.
    runs = max((len(t.influences) for t in terms if t.influences is not None), default=0)
    lost = max((t.lost for t in terms), default=0)
    infinite = RunEstimate(value=inf, stderr=nan, influences=None, runs=runs - lost, lost=lost)
    if any(term.lost > term.runs for term in terms):
        return Distance(infinite, near=0, loses_most=True)
    # Step 1: squares of the logarithms, and influences of the runs on half their sum.
    squares = 0.0
    near = 0
    influences_on_sum = np.zeros(runs)
    for number in numbers:
        term = number.measured
        printed = number.printed
        if not (isfinite(term.value) and term.value > 0.0 < printed):
            return Distance(infinite, near=0)
        # log(measured / printed); the power 0.5 takes the square root of a variance
        log_ratio = number.power * float(elementary.log(term.value / printed))
        squares += log_ratio * log_ratio
        if abs(term.value - printed) <= NEAR * printed:
            near += 1
        # d distance = sum log_ratio power dx / x / (n distance), x the measured value
        if term.influences is not None:
            # The influences of lost runs are 0 here. In a mean over all runs the others count for more.
            weight = runs / term.runs
            changes = np.nan_to_num(term.influences)
            influences_on_sum += log_ratio * number.power / term.value * weight * changes
    # Step 2: the root mean square D = sqrt(squares / n), with dD = d(squares / 2) / (n D).
    value = float(np.sqrt(squares / max(len(numbers), 1)))
    influences = influences_on_sum
    if value:
        influences = influences_on_sum / (len(numbers) * value)
    estimate = RunEstimate(
        value=value,
        stderr=mean(influences).stderr,
        influences=influences,
        runs=runs - lost,
        lost=lost,
    )
    return Distance(estimate, near=near)


def measured_numbers(evaluator: Evaluator, numbers: list[PublishedNumber]) -> list[Number]:
    """Measure the printed numbers at a point, each for all its filters."""
    measured = []
    for number in numbers:
        m = number.expression
        if m is None:
            continue
        for label in number.labels:
            measured.append(
                Number(
                    label=label,
                    printed=float(number.value),
                    measured=evaluator.term(m.of(label)),
                    is_variance=m.statistic == "variance",
                )
            )
    return measured
