"""Figure kind `rmse-per-run`: a metric in each run, in order of the errors or of the runs' numbers."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.metric_expression import OfRun, measure
from trackbench.registry import register
from trackbench.report.figures.over_time import Curves
from trackbench.report.plotting import filter_lines, style
from trackbench.report.plotting.style import Figure
from trackbench.report.results import Results

_MOST = 200  # points of a line over the share of runs


@register("figures", "rmse-per-run")
@dataclass(frozen=True, kw_only=True)
class RmsePerRun(Curves):
    """A metric in every run: each filter's runs in order, which is its distribution.

    At a share of 90 % is what 90 % of a filter's runs do not exceed; lost runs have no number and stand
    last, so that the line ends before 100 %.
    """

    metric: OfRun = measure("rmse")
    """metric of per_run.csv"""
    form: Literal["sorted", "runs"] = "sorted"
    """horizontal axis: the share of runs that do no worse; or the number of the run, as papers draw it
    although runs that follow each other have nothing to do with each other"""

    @property
    def x_name(self) -> str:
        """Label of the horizontal axis."""
        return self.x_label or {"sorted": "Share of runs (%)", "runs": "Run m"}[self.form]

    def draw(self, results: Results) -> Figure:
        """Return one line per filter."""
        if not self.y_label:
            curves: list[Array] = []
            keys = [(label, str(self.metric)) for label, _ in self.labels(results)]
            for point in results.points()[: style.MOST_PANELS]:
                runs = results.runs(point)
                curves += [runs[key] for key in keys if key in runs]
            return self.with_axis(self.metric, curves).draw(results)
        figure, panels = self.panels(results)
        for (ax,), point in panels:
            runs = results.runs(point)
            for label, look in self.labels(results):
                values = runs.get((label, str(self.metric)), np.empty(0))
                look = look | {"label": label}
                if self.form == "sorted":
                    filter_lines.draw_filter_line(ax, *_in_order(values), look)
                    continue
                number = np.arange(1, len(values) + 1)
                filter_lines.draw_filter_line(ax, number, values, look | {"linewidth": 0.8})
        return self.finish(figure)


def _in_order(values: Array) -> tuple[Array, Array]:
    """Sort values over percentages of runs; NaN for lost runs."""
    if not len(values):
        return values, values
    ranked = np.sort(values)
    places = np.unique(np.linspace(0, len(ranked) - 1, min(_MOST, len(ranked))).round().astype(int))
    return 100.0 * (places + 1) / len(ranked), ranked[places]
