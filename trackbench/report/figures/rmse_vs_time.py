"""Figure kind `rmse-vs-time`: a metric over steps or time, a line a filter."""

from dataclasses import dataclass

import numpy as np

from trackbench.evaluation.metric_expression import OfStep, measure
from trackbench.registry import register
from trackbench.report.figures import caption_parts
from trackbench.report.figures.coinciding_lines import coinciding_lines
from trackbench.report.figures.over_time import OverTime
from trackbench.report.findings import phrases
from trackbench.report.plotting import error_bands_and_bars, filter_lines, zeros_on_log_axes
from trackbench.report.plotting.fault_shading import faults_overlap, shade_faults
from trackbench.report.plotting.panels import MOST_PANELS
from trackbench.report.plotting.style import Figure
from trackbench.report.tables_and_figures import Results


@register("figures", "rmse-vs-time")
@dataclass(frozen=True, kw_only=True)
class RmseVsTime(OverTime):
    """A metric over steps or time, a line a filter, with two standard errors on either side.

    Faults of sensors are shaded.

    More than 5 filters over more than 150 steps have a panel each, with the other filters in gray.
    """

    metric: OfStep = measure("rmse")
    """metric of per_step.csv"""

    @property
    def drawn_metric(self) -> str:
        """Metric of per_step.csv without which a filter has no line."""
        return str(self.metric)

    def default_caption(self, results: Results) -> str:
        """Return metric, filters, number of runs and what bands or bars are."""
        labels = [label for label, _ in self.labels_and_looks(results, with_exact_errors=True)]
        words = f"{caption_parts.quantity(self.metric)} over {self.x_words}"
        caption = caption_parts.of_curves(results, words, labels)
        panel_labels = self.panel_labels(results, self.count_steps(results, self.metric))
        if results.config["runs"] > 1:
            # A filter with a panel of its own has a band.
            has_bars = not panel_labels and len(labels) > error_bands_and_bars.MOST_BANDS
            spread = "Bars" if has_bars else "Bands"
            caption += f" {spread} are two standard errors on either side."
        if self._hides_first_errors(results):
            caption += (
                " The state is known exactly at the first step, so that lines begin behind it."
            )
        if not panel_labels:
            caption += self._coinciding_lines(results)
        caption += caption_parts.bound(results, labels)
        faults = results.facts(results.points()[0]).scenario.get("faults") or ()
        if not faults:
            return caption
        caption += " The times of faults are shaded."
        rows = results.columns("per_step", results.points()[0]).where(metric=str(self.metric))
        if faults_overlap(rows, faults, self.x):
            names = phrases.joined([fault["name"] for fault in faults])
            caption += (
                f" As some overlap in time, {names} have a strip each, from top to bottom. The height "
                "of a strip means nothing."
            )
        return caption

    def _coinciding_lines(self, results: Results) -> str:
        """Return sentences that name lines of which one hides the other; empty if there are none."""
        panels = []
        for point in results.points()[:MOST_PANELS]:
            all_series = self.metric_series(results, point, self.metric)
            panels.append({series.look["label"]: series.rows["value"] for series in all_series})
        curves = self.values_of_curves(results, self.metric)
        return coinciding_lines(panels, self.with_vertical_axis(self.metric, curves).log)

    def _hides_first_errors(self, results: Results) -> bool:
        """Test whether the axis is logarithmic, and the first error of every line in some panel is zero.

        A logarithmic axis does not show it.
        """
        curves = self.values_of_curves(results, self.metric)
        if not self.with_vertical_axis(self.metric, curves).log:
            return False
        points = results.points()[:MOST_PANELS]
        for point in points:
            all_series = self.metric_series(results, point, self.metric)
            if zeros_on_log_axes.all_start_at_zero([series.rows["value"] for series in all_series]):
                return True
        return False

    def draw(self, results: Results) -> Figure:
        """Return one line per filter."""
        curves = self.values_of_curves(results, self.metric)
        figure_with_axis = self.with_vertical_axis(self.metric, curves)
        return figure_with_axis._draw_curves(results)

    def _draw_curves(self, results: Results) -> Figure:
        """Draw the figure; `with_vertical_axis` has set its keys ``y_label`` and ``log`` before."""
        # Filters with a panel of their own; empty if all share a panel.
        panel_labels = self.panel_labels(results, self.count_steps(results, self.metric))
        figure, panels = self.make_panels_over_time(results, panel_labels)
        for panel in panels:
            (ax,) = panel.axes
            all_series = list(self.metric_series(results, panel.point, self.metric))
            # In a filter's own panel the errors are a band, as of a single line: gray lines have none.
            lines_with_errors = 1 if panel_labels else len(all_series)
            faults = results.facts(panel.point).scenario.get("faults", ())
            if all_series:  # there is none if every filter failed
                shade_faults(ax, all_series[0].rows, faults, self.x)
            zeros_of_lines = []
            values_of_lines = [series.rows["value"] for series in all_series]
            starts_known = self.log and zeros_on_log_axes.all_start_at_zero(values_of_lines)
            for line_index, series in enumerate(all_series):
                look = series.look
                x, value, stderr = self.series_with_gaps(series.rows)
                # Zeros, and errors that are only rounding: a logarithmic axis does not show them.
                is_hidden = np.zeros(len(value), dtype=np.bool_)
                if self.log:
                    shown = zeros_on_log_axes.without_rounding(value)
                    is_hidden = np.isfinite(value) & np.isnan(shown)
                    # A line of zeros alone stays, so that the legend has it.
                    if np.isfinite(shown).any():
                        value = shown
                # False for a gray line, as of a filter with another panel, and for one without a value.
                has_own_look = self.draw_curve(ax, x, value, look, panel.label, panel_labels)
                if has_own_look:
                    error_bands_and_bars.draw_error_band(
                        ax, x, value, stderr, look, line_index, lines_with_errors, self.log
                    )
                    if is_hidden.any():
                        filter_lines.draw_lone_points(ax, x, value, look["color"])
                    if starts_known:  # the zero at the start is that of all lines, and gets no mark
                        is_hidden[0] = False
                    zeros = zeros_on_log_axes.Zeros(x=x[is_hidden], color=look["color"])
                    zeros_of_lines.append(zeros)
            zeros_on_log_axes.mark_zeros(ax, zeros_of_lines)
        return self.finish(figure, panel_labels)
