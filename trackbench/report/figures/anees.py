"""Figure kind `anees`: ANEES over time, with the band of a consistent filter."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from trackbench.config.experiment import Point
from trackbench.evaluation.metric_expression import OfStep, measure
from trackbench.evaluation.nees import sizes
from trackbench.field_types import Count, OpenShare
from trackbench.registry import register
from trackbench.report.figures import caption_parts
from trackbench.report.figures.over_time import MetricSeries, OverTime
from trackbench.report.findings import grid_headings
from trackbench.report.findings.phrases import named
from trackbench.report.plotting import style
from trackbench.report.plotting.style import Axes, Figure
from trackbench.report.tables.consistency import degrees_of
from trackbench.report.tables_and_figures import Results
from trackbench.results.points_json import GridPoint
from trackbench.statistics.consistency_bands import anees_band


@register("figures", "anees")
@dataclass(frozen=True, kw_only=True)
class Anees(OverTime):
    """Average normalized estimation error squared over time, with the band of a consistent filter.

    More than 5 filters over more than 150 steps have a panel each, with the other filters in gray.
    """

    metric: OfStep = measure("anees")
    """metric of per_step.csv: anees, or that of a part of the state as anees_position"""
    n_x: Count | None = None
    """number of components of the state, or of the part; default: counted; a wrong number is rejected"""
    level: OpenShare = 0.95
    """probability of the chi-square band"""

    @property
    def drawn_metric(self) -> str:
        """Metric of per_step.csv without which a filter has no line."""
        return str(self.metric)

    def conflicts(self, points: Sequence[Point]) -> dict[str, str]:
        """Reject a key ``n_x`` that is not the number of components of the metric.

        Return the reason by key; empty if all is well.
        """
        for point in points:
            n = sizes(point.scenario).get(self.metric.quantity)
            if self.n_x is not None and n is not None and self.n_x != n:
                problem = f"{self.n_x} components, and `{self.metric}` is of {n}; leave the key out"
                return {"n_x": problem}
        return {}

    def default_caption(self, results: Results) -> str:
        """Return the share of the steps at which each filter is inside the band."""
        point = results.points()[0]
        shares: list[tuple[float, str]] = []
        for series in self.metric_series(results, point, self.metric):
            label = series.look["label"]
            if len(series.rows) and label not in results.exact:
                shares.append((self._share_in_band(results, point, series), label))
        if not shares:
            return ""
        shares.sort(reverse=True)
        texts = [f"{named(label)} {100 * share:.0f} %" for share, label in shares]
        where = grid_headings.at_point(point)
        labels = [label for _, label in shares]
        words = f"{caption_parts.quantity(self.metric)} over {self.x_words}"
        curves = caption_parts.of_curves(results, words, labels)
        beginning = f"Of the steps{where} so many are in the {100 * self.level:g} % band: "
        return f"{curves} {beginning}{', '.join(texts)}. Above it a filter is overconfident."

    def _share_in_band(self, results: Results, point: GridPoint, series: MetricSeries) -> float:
        """Return the share of a filter's steps at which the metric is in the band."""
        degrees = self._degrees_by_step(results, point, series.look["label"])
        bands = self._bands(degrees.values())  # low and high end, by number of degrees of freedom
        steps = series.rows["step"].tolist()
        low, high = np.array([bands[degrees[step]] for step in steps]).T
        value = series.rows["value"]
        is_inside = (low <= value) & (value <= high)
        return float(is_inside.mean())

    def _bands(self, degrees: Iterable[float]) -> dict[float, tuple[float, float]]:
        """Return the low and high end of a consistent filter's band, by degrees of freedom."""
        # A band depends only on the number of components times the number of runs, which is that of the
        # degrees of freedom. One component and so many runs have the same band.
        return {number: anees_band(n_x=1, runs=number, level=self.level) for number in set(degrees)}

    def draw(self, results: Results) -> Figure:
        """Return one line per filter, and the gray band in which a consistent filter stays."""
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
            x_by_step: dict[int, float] = {}
            degrees_by_step: dict[int, float] = {}
            for series in self.metric_series(results, panel.point, self.metric):
                rows = series.rows
                if not len(rows):
                    continue
                x, value, _ = self.series_with_gaps(rows)  # without the standard errors
                self.draw_curve(ax, x, value, series.look, panel.label, panel_labels)
                x_by_step |= zip(rows["step"].tolist(), rows[self.x].tolist(), strict=True)
                # The band is that of the filter with the most degrees of freedom, hence the most runs.
                degrees = self._degrees_by_step(results, panel.point, series.look["label"])
                for step, number in degrees.items():
                    degrees_by_step[step] = max(number, degrees_by_step.get(step, 0.0))
            self._draw_band(ax, x_by_step, degrees_by_step)
        return self.finish(figure, panel_labels)

    def _draw_band(
        self, ax: Axes, x_by_step: dict[int, float], degrees_by_step: dict[int, float]
    ) -> None:
        """Draw the band of a consistent filter: straight where all degrees of freedom are equal.

        Both arguments are by step: the place on the horizontal axis, and the degrees of freedom.
        """
        look = {"label": f"{100 * self.level:g} % band", **style.BAND}
        # A panel without any line has a band, too, of one degree of freedom.
        bands = self._bands(degrees_by_step.values() or [1.0])
        if len(bands) == 1:
            ((low, high),) = bands.values()
            ax.axhspan(low, high, **look)
            return
        steps = sorted(degrees_by_step)
        lows, highs = np.array([bands[degrees_by_step[step]] for step in steps]).T
        ax.fill_between([x_by_step[step] for step in steps], lows, highs, **look)

    def _degrees_by_step(self, results: Results, point: GridPoint, label: str) -> dict[int, float]:
        """Count the degrees of freedom of a filter's metric, by step.

        They are the components of the state that the metric is of, summed over the runs. Components that
        are not measured or known exactly do not count.
        """
        rows = results.columns("per_step", point).where(filter=label)
        components = results.facts(point).sizes[self.metric.quantity]
        degrees = degrees_of(rows, str(self.metric), components)
        steps = rows.where(metric=str(self.metric))["step"].tolist()
        return dict(zip(steps, degrees.tolist(), strict=True))
