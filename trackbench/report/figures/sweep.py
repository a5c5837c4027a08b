"""Figure kinds over the keys that a grid varies: `sweep`, and a metric over one key."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from trackbench.config.experiment import Point
from trackbench.config.grid import filters_of, is_of_scenario
from trackbench.core.arrays import Array
from trackbench.evaluation.metric_expression import Measure, OfSummary, measure, measured
from trackbench.field_types import is_number
from trackbench.registry import register
from trackbench.report.findings import phrases
from trackbench.report.findings.phrases import mean_of, named, three_digits
from trackbench.report.findings.ranking import ranking_metrics
from trackbench.report.kinds import FigureKind
from trackbench.report.plotting import style
from trackbench.report.plotting.scales import drawn_values, has_logarithm, plain_log_axis
from trackbench.report.plotting.style import Axes, Figure, LineStyle
from trackbench.report.results import Results, missing_paths
from trackbench.results.frames import Columns

_GAP = 0.2  # of a decade's factor: where zero stands on a logarithmic axis, left of the least value


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
        found = missing_paths(points, parameter=path)
        values = [point.values[path] for point in points] if not found else []
        words = [value for value in values if _common_number(value) is None]
        return {"parameter": f"{words[0]!r} in the grid of {path} is no number"} if words else found

    def default_caption(self, results: Results) -> str:
        """Return where each filter is best."""
        path, shown = self._shown(results)
        name, unit = phrases.quantity(path)
        told = []
        for label in results.chosen(self.filters) if not is_of_scenario(path) else ():
            rows = shown.where(filter=label)
            rows = rows.chosen(np.isfinite(rows["value"]))
            x, y = _abscissas(results, path, rows), rows["value"]
            if len(y) and np.ptp(y) > 0.0:
                best = best_place(y, self.metric)
                number = three_digits(float(y[best]))
                told.append(f"{named(label)} {number} at {x[best]:g} {unit}".rstrip())
        return f"Best over {name}: {', '.join(told)}." if told else ""

    def _shown(self, results: Results) -> tuple[str, Columns]:
        """Return the horizontal axis's path and rows of summary.csv at the other paths' first values."""
        path = self.parameter or results.grid[0]
        held = {p: v for p, v in results.points()[0].items() if p != path}
        return path, results.columns("summary", held).where(metric=str(self.metric))

    def draw(self, results: Results) -> Figure:
        """Return one panel; other paths of the grid are held at their first values."""
        path, shown = self._shown(results)
        figure, ax = style.subplots(1, 1, 3.6)
        every_x = _abscissas(results, path, shown)
        log_x = self.log_x and has_logarithm(every_x)
        labels = results.chosen(self.filters)
        for label in labels:
            rows = shown.where(filter=label)
            rows = rows.chosen(np.argsort(_abscissas(results, path, rows), kind="stable"))
            x, y, stderr = _abscissas(results, path, rows), rows["value"], rows["stderr"]
            shown_x = _moved_zero(x) if log_x else x
            self._line(ax, shown_x, y, stderr, label, results.line_style(label))
            if np.isfinite(y).any() and np.ptp(y) != 0.0 and not is_of_scenario(path):
                best = best_place(y, self.metric)
                color = results.line_style(label)["color"]
                ax.plot(shown_x[best], y[best], "o", color=color, markersize=5, zorder=3,
                        label=f"_{label}")  # fmt: skip
        if log_x:
            _logarithmic(ax, np.unique(every_x))
        if self.log_y:
            plain_log_axis(ax.yaxis, most=float("inf"))
        ends = _moved_zero(every_x) if log_x else every_x
        if not len(drawn_values(ax.xaxis)) and len(np.unique(ends)) > 1:  # horizontal lines alone
            ax.set_xlim(ends.min(), ends.max())
        ax.set_xlabel(self.x_label or results.axis(path))
        ax.set_ylabel(self.y_label or phrases.error_of(self.metric))
        style.title(figure, self.title)
        style.legend_outside(figure)
        return figure

    def _line(
        self, ax: Axes, x: Array, y: Array, stderr: Array, label: str, look: LineStyle
    ) -> None:
        if len(y) and np.ptp(y) == 0.0:
            ax.axhline(y[0], label=label, **look | {"linewidth": 0.9})
            return
        ax.plot(x, y, label=label, **look)
        bars = 2.0 * stderr
        ax.errorbar(x, y, bars, fmt="none", color=look["color"], capsize=1.5, elinewidth=0.8,
                    label=f"_{label}")  # fmt: skip


def _common_number(value: object) -> float | None:
    """Return the number of a grid value; of linked paths the one that all of them have."""
    values = value if isinstance(value, list) else [value]
    first = values[0] if values and is_number(values[0]) else None
    return first if all(other == first for other in values) else None


def _abscissas(results: Results, path: str, rows: Columns) -> Array:
    """Return the numbers (n,) of a path in rows of a file, which has lists as texts."""
    given = {str(point[path]): _common_number(point[path]) for point in results.grid_points}
    return np.array([given.get(str(value), value) for value in rows[path]], dtype=float)


def best_place(values: Array, metric: Measure) -> int:
    """Return the place of the best among numbers, NaN where there is none."""
    better = metric.family[0].better
    if better == "higher":
        return int(np.nanargmax(values))
    ideal = {"one": 1.0, "zero": 0.0}.get(better)
    return int(np.nanargmin(values if ideal is None else np.abs(values - ideal)))


def _moved_zero(x: Array) -> Array:
    positive = x[x > 0.0]
    return np.where(x > 0.0, x, _GAP * positive.min() if len(positive) else 1.0)


def _logarithmic(ax: Axes, values: Array) -> None:
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

    from trackbench.report.plotting.canvas import power_of_ten

    ax.set_xscale("log")
    if values[0] > 0.0:
        return
    zero = _moved_zero(values)[0]
    decades = np.unique(np.ceil(np.log10(values[1:]) - 1e-9))
    ax.xaxis.set_major_locator(FixedLocator([zero, *10.0**decades]))
    ax.xaxis.set_minor_locator(NullLocator())

    def words(x: float, _: object) -> str:
        return "0" if np.isclose(x, zero) else power_of_ten(round(np.log10(x)))

    ax.xaxis.set_major_formatter(FuncFormatter(words))


_ROW_IN = 2.6
_MOST_ERRORS = 2
_MOST_TEXT = 8  # values along an axis up to which a heat map says its numbers
_DECADE = 10.0  # between the ends of an axis that is logarithmic
_FEW = 3  # filters that are not varied and drawn all


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
        return next((e for p in self.paths if (e := missing_paths(points, paths=p))), {})

    def default_caption(self, results: Results) -> str:
        """Return where each filter is best by the first metric."""
        held, metrics = _Held(results, self.paths), list(self._metrics(results).values())
        told = []
        changes_problem = any(map(is_of_scenario, self.paths))
        for label in self._labels(results)[1] if metrics and not changes_problem else ():
            rows = held.of(label, metrics[0])
            if rows:
                best = rows[best_place(np.array([row[-2] for row in rows]), metrics[0])]
                at = phrases.heading(dict(zip(self.paths, best, strict=False)))
                told.append(f"{named(label)} {three_digits(best[-2])} at {at}")
        return f"Best: {'; '.join(told)}." if told else ""

    def draw(self, results: Results) -> Figure:
        """Return panels of metrics, or of filters."""
        held, metrics = _Held(results, self.paths), self._metrics(results)
        labels, varied = self._labels(results)
        if len(self.paths) == 2:
            return _heat_maps(held, *self.paths, varied, metrics, self.title)
        return _lines(held, self.paths[0], labels, varied, metrics, self.title)

    def _metrics(self, results: Results) -> dict[str, Measure]:
        return self.metrics or shown_metrics(results)

    def _labels(self, results: Results) -> tuple[list[str], list[str]]:
        """Return filters that are shown, and those of them that these paths vary."""
        varied = [b for b in results.labels if any(_varies(results, p, b) for p in self.paths)]
        elsewhere = {b for p in results.grid for b in results.filters if _varies(results, p, b)}
        labels = [b for b in results.chosen(self.filters) if b in varied or b not in elsewhere]
        return labels, [b for b in labels if b in varied]


def shown_metrics(results: Results) -> dict[str, Measure]:
    """Return the axis label and metric: the first errors over the whole run and ANEES, or log scores."""
    there = set(results.columns("summary")["metric"])
    ranked = [measured(f"mean({name})") for name in ranking_metrics(results)[:_MOST_ERRORS]]
    consistency = [measured(name) for name in ("anees", "mean(anis)") if name in there]
    chosen = [m for m in (*ranked, *consistency[:1]) if str(m) in there]
    return {"ANEES" if str(m) == "anees" else mean_of(m): m for m in chosen}


def _varies(results: Results, path: str, label: str) -> bool:
    return is_of_scenario(path) or label in filters_of(path, results.config["filters"])


class _Held:
    """summary.csv where all paths but the shown ones have their first values."""

    def __init__(self, results: Results, paths: Sequence[str]) -> None:
        self.results, self.paths = results, paths
        points = results.points()
        held = {p: v for p, v in points[0].items() if p not in paths}
        self._rows = results.columns("summary", held)
        self.values = {path: list(dict.fromkeys(self._rows[path].tolist())) for path in paths}

    def of(self, label: str, metric: Measure) -> list[tuple[Any, ...]]:
        """Return values of the paths, value and standard error where there is a number."""
        rows = self._rows.where(filter=label, metric=str(metric))
        found = rows.tuples([*self.paths, "value", "stderr"])
        return [row for row in found if np.isfinite(row[-2])]


def _lines(
    held: _Held,
    path: str,
    labels: list[str],
    varied: list[str],
    metrics: dict[str, Measure],
    title: str,
) -> Figure:
    figure, axes = style.panel_grid(len(metrics), _ROW_IN, 0.6)
    values = held.values[path]
    numeric = all(map(is_number, values))
    for ax, (words, metric) in zip(axes, metrics.items(), strict=False):
        drawn = _drawn(held, labels, varied, metric)
        for label in drawn:
            _line(ax, held, label, metric, None if numeric else values, label in varied)
        _scale(ax, values, numeric)
        heights = [float(row[-2]) for label in drawn for row in held.of(label, metric)]
        if heights and 0.0 < _DECADE * min(heights) < max(heights):
            plain_log_axis(ax.yaxis, most=np.inf)
        ax.set(xlabel=held.results.axis(path), ylabel=words)
    style.title(figure, title)
    style.legend_outside(figure)
    return figure


def _drawn(held: _Held, labels: list[str], varied: list[str], metric: Measure) -> list[str]:
    """Return the filters that vary and those that do not; of many the best."""
    levels = {b: rows[0][-2] for b in labels if b not in varied and (rows := held.of(b, metric))}
    if len(levels) <= _FEW:
        return [b for b in labels if b in varied or b in levels]
    best = [*levels][best_place(np.array([*levels.values()]), metric)]
    return [b for b in labels if b in varied or b == best]


def _line(
    ax: Axes, held: _Held, label: str, metric: Measure, words: list[Any] | None, varied: bool
) -> None:
    rows, look = held.of(label, metric), held.results.line_style(label)
    if not rows:
        return
    if not varied:
        ax.axhline(rows[0][-2], label=label, **look | {"linewidth": 0.9})
        return
    x = [row[0] if words is None else words.index(row[0]) for row in rows]
    y, stderr = (np.array([row[i] for row in rows], dtype=float) for i in (-2, -1))
    bars = np.where(np.isfinite(stderr), 2.0 * stderr, 0.0)
    ax.plot(x, y, label=label, marker="o", markersize=3, **look)
    more: Any = {"color": look["color"], "label": f"_{label}"}
    ax.errorbar(x, y, bars, fmt="none", capsize=2, **more)
    if not any(map(is_of_scenario, held.paths)):
        best = best_place(y, metric)
        ax.plot(x[best], y[best], "o", markersize=6, zorder=3, **more)


def _scale(ax: Axes, values: list[Any], numeric: bool) -> None:
    if not numeric:
        ax.set_xticks(range(len(values)), [str(v) for v in values])
    elif min(values) > 0 and max(values) >= 50 * min(values):
        ax.set_xscale("log")


def _heat_maps(
    held: _Held, x: str, y: str, labels: list[str], metrics: dict[str, Measure], title: str
) -> Figure:
    """Return a panel per filter, on one color scale; the best value is framed."""
    words, metric = next(iter(metrics.items()), ("", measured("mean(rmse)")))
    # Fields of the filters that have any number, and their common color scale.
    across, down = held.values[x], held.values[y]
    fields = {label: _field(held, label, metric, across, down) for label in labels}
    fields = {label: field for label, field in fields.items() if np.isfinite(field).any()}
    figure, axes = style.panel_grid(len(fields), _ROW_IN, 0.6)
    finite = np.concatenate([f[np.isfinite(f)] for f in fields.values()] or [np.zeros(1)])
    for ax, (label, values) in zip(axes, fields.items(), strict=False):
        image = ax.imshow(
            values, origin="lower", aspect="auto", vmin=finite.min(), vmax=finite.max()
        )
        ax.set_xticks(range(len(across)), [phrases.number(v) for v in across])
        ax.set_yticks(range(len(down)), [phrases.number(v) for v in down])
        ax.set_title(style.wrap_label(label))
        ax.grid(visible=False)
        _write_values(ax, values, finite, few=len(axes) == 1)
        # Frame the best value, unless the points are different scenarios.
        if not any(map(is_of_scenario, held.paths)):
            _frame(ax, np.unravel_index(best_place(values.ravel(), metric), values.shape))
    figure.supxlabel(held.results.axis(x))
    figure.supylabel(held.results.axis(y))
    style.title(figure, title)
    if fields:
        figure.colorbar(image, ax=axes, label=words)
    return figure


def _field(held: _Held, label: str, metric: Measure, across: list[Any], down: list[Any]) -> Array:
    """Return the metric by grid values, an array (len(down), len(across)) with NaN in empty cells."""
    found = np.full((len(down), len(across)), np.nan)
    for a, b, value, _ in held.of(label, metric):
        found[down.index(b), across.index(a)] = value
    return found


def _write_values(ax: Axes, values: Array, finite: Array, few: bool) -> None:
    if max(values.shape) > (_MOST_TEXT if few else _MOST_TEXT // 2):
        return
    middle = 0.5 * (finite.min() + finite.max())
    for (i, j), value in np.ndenumerate(values):
        if np.isfinite(value):
            color = "black" if value > middle else "white"
            ax.text(j, i, f"{value:.3g}", ha="center", va="center", color=color, fontsize=8)


def _frame(ax: Axes, at: tuple[Any, ...]) -> None:
    from matplotlib.patches import Rectangle

    i, j = at
    frame = Rectangle(
        (j - 0.5, i - 0.5), 1, 1, fill=False, edgecolor=style.COLORS[1], linewidth=2, zorder=5
    )
    frame.set_clip_on(False)
    ax.add_patch(frame)
