"""Comparison of two results folders, number by number: tests, table, sentence and figure.

Numbers are paired on common runs, else they are compared by independent errors.

Run ``i`` of two folders with one seed and one scenario has one truth and one set of measurements, so
the difference of a metric per run has less noise than either value. Without per_run.csv, or with
another seed or scenario, the numbers of both folders are independent, and their variances add up.
"""

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from functools import partial
from math import copysign, inf, isfinite, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from trackbench.atomic_files import write_bytes
from trackbench.core.elementary import log
from trackbench.errors import Mark, Problem, UserError, counted
from trackbench.evaluation.metric_expression import measured
from trackbench.evaluation.summary import per_component
from trackbench.metrics import unit_of
from trackbench.report.findings import phrases
from trackbench.report.paired import compared_statistic, primary_metrics
from trackbench.report.plotting import style
from trackbench.report.results import Results
from trackbench.report.table import Text, TextTable, rounded
from trackbench.results.folder_contents import DIGITS
from trackbench.results.point_facts import GridPoint
from trackbench.statistics import rules
from trackbench.statistics.comparison import (
    Comparison,
    Sample,
    as_family,
    compare,
    compare_estimates,
    compare_independent,
)
from trackbench.statistics.estimates import RunEstimate, Share
from trackbench.statistics.intervals import sign_test
from trackbench.statistics.rules import ALIKE, BETTER, EQUAL, UNTESTED, WORSE

if TYPE_CHECKING:
    from matplotlib.figure import Figure


DIFFERS = "differs"
INFINITE = " infinite"
"""End of the name of a row: share of the runs in which the metric is infinite."""


class Row(NamedTuple):
    """A metric of a filter in both folders, and how the second folder compares with the first."""

    point: GridPoint
    filter: str
    metric: str
    how: str
    """equal (byte for byte), paired, independent or cost"""
    change: Comparison
    """of the second folder with the first"""
    worse: Comparison
    """of how far both are from the best value; without z if neither direction is better"""
    verdict: str = EQUAL

    @property
    def difference(self) -> RunEstimate:
        """Second folder's number less that of the first."""
        return self.change.difference

    @property
    def is_primary(self) -> bool:
        """True if the metric is an error, a score, a share of runs or the ANEES of whole runs."""
        of = measured(self.metric)
        if of.window:
            return False
        whole = is_event(self.metric) or self.metric == "anees"
        return whole or bool(primary_metrics([of.metric]))

    @property
    def fields(self) -> dict[str, Any]:
        """Row for programs, ``difference = b - a``."""
        number = self.difference
        named = {"point": self.point, "filter": self.filter, "metric": self.metric}
        values = {"a": self.change.b.value, "b": self.change.a.value, "runs": number.runs}
        apart = {"how": self.how, "difference": number.value, "stderr": number.stderr}
        tests = {"z": self.change.z, "z_worse": self.worse.z, "p_holm": self.change.p}
        return {**named, **values, **apart, **tests, "verdict": self.verdict}


def is_event(metric: str) -> bool:
    """Test whether a metric is a share of runs."""
    return metric.endswith(INFINITE) or measured(metric).family[0].is_event


def compare_folders(a: Results, b: Results) -> tuple[list[Row], str]:
    """Compare every filter and metric of both; also explain why the runs are not paired."""
    points = [point for point in a.points() if point in b.points()]
    statistics = partial(compared_statistic, a.config)
    why, rows = _why_unpaired(a, b, points), list[Row]()
    stored = all((results.folder / "per_run.csv").is_file() for results in (a, b))
    exact = set(a.deterministic) & set(b.deterministic)
    # A folder of an older version has fewer digits of filters without random numbers.
    rounded_labels = {x for x in exact if stored and a.digits_of(x) != b.digits_of(x)}
    for point in points:
        columns = [*a.runs(point).values(), *b.runs(point).values()] if not why else []
        runs = min(map(len, columns), default=None)
        first, second = (
            _numbers(results, point, stored, runs, statistics, rounded_labels) for results in (a, b)
        )
        for (label, metric), sample in first.items():
            if other := second.get((label, metric)):
                rows += rows_of((point, label, metric), sample, other, not why, label in exact)
    return judged(rows), why


