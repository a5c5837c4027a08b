"""Figure kind `rmse-vs-parameter`: a metric against a value the experiment's grid varies."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackbench.config.experiment import Point
from trackbench.config.grid import is_of_scenario
from trackbench.core.arrays import Array
from trackbench.evaluation.metric_expression import Measure, OfSummary, measure
from trackbench.field_types import is_number
from trackbench.registry import register
from trackbench.report.findings import phrases
from trackbench.report.findings.phrases import named, three_digits
from trackbench.report.kinds import FigureKind
from trackbench.report.plotting import style
from trackbench.report.plotting.style import Axes, Figure, LineStyle
from trackbench.report.results import Results, missing_paths
from trackbench.results.read_csv import Columns

_GAP = 0.2  # of a decade's factor: where zero stands on a logarithmic axis, left of the least value


@register("figures", "rmse-vs-parameter")
@dataclass(frozen=True, kw_only=True)
class RmseVsParameter(FigureKind):
    """A metric of summary.csv against a grid parameter, a line per filter, each best value marked.

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
        words = [value for value in values if not is_number(value)]
        return {"parameter": f"{words[0]!r} in the grid of {path} is no number"} if words else found

    def default_caption(self, results: Results) -> str:
        """Return where each filter is best."""
        path, shown = self._shown(results)
        name, unit = phrases.quantity(path)
        told = []
        for label in results.chosen(self.filters) if not is_of_scenario(path) else ():
            rows = shown.where(filter=label)
            x, y = (rows[c][np.isfinite(rows["value"])] for c in (path, "value"))
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
        labels = results.chosen(self.filters)
        for label in labels:
            rows = shown.where(filter=label)
            rows = rows.chosen(np.argsort(rows[path], kind="stable"))
            x, y, stderr = (rows[c].astype(float) for c in (path, "value", "stderr"))
            self._line(ax, x, y, stderr, label, results.line_style(label))
            if np.isfinite(y).any() and np.ptp(y) != 0.0 and not is_of_scenario(path):
                best, shown_x = best_place(y, self.metric), _moved_zero(x) if self.log_x else x
                colour = results.line_style(label)["color"]
                ax.plot(shown_x[best], y[best], "o", color=colour, markersize=5, zorder=3,
                        label=f"_{label}")  # fmt: skip
        if self.log_x and len(shown):
            _logarithmic(ax, np.unique(shown[path].astype(float)))
        if self.log_y and len(shown):  # nothing, where every filter failed, has no logarithm
            ax.set_yscale("log")
            style.plain_log_axis(ax.yaxis, most=float("inf"))
        ax.set_xlabel(self.x_label or results.axis(path))
        ax.set_ylabel(self.y_label or phrases.error_of(self.metric))
        style.title(figure, self.title)
        style.legend_outside(figure)
        return figure

    def _line(
        self, ax: Axes, x: Array, y: Array, stderr: Array, label: str, look: LineStyle
    ) -> None:
        shown = _moved_zero(x) if self.log_x else x
        if len(y) and np.ptp(y) == 0.0:
            ax.axhline(y[0], label=label, **look | {"linewidth": 0.9})
            return
        ax.plot(shown, y, label=label, **look)
        bars = 2.0 * stderr
        ax.errorbar(shown, y, bars, fmt="none", color=look["color"], capsize=1.5, elinewidth=0.8,
                    label=f"_{label}")  # fmt: skip


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
