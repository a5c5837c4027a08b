"""Figure kinds of consistency and bias: `anees`, `bias`, `dots`."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackbench.config.experiment import Point
from trackbench.evaluation.consistency_and_calibration import sizes
from trackbench.evaluation.metric_expression import OfStep, OfSummary, measure
from trackbench.field_types import Count, OpenShare, Positive
from trackbench.registry import register
from trackbench.report.figures.over_time import OverTime
from trackbench.report.findings import phrases
from trackbench.report.findings.phrases import named
from trackbench.report.kinds import FigureKind
from trackbench.report.plotting import filter_lines, style
from trackbench.report.plotting.style import Axes, Figure
from trackbench.report.results import Results
from trackbench.report.tables.consistency import degrees_of
from trackbench.results.point_facts import GridPoint
from trackbench.statistics.intervals import anees_band


@register("figures", "anees")
@dataclass(frozen=True, kw_only=True)
class Anees(OverTime):
    """Average normalized estimation error squared over time, with the band of a consistent filter.

    More than 5 filters over more than 150 steps have a panel each, with the other filters in gray.
    """

    metric: OfStep = measure("anees")
    """metric of per_step.csv: anees, or that of a part of the state as anees_position"""
    n_x: Count | None = None
    """number of components of the state, or of the part; default: what it is, and no other is right"""
    level: OpenShare = 0.95
    """probability of the chi-square band"""

    def conflicts(self, points: Sequence[Point]) -> dict[str, str]:
        """Reject another number of components than there are."""
        for point in points:
            n = sizes(point.scenario).get(self.metric.family[1])
            if self.n_x is not None and n is not None and self.n_x != n:
                what = f"{self.n_x} components, and `{self.metric}` is of {n}"
                return {"n_x": f"{what}; leave the key out"}
        return {}

    def default_caption(self, results: Results) -> str:
        """Return how often each filter is inside the band."""
        point, parts = results.points()[0], []
        for rows, look in self.lines(results, point, self.metric):
            if len(rows) and look["label"] not in results.exact:
                number = self._degrees(results, point, look["label"])
                bands = {m: anees_band(1, m, self.level) for m in set(number.values())}
                low, high = np.array([bands[number[k]] for k in rows["step"].tolist()]).T
                inside = (low <= rows["value"]) & (rows["value"] <= high)
                parts.append((float(inside.mean()), look["label"]))
        parts.sort(reverse=True)
        shares = [f"{named(label)} {100 * share:.0f} %" for share, label in parts]
        where = f" at {phrases.heading(point)}" if point else ""
        what = f"Of the steps{where} so many are in the {100 * self.level:g} % band: "
        return f"{what}{', '.join(shares)}. Above it a filter is overconfident." if shares else ""

    def draw(self, results: Results) -> Figure:
        """Return one line per filter; between the gray lines a consistent filter stays."""
        titles = self.panel_titles(results, self.steps_of(results, self.metric))
        figure, panels = self.panels_over_time(results, titles)
        for (ax,), point, title in panels:
            number, at = dict[int, float](), dict[int, float]()
            for rows, look in self.lines(results, point, self.metric):
                if len(rows):
                    self.curve(ax, self.series(rows), look, title, titles)
                    at |= zip(rows["step"].tolist(), rows[self.x].tolist(), strict=True)
                    for k, m in self._degrees(results, point, look["label"]).items():
                        number[k] = max(m, number.get(k, 0.0))
            self._band(ax, at, number)
        return self.finish(figure, titles)

    def _band(self, ax: Axes, at: dict[int, float], number: dict[int, float]) -> None:
        """Draw the band of so many degrees of freedom by step: straight where all are equal."""
        look = {"label": f"{100 * self.level:g} % band", **style.BAND}
        bands = {m: anees_band(1, m, self.level) for m in set(number.values()) or {1.0}}
        if len(bands) == 1:
            ax.axhspan(*bands.popitem()[1], **look)
            return
        steps = sorted(number)
        low, high = np.array([bands[number[k]] for k in steps]).T
        ax.fill_between([at[k] for k in steps], low, high, **look)

    def _degrees(self, results: Results, point: GridPoint, label: str) -> dict[int, float]:
        """Count the degrees of freedom of a filter's metric over its runs, by step."""
        rows = results.columns("per_step", point).where(filter=label)
        n = results.facts(point).sizes[self.metric.family[1]]
        number = degrees_of(rows, str(self.metric), n)
        steps = rows.where(metric=str(self.metric))["step"].tolist()
        return dict(zip(steps, number.tolist(), strict=True))


@register("figures", "bias")
@dataclass(frozen=True, kw_only=True)
class Bias(OverTime):
    """Mean signed errors over time, a row of panels per quantity, with bands of two standard errors."""

    rows: dict[str, OfStep]
    """vertical axis with its unit: metric of per_step.csv, such as `bias_radial`"""
    linear_within: Positive | None = None
    """half-width of the linear part of a symmetric logarithmic axis; default: a linear axis"""

    def draw(self, results: Results) -> Figure:
        """Return one line per filter."""
        figure, panels = self.panels(results, len(self.rows))
        for axes, point in panels:
            for ax, metric in zip(axes, self.rows.values(), strict=True):
                ax.axhline(0.0, color="black", linewidth=0.6)
                lines = list(self.lines(results, point, metric))
                for i, (rows, look) in enumerate(lines):
                    k, value, stderr = self.series(rows)
                    if filter_lines.draw_filter_line(ax, k, value, look):
                        filter_lines.draw_error_band(ax, k, value, stderr, look, i, len(lines))
                if self.linear_within is not None:
                    ax.set_yscale("symlog", linthresh=self.linear_within)
        for ax, head in zip(panels[0][0], self.rows, strict=True):
            ax.set_ylabel(head)
        self.keep_possible_scales(figure)
        style.legend_outside(figure)
        return figure


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

    def draw(self, results: Results) -> Figure:
        """Return a column of panels per metric."""
        points = results.points()[: style.MOST_PANELS]
        labels = results.chosen(self.filters, exact=True)
        height = (0.6 + 0.2 * len(labels)) * len(points) + 0.5
        shape = len(points), len(self.columns)
        figure, axes = style.subplots(*shape, height, sharey=True, squeeze=False)
        for row, point in zip(axes, points, strict=True):
            rows = results.columns("summary", point)
            row[len(row) // 2].set_title(phrases.heading(point))
            for ax, metric in zip(row, map(str, self.columns.values()), strict=True):
                mine = rows.where(metric=metric).tuples(["filter", "value", "stderr"])
                estimates = {label: estimate for label, *estimate in mine}
                for i, label in enumerate(labels):
                    look = {
                        "color": results.line_style(label)["color"],
                        "marker": "o",
                        "capsize": 2,
                    }
                    value, stderr = estimates.get(label, (np.nan, np.nan))
                    ax.errorbar(value, i, xerr=2 * np.nan_to_num(stderr), markersize=3.5, **look)
                if metric in self.expected:
                    ax.axvline(self.expected[metric], color="black", linewidth=0.6)
                ax.locator_params(axis="x", nbins=2)
                ax.ticklabel_format(axis="x", scilimits=(-2, 4))
            row[0].set_yticks(range(len(labels)), map(style.wrap_label, labels))
        axes[0][0].invert_yaxis()
        for ax, head in zip(axes[-1], self.columns, strict=True):
            ax.set_xlabel(head)
        style.set_title(figure, self.title, len(results.points()))
        return figure
