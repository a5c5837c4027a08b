"""Figure kinds over the keys that a grid varies: `sweep`, and a metric over one key."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from trackbench.config.experiment import Point
from trackbench.config.grid import filters_of, is_of_scenario, single_paths
from trackbench.core.arrays import Array
from trackbench.evaluation.metric_expression import Measure, OfSummary, measure, measured
from trackbench.field_types import is_number
from trackbench.registry import register
from trackbench.report.figures.heat_map import write_cells
from trackbench.report.findings import phrases
from trackbench.report.findings.phrases import head_of, named, rounded
from trackbench.report.findings.ranking import ranking_metrics
from trackbench.report.kinds import FigureKind
from trackbench.report.plotting import filter_lines, scales, style
from trackbench.report.plotting.style import Axes, Figure, LineStyle
from trackbench.report.results import Results, missing_paths
from trackbench.results.frames import Columns


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
        """Reject an axis that is no path of the grid, and values that are no numbers."""
        path = self.parameter or next(iter(points[0].values), "")
        problems = missing_paths(points, parameter=path)
        if problems:
            return problems
        for point in points:
            value = point.values[path]
            if _common_number(value) is None:
                what = f"{value!r} in the grid of {path} is no number"
                if len(single_paths(path)) > 1:
                    what += ": give the linked paths equal values, or show these in a table"
                return {"parameter": what}
        return {}

    def default_caption(self, results: Results) -> str:
        """Return where each filter is best."""
        path = self._path(results)
        if is_of_scenario(path):
            return ""
        all_rows = self._rows(results, path)
        name, unit = phrases.quantity(path)
        parts = []
        for label in results.chosen(self.filters):
            rows = all_rows.where(filter=label)
            rows = rows.chosen(np.isfinite(rows["value"]))
            values = rows["value"]
            if len(values) and np.ptp(values) > 0.0:
                best = best_place(values, self.metric)
                parameter = _parameter_values(results, path, rows)[best]
                number = rounded(float(values[best]), 3)
                parts.append(f"{named(label)} {number} at {parameter:g} {unit}".rstrip())
        if not parts:
            return ""
        return f"Best over {name}: {', '.join(parts)}."

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
        x = scales.places_with_zero(parameters) if log_x else parameters
        y = rows["value"]
        stderr = rows["stderr"]
        ascending = np.argsort(x, kind="stable")
        marked_by = None if is_of_scenario(path) else self.metric
        figure, ax = style.subplots(1, 1, 3.6)
        looks = results.line_styles(results.chosen(self.filters))
        for label in results.chosen(self.filters):
            chosen = ascending[rows["filter"][ascending] == label]
            look = {"label": label, **looks[label]}
            if len(chosen) and np.ptp(y[chosen]) == 0.0:
                ax.axhline(y[chosen[0]], **look | {"linewidth": 0.9})
            else:
                estimates = _Estimates(x=x[chosen], value=y[chosen], stderr=stderr[chosen])
                bars = {"capsize": 1.5, "elinewidth": 0.8}
                _draw_estimates(ax, estimates, look, bars, marked_by, marker_size=5)
        if log_x:
            scales.set_log_scale_with_zero(ax, np.unique(parameters))
        if self.log_y:
            scales.set_plain_log_scale(ax.yaxis, most=np.inf)
        has_horizontal_lines_alone = not len(scales.drawn_values(ax.xaxis))
        if has_horizontal_lines_alone and len(np.unique(x)) > 1:
            ax.set_xlim(x.min(), x.max())
        ax.set_xlabel(self.x_label or results.axis(path))
        ax.set_ylabel(self.y_label or phrases.axis_of(self.metric))
        return style.add_title_and_legend(figure, self.title)


@dataclass(frozen=True, kw_only=True)
class _Estimates:
    """A filter's estimates over a parameter: arrays (n,)."""

    x: Array
    """places on the horizontal axis"""
    value: Array
    stderr: Array


