"""Table kind `claims`: statements that one filter's metric is less than another's, over a grid."""

from dataclasses import dataclass
from math import isnan
from typing import ClassVar

from trackbench.config.experiment import Labeled
from trackbench.evaluation.metric_expression import OfRun
from trackbench.field_types import Digits
from trackbench.registry import register
from trackbench.report.expressions import Evaluator
from trackbench.report.findings import phrases
from trackbench.report.kinds import TableKind
from trackbench.report.table import Cell, Table
from trackbench.report.tables_and_figures import Results
from trackbench.statistics import verdict_rules
from trackbench.statistics.estimates import RunEstimate
from trackbench.statistics.verdict_rules import NOT_MEASURED, UNDECIDED


@dataclass(frozen=True, kw_only=True)
class ClaimRow(Labeled):
    """Statement that one filter's metric is less than another's."""

    label_keys: ClassVar[tuple[str, ...]] = ("less", "than")

    less: str
    """label of the filter said to be better"""
    than: str
    """label of the filter said to be worse"""
    metric: OfRun
    """metric of per_run.csv, smaller is better"""


@register("tables", "claims")
@dataclass(frozen=True, kw_only=True)
class Claims(TableKind):
    """A row per claim, a column per value of the grid: paired difference, negative where it holds.

    A claim holds, or fails, if the paired difference is significant; else it is inconclusive. It is not
    measured if the filters have no run in common. The notes give the values of each.
    """

    label_keys: ClassVar[tuple[str, ...]] = ("claims",)

    claims: dict[str, ClaimRow]
    """claims by their words"""
    digits: Digits = 3
    """significant digits of the values"""

    def table(self, results: Results) -> Table:
        """Judge every claim at each point of the grid."""
        points = results.points()
        # A column for each point, named by its values; without a grid there is one column.
        names = [", ".join(map(phrases.number, point.values())) or "all runs" for point in points]
        table = Table(self.title, ["Claim"], names, self.digits)
        evaluators = [Evaluator(results, point) for point in points]
        for claim_text, claim in self.claims.items():
            cells = []
            words = []
            for evaluator in evaluators:
                difference, word = _judge(evaluator, claim)
                cells.append(Cell.of(difference))
                words.append(word)
            table.add([claim_text], cells)
            table.notes.append(f"{claim_text}: {_values_by_verdict(names, words)}.")
        return table


def _judge(evaluator: Evaluator, claim: ClaimRow) -> tuple[RunEstimate, str]:
    """Compare the two filters of a claim on common runs; return their difference and the verdict.

    The claim is that the metric's mean of the filter ``claim.less`` is smaller than that of
    ``claim.than``. The difference is NaN if the results lack the metric of one of them.
    """
    mean = claim.metric._replace(statistic="mean")
    # mean(less - than) on common runs, negative where the claim holds
    difference = evaluator.difference(mean.of(claim.less), mean.of(claim.than))
    if isnan(difference.value):
        return difference, NOT_MEASURED
    sign = verdict_rules.difference_sign(difference, evaluator.results.batches)
    if sign < 0:
        return difference, "holds"
    if sign > 0:
        return difference, "fails"
    return difference, UNDECIDED


def _values_by_verdict(names: list[str], words: list[str]) -> str:
    """Write ``holds at 0, 0.1; inconclusive at 1; fails at 10``.

    ``names`` are those of the points, ``words`` the verdicts there.
    """
    names_by_verdict: dict[str, list[str]] = {
        "holds": [],
        UNDECIDED: [],
        NOT_MEASURED: [],
        "fails": [],
    }
    for name, word in zip(names, words, strict=True):
        names_by_verdict[word].append(name)
    parts = []
    for verdict, names_of_points in names_by_verdict.items():
        if names_of_points:
            parts.append(f"{verdict} at {', '.join(names_of_points)}")
    return "; ".join(parts)