def judged(rows: Sequence[Row]) -> list[Row]:
    """Judge the rows by the rule for filters; the rows of a metric are a family."""
    by_index = dict(enumerate(rows))
    for metric in dict.fromkeys(row.metric for row in rows):
        of = {i: row for i, row in by_index.items() if row.metric == metric}
        changes = as_family({i: row.change for i, row in of.items()})
        worse = as_family({i: row.worse for i, row in of.items()})
        for i, row in of.items():
            by_index[i] = row._replace(change=changes[i], worse=worse[i])
    return [row._replace(verdict=_verdict(row)) for row in by_index.values()]


def _verdict(row: Row) -> str:
    if row.how == EQUAL:
        return EQUAL
    if not row.change.sign:
        return ALIKE if row.change.is_tested else UNTESTED
    # Neither direction may be better, or both be as far from the best value.
    return (DIFFERS, WORSE, BETTER)[row.worse.sign]


def _why_unpaired(a: Results, b: Results, points: Iterable[GridPoint]) -> str:
    for results in (a, b):
        if not (results.folder / "per_run.csv").is_file():
            return f"{results.folder} has no per_run.csv: the errors of summary.csv are used"
    if a.manifest["seed"] != b.manifest["seed"]:
        return f"the seeds differ ({a.manifest['seed']} and {b.manifest['seed']})"
    for point in points:
        x, y = ({**r.facts(point).scenario, "#": r.steps(point), "assume": 0} for r in (a, b))
        if not _agree(x, y, a.folder, b.folder):
            return "the scenarios differ"
    return ""


def _agree(a: Any, b: Any, home_a: Path, home_b: Path) -> bool:
    """Test whether two scenarios agree in all common keys; paths must be those of equal files."""
    if isinstance(a, dict) and isinstance(b, dict):
        return all(_agree(a[k], b[k], home_a, home_b) for k in a.keys() & b.keys())
    if isinstance(a, list) and isinstance(b, list):
        pairs = zip(a, b, strict=False)
        return len(a) == len(b) and all(_agree(x, y, home_a, home_b) for x, y in pairs)
    if isinstance(a, str) and isinstance(b, str) and a != b:
        files = home_a / a, home_b / b
        return all(f.is_file() for f in files) and files[0].read_bytes() == files[1].read_bytes()
    return bool(a == b)


def _numbers(
    results: Results,
    point: GridPoint,
    stored: bool,
    most: int | None,
    statistics: Callable[[str], str],
    rounded_labels: Collection[str],
) -> dict[tuple[str, str], Sample | RunEstimate]:
    """Return the metrics of each filter, ``anees`` in place of ``nees``, by filter and name.

    Values of the first runs if they are ``stored``, else the rows of summary.csv. ``statistics`` returns
    the statistic by which a metric is compared.
    """
    numbers, sizes = dict[tuple[str, str], Sample | RunEstimate](), results.facts(point).sizes
    for (label, metric), x in results.runs(point).items() if stored else ():
        if label in rounded_labels:
            x = np.array([float(f"{value:.{DIGITS['per_run.csv']}g}") for value in x])
        values = ((x != 0.0) * 1.0 if metric == "lost" else x)[:most]
        columns = {row: values / n for row, n in per_component(measured(metric), sizes)}
        for name, column in (columns or {metric: values}).items():
            numbers[label, name] = Sample(column, statistics(name))
    for row in results.columns("summary", point).records() if not stored else ():
        of, label, runs = measured(row["metric"]), row["filter"], row["runs"]
        if label in results.filters and (of.is_row or of.statistic == statistics(of.metric)):
            name = of.name if of.statistic in ("", "mean") else str(of)
            numbers[label, name] = RunEstimate(row["value"], row["stderr"], None, runs)
            every = runs + row["lost"]
            numbers[label, "lost"] = RunEstimate(row["lost"] / every, nan, None, every)
    return numbers


