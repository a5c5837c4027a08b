"""Table kind `differences`: paired differences to one filter."""

from dataclasses import dataclass
from typing import ClassVar

from trackbench.evaluation.metric_expression import OfRun
from trackbench.field_types import Digits
from trackbench.registry import register
from trackbench.report.kinds import TableKind
from trackbench.report.table import Cell, Table
from trackbench.report.tables_and_figures import Results


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
        """Fill a row for each filter but `against`: paired differences, metric by metric."""
        heads = [*results.grid_heads, f"Difference to {self.against}"]
        table = Table(self.title, heads, list(self.columns), self.digits)
        labels = [label for label in results.chosen(self.filters) if label != self.against]
        for point in results.points():
            runs = results.runs(point)
            for label in labels:
                cells = []
                for metric in map(str, self.columns.values()):
                    values = runs.get((label, metric))
                    subtracted_values = runs.get((self.against, metric))
                    cells.append(Cell.difference(values, subtracted_values))
                table.add([*map(str, point.values()), label], cells)
        return table
