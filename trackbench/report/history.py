"""A metric of each filter over results folders, in the order of their dates."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from trackbench.config.mistakes import unknown
from trackbench.errors import Mark, Problem, UserError
from trackbench.report.compare_folders import with_unit
from trackbench.report.findings import phrases
from trackbench.report.plotting import style
from trackbench.report.results import Results
from trackbench.report.table import Cell, Table
from trackbench.statistics.over_runs import Estimate

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def history(every: Sequence[Results], metric: str = "") -> list[Table]:
    """Return a table for each experiment; raises UserError if no folder has the metric.

    Folders are ordered by date if all have one (a clone has none), else as they are named. Of several
    experiments those with several folders are shown.
    """
    # Order the folders by date.
    dates = [results.manifest.get("date", "") for results in every]
    if all(dates):
        every = [every[i] for i in np.argsort(dates, kind="stable").tolist()]
    # A table per experiment, a row per folder, filter and grid point.
    tables: dict[str, Table] = {}
    is_clear = len({results.folder.name for results in every}) == len(every)
    for results in every:
        name, summary = results.config["name"], results.columns("summary")
        names = list(dict.fromkeys(summary["metric"].tolist()))
        if name not in tables:
            default = next((n for n in names if n.startswith("rms(rmse")), names[0])
            heads = ["Filter", "Folder", "Date", "Commit"]
            tables[name] = Table(name, heads, [metric or default], digits=4)
        table, facts = tables[name], results.manifest
        for row in summary.where(metric=table.value_headers[0]).records():
            point = phrases.heading({path: row[path] for path in results.grid})
            label = ", ".join(filter(None, [row["filter"], point]))
            name = results.folder.name if is_clear else str(results.folder)
            place = name, facts.get("date", "–"), (facts.get("commit") or "–")[:7]
            cell = Cell(Estimate(row["value"], row["stderr"]), row["runs"], row["lost"])
            table.add([label, *place], [cell])
    if not any(table.keys for table in tables.values()):
        what = f"no folder has it; {unknown(metric, [*names])}"
        raise UserError(Problem(Mark(f"--metric {metric}"), "", what))
    # Put the rows of one filter together.
    for table in tables.values():
        labels = list(dict.fromkeys(keys[0] for keys in table.keys))
        order = sorted(range(len(table.keys)), key=lambda i: labels.index(table.keys[i][0]))
        table.keys, table.cells = [table.keys[i] for i in order], [table.cells[i] for i in order]
    series = []
    for table in tables.values():
        folders = {keys[1] for keys in table.keys}
        if len(folders) > 1:
            series.append(table)
    if len(tables) > 1 and not series:
        raise UserError("no experiment has several of these folders")
    return series or [*tables.values()]


def draw(tables: Sequence[Table]) -> "Figure":
    """Return a panel for each experiment: values with two standard errors over the folders."""
    with style.rc_context():
        figure, axes = style.panel_grid(len(tables[: style.MOST_PANELS]), 2.6, 0.6)
        for ax, table in zip(axes, tables, strict=False):
            folders = list(dict.fromkeys(folder for _, folder, _, _ in table.keys))
            for i, label in enumerate(dict.fromkeys(keys[0] for keys in table.keys)):
                rows = [j for j, keys in enumerate(table.keys) if keys[0] == label]
                places = [folders.index(table.keys[j][1]) for j in rows]
                value, stderr = np.array([table.cells[j][0].estimate for j in rows]).T
                error, look = 2.0 * np.nan_to_num(stderr), style.line(i)
                ax.errorbar(places, value, yerr=error, marker="o", ms=3, label=label, **look)
            ax.set_xticks(range(len(folders)), folders, rotation=30, ha="right")
            ax.set_title(table.title if len(tables) > 1 else "", fontsize="medium")
            ax.set_ylabel(with_unit(*table.value_headers))
        style.legend_outside(figure)
        return style.lay_out(figure)