@np.errstate(all="ignore")
def rows_of(
    key: tuple[GridPoint, str, str],
    a: Sample | RunEstimate,
    b: Sample | RunEstimate,
    paired: bool,
    is_exact: bool,
) -> Iterator[Row]:
    """Yield the metric's row, before it one of the share of infinite values if these differ."""
    point, label, metric = key
    first, second = (of.overall if isinstance(of, Sample) else of for of in (a, b))
    equal = np.array_equal((*first.estimate, first.runs), (*second.estimate, second.runs), True)
    if isinstance(a, Sample) and isinstance(b, Sample):
        equal = np.array_equal(a.values, b.values, equal_nan=True)
        x, y = (np.isinf(of.values) * 1.0 for of in (a, b))
        if (x.any() or y.any()) and not np.array_equal(x, y) and not is_event(metric):
            shares = Sample(x), Sample(y)
            yield from rows_of((point, label, metric + INFINITE), *shares, paired, is_exact)
        metric = metric if a.statistic == "mean" else f"{a.statistic}({metric})"
    if equal:
        none = RunEstimate(0.0, 0.0, None, min(first.runs, second.runs))
        unchanged = Comparison(second, first, none, nan)
        yield Row(point, label, metric, EQUAL, unchanged, unchanged)
    elif paired and isinstance(a, Sample) and isinstance(b, Sample):
        on_common_runs = compare(b, a)
        if on_common_runs is None:
            return
        change = on_common_runs
        worse = _worse(metric, change, compare_estimates)
        if is_exact:  # a difference of numbers without randomness is real
            offs = (c.difference.value for c in (change, worse))
            zs = [off * inf if off else 0.0 for off in offs]
            change, worse = change._replace(z=zs[0]), worse._replace(z=zs[1])
        elif is_event(metric):
            change = worse = change._replace(z=sign_test(b.values, a.values))
        yield Row(point, label, metric, "paired", change, worse)
    else:
        if is_event(metric):
            first, second = Share(*first), Share(*second)
        change = compare_independent(second, first)
        worse = _worse(metric, change, compare_independent)
        yield Row(point, label, metric, "independent", change, worse)


def _worse(metric: str, change: Comparison, compared: Callable[..., Comparison]) -> Comparison:
    """Compare how far both numbers of a change are from the best value."""
    better = measured(metric).family[0].better
    if better == "lower" or is_event(metric) or change.is_equal:
        return change
    if better == "higher":
        return change.swapped
    if better == "zero":
        return compared(*(x.scaled(abs(x.value), copysign(1.0, x.value)) for x in change[:2]))
    if better == "one" and change.a.value > 0.0 < change.b.value:
        logs = (float(log(x.value)) for x in change[:2])
        pairs = zip(change[:2], logs, strict=True)
        return compared(*(x.scaled(abs(u), copysign(1.0, u), x.value) for x, u in pairs))
    return change._replace(z=nan)


def table_of(title: str, rows: Sequence[Row], names: tuple[str, str]) -> TextTable:
    """Tabulate the numbers that are not equal; a note names the filters whose numbers all are."""
    heads = ["Filter", "Metric", *names, "Difference", "Change", "z", "Verdict"]
    table = TextTable(title, heads)
    for row in rows:
        if row.how != EQUAL:
            numbers, z = (row.change.b, row.change.a), row.change.z
            cells = [rounded(number.value, nan, 4) for number in numbers]
            cells += [rounded(*row.difference.estimate, 2), _change(row)]
            cells += [f"{z:+.1f}" if isfinite(z) else "–"]
            words = _series(row), with_unit(row.metric)
            texts = [*map(Text, words), *(Text(cell, 0.0) for cell in cells), Text(row.verdict)]
            table.rows.append(texts)
    changed = {_series(row) for row in rows if row.how != EQUAL}
    same = [name for name in dict.fromkeys(map(_series, rows)) if name not in changed]
    if same:
        names_of_same = ", ".join(map(phrases.named, same))
        table.notes.append(f"{names_of_same}: unchanged, byte for byte.")
    return table


def with_unit(metric: str) -> str:
    """Add the unit of a metric that has one, which a share of runs has not."""
    unit = "" if metric.endswith(INFINITE) else unit_of(measured(metric).metric)
    return phrases.in_unit(metric, unit if unit != "1" else "")


def _series(row: Row) -> str:
    """Name the filter, and its point of the grid."""
    return ", ".join(filter(None, [row.filter, phrases.heading(row.point)]))


