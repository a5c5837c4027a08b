"""Table kind `metrics`: filters down, metrics across, each number with its standard error."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from math import isfinite, isnan
from typing import ClassVar

import numpy as np

from trackbench.config.experiment import Labeled
from trackbench.config.requested_truth import needs_truth
from trackbench.errors import counted
from trackbench.evaluation.lost_runs import LOST_BECAUSE
from trackbench.evaluation.metric_expression import Expression, Measure
from trackbench.field_types import Digits
from trackbench.registry import register
from trackbench.report.expressions import Evaluator
from trackbench.report.findings.phrases import listed, named, time_of_programs
from trackbench.report.findings.ranking import Candidate, ranking_of
from trackbench.report.kinds import TableKind
from trackbench.report.table import Cell, Table
from trackbench.report.tables_and_figures import Results
from trackbench.results.points_json import GridPoint
from trackbench.statistics import significance_rules as rules
from trackbench.statistics.comparison import Sample
from trackbench.statistics.heavy_tails import has_heavy_tail
from trackbench.statistics.sample_statistics import STATISTICS, influence, interval

_WHY_NO_NEES = (
    "is empty, as it needs a truth of the whole state, velocities included. "
    "`score: {marginals: [position]}` adds anees_position."
)
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
        labels = results.chosen(self.filters, exact=True)
        measures = list(self.columns.values())
        table = Table(self.title, [*results.grid_heads, "Filter"], list(self.columns), self.digits)
        # Bounds, the reference and exact errors are not marked as best.
        not_ranked = {results.config.get("bound"), results.config.get("reference"), *results.exact}
        ranked = [label for label in labels if label not in not_ranked]
        filled_columns = set()
        for point in results.points():
            evaluator = Evaluator(results, point)
            point_keys = [str(value) for value in point.values()]
            for column, m in enumerate(measures):
                for label in best_labels(evaluator, ranked, m):
                    # The rows of this point follow those so far, in the order of the labels.
                    row = len(table.keys) + labels.index(label)
                    table.best.add((row, column))
            for label in labels:
                cells = [_cell(evaluator, m.of(label)) for m in measures]
                table.add([*point_keys, label], cells)
                for column, cell in enumerate(cells):
                    if not isnan(cell.estimate.value):
                        filled_columns.add(column)
            # Last row: the gain over another filter in each column.
            if self.gain is not None:
                head = f"{self.gain.of} below {self.gain.over} (%)"
                cells = []
                for m in measures:
                    gain = m.beside("gain", self.gain.over).of(self.gain.of)
                    cells.append(Cell.of(evaluator.term(gain)))
                table.add([*point_keys, head], cells)
            table.notes += _lost_notes(results, point, labels)
            table.notes += _tail_notes(evaluator, labels, measures)
        # Notes on spreads over one run, empty columns, filters that loop over runs, filters that failed.
        statistics = {m.statistic or m.definition.over_runs for m in measures}
        if results.config["runs"] == 1 and statistics & {"std", "variance"}:
            table.notes.append("One run has no standard deviation or variance over the runs.")
        for column, head in enumerate(self.columns):
            metric = measures[column].definition
            quantity = measures[column].quantity
            if column in filled_columns:
                continue
            if metric.name in ("nees", "anees") and not quantity:
                table.notes.append(f"{head} {_WHY_NO_NEES}")
            elif needs_truth(measures[column]) and _keeps_runs_of_recording(results):
                table.notes.append(f"{head} {_WHY_NO_ERROR}")
        slow = [label for label in labels if label in results.loops_over_runs]
        if slow and any("cpu_s" in str(m) for m in measures):
            table.notes.append(f"Time of {', '.join(slow)}: one run after the other.")
            programs = [label for label in slow if label in results.programs]
            if programs:
                table.notes.append(time_of_programs(programs))
        for failure in results.failed:
            if failure["filter"] in labels:
                table.notes.append(f"{failure['filter']} failed: {failure['reason']}")
        return table


def _keeps_runs_of_recording(results: Results) -> bool:
    """Test whether the results are of recorded measurements, and some filter has not lost all runs.

    An error that such a filter lacks is missing because the recording has no truth for it.
    """
    targets = [results.facts(point).scenario.get("target") for point in results.points()]
    if not all(isinstance(target, dict) and target.get("kind") == "measured" for target in targets):
        return False
    for point in results.points():
        for (_, metric), values in results.runs(point).items():
            if metric == "lost" and (values == 0).any():
                return True
    return False


def best_labels(evaluator: Evaluator, labels: Sequence[str], m: Measure) -> list[str]:
    """Return those of the filters ``labels`` that are marked as best in the column of a measure.

    If each run has a value, they are the filters that the ranking marks. All filters of the experiment
    count in the correction for the number of tests. A CPU time or the number of a step has no value per
    run: the least number is marked. No label is returned for a measure of which neither the least nor
    the highest is best, for numbers that are zero in every run unless they are shares of runs, and for a
    step in fewer than five runs.
    """
    lower_is_better = m.is_cpu_time or m.definition.better == "lower"
    # A gain and a win rate are better the higher they are, whatever the metric.
    if not (lower_is_better or m.definition.is_score) or m.relation in ("gain", "win_rate"):
        return []
    # Case 1: runs have values, and the filters are ranked by them.
    candidates: dict[str, Candidate] = {}
    others = [label for label in evaluator.results.filters if label not in labels]
    for label in (*labels, *others):
        # `m.plain` is the measure without the filter that the column compares with.
        candidate = _candidate(evaluator, m.plain.of(label))
        if candidate is not None:
            candidates[label] = candidate
    rivals = [candidates[label] for label in labels if label in candidates]
    if len(rivals) > 1:
        # Equal numbers of all filters have no best one.
        if len({rival.overall.value for rival in rivals}) == 1:
            return []
        unranked = [candidates[label] for label in candidates if label not in labels]
        ranking = ranking_of(rivals, m.metric, unranked=unranked)
        # A share of runs that is zero is an answer; other numbers that are zero in every run are so by
        # construction.
        if ranking.best is not None and not m.is_share:
            values_of_runs = ranking.best.sample.values
            if not values_of_runs[np.isfinite(values_of_runs)].any():
                return []
        return [candidate.label for candidate in ranking.marked]
    # Case 2: fewer than two filters have values of their runs; the least number is the best.
    runs = max(map(len, evaluator.runs.values()), default=0)
    if runs < rules.FEWEST_RUNS and not m.is_cpu_time:
        return []
    values = {}
    for label in labels:
        value = _cell(evaluator, m.of(label)).estimate.value
        if isfinite(value):
            values[label] = value
    least = min(values.values(), default=0.0)
    if least == 0.0 and not m.is_share:
        return []
    best = [label for label, value in values.items() if value == least]
    # If all filters have the least number, none is better than another.
    if lower_is_better and len(best) < len(values):
        return best
    return []


def _candidate(evaluator: Evaluator, m: Measure) -> Candidate | None:
    """Return a measure's filter with the values of its runs, to be ranked.

    None if the runs have no values, or if filters are not ranked by the statistic.
    """
    column = evaluator.per_run(m)
    if column is None:
        return None
    statistic, values = column
    if statistic not in STATISTICS:
        return None
    return Candidate(
        label=m.filter,
        point=evaluator.point,
        lost=evaluator.runs.get((m.filter, "lost"), np.zeros(len(values))),
        sample=Sample(values, statistic, evaluator.estimate_of_steps(m)),
    )


def _cell(evaluator: Evaluator, m: Measure) -> Cell:
    """Return the cell of a filter's measure: its row of summary.csv, or without one its evaluation.

    The cell says so if only some of the runs that are not lost have a value.
    """
    # A share is evaluated, as its interval needs the number of runs with the event.
    stored = None if m.is_share else evaluator.stored.get((m.filter, str(m)))
    term = stored or evaluator.term(m)
    suffix = ""
    runs_not_lost = len(evaluator.runs.get((m.filter, "lost"), ())) - term.lost
    if m.is_over_runs and 0 < term.runs < runs_not_lost:
        suffix = f" ({term.runs} of {runs_not_lost} runs)"
    return Cell.of(term, evaluator.collapse_words(m))._replace(suffix=suffix)


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
                name = label
                if place:
                    name += f" at {place}"
                yield f"{name}: {counted(number, 'run')} lost because {reason}."


def _tail_notes(
    evaluator: Evaluator, labels: Sequence[str], columns: Collection[Expression]
) -> Iterator[str]:
    """Yield a warning for each error of which a few runs decide a filter's number.

    The warning has the medians of these filters, which the few runs do not change. ``columns`` are the
    measures in the columns of a table, ``labels`` the filters in its rows.
    """
    # Step 1: medians of the filters' errors that have a heavy tail, by error and filter.
    medians: dict[str, dict[str, str]] = {}
    for column in columns:
        if not column.is_error or column.relation:
            continue
        for label in labels:
            m = column.of(label)
            values_of_runs = evaluator.per_run(m)
            if values_of_runs is None:
                continue
            statistic, values = values_of_runs
            if statistic not in ("mean", "rms", "variance"):
                continue
            x = values[np.isfinite(values)]
            if has_heavy_tail(influence(statistic, x)):
                middle = STATISTICS["median"](x).value
                low, high = interval("median", x)
                name = m.metric
                if m.window:
                    name += f"[{m.window}]"
                text = f"{named(label)} {middle:.3g} ({low:.3g} to {high:.3g})"
                medians.setdefault(name, {})[label] = text
    # Step 2: a sentence for each error.
    place = evaluator.results.point_heading(evaluator.point)
    where = f" at {place}" if place else ""
    for name, text_by_label in medians.items():
        message = f"A few runs decide the {name}{where}, so its ± may be too small"
        yield f"{message}; medians: {listed(list(text_by_label.values()))}."
