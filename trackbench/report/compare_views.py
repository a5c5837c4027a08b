"""Show a comparison of two results folders: a table, sentences and a figure."""

from collections.abc import Sequence
from math import isfinite, nan
from pathlib import Path
from typing import TYPE_CHECKING

from trackbench.atomic_files import write_bytes
from trackbench.errors import Mark, Problem, UserError, counted
from trackbench.metrics import unit_of
from trackbench.report.compare_folders import ALPHA, BETTER, EQUAL, WORSE, Row
from trackbench.report.findings import phrases
from trackbench.report.plotting import style
from trackbench.report.table import rounded
from trackbench.report.text import Text, TextTable

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
    unit = unit_of(metric.partition("[")[0])
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
    apart = sum(row.p_holm < ALPHA for row in rows)
    text = f"Of {counted(len(rows), 'number')} {same} are equal, byte for byte, and {apart} of the "
    text += f"others differ significantly (Holm's p < {ALPHA:g})."
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
    colors = {WORSE: style.COLOURS[1], BETTER: style.COLOURS[2]}
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
