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


def history(folders: Sequence[Results], metric: str = "") -> list[Table]:
    """Return a table of a metric for each experiment.

    Folders are ordered by date if all have one (a clone has none), else as they are named. Of several
    experiments those with several folders are shown.

    Parameters
    ----------
    folders : results folders, of one or several experiments
    metric : row of summary.csv; default: the first rms error, else the first row of the experiment

    Returns
    -------
    Tables with a row per filter, folder and point of the grid.

    Raises
    ------
    UserError : no folder has the metric, or none of several experiments has several folders
    """
    # Step 1: order the folders by date.
    dates = [results.manifest.get("date", "") for results in folders]
    if all(dates):
        folders = [folders[i] for i in np.argsort(dates, kind="stable").tolist()]
    # Step 2: a table per experiment, a row per folder, filter and grid point.
    tables: dict[str, Table] = {}
    names_are_unique = len({results.folder.name for results in folders}) == len(folders)
    for results in folders:
        experiment = results.config["name"]
        summary = results.columns("summary")
        metrics = list(dict.fromkeys(summary["metric"].tolist()))
        if experiment not in tables:
            default = next((name for name in metrics if name.startswith("rms(rmse")), metrics[0])
            heads = ["Filter", "Folder", "Date", "Commit"]
            tables[experiment] = Table(experiment, heads, [metric or default], digits=4)
        table = tables[experiment]
        folder = results.folder.name if names_are_unique else str(results.folder)
        date = results.manifest.get("date", "–")
        commit = (results.manifest.get("commit") or "–")[:7]
        for row in summary.where(metric=table.value_headers[0]).records():
            point = phrases.heading({path: row[path] for path in results.grid})
            label = ", ".join(filter(None, [row["filter"], point]))
            cell = Cell(Estimate(row["value"], row["stderr"]), row["runs"], row["lost"])
            table.add([label, folder, date, commit], [cell])
    if not any(table.keys for table in tables.values()):
        what = f"no folder has it; {unknown(metric, [*metrics])}"
        raise UserError(Problem(Mark(f"--metric {metric}"), "", what))
    # Step 3: put the rows of one filter together.
    for table in tables.values():
        labels = list(dict.fromkeys(keys[0] for keys in table.keys))
        order = sorted(range(len(table.keys)), key=lambda i: labels.index(table.keys[i][0]))
        table.keys = [table.keys[i] for i in order]
        table.cells = [table.cells[i] for i in order]
    # Step 4: of several experiments take those with several folders.
    several = []
    for table in tables.values():
        if len({folder for _, folder, _, _ in table.keys}) > 1:
            several.append(table)
    if len(tables) > 1 and not several:
        raise UserError("no experiment has several of these folders")
    return several or [*tables.values()]


def draw(tables: Sequence[Table]) -> "Figure":
    """Return a panel for each experiment: values with two standard errors over the folders."""
    with style.rc_context():
        figure, axes = style.panel_grid(len(tables[: style.MOST_PANELS]), 2.6, 0.6)
        for ax, table in zip(axes, tables, strict=False):
            labels = list(dict.fromkeys(label for label, _, _, _ in table.keys))
            folders = list(dict.fromkeys(folder for _, folder, _, _ in table.keys))
            for i, label in enumerate(labels):
                rows = [j for j, keys in enumerate(table.keys) if keys[0] == label]
                places = [folders.index(table.keys[j][1]) for j in rows]
                values, stderrs = np.array([table.cells[j][0].estimate for j in rows]).T
                ax.errorbar(
                    places,
                    values,
                    yerr=2.0 * np.nan_to_num(stderrs),
                    marker="o",
                    ms=3,
                    label=label,
                    **style.line(i),
                )
            ax.set_xticks(range(len(folders)), folders, rotation=30, ha="right")
            ax.set_title(table.title if len(tables) > 1 else "", fontsize="medium")
            ax.set_ylabel(with_unit(table.value_headers[0]))
        style.legend_outside(figure)
        return style.lay_out(figure)
