"""Table kind `differences`: every filter against one, run by run on common noise."""

from dataclasses import dataclass
from typing import ClassVar

from trackbench.evaluation.measure import OfRun
from trackbench.keys import Digits
from trackbench.registry import register
from trackbench.report.kinds import TableKind
from trackbench.report.results import Results
from trackbench.report.table import Cell, Table


@register("tables", "differences")
@dataclass(frozen=True, kw_only=True)
class Differences(TableKind):
    """Mean paired difference to a filter, a row per other filter, a column per metric of per_run.csv.

    Negative: smaller than the filter it is compared with. Runs that either filter lost are left out.
    """

    label_keys: ClassVar[tuple[str, ...]] = ("against",)

    against: str
    """label of the filter that is subtracted"""
    columns: dict[str, OfRun]
    """header: metric of per_run.csv, such as `rmse_position`"""
    filters: tuple[str, ...] | None = None
    """labels of the rows; default: all others"""
    digits: Digits = 4
    """significant digits of the values"""

    def table(self, results: Results) -> Table:
        """The table from a results folder."""
        labels = results.chosen(self.filters)
        heads = [*results.grid_heads, f"Difference to {self.against}"]
        table = Table(self.title, heads, list(self.columns), self.digits)
        for point in results.points():
            runs = results.runs(point)
            for label in (b for b in labels if b != self.against):
                cells = [
                    Cell.difference(runs.get((label, metric)), runs.get((self.against, metric)))
                    for metric in map(str, self.columns.values())
                ]
                table.add([*(str(v) for v in point.values()), label], cells)
        return table
