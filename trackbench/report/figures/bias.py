"""Figure kind `bias`: mean signed errors over time."""

from dataclasses import dataclass

from trackbench.evaluation.metric_expression import OfStep
from trackbench.field_types import Positive
from trackbench.registry import register
from trackbench.report.figures import caption_parts
from trackbench.report.figures.over_time import OverTime
from trackbench.report.figures.panels_of_points_and_filters import leftmost_panels
from trackbench.report.findings.phrases import joined
from trackbench.report.plotting import error_bands_and_bars, filter_lines
from trackbench.report.plotting.legend import legend_outside
from trackbench.report.plotting.style import Axes, Figure
from trackbench.report.tables_and_figures import Results
from trackbench.results.points_json import GridPoint


@register("figures", "bias")
@dataclass(frozen=True, kw_only=True)
class Bias(OverTime):
    """Mean signed errors over time, a row of panels per quantity, with bands of two standard errors."""

    rows: dict[str, OfStep]
    """vertical axis with its unit: metric of per_step.csv, such as `bias_radial`"""
    linear_within: Positive | None = None
    """half-width of the linear part of a symmetric logarithmic axis; default: a linear axis"""

    def default_caption(self, results: Results) -> str:
        """Return metrics, filters and number of runs, and how an error without bias looks."""
        labels = [label for label, _ in self.labels_and_looks(results, with_exact_errors=True)]
        metrics = joined(f"`{metric}`" for metric in self.rows.values())
        caption = caption_parts.of_curves(
            results, f"mean errors {metrics} over {self.x_words}", labels
        )
        if results.config["runs"] == 1:
            return caption
        return f"{caption} Errors are within two standard errors of zero if there is no bias."

    def draw(self, results: Results) -> Figure:
        """Return one line per filter."""
        figure, panels = self.make_panels(results, len(self.rows))
        for panel in panels:
            for ax, metric in zip(panel.axes, self.rows.values(), strict=True):
                self._draw_metric(ax, results, panel.point, metric)
        for panel in leftmost_panels(panels):
            for ax, y_label in zip(panel.axes, self.rows, strict=True):
                ax.set_ylabel(y_label)
        self.drop_impossible_log_scales(figure)
        self.label_clock_times_from_start(figure)
        legend_outside(figure)
        return figure

    def _draw_metric(self, ax: Axes, results: Results, point: GridPoint, metric: OfStep) -> None:
        """Draw a line with two standard errors per filter, and a line at zero."""
        ax.axhline(0.0, color="black", linewidth=0.6)
        all_series = list(self.metric_series(results, point, metric))
        for line_index, series in enumerate(all_series):
            look = series.look
            x, value, stderr = self.series_with_gaps(series.rows)
            if filter_lines.draw_filter_line(ax, x, value, look):
                lines = len(all_series)
                error_bands_and_bars.draw_error_band(ax, x, value, stderr, look, line_index, lines)
        if self.linear_within is not None:
            ax.set_yscale("symlog", linthresh=self.linear_within)
