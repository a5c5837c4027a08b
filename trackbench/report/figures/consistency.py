"""Figure kinds of consistency and bias: `anees`, `bias`, `dots`."""

from dataclasses import dataclass

import numpy as np

from trackbench.evaluation.inference import anees_band
from trackbench.evaluation.metric_expression import OfStep, OfSummary, measure
from trackbench.field_types import Count, OpenShare, Positive
from trackbench.registry import register
from trackbench.report.figures.over_time import OverTime
from trackbench.report.findings import phrases
from trackbench.report.findings.phrases import named
from trackbench.report.kinds import FigureKind
from trackbench.report.plotting import style
from trackbench.report.plotting.style import Figure
from trackbench.report.results import Results


@register("figures", "anees")
@dataclass(frozen=True, kw_only=True)
class Anees(OverTime):
    """Average normalized estimation error squared over time, with the band of a consistent filter.

    More than 5 filters over more than 150 steps have a panel each, with the other filters in gray.
    """

    metric: OfStep = measure("anees")
    """metric of per_step.csv: anees, or that of a part of the state as anees_position"""
    n_x: Count
    """number of components of the state, or of the part"""
    level: OpenShare = 0.95
    """probability of the chi-square band"""

    def default_caption(self, results: Results) -> str:
        """Return how often each filter is inside the band."""
        point, parts = results.points()[0], []
        for rows, look in self.lines(results, point, self.metric):
            if len(rows) and look["label"] not in results.exact:
                low, high = anees_band(self.n_x, int(rows["runs"].max()), self.level)
                inside = (low <= rows["value"]) & (rows["value"] <= high)
                parts.append((float(inside.mean()), look["label"]))
        told = [
            f"{named(label)} {100 * share:.0f} %" for share, label in sorted(parts, reverse=True)
        ]
        where = f" at {phrases.heading(point)}" if point else ""
        what = f"Of the steps{where} so many are in the {100 * self.level:g} % band: "
        return f"{what}{', '.join(told)}. Above it a filter is overconfident." if told else ""

    def draw(self, results: Results) -> Figure:
        """Return one line per filter; between the gray lines a consistent filter stays."""
        titles = self.panel_titles(results, self.steps_of(results, self.metric))
        figure, panels = self.panels_over_time(results, titles)
        for (ax,), point, title in panels:
            runs = 1
            for rows, look in self.lines(results, point, self.metric):
                if len(rows):
                    self.curve(ax, self.series(rows), look, title, titles)
                    runs = max(runs, int(rows["runs"].max()))
            band = anees_band(self.n_x, runs, self.level)
            ax.axhspan(*band, label=f"{100 * self.level:g} % band", **style.BAND)
        return self.finish(figure, titles)


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
                    ax.plot(k, value, **look)
                    style.error_band(ax, k, value, stderr, look, i, len(lines))
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
        figure, axes = style.subplots(
            len(points), len(self.columns), height, sharey=True, squeeze=False
        )
        for row, point in zip(axes, points, strict=True):
            rows = results.columns("summary", point)
            row[len(row) // 2].set_title(phrases.heading(point))
            for ax, metric in zip(row, map(str, self.columns.values()), strict=True):
                mine = rows.where(metric=metric).tuples(["filter", "value", "stderr"])
                found = {label: estimate for label, *estimate in mine}
                for i, label in enumerate(labels):
                    look = {
                        "color": results.line_style(label)["color"],
                        "marker": "o",
                        "markersize": 3.5,
                    }
                    value, stderr = found.get(label, (np.nan, np.nan))
                    ax.errorbar(value, i, xerr=2 * np.nan_to_num(stderr), capsize=2, **look)
                if metric in self.expected:
                    ax.axvline(self.expected[metric], color="black", linewidth=0.6)
                ax.locator_params(axis="x", nbins=2)
                ax.ticklabel_format(axis="x", scilimits=(-2, 4))
            row[0].set_yticks(range(len(labels)), map(style.wrap_label, labels))
        axes[0][0].invert_yaxis()
        for ax, head in zip(axes[-1], self.columns, strict=True):
            ax.set_xlabel(head)
        style.title(figure, self.title, len(results.points()))
        return figure
