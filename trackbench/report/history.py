"""A metric of each filter over results folders, in the order of their dates."""

from collections.abc import Iterator, Sequence
from math import nan
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from trackbench.errors import Mark, Problem, UserError
from trackbench.evaluation.metric_expression import measured
from trackbench.evaluation.statistics import Estimate
from trackbench.metrics import unit_of
from trackbench.report.findings import phrases
from trackbench.report.plotting import style
from trackbench.report.results import Results
from trackbench.report.table import Cell, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MISSING = Estimate(nan, nan)


class History(NamedTuple):
    """A metric of an experiment: folders in order, and each filter's values there."""

    experiment: str
    metric: str
    folders: list[tuple[str, str, str]]
    """name, date and commit of each"""
    values: dict[str, list[Estimate]]

    def table(self) -> Table:
        """Return a row for each folder, a column for each filter."""
        title = f"{self.experiment}: {self.metric}"
        if len(self.values) > max(len(self.folders), 6):  # beside each other there is no room
            table = Table(title, ["Filter"], [folder for folder, _, _ in self.folders], 4)
            for label, values in self.values.items():
                table.add([label], [Cell(value, 0, 0) for value in values])
            return table
        table = Table(title, ["Folder", "Date", "Commit"], list(self.values), 4)
        for i, folder in enumerate(self.folders):
            table.add([*folder], [Cell(values[i], 0, 0) for values in self.values.values()])
        return table

    def lines(self) -> Iterator[dict[str, str | float]]:
        """Yield a value of a filter in a folder as plain data."""
        for label, series in self.values.items():
            for (folder, date, commit), estimate in zip(self.folders, series, strict=True):
                place = {"folder": folder, "date": date, "commit": commit}
                named = {"experiment": self.experiment, "filter": label, "metric": self.metric}
                yield {**named, **place, **estimate._asdict()}


def history(every: Sequence[Results], metric: str = "") -> list[History]:
    """Return the history of each experiment; raises UserError if no folder has the metric.

    Folders are ordered by date if all have one (a clone has none), else as they are named.
    """
    dates = [results.manifest.get("date", "") for results in every]
    if all(dates):
        every = [every[i] for i in np.argsort(dates, kind="stable").tolist()]
    by_name: dict[str, list[Results]] = {}
    for results in every:
        by_name.setdefault(results.config["name"], []).append(results)
    histories = [_history(name, group, metric) for name, group in by_name.items()]
    if metric and not any(h.values for h in histories):
        known = ", ".join(dict.fromkeys(every[0].columns("summary")["metric"].tolist()))
        raise UserError(
            Problem(Mark(f"--metric {metric}"), "", f"no folder has it; known: {known}")
        )
    return [h for h in histories if h.values]


def _history(name: str, group: Sequence[Results], metric: str) -> History:
    names = group[-1].columns("summary")["metric"].tolist()
    metric = metric or next((n for n in names if n.startswith("rms(rmse")), names[0])
    values: dict[str, list[Estimate]] = {}
    for i, results in enumerate(group):
        for row in results.columns("summary").where(metric=metric).records():
            point = {path: row[path] for path in results.grid}
            label = ", ".join(filter(None, [row["filter"], phrases.heading(point)]))
            series = values.setdefault(label, [_MISSING] * len(group))
            series[i] = Estimate(row["value"], row["stderr"])
    facts = [(r.folder.name, r.manifest.get("date"), r.manifest.get("commit")) for r in group]
    places = [(folder, day or "–", (commit or "–")[:7]) for folder, day, commit in facts]
    return History(name, metric, places, values)


def draw(histories: Sequence[History]) -> "Figure":
    """Return a panel for each experiment: values with two standard errors over the folders."""
    shown = histories[: style.MOST_PANELS]
    with style.rc_context():
        figure, axes = style.panel_grid(len(shown), 2.6, 0.6)
        for ax, h in zip(axes, shown, strict=False):
            places = range(len(h.folders))
            for i, (label, series) in enumerate(h.values.items()):
                value, stderr = (np.array(column) for column in zip(*series, strict=True))
                look = style.line(i)
                error = 2.0 * np.nan_to_num(stderr)
                ax.errorbar(places, value, yerr=error, marker="o", ms=3, label=label, **look)
            ax.set_xticks(places, [name for name, _, _ in h.folders], rotation=30, ha="right")
            ax.set_title(h.experiment if len(shown) > 1 else "", fontsize="medium")
            ax.set_ylabel(
                f"{h.metric} ({unit})" if (unit := unit_of(measured(h.metric).metric)) else h.metric
            )
        style.legend_outside(figure)
        return style.lay_out(figure)