def _change(row: Row) -> str:
    """Write the change in percent; that of a share in percent of the runs, of a score plainly."""
    difference, before = row.difference.value, row.change.b.value
    if not isfinite(difference):
        return "–"
    if not is_event(row.metric) and (not before > 0.0 or "score" in row.metric):
        return f"{difference:+.2g}"
    share = difference / (1.0 if is_event(row.metric) else before)
    text = phrases.percent(share) + " of runs" * is_event(row.metric)
    return text if share < 0.0 else f"+{text}"


def changes(rows: Sequence[Row], verdict: str) -> list[str]:
    """Return ``rmse_position of UKF (+4.1 %)`` of the rows with a verdict, the surest first."""
    chosen = sorted((r for r in rows if r.verdict == verdict), key=lambda row: -abs(row.change.z))
    return [f"{r.metric} of {phrases.named(_series(r))} ({_change(r)})" for r in chosen]


def conclusion(rows: Sequence[Row], names: tuple[str, str]) -> str:
    """Write the comparison in sentences."""
    same = sum(row.how == EQUAL for row in rows)
    if same == len(rows):
        return f"All {counted(same, 'number')} are equal, byte for byte."
    apart = [row for row in rows if row.change.sign != 0]
    untested = sum(row.verdict == UNTESTED for row in rows)
    level = f"at {100 * rules.LEVEL:g} % over the numbers of a metric"
    parts = [f"{same} are equal, byte for byte", f"{len(apart)} differ significantly ({level})"]
    if untested:
        parts.append(f"{untested} are untested: too few runs")
    text = f"Of {counted(len(rows), 'number')} {phrases.listed(parts)}."
    if others := {row.metric for row in apart if not row.is_primary}:
        text += (
            f" Some of these are {phrases.listed(sorted(others))}, which have no row (see --json)."
        )
    primary = [row for row in rows if row.is_primary and row.how != EQUAL] or rows
    for verdict in (WORSE, BETTER):
        if lines := changes(primary, verdict):
            text += f" {verdict.capitalize()} in {names[1]}: {phrases.listed(lines)}."
    return text


def draw(rows: Sequence[Row], names: tuple[str, str]) -> "Figure":
    """Return a panel for each primary metric that changed: differences of the filters that did."""
    primary = [row for row in rows if row.is_primary and isfinite(row.difference.value)]
    shown = [row for row in primary if row.how != EQUAL] or primary
    metrics = list(dict.fromkeys(row.metric for row in shown))[: style.MOST_PANELS]
    colors = {WORSE: style.COLORS[1], BETTER: style.COLORS[2]}
    counts = Counter(row.metric for row in shown)
    most = max((counts[metric] for metric in metrics), default=1)
    with style.rc_context():
        figure, axes = style.panel_grid(len(metrics), 0.9 + 0.22 * most, 0.5)
        for ax, metric in zip(axes, metrics, strict=False):
            of = [row for row in shown if row.metric == metric]
            for i, row in enumerate(of):
                value, stderr = row.difference.estimate
                error = 2.0 * stderr if isfinite(stderr) else 0.0
                color = colors.get(row.verdict, "#777777")
                ax.errorbar(value, i, xerr=error, fmt="o", ms=4, color=color)
            ax.axvline(0.0, color="black", linewidth=0.8)
            ax.set_yticks(range(len(of)), [style.wrap_label(_series(row)) for row in of])
            ax.set_ylim(len(of) - 0.5, -0.5)
            ax.set_title(with_unit(metric), fontsize="medium")
            ax.locator_params(axis="x", nbins=4)
            ax.ticklabel_format(axis="x", scilimits=(-3, 4))
        words = f"{names[1]} minus {names[0]}, ± 2 standard errors (orange worse, green better)"
        figure.suptitle(style.wrapped(words), fontsize="medium")
        return style.lay_out(figure)


def save(figure: "Figure", path: Path) -> None:
    """Write a figure in the format that the path ends in; raises UserError for another ending."""
    form = path.suffix.removeprefix(".")
    if form not in ("png", "svg", "pdf"):
        what = "is no figure's name; it must end in .png, .svg or .pdf"
        raise UserError(Problem(Mark(f"--out {path}"), "", what))
    with style.rc_context():
        write_bytes(path, style.content(figure, form))
