"""Table kind `metrics`: filters down, metrics across, each number with its standard error."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import isnan
from typing import ClassVar

import numpy as np

from trackbench.config.experiment import Labeled
from trackbench.config.requested_truth import needs_truth
from trackbench.errors import counted
from trackbench.evaluation.lost_runs import LOST_BECAUSE
from trackbench.evaluation.metric_expression import Expression, Measure
from trackbench.field_types import Digits
from trackbench.models.component_names import has_position_and_velocity
from trackbench.registry import register
from trackbench.report.expressions import Evaluator
from trackbench.report.findings.consistency_words import collapse_words
from trackbench.report.findings.cpu_time_notes import time_of_programs
from trackbench.report.findings.phrases import named
from trackbench.report.kinds import TableKind
from trackbench.report.table import Cell, Table
from trackbench.report.tables.best_marks import best_labels
from trackbench.report.tables.few_runs_decide import few_runs_notes
from trackbench.report.tables_and_figures import Results
from trackbench.results.points_json import GridPoint

_WHY_NO_NEES = "is empty, as it needs a truth of the whole state, and a covariance of full rank."
_NEES_OF_POSITION = " `score: {marginals: [position]}` adds anees_position."
_WHY_NO_NEES_OF_WHOLE_TRUTH = (
    "is empty, as it needs a covariance of full rank: those here are missing, zero or not positive "
    "definite."
)
_WHY_NO_COVARIANCE = "is empty, as a program that answers the mean alone has no covariance."
_WHY_NO_ERROR = "is empty: at no scored step the truth has what it needs."


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
            why = _why_empty(results, m, labels)
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


def _why_empty(results: Results, m: Measure, labels: list[str]) -> str:
    """Return why no filter in ``labels`` has a number of the measure, as a sentence's predicate.

    Without a kept run the text is empty: other notes give the reason of the lost runs or of the failure.
    It is also empty if the reason is unknown.
    """
    if m.other in results.labels_without_runs:
        return f"is empty, as {named(m.other)} has no such number."
    kept = _labels_with_kept_runs(results)
    if m.definition.name in ("nees", "anees") and not m.quantity:
        kept_labels = kept.intersection(labels)
        if not kept_labels:
            return ""
        if _is_recording(results):
            missing = _parts_without_truth(results, kept)
            if not missing:
                return _WHY_NO_NEES
            why = f"is empty, as {_truth_lacks(missing)}, and it is of the whole state."
            return why + _NEES_OF_POSITION if missing == ["velocity"] else why
        if kept_labels <= {*results.programs}:
            return _WHY_NO_COVARIANCE
        # The truth of a simulation has the whole state.
        return _WHY_NO_NEES_OF_WHOLE_TRUTH
    # A recording has no truth for an error that a filter with kept runs lacks.
    if needs_truth(m) and kept and _is_recording(results):
        missing = _parts_without_truth(results, kept)
        # An error of the config is of several components, and otherwise its name is that of its part.
        score = results.facts(results.points()[0]).scenario.get("score") or {}
        parts_of_error = (score.get("errors") or {}).get(m.quantity, [m.quantity])
        missing = [part for part in missing if part in parts_of_error]
        return f"is empty, as {_truth_lacks(missing)}." if missing else _WHY_NO_ERROR
    return ""


def _truth_lacks(parts: list[str]) -> str:
    """Write that the truth lacks some parts of the state, as a clause."""
    return f"the truth has no {' or '.join(parts)} at any scored step"


def _parts_without_truth(results: Results, kept: set[str]) -> list[str]:
    """Return the parts of the state that the truth of a recording has at no scored step.

    They are components, or position and velocity of a state that has both. Their errors are stored, and
    those of filters in ``kept``, which have kept runs, have a number wherever there is a truth.
    """
    points = results.points()
    components = tuple(results.facts(points[0]).components)
    parts = components
    if has_position_and_velocity(components):
        parts = ("position", "velocity")
    missing = []
    for part in parts:
        errors = []
        for point in points:
            for (label, metric), values in results.runs(point).items():
                if label in kept and metric == f"rmse_{part}":
                    errors.append(values)
        if errors and all(np.isnan(values).all() for values in errors):
            missing.append(part)
    return missing


def _is_recording(results: Results) -> bool:
    """Test whether the results are of recorded measurements, at every point of the grid."""
    targets = [results.facts(point).scenario.get("target") for point in results.points()]
    return all(isinstance(target, dict) and target.get("kind") == "measured" for target in targets)


def _labels_with_kept_runs(results: Results) -> set[str]:
    """Return the labels of the filters that have not lost all runs, at some point of the grid."""
    labels = set()
    for point in results.points():
        for (label, metric), values in results.runs(point).items():
            if metric == "lost" and (values == 0).any():
                labels.add(label)
    return labels


def _cell(evaluator: Evaluator, m: Measure) -> Cell:
    """Return the cell of a filter's measure, which says if only some of the kept runs have a value."""
    term = evaluator.stored_or_evaluated(m)
    kept_runs = 0
    if m.is_over_runs:
        kept_runs = len(evaluator.runs.get((m.filter, "lost"), ())) - term.lost
    return Cell.of(term, collapse_words(evaluator, m), kept_runs)


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
