"""Figure kinds over the keys that a grid varies: `sweep`, and a metric over one key."""

from collections.abc import Sequence
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
from trackbench.report.plotting import scales, style
from trackbench.report.plotting.style import Axes, Figure, LineStyle
from trackbench.report.results import Results, missing_paths
from trackbench.results.frames import Columns


@register("figures", "rmse-vs-parameter")
@dataclass(frozen=True, kw_only=True)
class RmseVsParameter(FigureKind):
    """A metric of summary.csv against a grid parameter, a line per filter, each best value marked.

    Linked paths with equal values are one parameter.
    Of a key of the scenario, which changes the problem, no value is the best.
    Bars are two standard errors. A filter that the parameter does not touch is a horizontal line. Zero
    on a logarithmic axis stands at the left, apart.
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
        for value in [] if problems else [point.values[path] for point in points]:
            if _common_number(value) is None:
                what = f"{value!r} in the grid of {path} is no number"
                if len(single_paths(path)) > 1:
                    what += ": give the linked paths equal values, or show these in a table"
                return {"parameter": what}
        return problems

    def default_caption(self, results: Results) -> str:
        """Return where each filter is best."""
        path, shown = self._shown(results)
        name, unit = phrases.quantity(path)
        parts = []
        for label in results.chosen(self.filters) if not is_of_scenario(path) else ():
            rows = shown.where(filter=label)
            rows = rows.chosen(np.isfinite(rows["value"]))
            x, y = _abscissas(results, path, rows), rows["value"]
            if len(y) and np.ptp(y) > 0.0:
                best = best_place(y, self.metric)
                number = rounded(float(y[best]), 3)
                parts.append(f"{named(label)} {number} at {x[best]:g} {unit}".rstrip())
        return f"Best over {name}: {', '.join(parts)}." if parts else ""

    def _shown(self, results: Results) -> tuple[str, Columns]:
        """Choose the horizontal axis's path and rows of summary.csv at the other paths' first values."""
        path = self.parameter or results.grid[0]
        first_values = {p: v for p, v in results.points()[0].items() if p != path}
        return path, results.columns("summary", first_values).where(metric=str(self.metric))

    def draw(self, results: Results) -> Figure:
        """Return one panel; other paths of the grid are held at their first values."""
        path, shown = self._shown(results)
        figure, ax = style.subplots(1, 1, 3.6)
        x, y, stderr = _abscissas(results, path, shown), shown["value"], shown["stderr"]
        log_x = self.log_x and scales.has_logarithm(x)
        places = scales.moved_zero(x) if log_x else x
        order = np.argsort(places, kind="stable")
        marked = None if is_of_scenario(path) else self.metric
        for label in results.chosen(self.filters):
            rows, look = order[shown["filter"][order] == label], results.line_style(label)
            if len(rows) and np.ptp(y[rows]) == 0.0:
                ax.axhline(y[rows[0]], label=label, **look | {"linewidth": 0.9})
            else:
                estimates = places[rows], y[rows], stderr[rows]
                _line(ax, estimates, label, look, marked, 5, capsize=1.5, elinewidth=0.8)
        if log_x:
            scales.log_axis_with_zero(ax, np.unique(x))
        if self.log_y:
            scales.plain_log_axis(ax.yaxis, most=np.inf)
        has_horizontal_lines_alone = not len(scales.drawn_values(ax.xaxis))
        if has_horizontal_lines_alone and len(np.unique(places)) > 1:
            ax.set_xlim(places.min(), places.max())
        ax.set_xlabel(self.x_label or results.axis(path))
        ax.set_ylabel(self.y_label or phrases.axis_of(self.metric))
        return style.finished(figure, self.title)


def _line(
    ax: Axes,
    estimates: Sequence[Array] | Array,
    label: str,
    look: LineStyle,
    metric: Measure | None,
    size: float,
    **bars: Any,
) -> None:
    """Draw a filter's values and standard errors over x; mark the best value by ``metric``, if any."""
    x, y, stderr = estimates
    if not style.filter_line(ax, x, y, {"label": label, **look}):
        return
    style.error_bars(ax, x, y, stderr, label, look["color"], **bars)
    if metric is not None:
        best, color = best_place(y, metric), look["color"]
        ax.plot(x[best], y[best], "o", color=color, markersize=size, zorder=3, label=f"_{label}")


def _common_number(value: object) -> float | None:
    """Take the number of a grid value; of linked paths the one that all of them have."""
    values = value if isinstance(value, list) else [value]
    first = values[0] if values and is_number(values[0]) else None
    return first if all(other == first for other in values) else None


