"""Table kind `differences`: paired differences to one filter; and a table of every two filters."""

from dataclasses import dataclass
from math import isnan
from typing import ClassVar

import numpy as np

from trackbench.errors import counted
from trackbench.evaluation.metric_expression import OfRun
from trackbench.field_types import Digits
from trackbench.registry import register
from trackbench.report.findings import phrases
from trackbench.report.findings.grid_headings import join_heading
from trackbench.report.findings.phrases import named
from trackbench.report.kinds import TableKind
from trackbench.report.markdown_table import Text, TextTable
from trackbench.report.rounded_numbers import rounded
from trackbench.report.table import Cell, Table
from trackbench.report.tables_and_figures import Results
from trackbench.results.rows_and_columns import Runs
from trackbench.statistics import significance_rules as rules

_PAIR_ALONE = (
    "An interval is of its pair alone, and left out where it would show a difference that is not "
    "significant."
)


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
                lost = _lost_runs(runs, label)
                cells = []
                for metric in map(str, self.columns.values()):
                    values = runs.get((label, metric))
                    subtracted_values = runs.get((self.against, metric))
                    cells.append(Cell.difference(values, subtracted_values, lost))
                table.add([*map(str, point.values()), label], cells)
            lost_by_other = _lost_runs(runs, self.against)
            if lost_by_other:
                all_runs = len(runs[self.against, "lost"])
                other = join_heading(named(self.against), results.point_heading(point))
                table.notes.append(
                    f"{other}: {lost_by_other} of {counted(all_runs, 'run')} lost, which every "
                    "difference leaves out beside the lost runs of its row."
                )
        return table


def _lost_runs(runs: Runs, label: str) -> int:
    """Return the number of runs that a filter lost at a point of the grid, by its values per run."""
    return int((runs.get((label, "lost"), np.empty(0)) > 0).sum())


def table_of_pairs(results: Results) -> TextTable:
    """Tabulate the differences of every two filters on common runs, a row per pair and metric.

    Parameters
    ----------
    results
        results folder

    Returns
    -------
    TextTable
        table with a note on the test
    """
    heads = [*results.grid_heads, "a", "b", "Metric", "a - b", "95 % interval", "a is"]
    title = "Differences on common runs"
    how_filters_differ = rules.HOW_FILTERS_DIFFER
    if results.steps_decide:
        title = "Differences on one recording"
        how_filters_differ = rules.HOW_STEPS_DIFFER
    rule = f"Significant: {how_filters_differ}. {_PAIR_ALONE}"
    table = TextTable(title, heads, notes=[rule])
    for point, pairs in results.pairs:
        point_cells = []
        for value in point.values():
            number = value if isinstance(value, int | float) else None
            point_cells.append(Text(phrases.number(value), number=number))
        for pair in pairs:
            difference = pair.comparison.difference
            value_text = rounded(difference.value, difference.stderr, digits=4)
            low, high = difference.interval()
            # The ends have the digits of the value, without the error: "1.23" of "1.23 ± 0.12".
            end_texts = []
            for end in (low, high):
                end_texts.append(rounded(end, difference.stderr, digits=4).partition(" ")[0])
            interval_text = " to ".join(end_texts)
            has_interval = not (isnan(low) and isnan(high))
            # The interval is of this pair alone. It contradicts the word of the test, which is one of a
            # family, if it shows a difference that is not significant in the family.
            if not has_interval or pair.comparison.interval_contradicts:
                interval_text = "–"
            table.rows.append(
                [
                    *point_cells,
                    Text(pair.filter_a),
                    Text(pair.filter_b),
                    Text(pair.metric),
                    Text(value_text, number=difference.value),
                    Text(interval_text),
                    Text(pair.word),
                ]
            )
    return table
