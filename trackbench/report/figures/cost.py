"""Figure kind `accuracy-vs-cost`: errors against CPU time, and which of them nothing beats."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from typing import ClassVar

import numpy as np

from trackbench.config.experiment import Point
from trackbench.core.arrays import Array
from trackbench.evaluation.metric_expression import Expression, measure
from trackbench.registry import register
from trackbench.report.costs import (
    COST,
    MICRO,
    Curve,
    Spot,
    cost_conflicts,
    curves,
    front,
    own_sizes,
    shown,
)
from trackbench.report.expressions import Evaluator
from trackbench.report.findings import phrases
from trackbench.report.findings.phrases import joined
from trackbench.report.kinds import FigureKind
from trackbench.report.plotting import filter_lines, scales, style
from trackbench.report.plotting.style import Axes, Figure, LineStyle
from trackbench.report.results import Results, points_of, scenes
from trackbench.results.point_facts import GridPoint

_MARKERS = "osD^vP*X"
_FRONT: LineStyle = {"color": "#bbbbbb", "linewidth": 4.0, "alpha": 0.6, "zorder": 0.5}


@register("figures", "accuracy-vs-cost")
@dataclass(frozen=True, kw_only=True)
class AccuracyVsCost(FigureKind):
    """Error against CPU time per step: a point per filter and number of particles, and the front.

    Bars are two standard errors, of the error and of the time. The front joins the points that no other
    betters at the same time or less. A panel for each scenario that the grid has.
    """

    label_keys: ClassVar[tuple[str, ...]] = ("floor",)
    requires: ClassVar[dict[str, str]] = {"cpu_s_per_run": "summary"}

    metric: Expression = measure("mean(rmse)")
    """what is compared: an RMSE, a distance or an efficiency"""
    along: str = "N"
    """the filters' key that buys accuracy with time; its values stand beside the points"""
    filters: tuple[str, ...] | None = None
    """labels to draw; default: all but the reference"""
    floor: str | None = None
    """label of the filter or bound that none can beat: a line; default: the reference"""
    y_label: str = ""
    """label of the vertical axis, with its unit; default: the metric"""
    log: bool = True
    """logarithmic vertical axis"""

    def conflicts(self, points: Sequence[Point]) -> dict[str, str]:
        """Require a grid over which a filter varies."""
        labels = [b for b in points[0].filters if self.filters is None or b in self.filters]
        most = max(labels, key=lambda b: len(own_sizes(points, b, self.along)), default="")
        return cost_conflicts(points, self.metric, self.along, {"along": most})

    def default_caption(self, results: Results) -> str:
        """Return the filters on the front."""
        scene = scenes(results)[0]
        every = self._curves(results, scene)
        best = [id(spot) for spot in self._front(every)]
        names = []
        for curve in every:
            sizes = [phrases.number(spot.size) for spot in curve.spots if id(spot) in best]
            size = f" with {self.along} = {joined(sizes)}" if sizes and not curve.is_fixed else ""
            names += [f"{curve.name}{size}"] if sizes else []
        where = f" at {phrases.heading(scene)}" if scene else ""
        return f"On the front{where}: {'; '.join(names)}." if names else ""

    def draw(self, results: Results) -> Figure:
        """Return one panel per scene."""
        every = scenes(results)
        drawn = every[: style.MOST_PANELS]
        figure, axes = style.make_panels(len(drawn), 1, 4.2, sharey=True)
        heads = style.wrap_headings([phrases.heading(scene) for scene in drawn])
        for (ax,), scene, head in zip(axes, drawn, heads, strict=True):
            self._panel(ax, results, scene)
            ax.set_title(head)
            ax.set_xlabel(COST)
        axes[0][0].set_ylabel(self.y_label or str(self.metric))
        return style.add_title_and_legend(figure, self.title, len(every))

    def _panel(self, ax: Axes, results: Results, scene: GridPoint) -> None:
        drawn = self._curves(results, scene)
        marks: dict[str, int] = {}
        for curve in drawn:
            mark = marks[curve.label] = marks.get(curve.label, -1) + 1
            look = results.line_style(curve.label) | {"marker": _MARKERS[mark % len(_MARKERS)]}
            self._curve(ax, curve, look)
        spots = _spots(drawn)
        x, y = _values(self._front(drawn))
        dearest = [MICRO * max(spot.cost.value for spot in spots)] if spots else []
        ax.step([*x[0], *dearest], [*y[0], *y[0, -1:]], where="post", label="Front", **_FRONT)
        # Of a bound, which has no runs, summary.csv has the value.
        floor, expressions = self._floor(results), Evaluator(results, points_of(results, scene)[0])
        stored = expressions.stored.get((floor, str(self.metric)))
        least = (stored or expressions.term(self.metric.of(floor))).value
        if np.isfinite(least):
            ax.axhline(least, label=floor, **style.FLOOR)
        scales.plain_log_axis(ax.xaxis)
        if self.log:
            scales.plain_log_axis(ax.yaxis)

    def _floor(self, results: Results) -> str:
        return self.floor or str(results.config.get("reference"))

    def _curves(self, results: Results, scene: GridPoint) -> list[Curve]:
        labels = [b for b in shown(results, self.filters) if b != self._floor(results)]
        return curves(results, scene, labels, self.metric, self.along)

    def _front(self, every: Sequence[Curve]) -> list[Spot]:
        return list(front(_spots(every), self.metric.family[0].more_is_better))

    def _curve(self, ax: Axes, curve: Curve, look: LineStyle) -> None:
        x, y = _values(curve.spots)
        ax.plot(x[0], y[0], markersize=3.5, label=curve.name, **look)
        bars = {"elinewidth": 0.8, "capsize": 1.5, "xerr": 2.0 * x[1]}
        filter_lines.draw_error_bars(ax, x[0], y[0], y[1], curve.name, look["color"], **bars)
        for spot in curve.spots if not curve.is_fixed else ():
            place = (MICRO * spot.cost.value, spot.error.value)
            ax.annotate(phrases.number(spot.size), place, (2.5, 2.5), textcoords="offset points",
                        fontsize=6, color=look["color"])  # fmt: skip


def _spots(every: Sequence[Curve]) -> list[Spot]:
    return list(chain.from_iterable(curve.spots for curve in every))


def _values(spots: Sequence[Spot]) -> tuple[Array, Array]:
    """Return CPU times (µs) and errors, each with standard errors (2, n); none is nothing."""
    estimates = np.array([[spot.cost.estimate, spot.error.estimate] for spot in spots])
    times, errors = np.nan_to_num(estimates.reshape(-1, 2, 2).transpose(1, 2, 0))
    return MICRO * times, errors
