"""Table kind `calibration`: are the ranks of the truth uniform?"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from trackbench.config.experiment import Point
from trackbench.evaluation.metric_expression import OfRank
from trackbench.evaluation.statistics import Estimate
from trackbench.evaluation.uniformity_tests import Histogram
from trackbench.field_types import Digits, OpenShare
from trackbench.registry import register
from trackbench.report.findings.phrases import joined
from trackbench.report.kinds import TableKind
from trackbench.report.rank_histograms import (
    Uniformity,
    check_rank,
    histogram,
    judged,
    steps_that_are_not,
)
from trackbench.report.results import Results
from trackbench.report.table import Cell, Table

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
        return steps_that_are_not("rows", self.rows.values(), points)

    def table(self, results: Results) -> Table:
        """Return the table from a results folder."""
        keys = [*results.grid_heads, "Filter", "PIT"]
        table = Table(self.title, keys, _HEADS, self.digits)
        every: list[tuple[str, str, Histogram]] = []
        for point in results.points():
            for label in results.chosen(self.filters):
                row = [*(str(v) for v in point.values()), label]
                for head, m in self.rows.items():
                    found = histogram(results, point, label, m)
                    table.add([*row, head], _cells(found))
                    every.append((", ".join(row), head, found))
        table.notes += _verdict(judged(every, self.alpha), self.alpha)
        return table


def _cells(found: Histogram) -> list[Cell]:
    numbers = (found.distance, found.p_distance, found.p)
    return [Cell(Estimate(x, np.nan), found.runs, 0) for x in numbers]


def _verdict(found: Uniformity, alpha: float) -> Iterator[str]:
    """Return which ranks are not uniform, and which show no difference."""
    by = f"by {found.tests} tests, {alpha:g} for all of them (Holm)"
    if found.bad:
        words = "; ".join(f"{label} in {joined(heads)}" for label, heads in found.bad.items())
        yield f"Not calibrated {by}: {words}."
    if found.good:
        yield f"Not seen to be otherwise than calibrated {by}: {', '.join(found.good)}."
