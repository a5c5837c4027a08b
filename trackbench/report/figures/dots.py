"""Figure kind `dots`: metrics of summary.csv, a dot with two standard errors per filter."""

from dataclasses import dataclass

import numpy as np

from trackbench.evaluation.metric_expression import OfSummary
from trackbench.registry import register
from trackbench.report.figures import caption_parts
from trackbench.report.figures.panels_of_points_and_filters import panel_headings
from trackbench.report.findings.phrases import joined
from trackbench.report.kinds import FigureKind
from trackbench.report.plotting import style, tick_labels
from trackbench.report.plotting.panels import MOST_PANELS, add_title_and_legend
from trackbench.report.plotting.style import Axes, Figure
from trackbench.report.tables_and_figures import Results
from trackbench.results.points_json import GridPoint


@register("figures", "dots")
@dataclass(frozen=True, kw_only=True)
class Dots(FigureKind):
    """Metrics of summary.csv, a dot with two standard errors per filter; a panel row per grid point."""

    filters: tuple[str, ...] | None = None
    """labels to draw; default: all"""
    columns: dict[str, OfSummary]
    """horizontal axis with its unit: metric of summary.csv, such as `mean(bias_radial)`"""
    expected: dict[str, float]
    """value of each metric for a filter without fault, drawn as a line"""

    def default_caption(self, results: Results) -> str:
        """Return metrics, filters and number of runs."""
        metrics = joined(f"`{metric}`" for metric in self.columns.values())
        labels = results.chosen(self.filters, with_exact_errors=True)
        words = f"{metrics} of {caption_parts.filters(labels)}, {caption_parts.runs(results)}"
        caption = caption_parts.sentence(f"{words}{caption_parts.panels(results)}")
        if results.config["runs"] > 1:
            caption += " Bars are two standard errors on either side."
        if self.expected:
            caption += " A line is the value of a filter without fault."
        return caption

    def draw(self, results: Results) -> Figure:
        """Return a column of panels per metric."""
        points = results.points()[:MOST_PANELS]
        labels = results.chosen(self.filters, with_exact_errors=True)
        height = (0.6 + 0.2 * len(labels)) * len(points) + 0.5  # inches
        figure, axes = style.subplots(
            len(points), len(self.columns), height, sharey=True, squeeze=False
        )
        headings = panel_headings(results, points)
        for panels, point, heading in zip(axes, points, headings, strict=True):
            # The panel in the middle has the title of the row.
            panels[len(panels) // 2].set_title(heading)
            for ax, metric in zip(panels, self.columns.values(), strict=True):
                self._draw_metric(ax, results, point, str(metric), labels)
            panels[0].set_yticks(range(len(labels)), map(style.wrap_label, labels))
        axes[0][0].invert_yaxis()  # the first filter is on top
        for ax, x_label in zip(axes[-1], self.columns, strict=True):
            ax.set_xlabel(x_label)
        bar: style.LineStyle = {"marker": "_", "markersize": 8, "color": "#888888"}
        axes[0][0].plot([], [], linestyle="", label=style.SPREAD, **bar)
        return add_title_and_legend(figure, self.title, number_of_points=len(results.points()))

    def _draw_metric(
        self, ax: Axes, results: Results, point: GridPoint, metric: str, labels: list[str]
    ) -> None:
        """Draw a dot with two standard errors per filter, and a line at the expected value.

        ``labels`` are those of the rows, from the first to the last. The config's ``expected`` has the
        value of some metrics for a filter without fault.
        """
        rows = results.columns("summary", point).where(metric=metric)
        looks = results.line_styles(labels)
        estimates: dict[str, tuple[float, float]] = {}
        for label, value, stderr in rows.tuples(["filter", "value", "stderr"]):
            estimates[label] = (value, stderr)
        for row, label in enumerate(labels):
            value, stderr = estimates.get(label, (np.nan, np.nan))
            ax.errorbar(
                value,
                row,
                xerr=2 * np.nan_to_num(stderr),
                color=looks[label]["color"],
                marker="o",
                markersize=3.5,
                capsize=2,
            )
        if metric in self.expected:
            ax.axvline(self.expected[metric], color="black", linewidth=0.6, label="Without fault")
        # Without an expected value the ticks are those nearest to zero and farthest from it.
        tick_labels.set_few_ticks(ax, expected=self.expected.get(metric, 0.0))
