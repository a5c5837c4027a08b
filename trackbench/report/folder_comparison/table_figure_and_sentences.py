"""Changes between two results folders, which were compared: as a table, in sentences and as a figure."""

from collections import Counter
from collections.abc import Iterator, Sequence
from math import isfinite, nan
from pathlib import Path

from trackbench.atomic_files import write_bytes
from trackbench.errors import Mark, Problem, UserError, counted, form_for
from trackbench.evaluation.metric_expression import measured
from trackbench.metrics import unit_of
from trackbench.report.findings import grid_headings, metric_phrases, phrases
from trackbench.report.folder_comparison.tests_and_verdicts import INFINITE, Row, is_event
from trackbench.report.markdown_table import Text, TextTable
from trackbench.report.plotting import file_formats, filter_colors, style
from trackbench.report.plotting.panels import MOST_PANELS, panel_grid
from trackbench.report.plotting.style import Figure
from trackbench.report.rounded_numbers import rounded, unsigned_zeros
from trackbench.statistics import significance_rules as rules
from trackbench.statistics.significance_rules import BETTER, EQUAL, UNTESTED, WORSE

_LEAST_P = 1e-4
"""Least p-value that a table shows."""


def table_of_changes(rows: Sequence[Row], names: tuple[str, str], why_not_paired: str) -> TextTable:
    """Tabulate the primary numbers that changed or, if there are none, all that changed.

    Primary are errors, scores, shares of runs and the ANEES of whole runs. ``names`` are those of the
    first and second folder. ``why_not_paired`` is empty if equal runs are compared.
    """
    if why_not_paired:
        pairing = f"independent: {why_not_paired}"
    else:
        common_runs = max(row.difference.runs for row in rows)
        pairing = f"paired on {counted(common_runs, 'common run')}"
    title = f"{names[1]} against {names[0]}, {pairing}"
    changed = [row for row in rows if row.how != EQUAL]
    shown = [row for row in changed if row.is_primary] or changed
    # Rows of equal numbers let a note name the filters that did not change.
    table = table_of(title, [row for row in rows if row in shown or row.how == EQUAL], names)
    if len(changed) > len(shown):
        number = len(changed) - len(shown)
        table.notes.append(f"{number} more of windows, components and diagnostics: --json")
    return table


def table_of(
    title: str, rows: Sequence[Row], names: tuple[str, str], has_tests: bool = False
) -> TextTable:
    """Tabulate the numbers that differ; a note names the filters of which no number differs.

    A row whose ``how`` is EQUAL has equal numbers in both folders.
    ``names`` are the names of the first and second folder, as column headings. With ``has_tests`` there
    is a column with the p-value of each row's test.
    """
    heads = ["Filter", "Metric", *names, "Difference", "Change", "z"]
    if has_tests:
        heads.append("p")
    heads.append("Verdict")
    table = TextTable(title, heads)
    for row in rows:
        if row.how == EQUAL:
            continue
        z = row.change.z
        # The comparison ``change`` is of the second folder, its a, with the first, its b.
        numbers = [
            rounded(row.change.b.value, stderr=nan, digits=4),
            rounded(row.change.a.value, stderr=nan, digits=4),
            rounded(row.difference.value, row.difference.stderr, digits=2),
            _change(row),
            unsigned_zeros(f"{z:+.1f}") if isfinite(z) else "–",
        ]
        if has_tests:
            numbers.append(_p_value(row.change.p))
        cells = [Text(_filter_and_point(row)), Text(_with_unit(row.metric))]
        # Any number as the second field puts the text to the right.
        cells += [Text(number, number=0.0) for number in numbers]
        table.rows.append([*cells, Text(row.verdict)])
    changed = {_filter_and_point(row) for row in rows if row.how != EQUAL}
    unchanged = [
        name for name in dict.fromkeys(map(_filter_and_point, rows)) if name not in changed
    ]
    if unchanged:
        names_of_unchanged = ", ".join(map(phrases.named, unchanged))
        table.notes.append(f"{names_of_unchanged}: unchanged in all compared numbers.")
    table.notes += _notes_on_left_out_runs(rows)
    return table


def _notes_on_left_out_runs(rows: Sequence[Row]) -> Iterator[str]:
    """Yield a sentence for each filter that has values of some runs on one side only.

    These are mostly runs that it lost there. Both numbers of a row are then over fewer runs than each
    side's own number, and may differ from that.
    """
    left_out: dict[str, set[tuple[int, int]]] = {}
    for row in rows:
        if row.left_out:
            runs = (row.left_out, row.difference.runs)
            left_out.setdefault(_filter_and_point(row), set()).add(runs)
    for name, counts in left_out.items():
        # Of metrics that some runs do not measure the number of runs differs: the most runs are named.
        runs_on_one_side, runs_on_both = max(counts, key=lambda runs: runs[1])
        yield (
            f"{phrases.named(name)}: {counted(runs_on_one_side, 'run')} with a value on one side only "
            f"{form_for(runs_on_one_side, 'is', 'are')} left out. Its numbers on both sides are those "
            f"of the other {counted(runs_on_both, 'run')}."
        )


def _with_unit(metric: str) -> str:
    """Return the name of a row, such as ``rms(rmse_position)``, with the metric's unit if it has one."""
    # Such as "rmse infinite": the share of the runs in which the metric is infinite.
    if metric.endswith(INFINITE):
        return metric
    unit = unit_of(measured(metric).metric)  # of the metric without its statistic: rmse_position
    if unit == "1":  # a pure number
        return metric
    return metric_phrases.in_unit(metric, unit)


