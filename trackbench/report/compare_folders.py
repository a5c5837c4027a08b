"""Comparison of two results folders, number by number: tests, table, sentence and figure.

Numbers are paired on common runs, else they are compared by independent errors.

Run ``i`` of two folders with one seed and one scenario has one truth and one set of measurements, so
the difference of a metric per run has less noise than either value. Without per_run.csv, or with
another seed or scenario, the numbers of both folders are independent, and their variances add up.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from math import copysign, hypot, inf, isfinite, isnan, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from trackbench.atomic_files import write_bytes
from trackbench.core.arrays import Array
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
from trackbench.results.point_facts import GridPoint
from trackbench.statistics import rules
from trackbench.statistics.comparison import difference_of
from trackbench.statistics.intervals import (
    Events,
    Sides,
    normal_of_t,
    share_z,
    studentized,
    studentized_difference,
)
from trackbench.statistics.over_runs import STATISTICS, Estimate, influence, mean

if TYPE_CHECKING:
    from matplotlib.figure import Figure


EQUAL, WORSE, BETTER, DIFFERS = "equal", "worse", "better", "differs"
ALIKE, UNTESTED, NEGLIGIBLE = "no significant difference", "untested", "negligible"
INFINITE = " infinite"
"""End of the name of a row: share of the runs in which the metric is infinite."""


class Stored(NamedTuple):
    """Statistic of a metric over runs, and its values per run (M,) if they are stored."""

    estimate: Estimate
    runs: int
    values: Array | None = None
    statistic: str = "mean"


class Row(NamedTuple):
    """A metric of a filter in both folders, ``difference = b - a``."""

    point: GridPoint
    filter: str
    metric: str
    a: float
    b: float
    runs: int
    how: str = EQUAL
    """equal (byte for byte), paired or independent"""
    difference: float = 0.0
    stderr: float = 0.0
    z: float = nan
    """of no difference"""
    z_worse: float = nan
    """of ``b`` no worse than ``a``: positive if it is worse; NaN if neither direction is better"""
    p_holm: float = nan
    verdict: str = EQUAL

    @property
    def is_event(self) -> bool:
        """Return whether the metric is a share of runs."""
        return self.metric.endswith(INFINITE) or measured(self.metric).family[0].is_event

    @property
    def is_primary(self) -> bool:
        """Return whether the metric is an error, a score, a share of runs or the ANEES of whole runs."""
        of = measured(self.metric)
        if of.window:
            return False
        return self.is_event or self.metric == "anees" or bool(primary_metrics([of.metric]))


def compare_folders(a: Results, b: Results) -> tuple[list[Row], str]:
    """Return a row for every filter and metric of both, and why the runs are not paired, if so."""
    points = [point for point in a.points() if point in b.points()]
    statistics = partial(compared_statistic, a.config)
    why, rows = _why_unpaired(a, b, points), list[Row]()
    stored = all((results.folder / "per_run.csv").is_file() for results in (a, b))
    exact = set(a.deterministic) & set(b.deterministic)
    for point in points:
        sizes = [len(x) for r in (a, b) if not why for x in r.runs(point).values()]
        runs = min(sizes, default=None)
        first, second = (_samples(results, point, stored, runs, statistics) for results in (a, b))
        for (label, metric), sample in first.items():
            if other := second.get((label, metric)):
                rows += rows_of((point, label, metric), sample, other, not why, label in exact)
    return _judged(rows), why


def _judged(rows: Sequence[Row]) -> list[Row]:
    """Return the rows with verdicts by the rule for filters; the rows of a metric are a family."""
    z = np.array([row.z if row.runs >= rules.FEWEST_RUNS else nan for row in rows])
    p = np.full(len(rows), nan)
    for metric in dict.fromkeys(row.metric for row in rows):
        of = np.array([row.metric == metric for row in rows])
        p[of] = rules.adjusted(z[of].tolist())
    return [
        row._replace(p_holm=value, verdict=_verdict(row, value))
        for row, value in zip(rows, p.tolist(), strict=True)
    ]


def _verdict(row: Row, p: float) -> str:
    if row.how == EQUAL or isnan(p) or p >= rules.LEVEL:
        return EQUAL if row.how == EQUAL else UNTESTED if isnan(p) else ALIKE
    if not abs(row.z_worse) > 2.0:  # neither direction is better, or both are as far from one
        return DIFFERS
    return WORSE if row.z_worse > 0.0 else BETTER


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
    """Return whether two scenarios agree in all common keys; paths must be those of equal files."""
    if isinstance(a, dict) and isinstance(b, dict):
        return all(_agree(a[k], b[k], home_a, home_b) for k in a.keys() & b.keys())
    if isinstance(a, list) and isinstance(b, list):
        pairs = zip(a, b, strict=False)
        return len(a) == len(b) and all(_agree(x, y, home_a, home_b) for x, y in pairs)
    if isinstance(a, str) and isinstance(b, str) and a != b:
        files = home_a / a, home_b / b
        return all(f.is_file() for f in files) and files[0].read_bytes() == files[1].read_bytes()
    return bool(a == b)


def _samples(
    results: Results,
    point: GridPoint,
    stored: bool,
    most: int | None,
    statistics: Callable[[str], str],
) -> dict[tuple[str, str], Stored]:
    """Return the metrics of each filter over the first runs, ``anees`` in place of ``nees``.

    ``statistics`` returns the one by which a metric is compared.
    """
    samples, sizes = {}, results.facts(point).sizes
    for (label, metric), x in results.runs(point).items() if stored else ():
        values = ((x != 0.0) * 1.0 if metric == "lost" else x)[:most]
        columns = {row: values / n for row, n in per_component(measured(metric), sizes)}
        for name, column in (columns or {metric: values}).items():
            finite, statistic = column[np.isfinite(column)], statistics(name)
            estimate = STATISTICS[statistic](finite)
            samples[label, name] = Stored(estimate, len(finite), column, statistic)
    for row in results.columns("summary", point).records() if not stored else ():
        of, label, runs = measured(row["metric"]), row["filter"], row["runs"]
        if label in results.filters and (of.is_row or of.statistic == statistics(of.metric)):
            estimate = Estimate(row["value"], row["stderr"])
            samples[label, of.name] = Stored(estimate, runs, None, of.statistic or "mean")
            every = runs + row["lost"]
            samples[label, "lost"] = Stored(Estimate(row["lost"] / every, nan), every)
    return samples


@np.errstate(all="ignore")
def rows_of(
    key: tuple[GridPoint, str, str], a: Stored, b: Stored, paired: bool, is_exact: bool
) -> Iterator[Row]:
    """Yield the metric's row, before it one of the share of infinite values if these differ."""
    point, label, metric = key
    name = metric if a.statistic == "mean" else f"{a.statistic}({metric})"
    row = Row(point, label, name, a.estimate.value, b.estimate.value, min(a.runs, b.runs))
    if a.values is None or b.values is None:
        equal = a.runs == b.runs and np.array_equal(a.estimate, b.estimate, equal_nan=True)
    else:
        equal = np.array_equal(a.values, b.values, equal_nan=True)
        x, y = (np.isinf(values) * 1.0 for values in (a.values, b.values))
        if (x.any() or y.any()) and not np.array_equal(x, y) and not row.is_event:
            shares = Stored(mean(x), len(x), x), Stored(mean(y), len(y), y)
            yield from rows_of((*key[:2], key[2] + INFINITE), *shares, paired, is_exact)
    if equal:
        yield row
    elif paired and a.values is not None and b.values is not None:
        both = np.isfinite(a.values) & np.isfinite(b.values)
        if both.any():
            yield _paired(row, a.values[both], b.values[both], is_exact, a.statistic)
    else:
        yield _independent(row, a, b)


