"""Figure kind `sweep`: metrics over one or two keys that a grid varies."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Any

import numpy as np

from trackbench.config.experiment import Point
from trackbench.config.grid import (
    filters_of,
    is_of_scenario,
)
from trackbench.config.table_and_figure_checks import missing_paths
from trackbench.evaluation.metric_expression import Measure, OfSummary, measured
from trackbench.field_types import is_number
from trackbench.registry import register
from trackbench.report.figures import caption_parts
from trackbench.report.figures.lines_over_parameter import (
    Estimates,
    best_index,
    draw_estimates,
)
from trackbench.report.figures.sweep_heat_maps import draw_heat_maps
from trackbench.report.findings import grid_headings, phrases
from trackbench.report.findings.phrases import joined, listed, named, rounded
from trackbench.report.findings.ranking_metrics import shown_metrics
from trackbench.report.kinds import FigureKind
from trackbench.report.plotting import scales, style, tick_labels
from trackbench.report.plotting.page_formats import sheet
from trackbench.report.plotting.panels import MOSAIC, add_title_and_legend, panel_grid, set_title
from trackbench.report.plotting.scales import set_limits_with_margin
from trackbench.report.plotting.style import Axes, Figure, LineStyle
from trackbench.report.tables_and_figures import Results
from trackbench.results.points_json import GridPoint
from trackbench.statistics.estimates import MISSING
from trackbench.statistics.sample_statistics import Estimate

_ROW_IN = 2.6
"""Height of a row of panels."""
_EXTRA_IN = 0.6
"""Height of titles and labels beside the rows."""
_AXIS_IN = 0.8
"""Width of the labels beside a panel."""
_MOST_LEVEL_PANELS = 6
"""Values of a second path up to which each has a panel; two paths with more have a heat map."""
_MOST_LEVELS = 3
"""Filters that are not varied and are all drawn; of more only the best is drawn."""
_WITHOUT_NUMBER = "No finite value"
MOST_PATHS = 2
"""Paths that a figure shows, at most."""


@dataclass(frozen=True, kw_only=True)
class _SectionPoint:
    """A filter's metric at one combination of the shown paths' values."""

    path_values: GridPoint
    """values of the shown paths, by path"""
    value: float
    """NaN or infinite if the filter has no finite number there"""
    stderr: float
    """NaN if it is unknown"""


class _Section:
    """summary.csv where all paths but the shown ones have their first values."""

    def __init__(self, results: Results, paths: Sequence[str]) -> None:
        """Select the rows; ``paths`` are the one or two paths of the grid that the figure shows."""
        self.results = results
        self.paths = paths
        first_point = results.points()[0]
        self.fixed_values = {path: v for path, v in first_point.items() if path not in paths}
        """values of the other paths"""
        self._rows = results.columns("summary", self.fixed_values)
        self.values = {path: list(dict.fromkeys(self._rows[path].tolist())) for path in paths}
        """values of each shown path, in order"""

    def points_of(self, label: str, metric: Measure) -> list[_SectionPoint]:
        """Return the points at which a filter's metric is stored; its value may be NaN or infinite."""
        rows = self._rows.where(filter=label, metric=str(metric))
        points = []
        for *path_values, value, stderr in rows.tuples([*self.paths, "value", "stderr"]):
            point = _SectionPoint(
                path_values=dict(zip(self.paths, path_values, strict=True)),
                value=value,
                stderr=stderr,
            )
            points.append(point)
        return points

    def best_of(self, label: str, metric: Measure) -> _SectionPoint | None:
        """Return the point at which a filter is best; None if its ``metric`` is finite nowhere."""
        finite = [point for point in self.points_of(label, metric) if np.isfinite(point.value)]
        if not finite:
            return None
        return finite[best_index(np.array([point.value for point in finite]), metric)]


@dataclass(frozen=True, kw_only=True)
class _SweepPanel:
    """A panel: a metric at values of those paths that have a panel for each value."""

    metric: Measure
    y_label: str
    path_values: GridPoint
    """the panel's value of the path that has a panel for each value; empty without such a path"""


