"""Figure kind `bars`: one statistic per filter with its interval, beside the published number."""

from dataclasses import dataclass
from math import isfinite
from typing import ClassVar

import numpy as np

from trackbench.evaluation.metric_expression import Expression, measure
from trackbench.field_types import OpenShare
from trackbench.registry import register
from trackbench.report.expressions import Evaluator
from trackbench.report.findings import phrases
from trackbench.report.kinds import FigureKind
from trackbench.report.plotting import scales, style
from trackbench.report.plotting.style import Axes, Figure, LineStyle
from trackbench.report.results import Results
from trackbench.report.verdicts.claims import point_of
from trackbench.results.point_facts import GridPoint
from trackbench.statistics.over_runs import interval


@register("figures", "bars")
@dataclass(frozen=True, kw_only=True)
class Bars(FigureKind):
    """A statistic per filter with its confidence interval, and the published number beside it."""

    label_keys: ClassVar[tuple[str, ...]] = ("floor", "baseline")

    filters: tuple[str, ...] | None = None
    """labels to draw; default: all"""
    metric: Expression = measure("mean(rmse)")
    """what is drawn: a metric of summary.csv, or any expression such as `rmse@20`"""
    level: OpenShare = 0.95
    """of the intervals"""
    x_label: str = ""
    """label of the axis, with its unit; default: the metric"""
    log: bool = False
    """logarithmic axis"""
    floor: str | None = None
    """label of the filter that none can beat: a black dashed line"""
    baseline: str | None = None
    """label of the filter that every other should beat: a gray dotted line"""

    def default_caption(self, results: Results) -> str:
        """Return what the diamonds are, if there are any."""
        is_published = any(n.expression == self.metric for n in results.published.numbers)
        return "Diamonds are the numbers that were published." if is_published else ""

    def draw(self, results: Results) -> Figure:
        """Return a row per filter, a panel per point of the grid."""
        points = results.points()[: style.MOST_PANELS]
        lines = {self.floor: style.FLOOR, self.baseline: style.BASELINE}
        labels = [b for b in results.chosen(self.filters) if b not in lines]
        height = 0.9 + 0.26 * len(labels)
        figure, axes = style.make_panels(len(points), 1, height, sharex=True, sharey=True)
        heads = style.wrap_headings([phrases.heading(point) for point in points])
        for (ax,), point, head in zip(axes, points, heads, strict=True):
            expressions = Evaluator(results, point)
            self._bars(ax, results, expressions, labels)
            # Floor and baseline are lines through all bars.
            for label, look in lines.items():
                if label in results.labels:
                    value = expressions.term(self.metric.of(str(label))).value
                    ax.axvline(value, label=label, **look)
            self._published(ax, results, point, labels)
            ax.set_title(head)
            ax.set_xlabel(self.x_label or str(self.metric))
            if self.log:
                scales.log_scale(ax.xaxis)
            ax.grid(visible=False, axis="y")
        # The first filter is on top.
        axes[0][0].set_yticks(range(len(labels)), [style.wrap_label(b) for b in labels])
        axes[0][0].invert_yaxis()
        return style.add_title_and_legend(figure, self.title, len(results.points()))

    def _bars(self, ax: Axes, results: Results, expressions: Evaluator, labels: list[str]) -> None:
        look: LineStyle = {"fmt": "o", "markersize": 4, "capsize": 3}
        for i, label in enumerate(labels):
            m = self.metric.of(label)
            term, values = expressions.term(m), expressions.values(m)
            value = term.value
            if values is not None:
                low, high = interval(m.statistic, values, level=self.level)
            else:
                low, high = (x if isfinite(x) else value for x in term.interval(self.level))
            if np.isfinite(value):
                off = [[max(value - low, 0.0)], [max(high - value, 0.0)]]
                color = results.line_style(label)["color"]
                ax.errorbar(value, i, xerr=off, color=color, **look)
        words = f"Measured, {100 * self.level:g} %"
        ax.errorbar([], [], xerr=[], color=style.ANY, label=words, **look)

    def _published(self, ax: Axes, results: Results, point: GridPoint, labels: list[str]) -> None:
        look: LineStyle = {"marker": "D", "linestyle": "", "markerfacecolor": "none"}
        for number in results.published.numbers:
            matches = number.expression == self.metric and point_of(results, number.point) == point
            for label in number.labels if matches else ():
                if label in labels and not isinstance(number.value, str):
                    ax.plot(number.value, labels.index(label), color="black",
                            markersize=5, label="Published", **look)  # fmt: skip
