"""Table kind `metrics`: filters down, metrics across, each number with its standard error."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
from annotated_types import Interval

from trackbench.evaluation.measure import Expression, Measure
from trackbench.evaluation.metrics import LOST_BECAUSE
from trackbench.evaluation.statistics import Estimate
from trackbench.experiment.reading.definition import Labelled
from trackbench.registry import register
from trackbench.report.expressions import Expressions
from trackbench.report.kinds import TableKind
from trackbench.report.results import Results
from trackbench.report.table import Cell, Table

_SMALLER = re.compile(r"[a-z-]+\((rmse|distance)[^()]*\)|rmse[^()]*|cpu_s_per_run")
"""Of what the least value is the best."""


@dataclass(frozen=True, kw_only=True)
class Gain(Labelled):
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
    digits: Annotated[int, Interval(ge=1, le=15)] = 4
    """significant digits of the values"""
    gain: Gain | None = None
    """a last row with one filter's improvement over another's, in percent"""

    def table(self, results: Results) -> Table:
        """The table from a results folder."""
        labels = results.chosen(self.filters)
        table = Table(self.title, [*results.grid_heads, "Filter"], list(self.columns), self.digits)
        table.least = [i for i, m in enumerate(self.columns.values()) if _SMALLER.fullmatch(str(m))]
        table.apart = {str(results.config.get(key)) for key in ("bound", "reference")}
        for point in results.points():
            found, expressions = _index(results, point), Expressions(results, point)
            keys = [str(v) for v in point.values()]
            for label in labels:
                cells = [
                    found.get((label, str(m))) or _evaluated(expressions, m.of(label))
                    for m in self.columns.values()
                ]
                table.add([*keys, label], cells)
            if self.gain is not None:
                head = f"{self.gain.of} below {self.gain.over} (%)"
                table.apart.add(head)
                cells = [
                    _evaluated(expressions, m.beside("gain", self.gain.over).of(self.gain.of))
                    for m in self.columns.values()
                ]
                table.add([*keys, head], cells)
            table.notes += _lost_notes(results, point, labels)
        slow = [label for label in labels if label in results.one_by_one]
        if slow and any("cpu_s" in str(m) for m in self.columns.values()):
            table.notes.append(f"Time of {', '.join(slow)}: one run after the other, in Python.")
        table.notes += [
            f"{row['filter']} failed: {row['reason']}"
            for row in results.failed
            if row["filter"] in labels
        ]
        return table


def _evaluated(expressions: Expressions, m: Measure) -> Cell:
    """A cell of a measure that is no row of summary.csv, such as a ratio to another filter."""
    term = expressions.term(m)
    return Cell(term.estimate, term.runs, term.lost)


def _lost_notes(results: Results, point: dict[str, Any], labels: list[str]) -> Iterator[str]:
    """Why runs were lost, in words."""
    runs = results.runs(point)
    for label in labels:
        codes = runs.get((label, "lost"), np.empty(0))
        for code, reason in LOST_BECAUSE.items():
            number = int((codes == code).sum())
            if number:
                where = ", ".join(f"{k} = {v}" for k, v in point.items())
                yield f"{label}{f' at {where}' if where else ''}: {number} runs lost because {reason}."


def _index(results: Results, point: dict[str, Any]) -> dict[tuple[str, str], Cell]:
    """Cells by (filter, metric)."""
    cells: dict[tuple[str, str], Cell] = {}
    for row in results.columns("summary", point).records():
        cell = Cell(Estimate(row["value"], row["stderr"]), row["runs"], row["lost"])
        cells[row["filter"], row["metric"]] = cell
    for row in results.columns("timing", point).records():
        cell = Cell(Estimate(row["cpu_s_per_run"], row["stderr"]), row["runs"], 0)
        cells[row["filter"], "cpu_s_per_run"] = cell
    return cells