@register("figures", "sweep")
@dataclass(frozen=True, kw_only=True)
class SweepFigure(FigureKind):
    """Metrics of summary.csv over one path of the grid, a panel each; the first one over two paths.

    Of two paths the one with fewer values has a panel for each of them. If both have more than six
    values, each filter has a heat map, in which its best value is framed. The figure shows the filters
    that its paths vary, with bars of two standard errors and the best value of each filter marked. A
    filter that no path varies is a horizontal line; of more than three such filters only the best is
    drawn. Other paths keep their first values, and filters that only they vary are left out. A key of
    the scenario changes the problem, so that no value is marked as the best.
    """

    paths: tuple[str, ...]
    """one path of the grid, or two"""
    metrics: dict[str, OfSummary] = field(default_factory=dict)
    """label of the axis: metric of summary.csv; default: the first errors and ANEES, or log scores"""
    filters: tuple[str, ...] | None = None
    """labels to draw; default: all"""

    def conflicts(self, points: Sequence[Point]) -> dict[str, str]:
        """Reject other than one or two paths of the grid.

        Return the reason by key; empty if all is well.
        """
        if not 1 <= len(self.paths) <= MOST_PATHS:
            return {"paths": f"{len(self.paths)} paths; name one or two"}
        for path in self.paths:
            problems = missing_paths(points, paths=path)  # reported under the config key ``paths``
            if problems:
                return problems
        return {}

    def default_caption(self, results: Results) -> str:
        """Return what is drawn over which keys, where each filter is best, and what is not finite.

        Best and not finite are by the first metric.
        """
        metrics = self._metrics(results)
        if not metrics:
            return ""
        section = _Section(results, self.paths)
        x_path, level_path = self._axes(section)
        names = [y_label.partition(" (")[0] for y_label in metrics]  # without units
        # `quantity` returns a path in words, and its unit.
        words = f"{joined(names)} over {grid_headings.quantity(x_path)[0]}"
        if level_path is not None and self._has_panels(section):
            words += f", a panel for each value of {grid_headings.quantity(level_path)[0]}"
        elif level_path is not None:
            words += f" and {grid_headings.quantity(level_path)[0]}"
        sentences = [f"{words}; {caption_parts.runs(results)} at each value."]
        if section.fixed_values:
            sentences.append(
                f"In all panels {caption_parts.heading(results, section.fixed_values)}."
            )
        metric = next(iter(metrics.values()))
        best = []
        missing = []
        for label in self._varied_labels(results):
            point = section.best_of(label, metric)
            # Each value of a scenario's key is another problem: a smaller error is no better choice.
            if point is not None and not self._changes_problem():
                where = caption_parts.heading(results, point.path_values)
                best.append(f"{named(label)} {rounded(point.value, 3)} at {where}")
            for other in section.points_of(label, metric):
                if not np.isfinite(other.value):
                    missing.append(
                        f"{named(label)} at {caption_parts.heading(results, other.path_values)}"
                    )
        if best:
            sentences.append(f"Best: {'; '.join(best)}.")
        if missing:
            sentences.append(f"{_WITHOUT_NUMBER}: {listed(missing)}.")
        return " ".join(sentences)

    def draw(self, results: Results) -> Figure:
        """Return a panel for each metric, or for each value of the path with fewer values.

        Two paths with many values each have heat maps of the first metric, one for each filter.
        """
        section = _Section(results, self.paths)
        x_path, level_path = self._axes(section)
        # Values of the second path that have a panel each; without one a metric has one panel.
        levels: list[GridPoint] = [{}]
        if level_path is not None:
            if not self._has_panels(section):  # too many values for a panel each
                return self._draw_heat_maps(section)
            levels = [{level_path: value} for value in section.values[level_path]]
        panels: list[_SweepPanel] = []
        for y_label, metric in self._metrics(results).items():
            for level in levels:
                panels.append(_SweepPanel(metric=metric, y_label=y_label, path_values=level))
        return self._draw_panels(section, panels, x_path)

    def _axes(self, section: _Section) -> tuple[str, str | None]:
        """Return the path along the horizontal axis, and the path that has a panel for each value.

        The latter is None if the figure has one path, and else the path with fewer values.
        """
        if len(self.paths) == 1:
            return self.paths[0], None
        first, second = self.paths
        if len(section.values[first]) < len(section.values[second]):
            return second, first
        return first, second

    def _has_panels(self, section: _Section) -> bool:
        """Return whether the path with fewer values has few enough of them for a panel each."""
        return min(len(section.values[path]) for path in self.paths) <= _MOST_LEVEL_PANELS

    def _draw_panels(self, section: _Section, panels: list[_SweepPanel], x_path: str) -> Figure:
        """Draw the metric of each panel over the path ``x_path``, with equal horizontal axes.

        If the values of the path are no numbers, they stand at 0, 1, 2, ...
        """
        results = section.results
        x_values = section.values[x_path]
        is_numeric = all(map(is_number, x_values))
        if is_numeric:
            x_values = sorted(x_values)
            places = np.array(x_values, dtype=float)
        else:
            places = np.arange(len(x_values), dtype=float)
        has_one_metric = len({panel.metric for panel in panels}) == 1
        figure, axes = panel_grid(len(panels), _ROW_IN, _EXTRA_IN, sharey=has_one_metric)
        # Step 1: the lines; a filter has one look in all panels. The heights of a panel are the values
        # that are drawn in it.
        drawn_labels = set[str]()
        for panel in panels:
            drawn_labels.update(self._labels_to_draw(section, panel.metric))
        looks = results.line_styles(
            [label for label in results.chosen(self.filters) if label in drawn_labels]
        )
        place_of_value = dict(zip(x_values, places, strict=True))
        heights: list[list[float]] = []
        for ax, panel in zip(axes, panels, strict=False):  # blank axes may fill the last row
            heights.append(self._draw_panel(ax, section, panel, x_path, place_of_value, looks))
        # Step 2: the axes.
        if has_one_metric:  # the panels share their vertical axis
            heights = [list(chain.from_iterable(heights))] * len(panels)
        across = max(1, min(len(panels), MOSAIC))
        panel_in = sheet().width_in / across - _AXIS_IN
        for index, (ax, panel) in enumerate(zip(axes, panels, strict=False)):
            if is_numeric and scales.are_wide(x_values):
                ax.set_xscale("log")
            set_limits_with_margin(ax, places)
            if is_numeric:
                texts = tick_labels.value_texts(x_values)
                tick_labels.set_ticks_at_values(ax, places, texts, panel_in)
            else:
                ax.set_xticks(places, [str(value) for value in x_values])
            if scales.are_wide(heights[index]):
                # Plain numbers, as 200, whatever the ratio of the axis's ends is.
                scales.set_plain_log_scale(ax.yaxis, largest_ratio=np.inf)
            ax.set_xlabel(results.axis(x_path))
            is_first_of_row = index % across == 0
            if is_first_of_row or not has_one_metric:
                ax.set_ylabel(panel.y_label)
            heading = caption_parts.heading(results, panel.path_values)
            ax.set_title(style.wrapped(heading, across))
        return add_title_and_legend(figure, self.title)

    def _draw_panel(
        self,
        ax: Axes,
        section: _Section,
        panel: _SweepPanel,
        x_path: str,
        place_of_value: Mapping[Any, float],
        looks: Mapping[str, LineStyle],
    ) -> list[float]:
        """Draw the panel's metric of each filter; return all finite values of it that the panel shows.

        ``place_of_value`` has the place of each value of the path ``x_path`` on the horizontal axis, and
        ``looks`` has the color and dash of each filter.
        """
        varied = self._varied_labels(section.results)
        heights: list[float] = []
        labels_without_number = 0  # filters so far with a row of crosses
        for label in self._labels_to_draw(section, panel.metric):
            # Step 1: the filter's points in this panel, by their places on the axis.
            points = {
                place_of_value[point.path_values[x_path]]: point
                for point in section.points_of(label, panel.metric)
                if panel.path_values.items() <= point.path_values.items()
            }
            if not points:  # such as a bound, which has no mean per run
                continue
            look = {"label": label, **looks[label]}
            # Places with a finite value, in order.
            finite = [place for place in sorted(points) if np.isfinite(points[place].value)]
            heights += [float(points[place].value) for place in finite]
            # Step 2: a line.
            if label not in varied:  # it has one value
                if finite:
                    ax.axhline(points[finite[0]].value, **look | {"linewidth": 0.9})
                continue
            values = [points[place].value for place in finite]
            errors = [points[place].stderr for place in finite]
            estimates = Estimates(
                x=np.array(finite), value=np.array(values), stderr=np.array(errors)
            )
            # The index of the best point, if it is in this panel. No point is the best if a path is of
            # the scenario: each of its values is another problem.
            best = None
            best_point = section.best_of(label, panel.metric)
            if best_point is not None and not self._changes_problem():
                best_values = best_point.path_values
                if panel.path_values.items() <= best_values.items():
                    best = finite.index(place_of_value[best_values[x_path]])
            draw_estimates(ax, estimates, look | {"marker": "o", "markersize": 3}, best)
            # Step 3: a cross at the top for each value of the path without a number.
            missing = [place for place in place_of_value.values() if place not in finite]
            if missing:
                # As a share of the panel's height: the crosses of each filter are a row of their own.
                height = 0.97 - 0.06 * labels_without_number
                labels_without_number += 1
                cross: LineStyle = {"linestyle": "", "marker": "x", "markersize": 5}
                ax.plot(
                    missing,
                    [height] * len(missing),
                    color=look["color"],
                    transform=ax.get_xaxis_transform(),
                    label="_without_number",  # not in the legend, which has one cross for all filters
                    **cross,
                )
                ax.plot([], [], color=style.ANY, label=_WITHOUT_NUMBER, **cross)
        if panel.metric.definition.better == "one":
            ax.axhline(1.0, color="black", linewidth=0.6)  # a consistent filter
        return heights

    def _draw_heat_maps(self, section: _Section) -> Figure:
        """Draw a panel per filter over the two paths, on one color scale.

        A filter's best value is framed, unless a path changes the problem.
        """
        results = section.results
        x_path, y_path = self.paths
        # Over two paths `_metrics` returns one metric. Without any, there are no fields either, and the
        # figure is empty.
        metrics = self._metrics(results)
        bar_label, metric = next(iter(metrics.items()), ("", measured("mean(rmse)")))
        fields = self._fields(section, metric)
        columns = [phrases.number(value) for value in section.values[x_path]]
        rows = [phrases.number(value) for value in section.values[y_path]]
        figure, axes = panel_grid(len(fields), _ROW_IN, _EXTRA_IN)
        framed_metric = None if self._changes_problem() else metric
        image = draw_heat_maps(axes, fields, columns, rows, framed_metric)
        figure.supxlabel(results.axis(x_path))
        figure.supylabel(results.axis(y_path))
        set_title(figure, self.title)
        if image is not None:
            figure.colorbar(image, ax=axes, label=bar_label)
        return figure

    def _fields(self, section: _Section, metric: Measure) -> dict[str, list[list[Estimate]]]:
        """Return the metric over both paths by filter: a row for each value of the second path.

        Only varied filters with any number have a field. NaN stands where a filter has no number.
        """
        x_path, y_path = self.paths
        columns = section.values[x_path]
        rows = section.values[y_path]
        fields: dict[str, list[list[Estimate]]] = {}
        for label in self._varied_labels(section.results):
            cells = [[MISSING.estimate] * len(columns) for _ in rows]
            finite = [p for p in section.points_of(label, metric) if np.isfinite(p.value)]
            for point in finite:
                row = rows.index(point.path_values[y_path])
                column = columns.index(point.path_values[x_path])
                cells[row][column] = Estimate(point.value, point.stderr)
            if finite:
                fields[label] = cells
        return fields

    def _metrics(self, results: Results) -> dict[str, Measure]:
        """Return the metrics to draw, by the label of their axis; over two paths the first one."""
        metrics = self.metrics or shown_metrics(results)
        if len(self.paths) == 1:
            return metrics
        return dict(list(metrics.items())[:1])

    def _changes_problem(self) -> bool:
        """Return whether a path is of the scenario, so that its values are different problems."""
        return any(is_of_scenario(path) for path in self.paths)

    def _varied_labels(self, results: Results) -> list[str]:
        """Return the chosen filters that the shown paths vary."""
        chosen = results.chosen(self.filters)
        return [label for label in chosen if _is_varied(results, self.paths, label)]

    def _labels_to_draw(self, section: _Section, metric: Measure) -> list[str]:
        """Return the filters that the shown paths vary, and those that no path of the grid varies.

        Of more than three that no path varies, only the best by ``metric`` is returned.
        """
        results = section.results
        chosen = results.chosen(self.filters)
        varied = self._varied_labels(results)
        # Filters that no path varies, with their one value.
        levels: dict[str, float] = {}
        for label in chosen:
            if not _is_varied(results, results.grid, label):
                points = section.points_of(label, metric)
                if points and np.isfinite(points[0].value):
                    levels[label] = points[0].value
        if len(levels) > _MOST_LEVELS:
            best = list(levels)[best_index(np.array(list(levels.values())), metric)]
            levels = {best: levels[best]}
        return [label for label in chosen if label in varied or label in levels]


def _is_varied(results: Results, paths: Sequence[str], label: str) -> bool:
    """Return whether one of the paths changes the filter ``label`` or the scenario that it filters."""
    filters = results.config["filters"]
    return any(is_of_scenario(path) or label in filters_of(path, filters) for path in paths)
