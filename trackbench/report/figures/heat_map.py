"""Figure kind `heat-map`: a statistic over two paths of the grid, or the z of every pair of filters."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from trackbench.config.experiment import Point
from trackbench.config.table_and_figure_checks import missing_paths
from trackbench.core.arrays import Array
from trackbench.errors import counted, form_for
from trackbench.evaluation.metric_expression import Comparison, measure, measured
from trackbench.registry import register
from trackbench.report.expressions import Evaluator
from trackbench.report.figures import caption_parts
from trackbench.report.figures.heat_map_cells import cell_texts, has_room, write_cells
from trackbench.report.findings import grid_headings, metric_phrases, phrases
from trackbench.report.findings.phrases import joined
from trackbench.report.kinds import FigureKind
from trackbench.report.pairs_of_filters import Pair
from trackbench.report.plotting import style
from trackbench.report.plotting.page_formats import sheet
from trackbench.report.plotting.panels import MOST_PANELS, make_panels, set_title
from trackbench.report.plotting.scales import has_logarithm
from trackbench.report.plotting.style import Axes, Figure
from trackbench.report.plotting.tick_labels import with_true_minus
from trackbench.report.points_by_scenario import points_of
from trackbench.report.rounded_numbers import unsigned_zeros
from trackbench.report.tables_and_figures import Results
from trackbench.results.points_json import GridPoint
from trackbench.statistics import significance_rules as rules
from trackbench.statistics.estimates import MISSING
from trackbench.statistics.sample_statistics import Estimate

_LETTER_IN = 0.075
"""Width of a letter of a tick's label."""


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
        """Reject axes that are no paths of the grid; return the reason by key, empty if all is well."""
        return missing_paths(points, x=self.x, y=self.y)

    def default_caption(self, results: Results) -> str:
        """Return how to read the map, and for pairs how many do not differ significantly.

        Pairs are compared by the metric, which stands at the vertical axis. Blue is the smaller value,
        whichever is better.
        """
        if results.grid:
            paths = [self.x or results.grid[0]]
            if self.y is not None:
                paths.append(self.y)
            # `quantity` returns a path in words, and its unit.
            keys = joined(grid_headings.quantity(path)[0] for path in paths)
            words = f"{caption_parts.quantity(self.metric)} over {keys} of"
            labels = caption_parts.filters(self._labels(results))
            caption = f"{words} {labels}, {caption_parts.runs(results)} at each value"
            return f"{caption_parts.sentence(caption)} Cells have the value and its standard error."
        pairs = self._shown_pairs(results)
        alike = sum(pair.word not in ("better", "worse") for pair in pairs)
        blue = "Blue: the filter on the left has the smaller one"
        unit = "in standard errors of the difference"
        verb = form_for(alike, "does", "do")
        count = f"{alike} of {counted(len(pairs), 'pair')} {verb} not differ significantly"
        return f"{blue}, {unit}. {count} (at {100 * rules.LEVEL:g} % over all pairs)."

    def _shown_pairs(self, results: Results) -> list[Pair]:
        """Return the compared pairs of shown filters in the figure's metric."""
        labels = results.chosen(self.filters)
        shown = []
        for _, pairs in results.pairs:  # by point of the grid
            for pair in pairs:
                # `name` is the metric in the brackets of a statistic: rmse of mean(rmse).
                is_of_metric = measured(pair.metric).metric == self.metric.name
                if is_of_metric and pair.filter_a in labels and pair.filter_b in labels:
                    shown.append(pair)
        return shown

    def draw(self, results: Results) -> Figure:
        """Return one panel; with two paths, one per filter."""
        if not results.grid:
            return self._draw_pairs(results)
        if self.y is None:
            return self._draw_filters_over_path(results)
        return self._draw_paths(results, self.y)

    def _labels(self, results: Results) -> list[str]:
        """Return the shown filters; the bound has no number per run."""
        return caption_parts.measured_labels(results, results.chosen(self.filters), self.metric)

    def _draw_filters_over_path(self, results: Results) -> Figure:
        """Draw one panel with a row per filter, over one path of the grid."""
        labels = self._labels(results)
        x_path = self.x or results.grid[0]
        columns = _values_of_path(results, x_path)
        rows = []
        for label in labels:
            rows.append([self._estimate(results, {x_path: x}, label) for x in columns])
        row_names = [style.wrap_label(label) for label in labels]
        fields = {"": rows}  # a single panel, without a title
        return self._draw_panels(fields, columns, row_names, results.axis(x_path), y_label="")

    def _draw_paths(self, results: Results, y_path: str) -> Figure:
        """Draw a panel per filter over two paths of the grid."""
        x_path = self.x or results.grid[0]
        columns = _values_of_path(results, x_path)
        levels = _values_of_path(results, y_path)
        fields = {}
        for label in self._labels(results):
            rows = []
            for y in levels:
                row = [self._estimate(results, {x_path: x, y_path: y}, label) for x in columns]
                rows.append(row)
            fields[label] = rows
        row_names = [phrases.number(level) for level in levels]
        x_label = results.axis(x_path)
        return self._draw_panels(fields, columns, row_names, x_label, results.axis(y_path))

    def _estimate(self, results: Results, path_values: GridPoint, label: str) -> Estimate:
        """Return a filter's metric at the first point with these values; NaN if there is none.

        ``path_values`` are those of the axes, by path. The other paths of the grid, which the figure
        does not show, have their first values there, unless every filter failed at these.
        """
        points = points_of(results, path_values)
        if not points:
            return MISSING.estimate
        return Evaluator(results, points[0]).term(self.metric.of(label)).estimate

    def _draw_panels(
        self,
        fields: dict[str, list[list[Estimate]]],
        columns: list[Any],
        row_names: list[str],
        x_label: str,
        y_label: str,
    ) -> Figure:
        """Draw the metric of each panel on one color scale, at most `MOST_PANELS` panels.

        The scale is that of all ``fields``, also of those that have no panel.
        ``fields`` has the rows of estimates of each panel by its title, ``columns`` the values of the
        horizontal path, and ``row_names`` the labels of the rows. ``x_label`` and ``y_label`` are those
        of the axes.
        """
        values_by_title: dict[str, Array] = {}
        for title, rows in fields.items():
            values_by_title[title] = np.array([[cell.value for cell in row] for row in rows])
        norm = self._color_scale(list(values_by_title.values()))
        drawn = dict(list(fields.items())[:MOST_PANELS])
        height = 1.2 + 0.36 * len(row_names)  # of a panel, inches
        figure, axes = make_panels(len(drawn), 1, height, sharey=True)
        across = min(len(drawn), sheet().across)
        # The labels of the rows and the color bar take 2 inches.
        cell_in = (sheet().width_in - 2.0) / across / len(columns)
        column_names = [phrases.number(value) for value in columns]
        for (ax,), (title, rows) in zip(axes, drawn.items(), strict=True):
            values = values_by_title[title]
            image = ax.imshow(values, aspect="auto", cmap="viridis", norm=norm)
            _set_ticks(ax, column_names, row_names, cell_in)
            ax.set_title(style.wrap_label(title))
            ax.set_xlabel(x_label)
            texts = cell_texts(rows)
            if has_room(texts, cell_in):
                write_cells(ax, values, texts, image)
        axes[0][0].set_ylabel(y_label)
        # All images have the same colors, so that the bar of the last one is valid for all.
        figure.colorbar(
            image, ax=list(axes[:, 0]), label=self.bar_label or metric_phrases.axis_of(self.metric)
        )
        set_title(figure, self.title)
        return figure

    def _color_scale(self, values_of_panels: list[Array]) -> Any:
        """Return matplotlib's norm of all finite values; logarithmic if wanted and possible.

        It maps the least value to 0, the largest to 1, and so to the ends of the colors.
        """
        from matplotlib.colors import LogNorm, Normalize

        finite = np.concatenate([values[np.isfinite(values)] for values in values_of_panels])
        if self.log and has_logarithm(finite):
            # Clipped: zero has the color of the least positive value.
            return LogNorm(finite[finite > 0.0].min(), finite.max(), clip=True)
        if len(finite):
            return Normalize(finite.min(), finite.max())
        return Normalize(1, 2)  # no cell has a color

    def _draw_pairs(self, results: Results) -> Figure:
        """Draw the z of the paired difference of every two filters: that of the row less the column's.

        z is the difference in its standard errors; NaN, without a color, where two are not compared.
        """
        labels = results.chosen(self.filters)
        z = np.full((len(labels), len(labels)), np.nan)
        for pair in self._shown_pairs(results):
            a = labels.index(pair.filter_a)
            b = labels.index(pair.filter_b)
            z[a, b] = pair.comparison.z
            z[b, a] = -pair.comparison.z
        figure, ax = style.subplots(height_in=2.0 + 0.32 * len(labels))
        # Differences beyond 10 standard errors have the color of 10.
        image = ax.imshow(z, aspect="auto", cmap="RdBu_r", vmin=-10, vmax=10)
        names = [style.wrap_label(label) for label in labels]
        # With this width no label stands upright; all labels are then turned by 45 degrees.
        _set_ticks(ax, names, names, cell_in=np.inf)
        ax.tick_params(axis="x", rotation=45)
        for tick in ax.get_xticklabels():
            tick.set_ha("right")
        # The names of the rows and the color bar take 2.5 inches.
        cell_in = (sheet().width_in - 2.5) / len(labels)
        texts = [[_z_text(value) for value in row] for row in z]
        if has_room(texts, cell_in):
            write_cells(ax, z, texts, image)
            # Texts within the axes do not change the layout, which would measure each of them.
            for text in ax.texts:
                text.set_in_layout(False)
        compared = metric_phrases.axis_of(measured(self.metric.name)).partition(" (")[0]
        ax.set(xlabel="less that of this filter", ylabel=f"{compared} of this filter")
        set_title(figure, self.title)
        figure.colorbar(image, ax=ax, extend="both", label="z (blue: left is smaller)")
        return figure


def _values_of_path(results: Results, path: str) -> list[Any]:
    """Return the values of a path of the grid, in order."""
    return list(dict.fromkeys(point[path] for point in results.points()))


def _set_ticks(ax: Axes, columns: list[str], rows: list[str], cell_in: float) -> None:
    """Label the ``columns`` and ``rows`` of a map; labels that are wider than a column stand upright.

    ``cell_in`` is the width of a column in inches.
    """
    longest = max(len(name) for name in columns)
    has_room = longest * _LETTER_IN <= cell_in
    ax.set_xticks(range(len(columns)), columns, rotation=0 if has_room else 90)
    ax.set_yticks(range(len(rows)), rows)
    ax.grid(visible=False)
    ax.spines[:].set_visible(False)
    ax.tick_params(length=0)


def _z_text(z: float) -> str:
    """Write a z with its sign; below 100 it has a decimal."""
    if abs(z) < 100:
        return with_true_minus(unsigned_zeros(f"{z:+.1f}"))
    return with_true_minus(f"{z:+.0f}")