def _paired(row: Row, x: Array, y: Array, is_exact: bool, statistic: str) -> Row:
    """Return the row with its tests from values of common runs (M,)."""
    of_x, of_y = (influence(statistic, values) for values in (x, y))
    difference = difference_of(statistic, y, x)

    def z_of(value: float, of_a: float, of_b: float) -> float:
        if is_exact:  # a difference of numbers without randomness is real
            return copysign(inf, value) if value else 0.0
        if row.is_event:  # the sign test
            up, down = int((y > x).sum()), int((y < x).sum())
            return share_z(up, up + down, 0.5) if up + down else 0.0
        return studentized(value, of_b * of_y - of_a * of_x)

    over = STATISTICS[statistic]
    row = row._replace(a=over(x).value, b=over(y).value, runs=len(x), how="paired")
    return _with_tests(row, difference.stderr, z_of)


def _independent(row: Row, a: Stored, b: Stored) -> Row:
    """Return the row with its tests from two independent estimates."""
    errors = a.estimate.stderr, b.estimate.stderr

    def z_of(value: float, of_a: float, of_b: float) -> float:
        if row.is_event:
            first, second = (Events(round(s.estimate.value * s.runs), s.runs) for s in (a, b))
            return studentized_difference(value, Sides(second, first))
        error = hypot(of_a * errors[0], of_b * errors[1])
        return normal_of_t(float(np.divide(value, error)), max(row.runs - 1, 1))

    return _with_tests(row._replace(how="independent"), hypot(*errors), z_of)


def _with_tests(row: Row, stderr: float, z_of: Callable[[float, float, float], float]) -> Row:
    """Return the row with z; ``z_of`` takes a change and its derivatives by both means."""
    a, b, better = row.a, row.b, measured(row.metric).family[0].better
    z = z_of(b - a, 1.0, 1.0)
    if better == "one" and a > 0.0 and b > 0.0:  # further from one: |log b| - |log a|
        u, v = float(log(a)), float(log(b))
        z_worse = z_of(abs(v) - abs(u), copysign(1.0 / a, u), copysign(1.0 / b, v))
    elif better == "zero":
        z_worse = z_of(abs(b) - abs(a), copysign(1.0, a), copysign(1.0, b))
    else:
        direction = {"lower": 1.0, "higher": -1.0}.get(better, nan)
        z_worse = z if row.is_event else direction * z
    return row._replace(difference=b - a, stderr=stderr, z=z, z_worse=z_worse)


