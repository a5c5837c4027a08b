"""Table kind `calibration`: are the ranks of the truth in the distributions of the filters uniform?"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from trackbench.config.experiment import Point
from trackbench.config.table_and_figure_checks import missing_steps
from trackbench.errors import counted
from trackbench.evaluation.metric_expression import OfRank
from trackbench.evaluation.uniformity_tests import Histogram
from trackbench.field_types import Digits, OpenShare
from trackbench.registry import register
from trackbench.report.findings.phrases import joined, named
from trackbench.report.kinds import TableKind
from trackbench.report.table import Cell, Table
from trackbench.report.tables_and_figures import Results
from trackbench.report.uniformity_of_ranks import (
    Uniformity,
    check_rank,
    histogram,
    judge_histograms,
)
from trackbench.statistics.sample_statistics import Estimate

_HEADS = ["Distance", "p of the distance", "p of the histogram"]


@register("tables", "calibration")
@dataclass(frozen=True, kw_only=True)
class CalibrationTable(TableKind):
    """Kolmogorov's distance of each PIT from the uniform distribution, and tests of it.

    At a step (`pit_px@20`) the runs are independent: Kolmogorov's test, and Pearson's of the histogram
    in tenths. Over all steps (`pit_px`) each run has its share of steps in each tenth: Hotelling's T^2.
    Talts et al. 2018; Gneiting, Balabdaoui & Raftery 2007.
    """

    rows: dict[str, OfRank]
    """what it is called: pit_nees (the whole state), pit_<component>; with @20 or @last at a step"""
    filters: tuple[str, ...] | None = None
    """labels of the rows; default: all"""
    alpha: OpenShare = 0.01
    """probability that a calibrated filter is said not to be, anywhere in the table"""
    digits: Digits = 3
    """significant digits of the values"""

    def __post_init__(self) -> None:
        for head, m in self.rows.items():
            check_rank(m, "rows", head)

    def conflicts(self, points: Sequence[Point]) -> dict[str, str]:
        """Reject steps outside the run."""
        return missing_steps("rows", self.rows.values(), points)

    def table(self, results: Results) -> Table:
        """Fill a row for each filter and PIT; a note judges all histograms together."""
        heads = [*results.grid_heads, "Filter", "PIT"]
        table = Table(self.title, heads, _HEADS, self.digits)
        # Each histogram with the point and filter in words, and the heading of the PIT.
        histograms: list[tuple[str, str, Histogram]] = []
        for point in results.points():
            for label in results.chosen(self.filters):
                keys = [*map(str, point.values()), label]
                for head, m in self.rows.items():
                    ranks = histogram(results, point, label, m)
                    cells = []
                    # Kolmogorov's distance from a uniform distribution with the p-value of its test, and
                    # the p-value of the histogram in tenths.
                    for number in (ranks.distance, ranks.p_distance, ranks.p):
                        cells.append(Cell(Estimate(number, np.nan), runs=ranks.runs, lost=0))
                    table.add([*keys, head], cells)
                    histograms.append((", ".join(keys), head, ranks))
        table.notes += _verdict(judge_histograms(histograms, self.alpha), self.alpha)
        return table


def _verdict(uniformity: Uniformity, alpha: float) -> Iterator[str]:
    """Yield a sentence on the filters that are not calibrated, and one on those that may be.

    ``uniformity`` has the outcome of tests at the family-wise error ``alpha``.
    """
    rule = f"by {counted(uniformity.tests, 'test')}, {alpha:g} for all of them (Holm)"
    if uniformity.bad:
        words = "; ".join(
            f"{named(label)} in {joined(heads)}" for label, heads in uniformity.bad.items()
        )
        yield f"Not calibrated {rule}: {words}."
    if uniformity.good:
        good = ", ".join(map(named, uniformity.good))
        yield f"Not seen to be otherwise than calibrated {rule}: {good}."
