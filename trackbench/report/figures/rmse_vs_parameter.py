"""Figure kind `rmse-vs-parameter`: a metric over one key that a grid varies."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackbench.config.experiment import Point
from trackbench.config.grid import common_number, is_of_scenario, single_paths
from trackbench.config.table_and_figure_checks import missing_paths
from trackbench.core.arrays import Array
from trackbench.evaluation.metric_expression import OfSummary, measure
from trackbench.registry import register
from trackbench.report.figures import caption_parts
from trackbench.report.figures.lines_over_parameter import (
    Estimates,
    best_index,
    draw_estimates,
    is_level,
)
from trackbench.report.findings import grid_headings, metric_phrases
from trackbench.report.findings.phrases import named, rounded
from trackbench.report.kinds import FigureKind
from trackbench.report.plotting import scales, style, tick_labels, zeros_on_log_axes
from trackbench.report.plotting.page_formats import sheet
from trackbench.report.plotting.panels import add_title_and_legend
from trackbench.report.plotting.style import Figure
from trackbench.report.tables_and_figures import Results
from trackbench.results.rows_and_columns import Columns

_AXIS_IN = 0.8
"""Width of the labels beside the panel."""


@register("figures", "rmse-vs-parameter")
@dataclass(frozen=True, kw_only=True)
class RmseVsParameter(FigureKind):
    """A metric of summary.csv against a grid parameter, a line per filter, each best value marked.

    Linked paths with equal values are one parameter. A parameter of the scenario changes the problem, so
    no value of it is marked. Bars are two standard errors. A filter that does not depend on the
    parameter is a horizontal line. Zero on a logarithmic axis stands at the left, apart.
    """

    parameter: str | None = None
    """path of the grid that is the horizontal axis; default: the only one"""
    metric: OfSummary = measure("mean(rmse_position)")
    """metric of summary.csv"""
    filters: tuple[str, ...] | None = None
    """labels to draw; default: all"""
    x_label: str = ""
    """label of the horizontal axis, with its unit; default: the path"""
    y_label: str = ""
    """label of the vertical axis, with its unit; default: the metric"""
    log_x: bool = True
    """logarithmic horizontal axis"""
    log_y: bool = True
    """logarithmic vertical axis"""

    def conflicts(self, points: Sequence[Point]) -> dict[str, str]:
        """Reject an axis that is no path of the grid, and values that are no numbers.

        Return the reason by key; empty if all is well.
        """
        path = self.parameter or next(iter(points[0].values), "")  # empty without a grid
        problems = missing_paths(points, parameter=path)
        if problems:
            return problems
        for point in points:
            value = point.values[path]
            # The value of linked paths is a list.
            if common_number(value) is None:
                message = f"{value!r} in the grid of {path} is no number"
                if len(single_paths(path)) > 1:
                    message += ": give the linked paths equal values, or show these in a table"
                return {"parameter": message}
        return {}

    def default_caption(self, results: Results) -> str:
        """Return metric, key, filters and number of runs, and where each filter is best."""
        path = self._path(results)
        key, _ = grid_headings.quantity(path)  # without its unit
        words = f"{caption_parts.quantity(self.metric)} over {key}"
        labels = caption_parts.filters(
            caption_parts.measured_labels(results, results.chosen(self.filters), self.metric)
        )
        caption = caption_parts.sentence(
            f"{words} of {labels}, {caption_parts.runs(results)} at each value"
        )
        fixed_values = {p: v for p, v in results.points()[0].items() if p != path}
        if fixed_values:
            caption += f" At {caption_parts.heading(results, fixed_values)}."
        if is_of_scenario(path):  # each value is another problem, and none is the best
            return caption
        all_rows = self._rows(results, path)
        name, unit = grid_headings.quantity(path)
        parts = []
        for label in results.chosen(self.filters):
            rows = all_rows.where(filter=label)
            rows = rows.chosen(np.isfinite(rows["value"]))
            values = rows["value"]
            if not is_level(values, rows["stderr"]):
                best = best_index(values, self.metric)
                parameter = _parameter_values(results, path, rows)[best]
                number = rounded(float(values[best]), 3)
                parts.append(f"{named(label)} {number} at {parameter:g} {unit}".rstrip())
        if not parts:
            return caption
        return f"{caption} Best over {name}: {', '.join(parts)}."

    def _path(self, results: Results) -> str:
        """Return the path of the grid that is the horizontal axis."""
        return self.parameter or results.grid[0]

    def _rows(self, results: Results, path: str) -> Columns:
        """Return the metric's rows of summary.csv at the first values of all paths but ``path``."""
        first_values = {p: v for p, v in results.points()[0].items() if p != path}
        return results.columns("summary", first_values).where(metric=str(self.metric))

    def draw(self, results: Results) -> Figure:
        """Return one panel; other paths of the grid are held at their first values."""
        path = self._path(results)
        rows = self._rows(results, path)
        parameters = _parameter_values(results, path, rows)
        log_x = self.log_x and scales.has_logarithm(parameters)
        x = zeros_on_log_axes.places_with_zero(parameters) if log_x else parameters
        y = rows["value"]
        stderr = rows["stderr"]
        ascending = np.argsort(x, kind="stable")
        # Metric by which a filter's best value is marked. A key of the scenario changes the problem: no
        # value of it is the best.
        marked_by = None if is_of_scenario(path) else self.metric
        figure, ax = style.subplots(1, 1, 3.6)  # 3.6 inches high
        looks = results.line_styles(results.chosen(self.filters))
        for label in results.chosen(self.filters):
            # Indices of the filter's rows, in order of x.
            of_filter = ascending[rows["filter"][ascending] == label]
            look = {"label": label, **looks[label]}
            # A filter with one value throughout is a horizontal line.
            if len(of_filter) and np.ptp(y[of_filter]) == 0.0:
                ax.axhline(y[of_filter[0]], **look | {"linewidth": 0.9})
            else:
                estimates = Estimates(x=x[of_filter], value=y[of_filter], stderr=stderr[of_filter])
                best: int | None = None
                if marked_by is not None and not is_level(estimates.value, estimates.stderr):
                    best = best_index(estimates.value, marked_by)
                draw_estimates(ax, estimates, look | {"marker": "o", "markersize": 2.5}, best)
        values = np.unique(parameters)
        if log_x:
            zeros_on_log_axes.set_log_scale_with_zero(ax, values)
            # Without a zero the numbers are plain, as 200, whatever the ratio of the axis's ends is.
            if values[0] > 0.0:
                scales.set_plain_log_scale(ax.xaxis, largest_ratio=np.inf)
        places = zeros_on_log_axes.places_with_zero(values) if log_x else values
        texts = tick_labels.value_texts(values.tolist())
        tick_labels.set_ticks_at_values(ax, places, texts, sheet().width_in - _AXIS_IN)
        if self.log_y:
            scales.set_plain_log_scale(ax.yaxis, largest_ratio=np.inf)
            zeros_on_log_axes.mark_zeros_of_lines(ax)
        # A line by `axhline` has no x in units of the data, so matplotlib would not find the range of x.
        has_horizontal_lines_alone = not len(scales.drawn_values(ax.xaxis))
        if has_horizontal_lines_alone and len(np.unique(x)) > 1:
            ax.set_xlim(x.min(), x.max())
        ax.set_xlabel(self.x_label or results.axis(path))
        ax.set_ylabel(self.y_label or metric_phrases.axis_of(self.metric))
        return add_title_and_legend(figure, self.title)


def _parameter_values(results: Results, path: str, rows: Columns) -> Array:
    """Return the values of a path of the grid in the rows of a file, as numbers (n,).

    The value of linked paths, which vary together, is a list of equal numbers: it gives this number.
    """
    # The file has lists as texts, so that the config's values are looked up by their texts.
    numbers = {str(point[path]): common_number(point[path]) for point in results.grid_points}
    return np.array([numbers.get(str(value), value) for value in rows[path]], dtype=float)
