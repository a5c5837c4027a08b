"""Table kind `metrics`: filters down, metrics across, each number with its standard error."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import isnan
from typing import ClassVar

import numpy as np

from trackbench.config.experiment import Labeled
from trackbench.errors import counted
from trackbench.evaluation.lost_runs import LOST_BECAUSE
from trackbench.evaluation.metric_expression import Expression, Measure
from trackbench.field_types import Digits
from trackbench.registry import register
from trackbench.report.expressions import Evaluator
from trackbench.report.findings.consistency_words import collapse_words
from trackbench.report.findings.cpu_time_notes import time_of_programs
from trackbench.report.findings.phrases import named
from trackbench.report.kinds import TableKind
from trackbench.report.table import Cell, Table
from trackbench.report.tables.best_marks import best_labels
from trackbench.report.tables.empty_columns import why_empty
from trackbench.report.tables.few_runs_decide import few_runs_notes
from trackbench.report.tables_and_figures import Results
from trackbench.results.points_json import GridPoint


@dataclass(frozen=True, kw_only=True)
class Gain(Labeled):
    """A last row: by how many percent one filter's metric is below another's, on common runs."""

    label_keys: ClassVar[tuple[str, ...]] = ("of", "over")

    of: str
    """label of the better filter"""
    over: str
    """label of the filter it is compared with"""


@register("tables", "metrics")
@dataclass(frozen=True, kw_only=True)
class Metrics(TableKind):
    """A row per filter, a column per metric of summary.csv, such as `mean(rmse)`."""

    label_keys: ClassVar[tuple[str, ...]] = ("gain",)

    columns: dict[str, Expression]
    """header: metric of summary.csv, `cpu_s_per_run`, or an expression, `ratio(cpu_s_per_run, RPF)`"""
    filters: tuple[str, ...] | None = None
    """labels of the rows; default: all"""
    digits: Digits = 4
    """significant digits of the values"""
    gain: Gain | None = None
    """a last row with one filter's improvement over another's, in percent"""

    def without_cpu_times(self) -> "Metrics | None":
        """Return the table without columns of CPU times; None if there are no others."""
        columns = {head: m for head, m in self.columns.items() if not m.is_cpu_time}
        if len(columns) == len(self.columns):
            return self
        if not columns:
            return None
        return replace(self, columns=columns)

    def table(self, results: Results) -> Table:
        """Fill a row for each filter at each point of the grid, a column for each metric expression.

        Rows of exact errors and of the bound are among them, and a last row with the gain.
        """
        labels = results.chosen(self.filters, with_exact_errors=True)
        measures = list(self.columns.values())
        table = Table(self.title, [*results.grid_heads, "Filter"], list(self.columns), self.digits)
        # Bounds, the reference and exact errors are not marked as best.
        not_ranked = {results.config.get("reference"), *results.labels_without_runs}
        ranked = [label for label in labels if label not in not_ranked]
        filled_columns = set()
        for point in results.points():
            evaluator = Evaluator(results, point)
            point_keys = [str(value) for value in point.values()]
            best = [best_labels(evaluator, ranked, m) for m in measures]
            for label in labels:
                cells = [_cell(evaluator, m.of(label)) for m in measures]
                for column, cell in enumerate(cells):
                    # An empty cell has no mark, as that of a ratio to a filter that failed.
                    if isnan(cell.estimate.value):
                        continue
                    filled_columns.add(column)
                    if label in best[column]:
                        table.best.add((len(table.keys), column))
                table.add([*point_keys, label], cells)
            # Last row: the gain over another filter in each column.
            if self.gain is not None:
                head = f"{self.gain.of} below {self.gain.over} (%)"
                cells = []
                for m in measures:
                    gain = m.beside("gain", self.gain.over).of(self.gain.of)
                    cells.append(Cell.of(evaluator.term(gain)))
                table.add([*point_keys, head], cells)
            table.notes += _lost_notes(results, point, labels)
            table.notes += few_runs_notes(evaluator, labels, measures)
        # Notes on spreads over one run, empty columns, filters that loop over runs, filters that failed.
        statistics = {m.statistic or m.definition.over_runs for m in measures}
        if results.config["runs"] == 1 and statistics & {"std", "variance"}:
            table.notes.append("One run has no standard deviation or variance over the runs.")
        for column, (head, m) in enumerate(self.columns.items()):
            if column in filled_columns:
                continue
            why = why_empty(results, m, labels)
            if why:
                table.notes.append(f"{head} {why}")
        slow = [label for label in labels if label in results.loops_over_runs]
        if slow and any("cpu_s" in str(m) for m in measures):
            table.notes.append(f"Time of {', '.join(map(named, slow))}: one run after the other.")
            programs = [label for label in slow if label in results.programs]
            if programs:
                table.notes.append(time_of_programs(programs))
        for failure in results.failed:
            if failure["filter"] in labels:
                table.notes.append(f"{named(failure['filter'])} failed: {failure['reason']}")
        return table


def _cell(evaluator: Evaluator, m: Measure) -> Cell:
    """Return the cell of a filter's measure, which says if only some of the kept runs have a value."""
    term = evaluator.stored_or_evaluated(m)
    all_runs = len(evaluator.runs.get((m.filter, "lost"), ()))
    # The runs of a CPU time are those of a timed block. Some of the results' runs may be lost, which
    # the row counts.
    if m.is_cpu_time:
        return Cell.of(term._replace(runs=all_runs))
    kept_runs = 0
    if m.is_over_runs:
        kept_runs = all_runs - term.lost
    cell = Cell.of(term, collapse_words(evaluator, m), kept_runs)
    if m.relation:
        return cell._replace(all_runs=all_runs)
    return cell


def _lost_notes(results: Results, point: GridPoint, labels: list[str]) -> Iterator[str]:
    """Yield a sentence for each filter and each reason for which it lost runs at a point."""
    runs = results.runs(point)
    place = results.point_heading(point)
    for label in labels:
        # The code of the reason why each run (M,) is lost, 0 if it is not.
        codes = runs.get((label, "lost"), np.empty(0))
        for code, reason in LOST_BECAUSE.items():
            number = int((codes == code).sum())
            if number:
                name = named(label)
                if place:
                    name += f" at {place}"
                yield f"{name}: {counted(number, 'run')} lost because {reason}."