def _draw_estimates(
    ax: Axes,
    estimates: _Estimates,
    look: LineStyle,
    bars: LineStyle,
    marked_by: Measure | None,
    marker_size: float,
) -> None:
    """Draw a filter's line with error bars, and mark the best value by a metric.

    ``look`` has the line's label. ``bars`` is the look of the error bars. No value is marked if the
    metric ``marked_by`` is None.
    """
    x = estimates.x
    y = estimates.value
    if not filter_lines.draw_filter_line(ax, x, y, look):
        return
    label = look["label"]
    color = look["color"]
    filter_lines.draw_error_bars(ax, x, y, estimates.stderr, label, color, **bars)
    if marked_by is not None:
        best = best_place(y, marked_by)
        ax.plot(
            x[best],
            y[best],
            "o",
            color=color,
            markersize=marker_size,
            zorder=3,
            label=f"_{label}",
        )


def _common_number(value: object) -> float | None:
    """Return the number of a grid value; of linked paths the number that all of them have."""
    values = value if isinstance(value, list) else [value]
    if not values or not is_number(values[0]):
        return None
    first: float = values[0]
    if any(other != first for other in values):
        return None
    return first


def _parameter_values(results: Results, path: str, rows: Columns) -> Array:
    """Return a path's values in rows of a file, which has lists as texts, as numbers (n,)."""
    numbers = {str(point[path]): _common_number(point[path]) for point in results.grid_points}
    return np.array([numbers.get(str(value), value) for value in rows[path]], dtype=float)


def best_place(values: Array, metric: Measure) -> int:
    """Return the place of the best among numbers (n,), which may have NaN."""
    better = metric.family[0].better
    if better == "higher":
        return int(np.nanargmax(values))
    if better == "one":
        return int(np.nanargmin(np.abs(values - 1.0)))
    if better == "zero":
        return int(np.nanargmin(np.abs(values)))
    return int(np.nanargmin(values))


_ROW_IN = 2.6
"""Height of a row of panels."""
_EXTRA_IN = 0.6
"""Height of titles and labels beside the rows."""
_MOST_ERRORS = 2
"""Number of errors that are shown by default."""
_MOST_TEXT = 8
"""Values along an axis up to which a heat map shows its numbers."""
_WIDE = 10.0
"""Ratio of the largest to the least metric from which on the vertical axis is logarithmic."""
_WIDE_X = 50.0
"""Ratio of the largest to the least parameter from which on the horizontal axis is logarithmic."""
_MOST_LEVELS = 3
"""Filters that are not varied and are all drawn; of more only the best is drawn."""


@dataclass(frozen=True, kw_only=True)
class _SectionPoint:
    """A filter's metric at one combination of the shown paths' values."""

    path_values: tuple[Any, ...]
    """values of the shown paths, in their order"""
    value: float
    stderr: float


class _Section:
    """summary.csv where all paths but the shown ones have their first values."""

    def __init__(self, results: Results, paths: Sequence[str]) -> None:
        self.results = results
        self.paths = paths
        first_point = results.points()[0]
        first_values = {path: v for path, v in first_point.items() if path not in paths}
        self._rows = results.columns("summary", first_values)
        self.values = {path: list(dict.fromkeys(self._rows[path].tolist())) for path in paths}
        """values of each shown path, in order"""

    def points_of(self, label: str, metric: Measure) -> list[_SectionPoint]:
        """Return the points at which a filter's metric has a number."""
        rows = self._rows.where(filter=label, metric=str(metric))
        points = []
        for *path_values, value, stderr in rows.tuples([*self.paths, "value", "stderr"]):
            if np.isfinite(value):
                point = _SectionPoint(path_values=tuple(path_values), value=value, stderr=stderr)
                points.append(point)
        return points