def _abscissas(results: Results, path: str, rows: Columns) -> Array:
    """Convert a path's values in rows of a file, which has lists as texts, to numbers (n,)."""
    given = {str(point[path]): _common_number(point[path]) for point in results.grid_points}
    return np.array([given.get(str(value), value) for value in rows[path]], dtype=float)


def best_place(values: Array, metric: Measure) -> int:
    """Return the place of the best among numbers, NaN where there is none."""
    better = metric.family[0].better
    if better == "higher":
        return int(np.nanargmax(values))
    ideal = {"one": 1.0, "zero": 0.0}.get(better)
    return int(np.nanargmin(values if ideal is None else np.abs(values - ideal)))


_ROW_IN = 2.6
_MOST_ERRORS = 2
_MOST_TEXT = 8  # values along an axis up to which a heat map says its numbers
_WIDE, _WIDE_X = 10.0, 50.0
"""Ratio of the largest to the least value from which on an axis is logarithmic."""
_FEW = 3  # filters that are not varied and drawn all


class _Section:
    """summary.csv where all paths but the shown ones have their first values."""

    def __init__(self, results: Results, paths: Sequence[str]) -> None:
        self.results, self.paths = results, paths
        points = results.points()
        first_values = {p: v for p, v in points[0].items() if p not in paths}
        self._rows = results.columns("summary", first_values)
        self.values = {path: list(dict.fromkeys(self._rows[path].tolist())) for path in paths}

    def of(self, label: str, metric: Measure) -> list[tuple[Any, ...]]:
        """Return values of the paths, value and standard error where there is a number."""
        rows = self._rows.where(filter=label, metric=str(metric))
        every = rows.tuples([*self.paths, "value", "stderr"])
        return [row for row in every if np.isfinite(row[-2])]


