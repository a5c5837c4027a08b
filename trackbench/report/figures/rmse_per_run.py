"""Figure kind `rmse-per-run`: a metric in each run, in order of the errors or of the runs' numbers."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.metric_expression import OfRun, measure
from trackbench.registry import register
from trackbench.report.figures import caption_parts
from trackbench.report.figures.coinciding_lines import coinciding_lines
from trackbench.report.figures.over_time import Curves
from trackbench.report.plotting import filter_lines
from trackbench.report.plotting.panels import MOST_PANELS
from trackbench.report.plotting.style import Figure
from trackbench.report.tables_and_figures import Results

_MOST_POINTS = 200
"""Points of a line over the share of runs."""


@register("figures", "rmse-per-run")
@dataclass(frozen=True, kw_only=True)
class RmsePerRun(Curves):
    """A metric in every run: each filter's runs in order, which is its distribution.

    At a share of 90 % the line has the value that 90 % of a filter's runs do not exceed. Lost runs have
    no number and stand last, so that the line ends before 100 %.
    """

    metric: OfRun = measure("rmse")
    """metric of per_run.csv"""
    form: Literal["sorted", "runs"] = "sorted"
    """horizontal axis: the share of runs that do no worse; or the number of the run, as papers draw it
    although runs that follow each other have nothing to do with each other"""

    @property
    def x_name(self) -> str:
        """Label of the horizontal axis."""
        if self.x_label:
            return self.x_label
        return {"sorted": "Share of runs (%)", "runs": "Run m"}[self.form]

    @property
    def has_integer_x(self) -> bool:
        """True if the horizontal axis counts runs."""
        return self.form == "runs"

    def default_caption(self, results: Results) -> str:
        """Return metric, filters and number of runs, and how to read a line."""
        labels = [label for label, _ in self.labels_and_looks(results)]
        words = f"{caption_parts.quantity(self.metric)} of each run"
        caption = caption_parts.of_curves(results, words, labels)
        if self.form == "sorted":
            caption += " Each filter's runs are in the order of their errors."
            caption += " At 90 % stands the error that 90 % of them do not exceed."
        values_by_label = self._values_by_label(results)
        log = self.with_vertical_axis(self.metric, self._all_values(results)).log
        return caption + coinciding_lines(values_by_label, log)

    def draw(self, results: Results) -> Figure:
        """Return one line per filter."""
        figure_with_axis = self.with_vertical_axis(self.metric, self._all_values(results))
        return figure_with_axis._draw_lines(results)

    def _draw_lines(self, results: Results) -> Figure:
        """Draw the figure; `with_vertical_axis` has set its keys ``y_label`` and ``log`` before."""
        figure, panels = self.make_panels(results)
        for panel in panels:
            (ax,) = panel.axes
            runs = results.runs(panel.point)
            for label, line_style in self.labels_and_looks(results):
                values = runs.get((label, str(self.metric)), np.empty(0))
                look = line_style | {"label": label}
                if self.form == "sorted":
                    shares, ranked = _sort_over_shares(values)
                    filter_lines.draw_filter_line(ax, shares, ranked, look)
                else:
                    run_numbers = np.arange(1, len(values) + 1)
                    thin_look = look | {"linewidth": 0.8}
                    filter_lines.draw_filter_line(ax, run_numbers, values, thin_look)
        return self.finish(figure)

    def _all_values(self, results: Results) -> list[Array]:
        """Return the metric's values per run (M,), an array for each shown filter and grid point."""
        return [y for panel in self._values_by_label(results) for y in panel.values()]

    def _values_by_label(self, results: Results) -> list[dict[str, Array]]:
        """Return the metric's values per run (M,) of each shown filter, for each grid point.

        They are in the order in which the figure draws them.
        """
        panels = []
        for point in results.points()[:MOST_PANELS]:
            runs = results.runs(point)
            values: dict[str, Array] = {}
            for label, _ in self.labels_and_looks(results):
                key = (label, str(self.metric))
                if key in runs:
                    values[label] = runs[key]
                    if self.form == "sorted":
                        values[label] = np.sort(runs[key])  # NaN last
            panels.append(values)
        return panels


def _sort_over_shares(values: Array) -> tuple[Array, Array]:
    """Return the points (n,) of a line from the runs' values (M,): shares of runs in %, and values.

    At each share stands the value that so many runs do not exceed. NaN, the value of a lost run, is
    last. The line has at most 200 of the runs, evenly spaced.
    """
    if not len(values):
        return values, values
    ranked = np.sort(values)
    number = min(_MOST_POINTS, len(ranked))
    indices = np.unique(np.linspace(0, len(ranked) - 1, number).round().astype(int))
    shares = 100.0 * (indices + 1) / len(ranked)
    return shares, ranked[indices]
