"""Figure kind `mean-and-std`: mean error and standard deviation of x and y over time."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from trackbench.config.experiment import Point
from trackbench.registry import register
from trackbench.report.figures import caption_parts
from trackbench.report.kinds import FigureKind
from trackbench.report.plotting import filter_lines, style
from trackbench.report.plotting.panels import add_title_and_legend
from trackbench.report.plotting.style import Figure
from trackbench.report.plotting.time_axis import count_times_from_start
from trackbench.report.tables_and_figures import Results

_AXES = ("x", "y")


@register("figures", "mean-and-std")
@dataclass(frozen=True, kw_only=True)
class MeanAndStd(FigureKind):
    """Mean error and standard deviation over the runs, per axis and step; maneuvers are shaded.

    Adaptive Kalman filter paper, eqs. 13 and 14: truth minus estimate, the opposite sign of `bias` in
    per_step.csv. The quantities are those the scenario calls x and y.
    """

    requires: ClassVar[dict[str, str]] = dict.fromkeys(
        ("bias_x", "bias_y", "std_x", "std_y"), "per_step"
    )

    filters: tuple[str, ...] | None = None
    """labels to draw; default: all"""

    def conflicts(self, points: Sequence[Point]) -> dict[str, str]:
        """Reject a scenario without errors of a position in x and y.

        Return the reason by key, ``""`` for the figure as a whole; empty if all is well.
        """
        scenario = points[0].scenario
        # The names of the errors are those of any state, such as zero.
        any_state = np.zeros((len(scenario.components), 1))
        # A state with position and velocity in the plane begins with px, vx. The error x of any other
        # state may be no position, and the axes are labeled in meters.
        has_position = scenario.components[:2] == ("px", "vx")
        if has_position and set(_AXES) <= set(scenario.errors(any_state, any_state)):
            return {}
        return {"": "there are no errors in x and y to show"}

    def default_caption(self, results: Results) -> str:
        """Return filters and number of runs."""
        # If the figure names no filters, it also has the exact errors of the config's key `exact`.
        labels = results.chosen(self.filters, with_exact_errors=True)
        words = f"of {caption_parts.filters(labels)} over time, {caption_parts.runs(results)}"
        caption = f"Mean error and standard deviation in x and y {words}."
        if results.facts(results.points()[0]).spans:
            caption += " Maneuvers are shaded."
        return caption

    def draw(self, results: Results) -> Figure:
        """Return the mean error above, standard deviation below; x left, y right.

        Only the first point of the grid is shown.
        """
        figure, axes = style.subplots(2, 2, 4.4, sharex=True, sharey="row")  # 4.4 inches high
        point = results.points()[0]
        all_rows = results.columns("per_step", point)
        labels = results.chosen(self.filters, with_exact_errors=True)
        looks = results.line_styles(labels)
        for statistic, row in zip(_STATISTICS, axes, strict=True):
            for quantity, ax in zip(_AXES, row, strict=True):
                for start, end in results.facts(point).spans:  # of the maneuvers, s
                    ax.axvspan(
                        start,
                        end,
                        color=style.MANEUVER,
                        alpha=0.5,
                        lw=0,
                        zorder=0,
                        label="Maneuvers",
                    )
                rows = all_rows.where(metric=f"{statistic.metric}_{quantity}")
                for label in labels:
                    curve = rows.where(filter=label)
                    # The mean error is truth minus estimate here, the opposite of the file's `bias`.
                    value = statistic.sign * curve["value"]
                    look = looks[label] | {"linewidth": 0.8, "label": label}
                    filter_lines.draw_filter_line(ax, curve["time"], value, look)
                ax.set_ylabel(statistic.axis_label.format(quantity))
        for ax in axes[1]:
            ax.set_xlabel("Time (s)")
            ax.set_ylim(bottom=0)
        count_times_from_start(figure, "Time (s)")
        return add_title_and_legend(figure, self.title)


class _Statistic(NamedTuple):
    """A statistic of per_step.csv that a row of panels shows for x and y."""

    metric: str
    sign: float
    axis_label: str


_STATISTICS = (
    _Statistic(metric="bias", sign=-1.0, axis_label="Mean error of {} (m)"),
    _Statistic(metric="std", sign=1.0, axis_label="Std. deviation of {} (m)"),
)