@register("figures", "sweep")
@dataclass(frozen=True, kw_only=True)
class SweepFigure(FigureKind):
    """Metrics of summary.csv over one path of the grid, a panel each; the first one over two paths.

    Over one path: the filters that it varies, the best value of each marked, with bars of two standard
    errors. A filter that the path leaves as it is is a horizontal line; of more than three such filters
    only the best is drawn. Over two paths: a heat map for each filter that they vary, the best value
    framed. Other paths keep their first values, and filters that only they vary are left out. A key of
    the scenario changes the problem, so that no value is marked the best.
    """

    paths: tuple[str, ...]
    """one path of the grid, or two"""
    metrics: dict[str, OfSummary] = field(default_factory=dict)
    """label of the axis: metric of summary.csv; default: the first errors and ANEES, or log scores"""
    filters: tuple[str, ...] | None = None
    """labels to draw; default: all"""

    def conflicts(self, points: Sequence[Point]) -> dict[str, str]:
        """Reject other than one or two paths of the grid."""
        if not 1 <= len(self.paths) <= 2:
            return {"paths": f"{len(self.paths)} paths; name one or two"}
        for path in self.paths:
            problems = missing_paths(points, paths=path)
            if problems:
                return problems
        return {}

    def default_caption(self, results: Results) -> str:
        """Return where each filter is best by the first metric."""
        metrics = list(self._metrics(results).values())
        if not metrics or self._changes_problem():
            return ""
        metric = metrics[0]
        section = _Section(results, self.paths)
        parts = []
        for label in self._varied_labels(results):
            points = section.points_of(label, metric)
            if points:
                best = points[best_place(np.array([point.value for point in points]), metric)]
                where = phrases.heading(dict(zip(self.paths, best.path_values, strict=False)))
                parts.append(f"{named(label)} {rounded(best.value, 3)} at {where}")
        if not parts:
            return ""
        return f"Best: {'; '.join(parts)}."

    def draw(self, results: Results) -> Figure:
        """Return panels of metrics, or of filters."""
        section = _Section(results, self.paths)
        if len(self.paths) == 2:
            return self._draw_heat_maps(section)
        return self._draw_lines(section)

    def _draw_lines(self, section: _Section) -> Figure:
        """Draw a panel per metric over the one path."""
        results = section.results
        path = self.paths[0]
        metrics = self._metrics(results)
        values = section.values[path]
        is_numeric = all(map(is_number, values))
        figure, axes = style.panel_grid(len(metrics), _ROW_IN, _EXTRA_IN)
        drawn_labels = set[str]()
        for metric in metrics.values():
            drawn_labels.update(self._labels_to_draw(section, metric))
        looks = results.line_styles(
            [label for label in results.chosen(self.filters) if label in drawn_labels]
        )
        for ax, (y_label, metric) in zip(axes, metrics.items(), strict=False):
            heights = self._draw_metric(ax, section, metric, looks, is_numeric)
            if not is_numeric:
                ax.set_xticks(range(len(values)), [str(value) for value in values])
            elif scales.spans(values, _WIDE_X):
                ax.set_xscale("log")
            if scales.spans(heights, _WIDE):
                scales.set_plain_log_scale(ax.yaxis, most=np.inf)
            ax.set(xlabel=results.axis(path), ylabel=y_label)
        return style.add_title_and_legend(figure, self.title)

    def _draw_metric(
        self,
        ax: Axes,
        section: _Section,
        metric: Measure,
        looks: Mapping[str, LineStyle],
        is_numeric: bool,
    ) -> list[float]:
        """Draw a metric of each filter, with its look, over the path; return all its values.

        If the values of the path are no numbers, they stand at 0, 1, 2, ...
        """
        values = section.values[self.paths[0]]
        varied = self._varied_labels(section.results)
        marked_by = None if self._changes_problem() else metric
        heights: list[float] = []
        for label in self._labels_to_draw(section, metric):
            points = section.points_of(label, metric)
            heights += [float(point.value) for point in points]
            look = {"label": label, **looks[label]}
            if points and label not in varied:
                ax.axhline(points[0].value, **look | {"linewidth": 0.9})
            elif points:
                x = [point.path_values[0] for point in points]
                if not is_numeric:
                    x = [values.index(value) for value in x]
                estimates = _Estimates(
                    x=np.array(x, dtype=float),
                    value=np.array([point.value for point in points], dtype=float),
                    stderr=np.array([point.stderr for point in points], dtype=float),
                )
                dotted = look | {"marker": "o", "markersize": 3}
                _draw_estimates(ax, estimates, dotted, {"capsize": 2}, marked_by, marker_size=6)
        return heights

    def _draw_heat_maps(self, section: _Section) -> Figure:
        """Draw a panel per filter over the two paths, on one color scale; the best value is framed."""
        results = section.results
        x_path, y_path = self.paths
        metrics = self._metrics(results)
        bar_label, metric = next(iter(metrics.items()), ("", measured("mean(rmse)")))
        fields = self._fields(section, metric)
        finite_values = [values[np.isfinite(values)] for values in fields.values()] or [np.zeros(1)]
        least = min(values.min() for values in finite_values)
        greatest = max(values.max() for values in finite_values)
        figure, axes = style.panel_grid(len(fields), _ROW_IN, _EXTRA_IN)
        for ax, (label, values) in zip(axes, fields.items(), strict=False):
            image = ax.imshow(values, origin="lower", aspect="auto", vmin=least, vmax=greatest)
            columns = [phrases.number(value) for value in section.values[x_path]]
            rows = [phrases.number(value) for value in section.values[y_path]]
            ax.set_xticks(range(len(columns)), columns)
            ax.set_yticks(range(len(rows)), rows)
            ax.set_title(style.wrap_label(label))
            ax.grid(visible=False)
            most_text = _MOST_TEXT if len(axes) == 1 else _MOST_TEXT // 2
            if max(values.shape) <= most_text:
                write_cells(ax, values, "{:.3g}".format, image, 8)
            if not self._changes_problem():
                best = best_place(values.ravel(), metric)
                row, column = np.unravel_index(best, values.shape)
                _outline_cell(ax, int(row), int(column))
        figure.supxlabel(results.axis(x_path))
        figure.supylabel(results.axis(y_path))
        style.set_title(figure, self.title)
        if fields:
            figure.colorbar(image, ax=axes, label=bar_label)
        return figure

    def _fields(self, section: _Section, metric: Measure) -> dict[str, Array]:
        """Return the metric over both paths, (values of the second, values of the first), by label.

        Only varied filters with any number have a field. NaN stands where a filter has no number.
        """
        x_path, y_path = self.paths
        columns = section.values[x_path]
        rows = section.values[y_path]
        fields: dict[str, Array] = {}
        for label in self._varied_labels(section.results):
            values = np.full((len(rows), len(columns)), np.nan)
            for point in section.points_of(label, metric):
                x, y = point.path_values
                values[rows.index(y), columns.index(x)] = point.value
            if np.isfinite(values).any():
                fields[label] = values
        return fields

    def _metrics(self, results: Results) -> dict[str, Measure]:
        """Return the metrics to draw, by the label of their axis."""
        return self.metrics or shown_metrics(results)

    def _changes_problem(self) -> bool:
        """Return whether a path is of the scenario, so that its values are different problems."""
        return any(is_of_scenario(path) for path in self.paths)

    def _varied_labels(self, results: Results) -> list[str]:
        """Return the chosen filters that the shown paths vary."""
        chosen = results.chosen(self.filters)
        return [label for label in chosen if _is_varied(results, self.paths, label)]

    def _labels_to_draw(self, section: _Section, metric: Measure) -> list[str]:
        """Return the filters that the path varies, and those that no path varies; of many the best."""
        results = section.results
        chosen = results.chosen(self.filters)
        varied = self._varied_labels(results)
        levels: dict[str, float] = {}
        for label in chosen:
            if not _is_varied(results, results.grid, label):
                points = section.points_of(label, metric)
                if points:
                    levels[label] = points[0].value
        if len(levels) > _MOST_LEVELS:
            best = list(levels)[best_place(np.array(list(levels.values())), metric)]
            levels = {best: levels[best]}
        return [label for label in chosen if label in varied or label in levels]


