"""Table kind `metrics`: filters down, metrics across, each number with its standard error."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from typing import ClassVar

import numpy as np

from trackbench.config.experiment import Labeled
from trackbench.errors import counted
from trackbench.evaluation.error_series import LOST_BECAUSE
from trackbench.evaluation.metric_expression import Expression, Measure
from trackbench.field_types import Digits
from trackbench.registry import register
from trackbench.report.expressions import Evaluator
from trackbench.report.findings.phrases import listed, named
from trackbench.report.findings.ranking import Candidate, ranking_of
from trackbench.report.kinds import TableKind
from trackbench.report.results import Results
from trackbench.report.table import Cell, Table
from trackbench.results.point_facts import GridPoint
from trackbench.statistics import rules
from trackbench.statistics.comparison import Sample
from trackbench.statistics.intervals import has_heavy_tail
from trackbench.statistics.over_runs import STATISTICS, influence, interval


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
        return replace(self, columns=columns) if columns else None

    def table(self, results: Results) -> Table:
        """Fill a row for each filter, a column for each metric expression."""
        labels = results.chosen(self.filters, exact=True)
        table = Table(self.title, [*results.grid_heads, "Filter"], list(self.columns), self.digits)
        no_rivals = {*map(results.config.get, ("bound", "reference")), *results.exact}
        rivals = [label for label in labels if label not in no_rivals]
        for point in results.points():
            expressions = Evaluator(results, point)
            keys = [str(v) for v in point.values()]
            for i, m in enumerate(self.columns.values()):
                best = best_labels(expressions, rivals, m)
                table.best |= {(len(table.keys) + labels.index(label), i) for label in best}
            for label in labels:
                wanted = [m.of(label) for m in self.columns.values()]
                table.add([*keys, label], [_cell(expressions, m) for m in wanted])
            if self.gain is not None:
                head = f"{self.gain.of} below {self.gain.over} (%)"
                # Last row: the gain over another filter in each column.
                beside = [m.beside("gain", self.gain.over) for m in self.columns.values()]
                gains = [expressions.term(m.of(self.gain.of)) for m in beside]
                table.add([*keys, head], [Cell.of(term) for term in gains])
            table.notes += _lost_notes(results, point, labels)
            table.notes += _tail_notes(expressions, labels, self.columns.values())
        # Notes on spreads over one run, filters that loop over runs, and filters that failed.
        kinds = {m.statistic or m.family[0].over_runs for m in self.columns.values()}
        if results.config["runs"] == 1 and kinds & {"std", "variance"}:
            table.notes.append("One run has no standard deviation or variance over the runs.")
        slow = [label for label in labels if label in results.loops_over_runs]
        if slow and any("cpu_s" in str(m) for m in self.columns.values()):
            table.notes.append(f"Time of {', '.join(slow)}: one run after the other.")
        failed = [row for row in results.failed if row["filter"] in labels]
        table.notes += [f"{row['filter']} failed: {row['reason']}" for row in failed]
        return table


def best_labels(expressions: Evaluator, labels: Sequence[str], m: Measure) -> list[str]:
    """Return the filters that are marked as best, by the ranking at this point.

    The other filters of the experiment belong to its family of tests. Of a time or a step, of which
    runs have no values, only the least value is the best; of a step none in fewer than five runs. A
    number that is zero in every run has no error to be compared, and the column no mark.
    """
    smaller = m.is_cpu_time or m.family[0].better == "lower"
    if not (smaller or m.family[0].is_score) or m.relation in ("gain", "win_rate"):
        return []
    every = [*labels, *(b for b in expressions.results.filters if b not in labels)]
    candidates = {b: c for b in every for c in _candidate(expressions, m.plain.of(b))}
    rivals = [candidates[label] for label in labels if label in candidates]
    if len(rivals) > 1:
        if len({c.overall.value for c in rivals}) == 1:
            return []
        others = [c for label, c in candidates.items() if label not in labels]
        ranking = ranking_of(rivals, m.metric, unranked=others)
        if ranking.best is not None and not m.is_share and _is_zero_in_every_run(ranking.best):
            return []
        return [c.label for c in ranking.marked]
    runs = max(map(len, expressions.runs.values()), default=0)
    if runs < rules.FEWEST_RUNS and not m.is_cpu_time:
        return []
    values = {label: _cell(expressions, m.of(label)).estimate.value for label in labels}
    values = {label: value for label, value in values.items() if isfinite(value)}
    least = min(values.values(), default=0.0)
    if least == 0.0 and not m.is_share:
        return []
    best = [label for label, value in values.items() if value == least]
    return best if smaller and len(best) < len(values) else []


def _is_zero_in_every_run(candidate: Candidate) -> bool:
    """Test whether a number is zero by construction: no run has another value."""
    values = candidate.sample.values
    return not values[np.isfinite(values)].any()


def _candidate(expressions: Evaluator, m: Measure) -> Iterator[Candidate]:
    """Yield a filter with the values of its runs, if the measure has them."""
    if (column := expressions.per_run(m)) is None:
        return
    statistic, values = column
    if statistic not in STATISTICS:  # no ranking is by it
        return
    point, lost = expressions.point, expressions.runs.get((m.filter, "lost"), np.zeros(len(values)))
    yield Candidate(m.filter, point, lost, Sample(values, statistic, expressions.of_steps(m)))


def _cell(expressions: Evaluator, m: Measure) -> Cell:
    """Read a row of summary.csv, or evaluate it, such as a ratio to another filter."""
    stored = None if m.is_share else expressions.stored.get((m.filter, str(m)))
    term = stored or expressions.term(m)
    possible = len(expressions.runs.get((m.filter, "lost"), ())) - term.lost
    counts = m.is_over_runs and 0 < term.runs < possible
    suffix = f" ({term.runs} of {possible} runs)" if counts else ""
    return Cell.of(term, expressions.collapse(m))._replace(suffix=suffix)


def _lost_notes(results: Results, point: GridPoint, labels: list[str]) -> Iterator[str]:
    """Yield why runs were lost, in words."""
    runs = results.runs(point)
    for label in labels:
        codes = runs.get((label, "lost"), np.empty(0))
        for code, reason in LOST_BECAUSE.items():
            number = int((codes == code).sum())
            if number:
                where = ", ".join(f"{k} = {v}" for k, v in point.items())
                at = f" at {where}" if where else ""
                yield f"{label}{at}: {counted(number, 'run')} lost because {reason}."


def _tail_notes(
    expressions: Evaluator, labels: Sequence[str], columns: Collection[Expression]
) -> Iterator[str]:
    """Yield for each error the filters of which a few runs decide a number, with their medians."""
    medians: dict[tuple[str, str], str] = {}
    errors: list[Measure] = []
    for m in columns:
        errors += [m.of(label) for label in labels] if m.is_error and not m.relation else []
    for m in errors:
        name = f"{m.metric}[{m.window}]" if m.window else m.metric
        column = expressions.per_run(m)
        if column is not None and column[0] in ("mean", "rms", "variance"):
            x = column[1][np.isfinite(column[1])]
            if has_heavy_tail(influence(column[0], x)):
                middle, (low, high) = STATISTICS["median"](x).value, interval("median", x)
                text = f"{named(m.filter)} {middle:.3g} ({low:.3g} to {high:.3g})"
                medians[name, m.filter] = text
    where = "".join(f" at {k} = {v}" for k, v in expressions.point.items())
    for name in dict.fromkeys(name for name, _ in medians):
        texts = [text for (of, _), text in medians.items() if of == name]
        what = f"A few runs decide the {name}{where}, so its ± may be too small"
        yield f"{what}; medians: {listed(texts)}."