def _p_value(p: float) -> str:
    """Write a p-value with two digits, and one below 0.0001 as that limit; a dash without a test."""
    if not isfinite(p):
        return "–"
    if p < _LEAST_P:
        return f"<{_LEAST_P:.4f}"
    return phrases.rounded(p, 2)


def _filter_and_point(row: Row) -> str:
    """Write the filter of a row, and the point of the grid if there is a grid: ``EKF, R = 0.1``."""
    return grid_headings.join_heading(row.filter, grid_headings.heading(row.point))


def _change(row: Row) -> str:
    """Write the change in percent of the first folder's number.

    A share of runs has its change in percent of the runs. A score, and a number that is not positive,
    has the difference itself.
    """
    difference = row.difference.value  # the second folder's number less the first's
    before = row.change.b.value  # the first folder's number
    if not isfinite(difference):
        return "–"
    if is_event(row.metric):
        text = f"{phrases.percent(difference)} of runs"
        if difference < 0.0:
            return text
        return f"+{text}"
    if not before > 0.0 or "score" in row.metric:
        return unsigned_zeros(f"{difference:+.2g}")  # 0 for +0
    share = difference / before
    text = phrases.percent(share)
    if share < 0.0:
        return text
    return f"+{text}"


def changes(rows: Sequence[Row], verdict: str) -> list[str]:
    """Return ``rmse_position of UKF (+4.1 %)`` of the rows with a verdict, the surest first."""
    chosen = sorted((r for r in rows if r.verdict == verdict), key=lambda row: -abs(row.change.z))
    texts = []
    for row in chosen:
        name = phrases.named(_filter_and_point(row))
        texts.append(f"{row.metric} of {name} ({_change(row)})")
    return texts


def conclusion(rows: Sequence[Row], names: tuple[str, str]) -> str:
    """Write the comparison in sentences.

    ``names`` are the names of the first and second folder, ``a`` and ``b`` of `compare_folders`.
    """
    # ``how`` is EQUAL for numbers that are equal in both folders, and else the kind of test. ``verdict``
    # is the result of that test.
    equal = sum(row.how == EQUAL for row in rows)
    if equal == len(rows):
        return f"All {counted(equal, 'compared number')} are equal."
    significant = [row for row in rows if row.change.sign != 0]
    untested = sum(row.verdict == UNTESTED for row in rows)
    level = f"at {100 * rules.LEVEL:g} % over the numbers of a metric"
    parts = [
        f"{equal} are equal",
        f"{len(significant)} differ significantly ({level})",
    ]
    if untested:
        parts.append(f"{untested} are untested: too few runs")
    text = f"Of {counted(len(rows), 'compared number')} {phrases.listed(parts)}."
    # `table_of_changes` prints a row for primary metrics alone, if any of them changed.
    others = {row.metric for row in significant if not row.is_primary}
    if others:
        text += (
            f" Some of these are {phrases.listed(sorted(others))}, which have no row (see --json)."
        )
    primary = [row for row in rows if row.is_primary and row.how != EQUAL] or rows
    for verdict in (WORSE, BETTER):
        lines = changes(primary, verdict)
        if lines:
            text += f" {verdict.capitalize()} in {names[1]}: {phrases.listed(lines)}."
    return text


def draw(rows: Sequence[Row], names: tuple[str, str]) -> Figure:
    """Draw a panel for each primary metric that changed: the difference of each filter that changed.

    A difference is the second folder's number minus the first's. ``names`` are the names of the first
    and second folder. If nothing changed, all primary metrics are drawn.
    """
    primary = [row for row in rows if row.is_primary and isfinite(row.difference.value)]
    # ``how`` is EQUAL for a number that did not change.
    drawn = [row for row in primary if row.how != EQUAL] or primary
    metrics = list(dict.fromkeys(row.metric for row in drawn))[:MOST_PANELS]
    colors = {WORSE: filter_colors.COLORS[1], BETTER: filter_colors.COLORS[2]}
    counts = Counter(row.metric for row in drawn)
    most = max((counts[metric] for metric in metrics), default=1)
    with style.rc_context():
        # The height of a panel grows with its rows, inches.
        figure, axes = panel_grid(len(metrics), 0.9 + 0.22 * most, 0.5)
        for ax, metric in zip(axes, metrics, strict=False):  # blank axes may fill the last row
            panel_rows = [row for row in drawn if row.metric == metric]
            for i, row in enumerate(panel_rows):
                value, stderr = row.difference.estimate
                error = 2.0 * stderr if isfinite(stderr) else 0.0
                color = colors.get(row.verdict, "#777777")
                ax.errorbar(value, i, xerr=error, fmt="o", ms=4, color=color)
            ax.axvline(0.0, color="black", linewidth=0.8)
            labels = [style.wrap_label(_filter_and_point(row)) for row in panel_rows]
            ax.set_yticks(range(len(panel_rows)), labels)
            ax.set_ylim(len(panel_rows) - 0.5, -0.5)
            ax.set_title(_with_unit(metric), fontsize="medium")
            ax.locator_params(axis="x", nbins=4)
            ax.ticklabel_format(axis="x", scilimits=(-3, 4))
        words = f"{names[1]} minus {names[0]}, ± 2 standard errors (orange worse, green better)"
        figure.suptitle(style.wrapped(words), fontsize="medium")
        return file_formats.lay_out(figure)


def save(figure: Figure, path: Path) -> None:
    """Write a figure in the format that the path ends in; raises UserError for another ending."""
    form = path.suffix.removeprefix(".")
    if form not in ("png", "svg", "pdf"):
        message = "is no figure's name; it must end in .png, .svg or .pdf"
        raise UserError(Problem(Mark(f"--out {path}"), "", message))
    with style.rc_context():
        write_bytes(path, file_formats.content(figure, form))