def shown_metrics(results: Results) -> dict[str, Measure]:
    """Return the axis label and metric: the first errors over the whole run and ANEES, or log scores."""
    stored = set(results.columns("summary")["metric"])
    metrics = [measured(f"mean({name})") for name in ranking_metrics(results)[:_MOST_ERRORS]]
    if "anees" in stored:
        metrics.append(measured("anees"))
    elif "mean(anis)" in stored:
        metrics.append(measured("mean(anis)"))
    by_label: dict[str, Measure] = {}
    for metric in metrics:
        if str(metric) == "anees":
            by_label["ANEES"] = metric
        elif str(metric) in stored:
            by_label[head_of("mean", metric)] = metric
    return by_label


def _is_varied(results: Results, paths: Sequence[str], label: str) -> bool:
    """Return whether one of the paths changes the filter or its problem."""
    filters = results.config["filters"]
    return any(is_of_scenario(path) or label in filters_of(path, filters) for path in paths)


def _outline_cell(ax: Axes, row: int, column: int) -> None:
    """Draw a frame around a cell of a heat map."""
    from matplotlib.patches import Rectangle

    lower_left = (column - 0.5, row - 0.5)
    frame = Rectangle(
        lower_left, 1, 1, fill=False, edgecolor=style.COLORS[1], linewidth=2, zorder=5
    )
    frame.set_clip_on(False)
    ax.add_patch(frame)
