"""Table kind `differences`: every filter against one, run by run on common noise."""

from dataclasses import dataclass

import numpy as np

from trackbench.evaluation.statistics import mean
from trackbench.registry import register
from trackbench.report.results import Results
from trackbench.report.table import Cell, Table


@register("tables", "differences")
@dataclass(frozen=True, kw_only=True)
class Differences:
    """Mean paired difference to a filter, a row per other filter, a column per metric of per_run.csv.

    Negative: smaller than the filter it is compared with. Runs that either filter lost are left out.
    """

    title: str = ""
    """caption"""
    against: str
    """label of the filter that is subtracted"""
    columns: dict[str, str]
    """header: metric of per_run.csv, such as `rmse_position`"""
    filters: tuple[str, ...] | None = None
    """labels of the rows; default: all others"""
    digits: int = 4
    """significant digits of the values"""

    def table(self, results: Results) -> Table:
        """The table from a results folder."""
        labels = [b for b in results.labels if self.filters is None or b in self.filters]
        heads = [*results.grid_heads, f"Difference to {self.against}"]
        table = Table(self.title, heads, list(self.columns), self.digits)
        for point in results.points():
            frame = results.at(results.per_run, point)
            wide = {
                metric: frame[frame["metric"] == metric].pivot(
                    index="run", columns="filter", values="value"
                )
                for metric in self.columns.values()
            }
            for label in labels:
                if label != self.against:
                    cells = [_cell(wide[m], label, self.against) for m in self.columns.values()]
                    table.add([*(str(v) for v in point.values()), label], cells)
        return table


def _cell(wide: "object", label: str, against: str) -> Cell:
    import pandas as pd

    assert isinstance(wide, pd.DataFrame)
    if label not in wide or against not in wide:
        return Cell.missing()
    difference = (wide[label] - wide[against]).to_numpy(dtype=float)
    found = difference[np.isfinite(difference)]
    return Cell(mean(found), len(found), len(difference) - len(found))