def table_of(title: str, rows: Sequence[Row], names: tuple[str, str]) -> TextTable:
    """Return the numbers that are not equal, and a note with the filters whose numbers all are."""
    heads = ["Filter", "Metric", *names, "Difference", "Change", "z", "Verdict"]
    table = TextTable(title, heads)
    for row in rows:
        if row.how != EQUAL:
            cells = [rounded(row.a, nan, 4), rounded(row.b, nan, 4)]
            cells += [rounded(row.difference, row.stderr, 2), _change(row)]
            cells += [f"{row.z:+.1f}" if isfinite(row.z) else "–"]
            words = _series(row), _with_unit(row.metric)
            texts = [*map(Text, words), *(Text(cell, 0.0) for cell in cells), Text(row.verdict)]
            table.rows.append(texts)
    changed = {_series(row) for row in rows if row.how != EQUAL}
    same = [name for name in dict.fromkeys(map(_series, rows)) if name not in changed]
    if same:
        names_of_same = ", ".join(map(phrases.named, same))
        table.notes.append(f"{names_of_same}: unchanged, byte for byte.")
    return table


def _with_unit(metric: str) -> str:
    unit = "" if metric.endswith(INFINITE) else unit_of(measured(metric).metric)
    return f"{metric} ({unit})" if unit not in ("", "1") else metric


def _series(row: Row) -> str:
    """Return the filter, and its point of the grid."""
    return ", ".join(filter(None, [row.filter, phrases.heading(row.point)]))


def _change(row: Row) -> str:
    """Return the change in percent; that of a share in percent of the runs, of a score nothing."""
    if not isfinite(row.difference):
        return "–"
    if not row.is_event and (not row.a > 0.0 or "score" in row.metric):
        return f"{row.difference:+.2g}"
    share = row.difference / (1.0 if row.is_event else row.a)
    text = phrases.percent(share) + " of runs" * row.is_event
    return text if share < 0.0 else f"+{text}"


def changes(rows: Sequence[Row], verdict: str) -> list[str]:
    """Return ``rmse_position of UKF (+4.1 %)`` of the rows with a verdict, the surest first."""
    chosen = sorted((r for r in rows if r.verdict == verdict), key=lambda row: -abs(row.z))
    return [f"{r.metric} of {phrases.named(_series(r))} ({_change(r)})" for r in chosen]


def conclusion(rows: Sequence[Row], names: tuple[str, str]) -> str:
    """Return the comparison in sentences."""
    same = sum(row.how == EQUAL for row in rows)
    if same == len(rows):
        return f"All {counted(same, 'number')} are equal, byte for byte."
    apart = sum(row.p_holm < rules.LEVEL for row in rows)
    text = f"Of {counted(len(rows), 'number')} {same} are equal, byte for byte, and {apart} of the "
    text += (
        f"others differ significantly (at {100 * rules.LEVEL:g} % over the numbers of a metric)."
    )
    primary = [row for row in rows if row.is_primary and row.how != EQUAL] or rows
    for verdict in (WORSE, BETTER):
        if lines := changes(primary, verdict):
            text += f" {verdict.capitalize()} in {names[1]}: {phrases.listed(lines)}."
    return text


def draw(rows: Sequence[Row], names: tuple[str, str]) -> "Figure":
    """Return a panel for each primary metric that changed: differences of the filters that did."""
    primary = [row for row in rows if row.is_primary and isfinite(row.difference)]
    shown = [row for row in primary if row.how != EQUAL] or primary
    metrics = list(dict.fromkeys(row.metric for row in shown))[: style.MOST_PANELS]
    colors = {WORSE: style.COLORS[1], BETTER: style.COLORS[2]}
    most = max((sum(row.metric == metric for row in shown) for metric in metrics), default=1)
    with style.rc_context():
        figure, axes = style.panel_grid(len(metrics), 0.9 + 0.22 * most, 0.5)
        for ax, metric in zip(axes, metrics, strict=False):
            of = [row for row in shown if row.metric == metric]
            for i, row in enumerate(of):
                color, error = colors.get(row.verdict, "#777777"), 2.0 * row.stderr
                error = error if isfinite(error) else 0.0
                ax.errorbar(row.difference, i, xerr=error, fmt="o", ms=4, color=color)
            ax.axvline(0.0, color="black", linewidth=0.8)
            ax.set_yticks(range(len(of)), [style.wrap_label(_series(row)) for row in of])
            ax.set_ylim(len(of) - 0.5, -0.5)
            ax.set_title(_with_unit(metric), fontsize="medium")
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
