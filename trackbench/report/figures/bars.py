"""Figure kind `bars`: one statistic per filter with its interval, beside the published number."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite
from typing import ClassVar

from trackbench.evaluation.metric_expression import Expression, measure
from trackbench.field_types import OpenShare
from trackbench.registry import register
from trackbench.report.expressions import Evaluator
from trackbench.report.figures import caption_parts
from trackbench.report.figures.panels_of_points_and_filters import panel_headings
from trackbench.report.findings import metric_phrases
from trackbench.report.kinds import FigureKind
from trackbench.report.plotting import scales, style
from trackbench.report.plotting.panels import (
    MOST_PANELS,
    add_title_and_legend,
    make_panels,
    wrap_headings,
)
from trackbench.report.plotting.style import Axes, Figure, LineStyle
from trackbench.report.tables_and_figures import Results
from trackbench.report.verdicts.claim_verdicts import point_of
from trackbench.results.points_json import GridPoint
from trackbench.statistics.sample_statistics import interval

_WITHOUT_NUMBER = "no finite value"
"""Text in the row of a filter that lost all its runs, or does not measure the metric."""


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
    """probability of the confidence intervals"""
    x_label: str = ""
    """label of the axis, with its unit; default: the metric"""
    log: bool = False
    """logarithmic axis"""
    floor: str | None = None
    """label of the filter that none can beat: a black dashed line"""
    baseline: str | None = None
    """label of the filter that every other should beat: a gray dotted line"""

    def default_caption(self, results: Results) -> str:
        """Return metric, filters and number of runs, and what the diamonds are, if there are any."""
        labels = caption_parts.measured_labels(results, results.chosen(self.filters), self.metric)
        caption = caption_parts.of_curves(results, caption_parts.quantity(self.metric), labels)
        if results.config["runs"] > 1:
            caption += f" Bars are {100 * self.level:g} % confidence intervals."
        references = self._references(results)
        bars = [label for label in results.chosen(self.filters) if label not in references]
        points = results.points()[:MOST_PANELS]
        if any(any(self._published_values(results, point, bars)) for point in points):
            caption += " Diamonds are the numbers that were published."
        return caption

    def draw(self, results: Results) -> Figure:
        """Return a row per filter, a panel per point of the grid."""
        points = results.points()[:MOST_PANELS]
        references = self._references(results)
        labels = [label for label in results.chosen(self.filters) if label not in references]
        looks = results.line_styles([*labels, *references], self.floor, self.baseline)
        height = 0.9 + 0.26 * len(labels)  # of a panel, inches
        figure, axes = make_panels(len(points), 1, height, sharex=True, sharey=True)
        headings = wrap_headings(panel_headings(results, points))
        for (ax,), point, heading in zip(axes, points, headings, strict=True):
            expressions = Evaluator(results, point)
            self._draw_measured(ax, expressions, {label: looks[label]["color"] for label in labels})
            # Floor, baseline and bound are lines through all bars.
            for label in references:
                value = expressions.term(self.metric.of(label)).value
                if isfinite(value):
                    ax.axvline(value, label=label, **looks[label])
            self._draw_published(ax, results, point, labels)
            ax.set_title(heading)
            ax.set_xlabel(self.x_label or metric_phrases.axis_of(self.metric))
            if self.log:
                scales.set_plain_log_scale(ax.xaxis)
            ax.grid(visible=False, axis="y")
        # The first filter is on top.
        axes[0][0].set_yticks(range(len(labels)), [style.wrap_label(label) for label in labels])
        axes[0][0].invert_yaxis()
        return add_title_and_legend(figure, self.title, number_of_points=len(results.points()))

    def _references(self, results: Results) -> list[str]:
        """Return the labels that are lines through all bars: floor, baseline and bound."""
        references = [
            str(label) for label in (self.floor, self.baseline) if label in results.labels
        ]
        bound = results.config.get("bound")
        if bound in results.chosen(self.filters) and bound not in references:
            references.append(bound)  # it has no runs, and so no interval
        return references

    def _draw_measured(self, ax: Axes, expressions: Evaluator, colors: dict[str, str]) -> None:
        """Draw a dot with its confidence interval for each filter; ``colors`` are by label."""
        look: LineStyle = {"fmt": "o", "markersize": 4, "capsize": 3}
        for row, (label, color) in enumerate(colors.items()):
            value, low, high = self._estimate(expressions, label)
            if not isfinite(value):
                # x is a share of the axis.
                transform = ax.get_yaxis_transform()
                ax.text(0.01, row, _WITHOUT_NUMBER, transform=transform, va="center", fontsize=7)
                continue
            # matplotlib takes no negative length of a bar.
            below = max(value - low, 0.0)
            above = max(high - value, 0.0)
            ax.errorbar(value, row, xerr=[[below], [above]], color=color, **look)
        legend_text = f"Measured, {100 * self.level:g} %"
        ax.errorbar([], [], xerr=[], color=style.ANY, label=legend_text, **look)

    def _estimate(self, expressions: Evaluator, label: str) -> tuple[float, float, float]:
        """Return a filter's value and the low and high end of its confidence interval.

        The interval of a statistic over the runs is NaN for fewer than two runs. Of any other expression
        an end that is unknown is the value itself. An unknown end draws no bar in either case.
        ``expressions`` are those of one point of the grid.
        """
        metric = self.metric.of(label)
        term = expressions.term(metric)
        values_of_runs = expressions.values(metric)
        if values_of_runs is not None:
            low, high = interval(metric.statistic, values_of_runs, level=self.level)
            return term.value, low, high
        low, high = term.interval(self.level)
        # An end is NaN without a standard error, as of a bound or a single run. The value as its own end
        # gives the bar no length on this side.
        if not isfinite(low):
            low = term.value
        if not isfinite(high):
            high = term.value
        return term.value, low, high

    def _draw_published(
        self, ax: Axes, results: Results, point: GridPoint, labels: list[str]
    ) -> None:
        """Draw a diamond for each published number of the metric at this point of the grid.

        ``labels`` are those of the rows, from the first to the last.
        """
        for label, value in self._published_values(results, point, labels):
            ax.plot(
                value,
                labels.index(label),
                marker="D",
                linestyle="",
                color="black",
                markerfacecolor="none",
                markersize=5,
                label="Published",
            )

    def _published_values(
        self, results: Results, point: GridPoint, labels: list[str]
    ) -> Iterator[tuple[str, float]]:
        """Yield label and value of the published numbers of these filters at a point of the grid."""
        for number in results.published.numbers:
            # A published value that is a text is a word on a bias.
            if number.expression != self.metric or isinstance(number.value, str):
                continue
            if point_of(results, number.point) != point:
                continue
            for label in number.labels:
                if label in labels:
                    yield label, number.value