@register("figures", "sweep")
@dataclass(frozen=True, kw_only=True)
class SweepFigure(FigureKind):
    """Metrics of summary.csv over one path of the grid, a panel each; the first one over two paths.

    Over one path: the filters that it varies, the best of each marked, bars of two standard errors; of
    filters that it leaves as they are a level, if they are many the best one's only. Over two paths: a
    heat map for each filter that they vary, the best framed. Other paths keep their first values, and
    filters that only they vary are left out. Over a key of the scenario, which changes the problem, no
    value is marked the best.
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
        return next(filter(None, (missing_paths(points, paths=p) for p in self.paths)), {})

    def default_caption(self, results: Results) -> str:
        """Return where each filter is best by the first metric."""
        section, metrics = _Section(results, self.paths), list(self._metrics(results).values())
        parts = []
        changes_problem = any(map(is_of_scenario, self.paths))
        for label in self._labels(results)[1] if metrics and not changes_problem else ():
            rows = section.of(label, metrics[0])
            if rows:
                best = rows[best_place(np.array([row[-2] for row in rows]), metrics[0])]
                at = phrases.heading(dict(zip(self.paths, best, strict=False)))
                parts.append(f"{named(label)} {rounded(best[-2], 3)} at {at}")
        return f"Best: {'; '.join(parts)}." if parts else ""

    def draw(self, results: Results) -> Figure:
        """Return panels of metrics, or of filters."""
        section, (labels, varied) = _Section(results, self.paths), self._labels(results)
        if len(self.paths) == 2:
            return self._heat_maps(section, varied)
        return self._lines(section, labels, varied)

    def _lines(self, section: _Section, labels: list[str], varied: list[str]) -> Figure:
        path, metrics = self.paths[0], self._metrics(section.results)
        figure, axes = style.panel_grid(len(metrics), _ROW_IN, 0.6)
        values = section.values[path]
        numeric = all(map(is_number, values))
        for ax, (words, metric) in zip(axes, metrics.items(), strict=False):
            marked = None if is_of_scenario(path) else metric
            heights: list[float] = []
            for label in _drawn(section, labels, varied, metric):
                rows, look = section.of(label, metric), section.results.line_style(label)
                heights += [float(row[-2]) for row in rows]
                if rows and label not in varied:
                    ax.axhline(rows[0][-2], label=label, **look | {"linewidth": 0.9})
                elif rows:
                    x, y, stderr = zip(*rows, strict=True)
                    places = x if numeric else [values.index(value) for value in x]
                    estimates = np.array([places, y, stderr], dtype=float)
                    dotted = look | {"marker": "o", "markersize": 3}
                    _line(ax, estimates, label, dotted, marked, 6, capsize=2)
            if not numeric:
                ax.set_xticks(range(len(values)), [str(v) for v in values])
            elif scales.spans(values, _WIDE_X):
                ax.set_xscale("log")
            if scales.spans(heights, _WIDE):
                scales.plain_log_axis(ax.yaxis, most=np.inf)
            ax.set(xlabel=section.results.axis(path), ylabel=words)
        return style.finished(figure, self.title)

    def _heat_maps(self, section: _Section, labels: list[str]) -> Figure:
        """Draw a panel per filter, on one color scale; the best value is framed."""
        (x, y), metrics = self.paths, self._metrics(section.results)
        words, metric = next(iter(metrics.items()), ("", measured("mean(rmse)")))
        # Fields of the filters that have any number, and their common color scale.
        across, down = section.values[x], section.values[y]
        fields: dict[str, Array] = {}
        for label in labels:
            values = np.full((len(down), len(across)), np.nan)
            for a, b, value, _ in section.of(label, metric):
                values[down.index(b), across.index(a)] = value
            if np.isfinite(values).any():
                fields[label] = values
        figure, axes = style.panel_grid(len(fields), _ROW_IN, 0.6)
        finite = np.concatenate([f[np.isfinite(f)] for f in fields.values()] or [np.zeros(1)])
        for ax, (label, values) in zip(axes, fields.items(), strict=False):
            ends = {"vmin": finite.min(), "vmax": finite.max()}
            image = ax.imshow(values, origin="lower", aspect="auto", **ends)
            ax.set_xticks(range(len(across)), [phrases.number(v) for v in across])
            ax.set_yticks(range(len(down)), [phrases.number(v) for v in down])
            ax.set_title(style.wrap_label(label))
            ax.grid(visible=False)
            if max(values.shape) <= (_MOST_TEXT if len(axes) == 1 else _MOST_TEXT // 2):
                write_cells(ax, values, "{:.3g}".format, image, 8)
            # Frame the best value, unless the points are different scenarios.
            if not any(map(is_of_scenario, section.paths)):
                _frame(ax, np.unravel_index(best_place(values.ravel(), metric), values.shape))
        figure.supxlabel(section.results.axis(x))
        figure.supylabel(section.results.axis(y))
        style.title(figure, self.title)
        if fields:
            figure.colorbar(image, ax=axes, label=words)
        return figure

    def _metrics(self, results: Results) -> dict[str, Measure]:
        return self.metrics or shown_metrics(results)

    def _labels(self, results: Results) -> tuple[list[str], list[str]]:
        """Choose the filters that are shown, and those of them that these paths vary."""
        chosen = results.chosen(self.filters)
        varied = [b for b in chosen if _vary(results, self.paths, b)]
        return [b for b in chosen if b in varied or not _vary(results, results.grid, b)], varied


def shown_metrics(results: Results) -> dict[str, Measure]:
    """Return the axis label and metric: the first errors over the whole run and ANEES, or log scores."""
    stored = set(results.columns("summary")["metric"])
    ranked = [measured(f"mean({name})") for name in ranking_metrics(results)[:_MOST_ERRORS]]
    consistency = [measured(name) for name in ("anees", "mean(anis)") if name in stored]
    chosen = [m for m in (*ranked, *consistency[:1]) if str(m) in stored]
    return {"ANEES" if str(m) == "anees" else head_of("mean", m): m for m in chosen}


def _vary(results: Results, paths: Sequence[str], label: str) -> bool:
    filters = results.config["filters"]
    return any(is_of_scenario(path) or label in filters_of(path, filters) for path in paths)


def _drawn(section: _Section, labels: list[str], varied: list[str], metric: Measure) -> list[str]:
    """Choose the filters that vary and those that do not; of many the best."""
    levels = {}
    for label in labels:
        rows = section.of(label, metric)
        if rows and label not in varied:
            levels[label] = rows[0][-2]
    if len(levels) <= _FEW:
        return [b for b in labels if b in varied or b in levels]
    best = [*levels][best_place(np.array([*levels.values()]), metric)]
    return [b for b in labels if b in varied or b == best]


def _frame(ax: Axes, at: tuple[Any, ...]) -> None:
    from matplotlib.patches import Rectangle

    corner = at[1] - 0.5, at[0] - 0.5
    look: LineStyle = {"edgecolor": style.COLORS[1], "linewidth": 2, "zorder": 5}
    frame = Rectangle(corner, 1, 1, fill=False, **look)
    frame.set_clip_on(False)
    ax.add_patch(frame)
