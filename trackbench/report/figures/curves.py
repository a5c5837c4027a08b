"""Figure kinds over time and over runs: `rmse-vs-time`, `rmse-per-run`, `estimates`."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from trackbench.evaluation.measure import Measure, OfRun, OfStep, measure
from trackbench.keys import Count
from trackbench.registry import register
from trackbench.report import style
from trackbench.report.kinds import FigureKind
from trackbench.report.results import Results

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_ROUNDING = 1e-12


@dataclass(frozen=True, kw_only=True)
class Curves(FigureKind):
    """Keys shared by the kinds that draw a line per filter in a panel per grid point."""

    label_keys: ClassVar[tuple[str, ...]] = ("floor", "baseline")

    filters: tuple[str, ...] | None = None
    """labels to draw; default: all"""
    x_label: str = "Step k"
    """label of the horizontal axis"""
    y_label: str = ""
    """label of the vertical axis, with its unit"""
    log: bool = False
    """logarithmic vertical axis"""
    floor: str | None = None
    """label of the filter that none can beat: drawn black and dashed"""
    baseline: str | None = None
    """label of the filter that every other should beat: drawn grey and dotted"""

    def labels(self, results: Results) -> Iterator[tuple[str, dict[str, Any]]]:
        """Each label to draw with its line style; the floor and the baseline last."""
        references = {self.baseline: style.BASELINE, self.floor: style.FLOOR}
        drawn = results.chosen(self.filters)
        for i, label in enumerate(b for b in drawn if b not in references):
            yield label, style.line(i)
        for name, look in references.items():
            if name in results.labels:
                yield str(name), look

    def panels(
        self, results: Results, rows: int = 1
    ) -> tuple["Figure", list[tuple[list["Axes"], dict[str, Any]]]]:
        """A column of panels per grid point, side by side; one row of them shares its vertical axis."""
        points = results.points()
        height = 3.2 if rows == 1 else 2.4 * rows
        figure, axes = style.subplots(
            rows, len(points), height, sharex=rows > 1, sharey=rows == 1, squeeze=False
        )
        for column, point in zip(axes.T, points, strict=True):
            column[0].set_title(style.heading(point))
            column[-1].set_xlabel(self.x_label)
            for ax in column if self.log else ():
                ax.set_yscale("log")
        if self.y_label:
            axes[0][0].set_ylabel(self.y_label)
        if self.title:
            figure.suptitle(self.title, fontsize=9)
        return figure, [(list(column), p) for column, p in zip(axes.T, points, strict=True)]

    def lines(
        self, results: Results, frame: "pd.DataFrame", point: dict[str, Any], metric: Measure
    ) -> Iterator[tuple["pd.DataFrame", dict[str, Any]]]:
        """Each label's rows of a metric at a grid point, and how its line looks, label included."""
        frame = results.at(frame, point)
        frame = frame[frame["metric"] == str(metric)]
        for label, look in self.labels(results):
            yield frame[frame["filter"] == label], {"label": label, **look}

    def finish(self, figure: "Figure") -> "Figure":
        """The figure with its legend and legible vertical axes."""
        for ax in figure.axes:
            if self.log:
                style.plain_log_axis(ax)
            else:
                ax.set_ylim(bottom=0)
        style.legend_outside(figure, figure.axes)
        return figure


@register("figures", "rmse-vs-time")
@dataclass(frozen=True, kw_only=True)
class RmseVsTime(Curves):
    """A metric of per_step.csv over time, with bands of two standard errors."""

    metric: OfStep = measure("rmse")
    """metric of per_step.csv"""

    def draw(self, results: Results) -> "Figure":
        """One line per filter."""
        figure, panels = self.panels(results)
        for (ax,), point in panels:
            for rows, look in self.lines(results, results.per_step, point, self.metric):
                k, value, stderr = (rows[c].to_numpy() for c in ("step", "value", "stderr"))
                if self.log and len(value):
                    # What is known exactly, as a first state may be, has only rounding for an error.
                    value = np.where(value > _ROUNDING * np.nanmax(value), value, np.nan)
                ax.plot(k, value, **look)
                low = value - 2 * stderr
                low = np.maximum(low, 0.1 * value) if self.log else low
                ax.fill_between(k, low, value + 2 * stderr, color=look["color"], alpha=0.15, lw=0)
        return self.finish(figure)


@register("figures", "rmse-per-run")
@dataclass(frozen=True, kw_only=True)
class RmsePerRun(Curves):
    """A metric of per_run.csv for each Monte Carlo run."""

    x_label: str = "Run m"
    """label of the horizontal axis"""
    metric: OfRun = measure("rmse")
    """metric of per_run.csv"""

    def draw(self, results: Results) -> "Figure":
        """One line per filter; a lost run leaves a gap."""
        figure, panels = self.panels(results)
        for (ax,), point in panels:
            runs = results.runs(point)
            for label, look in self.labels(results):
                values = runs.get((label, str(self.metric)), np.empty(0))
                number = np.arange(1, len(values) + 1)
                ax.plot(number, values, label=label, **look | {"linewidth": 0.8})
        return self.finish(figure)


@register("figures", "estimates")
@dataclass(frozen=True, kw_only=True)
class EstimatesOfOneRun(Curves):
    """Truth and every filter's estimate of one component in one run."""

    run: Count = 1
    """number of the run, from 1"""
    component: Count = 1
    """number of the state's component, from 1"""
    numbers: ClassVar[tuple[str, ...]] = ("run", "component")

    @property
    def shown_runs(self) -> int:
        """Runs whose tracks must be kept."""
        return self.run

    def draw(self, results: Results) -> "Figure":
        """One line per filter over the truth's points."""
        figure, panels = self.panels(results)
        for (ax,), point in panels:
            tracks = results.tracks(point)
            if not tracks:  # every filter failed here
                continue
            k, run, c = tracks["steps"], self.run - 1, self.component - 1
            truth = tracks["truth"][c, :, run]
            ax.plot(k, truth, label="Truth", marker="o", markersize=2.5, **style.TRUTH)
            for label, look in self.labels(results):
                if f"mean/{label}" in tracks:
                    ax.plot(k, tracks[f"mean/{label}"][c, :, run], label=label, **look)
        style.legend_outside(figure, figure.axes)
        return figure
