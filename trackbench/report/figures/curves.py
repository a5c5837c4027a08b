"""Figure kinds over time and over runs: `rmse-vs-time`, `rmse-per-run`, `estimates`."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from trackbench.keys import Count
from trackbench.registry import register
from trackbench.report import style
from trackbench.report.results import Results

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True, kw_only=True)
class Curves:
    """Keys shared by the kinds that draw a line per filter in a panel per grid point."""

    title: str = ""
    """heading"""
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
        drawn = [b for b in results.labels if self.filters is None or b in self.filters]
        for i, label in enumerate(b for b in drawn if b not in references):
            yield label, style.line(i)
        for name, look in references.items():
            if name in results.labels:
                yield str(name), look

    def panels(self, results: Results) -> tuple["Figure", list[tuple["Axes", dict[str, Any]]]]:
        """A panel per grid point, side by side."""
        points = results.points()
        figure, axes = style.subplots(1, len(points), sharey=True, squeeze=False)
        for ax, point in zip(axes[0], points, strict=True):
            ax.set_xlabel(self.x_label)
            ax.set_title(", ".join(f"{k.split('.')[-1]} = {v:g}" for k, v in point.items()))
            if self.log:
                ax.set_yscale("log")
        axes[0][0].set_ylabel(self.y_label)
        if self.title:
            figure.suptitle(self.title, fontsize=9)
        return figure, list(zip(axes[0], points, strict=True))


@register("figures", "rmse-vs-time")
@dataclass(frozen=True, kw_only=True)
class RmseVsTime(Curves):
    """A metric of per_step.csv over time, with bands of two standard errors."""

    metric: str = "rmse"
    """metric of per_step.csv"""

    def draw(self, results: Results) -> "Figure":
        """One line per filter."""
        figure, panels = self.panels(results)
        for ax, point in panels:
            frame = results.at(results.per_step, point)
            frame = frame[frame["metric"] == self.metric]
            for label, look in self.labels(results):
                rows = frame[frame["filter"] == label]
                k, value, stderr = (rows[c].to_numpy() for c in ("step", "value", "stderr"))
                if self.log:
                    value = np.where(value > 0, value, np.nan)
                ax.plot(k, value, label=label, **look)
                low = value - 2 * stderr
                low = np.maximum(low, 0.1 * value) if self.log else low
                ax.fill_between(k, low, value + 2 * stderr, color=look["color"], alpha=0.15, lw=0)
            if not self.log:
                ax.set_ylim(bottom=0)
        style.legend_outside(figure, [ax for ax, _ in panels])
        return figure


@register("figures", "rmse-per-run")
@dataclass(frozen=True, kw_only=True)
class RmsePerRun(Curves):
    """A metric of per_run.csv for each Monte Carlo run."""

    x_label: str = "Run m"
    """label of the horizontal axis"""
    metric: str = "rmse"
    """metric of per_run.csv"""

    def draw(self, results: Results) -> "Figure":
        """One line per filter; a lost run leaves a gap."""
        figure, panels = self.panels(results)
        for ax, point in panels:
            frame = results.at(results.per_run, point)
            frame = frame[frame["metric"] == self.metric]
            for label, look in self.labels(results):
                rows = frame[frame["filter"] == label]
                ax.plot(rows["run"] + 1, rows["value"], label=label, **look | {"linewidth": 0.8})
            if not self.log:
                ax.set_ylim(bottom=0)
        style.legend_outside(figure, [ax for ax, _ in panels])
        return figure


@register("figures", "estimates")
@dataclass(frozen=True, kw_only=True)
class Estimates(Curves):
    """Truth and every filter's estimate of one component in one run."""

    run: Count = 1
    """number of the run, from 1"""
    component: Count = 1
    """number of the state's component, from 1"""

    @property
    def shown_runs(self) -> int:
        """Runs whose tracks must be kept."""
        return self.run

    def draw(self, results: Results) -> "Figure":
        """One line per filter over the truth's points."""
        figure, panels = self.panels(results)
        for i, (ax, point) in enumerate(panels):
            prefix = f"point{i}/" if point else ""
            tracks = results.shown
            k, run, c = tracks[f"{prefix}steps"], self.run - 1, self.component - 1
            truth = tracks[f"{prefix}truth"][c, :, run]
            ax.plot(k, truth, label="Truth", marker="o", markersize=2.5, **style.TRUTH)
            for label, look in self.labels(results):
                if f"{prefix}mean/{label}" in tracks:
                    ax.plot(k, tracks[f"{prefix}mean/{label}"][c, :, run], label=label, **look)
        style.legend_outside(figure, [ax for ax, _ in panels])
        return figure
