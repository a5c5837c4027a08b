"""Figure kind `heat-map`: a statistic over two paths of the grid, or the z of every pair of filters."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np

from trackbench.config.experiment import Point
from trackbench.core.arrays import Array
from trackbench.errors import counted
from trackbench.evaluation.metric_expression import Comparison, measure, measured
from trackbench.registry import register
from trackbench.report.expressions import Evaluator
from trackbench.report.findings import phrases
from trackbench.report.kinds import FigureKind
from trackbench.report.paired import Pair
from trackbench.report.plotting import style
from trackbench.report.plotting.page_formats import sheet
from trackbench.report.plotting.scales import has_logarithm
from trackbench.report.plotting.style import Axes, Figure, LineStyle
from trackbench.report.results import Results, missing_paths, points_of
from trackbench.results.point_facts import GridPoint
from trackbench.statistics import rules
from trackbench.statistics.estimates import MISSING

_LETTER_IN, _DIGIT_IN = 0.075, 0.05  # widths of the ticks' and of the cells' letters


@register("figures", "heat-map")
@dataclass(frozen=True, kw_only=True)
class HeatMap(FigureKind):
    """A statistic over the grid and the filters; without a grid, the paired z of every two filters."""

    filters: tuple[str, ...] | None = None
    """labels to draw; default: all"""
    metric: Comparison = measure("mean(rmse)")
    """statistic in the cells; without a grid, the metric per run in brackets is compared"""
    x: str | None = None
    """path of the grid along the horizontal axis; default: the first"""
    y: str | None = None
    """path of the grid along the vertical axis; default: the filters"""
    log: bool = False
    """logarithmic colors"""
    bar_label: str = ""
    """label of the color bar, with the unit; default: the metric"""

    def conflicts(self, points: Sequence[Point]) -> dict[str, str]:
        """Reject axes that are no paths of the grid."""
        return missing_paths(points, x=self.x, y=self.y)

    def default_caption(self, results: Results) -> str:
        """Return how to read the map, and for pairs how many differ."""
        if results.grid:
            return ""
        pairs = self._shown_pairs(results)
        alike = sum(p.word not in ("better", "worse") for p in pairs)
        words = "Blue: the filter on the left has the smaller one, in standard errors of the difference."
        count = f"{alike} of {counted(len(pairs), 'pair')} do not differ significantly"
        return f"{words} {count} (at {100 * rules.LEVEL:g} % over all pairs)."

    def _shown_pairs(self, results: Results) -> list[Pair]:
        labels = results.chosen(self.filters)
        every = chain.from_iterable(pairs for _, pairs in results.pairs)
        pairs = [p for p in every if measured(p.metric).metric == self.metric.name]
        return [p for p in pairs if {p.filter_a, p.filter_b} <= {*labels}]

    def draw(self, results: Results) -> Figure:
        """Return one panel; with two paths, one per filter."""
        labels = results.chosen(self.filters)
        if not results.grid:
            return self._pairs(results, labels)
        x = self.x or results.grid[0]
        points = results.points()
        columns = list(dict.fromkeys(point[x] for point in points))
        if self.y is None:
            rows = [self._row(results, x, columns, {}, label) for label in labels]
            names = [style.wrap_label(b) for b in labels]
            return self._panels(results.axis(x), columns, "", names, {"": np.array(rows)})
        levels = list(dict.fromkeys(point[self.y] for point in points))
        panels = {}
        for label in labels:
            rows = [self._row(results, x, columns, {self.y: r}, label) for r in levels]
            panels[label] = np.array(rows)
        return self._panels(results.axis(x), columns, results.axis(self.y), levels, panels)

    def _row(
        self, results: Results, x: str, columns: list[Any], rest: GridPoint, label: str
    ) -> list[float]:
        cells = []
        for value in columns:
            points = points_of(results, {x: value, **rest})
            term = Evaluator(results, points[0]).term(self.metric.of(label)) if points else MISSING
            cells.append(term.value)
        return cells

    def _panels(
        self, x: str, columns: list[Any], y: str, levels: list[Any], panels: dict[str, Array]
    ) -> Figure:
        from matplotlib.colors import LogNorm, Normalize

        finite = np.concatenate([a[np.isfinite(a)] for a in panels.values()])
        norm = Normalize(*((finite.min(), finite.max()) if len(finite) else (1, 2)))
        if self.log and has_logarithm(finite):
            # Clipped: zero has the color of the least positive value.
            norm = LogNorm(finite[finite > 0.0].min(), finite.max(), clip=True)
        shown = dict(list(panels.items())[: style.MOST_PANELS])
        figure, axes = style.make_panels(len(shown), 1, 1.2 + 0.28 * len(levels), sharey=True)
        cell_in = (sheet().width_in - 2.0) / min(len(shown), sheet().across) / len(columns)
        for (ax,), (name, values) in zip(axes, shown.items(), strict=True):
            image = ax.imshow(values, aspect="auto", cmap="viridis", norm=norm)
            names = [phrases.number(c) for c in columns]
            _ticks(ax, names, [phrases.number(v) for v in levels], cell_in)
            ax.set_title(style.wrap_label(name))
            ax.set_xlabel(x)
            if _has_room(values, "{:.3g}".format, cell_in):
                write_cells(ax, values, "{:.3g}".format, image)
        axes[0][0].set_ylabel(y)
        figure.colorbar(image, ax=list(axes[:, 0]), label=self.bar_label or str(self.metric))
        style.set_title(figure, self.title)
        return figure

    def _pairs(self, results: Results, labels: list[str]) -> Figure:
        z = np.full((len(labels), len(labels)), np.nan)
        for pair in self._shown_pairs(results):
            i, j = labels.index(pair.filter_a), labels.index(pair.filter_b)
            z[i, j], z[j, i] = pair.comparison.z, -pair.comparison.z
        figure, ax = style.subplots(height_in=2.0 + 0.32 * len(labels))
        image = ax.imshow(z, aspect="auto", cmap="RdBu_r", vmin=-10, vmax=10)
        names = [style.wrap_label(b) for b in labels]
        _ticks(ax, names, names, np.inf)
        ax.tick_params(axis="x", rotation=45)
        for tick in ax.get_xticklabels():
            tick.set_ha("right")
        if _has_room(z, _z_text, (sheet().width_in - 2.5) / len(labels)):
            write_cells(ax, z, _z_text, image)
            # Texts within the axes do not change the layout, which would measure each of them.
            for text in ax.texts:
                text.set_in_layout(False)
        ax.set(xlabel="less that of this filter", ylabel=f"{self.metric.name} of this filter")
        style.set_title(figure, self.title)
        figure.colorbar(image, ax=ax, extend="both", label="z (blue: left is smaller)")
        return figure


def _ticks(ax: Axes, columns: list[str], rows: list[str], cell_in: float) -> None:
    """Turn labels upright where the columns are too narrow."""
    upright = max(map(len, columns)) * _LETTER_IN > cell_in
    ax.set_xticks(range(len(columns)), columns, rotation=90 if upright else 0)
    ax.set_yticks(range(len(rows)), rows)
    ax.grid(visible=False)
    ax.spines[:].set_visible(False)
    ax.tick_params(length=0)


def _z_text(z: float) -> str:
    return f"{z:+.1f}" if abs(z) < 100 else f"{z:+.0f}"


def _has_room(values: Array, text: Callable[[float], str], cell_in: float) -> bool:
    return max(len(text(value)) for value in values.flat) * _DIGIT_IN <= cell_in


def write_cells(
    ax: Axes, values: Array, text: Callable[[float], str], image: Any, size: float = 6.5
) -> None:
    """Write the finite values (rows, columns) into the cells, black or white."""
    colors = image.cmap(image.norm(values))
    for (i, j), value in np.ndenumerate(values):
        if np.isfinite(value):
            r, g, b, _ = colors[i, j]
            dark = 0.299 * r + 0.587 * g + 0.114 * b < 0.5
            look: LineStyle = {"fontsize": size, "color": "white" if dark else "black"}
            ax.text(j, i, text(value), ha="center", va="center", **look)
