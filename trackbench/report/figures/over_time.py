"""Figure kinds over time: `rmse-vs-time`, `estimates`; what they share with others of curves."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.metric_expression import Measure, OfStep, measure
from trackbench.field_types import Count
from trackbench.registry import register
from trackbench.report.findings import phrases
from trackbench.report.findings.phrases import ranking
from trackbench.report.kinds import FigureKind
from trackbench.report.plotting import style
from trackbench.report.plotting.artist_types import Axes, Figure
from trackbench.report.results import Results
from trackbench.results.point_facts import GridPoint
from trackbench.results.read_csv import Columns

_ROUNDING = 1e-12


@dataclass(frozen=True, kw_only=True)
class Curves(FigureKind):
    """Keys shared by the kinds that draw a line per filter in a panel per grid point."""

    label_keys: ClassVar[tuple[str, ...]] = ("floor", "baseline")

    filters: tuple[str, ...] | None = None
    """labels to draw; default: all"""
    x_label: str = ""
    """label of the horizontal axis; default: what it is"""
    y_label: str = ""
    """label of the vertical axis, with its unit"""
    log: bool = False
    """logarithmic vertical axis"""
    floor: str | None = None
    """label of the filter that none can beat: drawn black and dashed"""
    baseline: str | None = None
    """label of the filter that every other should beat: drawn grey and dotted"""

    def labels(self, results: Results, exact: bool = False) -> Iterator[tuple[str, GridPoint]]:
        """Yield each label to draw with its line style; the floor and the baseline last."""
        references = {self.baseline: style.BASELINE, self.floor: style.FLOOR}
        drawn = results.chosen(self.filters, exact)
        for label in (b for b in drawn if b not in references):
            yield label, results.line_style(label)
        for name, look in references.items():
            if name in results.labels:
                yield str(name), look

    @property
    def x_name(self) -> str:
        """Label of the horizontal axis."""
        return self.x_label

    def panels(
        self, results: Results, rows: int = 1, **layout: Any
    ) -> tuple[Figure, list[tuple[list[Axes], dict[str, Any]]]]:
        """Return a column of panels per grid point; those of one row share their vertical axis."""
        points = results.points()[: style.MOST_PANELS]
        height = 3.2 if rows == 1 else 2.4 * rows
        if len(points) > 4:
            height *= 0.75
        figure, axes = style.panels(
            len(points), rows, height, sharex=rows > 1, sharey=rows == 1, **layout
        )
        for column, head in zip(axes, style.headings(points), strict=True):
            column[0].set_title(head)
            column[-1].set_xlabel(self.x_name)
            for ax in column if self.log else ():
                ax.set_yscale("log")
        if self.y_label:
            axes[0][0].set_ylabel(self.y_label)
        style.title(figure, self.title, len(results.points()))
        return figure, [(list(column), p) for column, p in zip(axes, points, strict=True)]

    def lines(
        self, results: Results, point: GridPoint, metric: Measure
    ) -> Iterator[tuple[Columns, dict[str, Any]]]:
        """Yield each label's series of a metric at a grid point, and its line style."""
        rows = results.columns("per_step", point).where(metric=str(metric))
        for label, look in self.labels(results, exact=True):
            yield rows.where(filter=label), {"label": label, **look}

    def finish(self, figure: Figure) -> Figure:
        """Return the figure with its legend and legible vertical axes."""
        for ax in figure.axes:
            if self.log:
                style.plain_log_axis(ax.yaxis)
            else:
                ax.set_ylim(bottom=0)
        style.legend_outside(figure)
        return figure


@dataclass(frozen=True, kw_only=True)
class OverTime(Curves):
    """Keys shared by those whose horizontal axis are the steps."""

    x: Literal["step", "time"] = "step"
    """what the horizontal axis counts: steps, or seconds"""

    @property
    def x_name(self) -> str:
        """Label of the horizontal axis."""
        return self.x_label or {"step": "Step k", "time": "Time (s)"}[self.x]


@register("figures", "rmse-vs-time")
@dataclass(frozen=True, kw_only=True)
class RmseVsTime(OverTime):
    """A metric of per_step.csv over steps or time, with two standard errors on either side."""

    metric: OfStep = measure("rmse")
    """metric of per_step.csv"""

    def default_caption(self, results: Results) -> str:
        """Return which filter's average over the steps is best."""
        point = results.points()[0]
        found = self.lines(results, point, self.metric)
        rivals = {look["label"]: rows["value"] for rows, look in found}
        averages = {
            b: float(np.nanmean(values))
            for b, values in rivals.items()
            if np.isfinite(values).any() and b not in (self.floor, self.baseline, *results.exact)
        }
        where = f" at {phrases.heading(point)}" if point else ""
        better = self.metric.family[0].better
        return ranking(averages, better, f"Averaged over the steps{where}")

    def draw(self, results: Results) -> Figure:
        """Return one line per filter."""
        figure, panels = self.panels(results)
        for (ax,), point in panels:
            lines = list(self.lines(results, point, self.metric))
            for i, (rows, look) in enumerate(lines):
                k, value, stderr = (rows[c] for c in (self.x, "value", "stderr"))
                if self.log and len(value):
                    # What is known exactly, as a first state may be, has only rounding for an error.
                    value = np.where(value > _ROUNDING * np.nanmax(value), value, np.nan)
                ax.plot(k, value, **look)
                style.error_band(ax, k, value, stderr, look, i, len(lines), self.log)
        return self.finish(figure)


@register("figures", "estimates")
@dataclass(frozen=True, kw_only=True)
class EstimatesOfOneRun(OverTime):
    """Truth and every filter's estimate of one component in one run; below, the estimates' errors."""

    run: Count = 1
    """number of the run, from 1"""
    component: Count = 1
    """number of the state's component, from 1"""
    numbers: ClassVar[tuple[str, ...]] = ("run", "component")

    @property
    def shown_runs(self) -> int:
        """Return the runs whose tracks must be kept."""
        return self.run

    def draw(self, results: Results) -> Figure:
        """Return one line per filter over the truth's points; errors only where there is a truth."""
        tracks = [results.tracks(p) for p in results.points()[: style.MOST_PANELS]]
        c, run = self.component - 1, self.run - 1
        known = any(np.isfinite(t["truth"][c, :, run]).any() for t in tracks if t)
        layout = {"height_ratios": [3, 2] * -(-len(tracks) // 4)} if known else {}
        figure, panels = self.panels(results, 2 if known else 1, **layout)
        for (axes, _), arrays in zip(panels, tracks, strict=True):
            if arrays:  # not every filter failed here
                self._panel(axes, results, arrays, c, run)
        if known:
            panels[0][0][1].set_ylabel("Estimate - truth")
            figure.align_ylabels()
        style.legend_outside(figure)
        return figure

    def _panel(
        self, axes: list[Axes], results: Results, tracks: dict[str, Array], c: int, run: int
    ) -> None:
        k, truth = tracks[f"{self.x}s"], tracks["truth"][c, :, run]
        if np.isfinite(truth).any():
            axes[0].plot(k, truth, label="Truth", marker="o", markersize=2.5, **style.TRUTH)
        for below in axes[1:]:
            below.set_yscale("linear")
            below.axhline(0.0, **style.TRUTH | {"linewidth": 0.8})
        for label, look in self.labels(results):
            if f"mean/{label}" in tracks:
                mean = tracks[f"mean/{label}"][c, :, run]
                axes[0].plot(k, mean, label=label, **look)
                for below in axes[1:]:
                    below.plot(k, mean - truth, label=label, **look)
