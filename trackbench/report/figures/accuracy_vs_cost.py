"""Figure kind `accuracy-vs-cost`: errors against CPU time, and which of them nothing beats."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from trackbench.config.experiment import Point
from trackbench.core.arrays import Array
from trackbench.evaluation.metric_expression import Expression, measure
from trackbench.registry import register
from trackbench.report.cost_curves import (
    COST,
    MICRO,
    compared_labels,
    cost_conflicts,
    curves,
    front,
    own_sizes,
)
from trackbench.report.expressions import Evaluator
from trackbench.report.figures import caption_parts
from trackbench.report.figures.panels_of_points_and_filters import panel_headings
from trackbench.report.findings import grid_headings, phrases
from trackbench.report.findings.phrases import joined
from trackbench.report.kinds import FigureKind
from trackbench.report.plotting import (
    error_bands_and_bars,
    filter_colors,
    scales,
    zeros_on_log_axes,
)
from trackbench.report.plotting.panels import (
    MOST_PANELS,
    add_title_and_legend,
    make_panels,
    wrap_headings,
)
from trackbench.report.plotting.point_labels import PointLabel, label_points
from trackbench.report.plotting.style import Axes, Figure, LineStyle
from trackbench.report.points_by_scenario import points_of, scenes
from trackbench.report.tables_and_figures import Results
from trackbench.results.points_json import GridPoint
from trackbench.statistics.error_at_cpu_time import Curve, Spot

_MARKERS = "osD^vP*X"
"""Markers of the curves of one filter, in turn."""
_SIZE_POINTS = 7.0
"""Size of the letters of a filter's sizes, in points."""
_FRONT: LineStyle = {"color": "#bbbbbb", "linewidth": 4.0, "alpha": 0.6, "zorder": 0.5}


@register("figures", "accuracy-vs-cost")
@dataclass(frozen=True, kw_only=True)
class AccuracyVsCost(FigureKind):
    """Error against CPU time per step: a point per filter and number of particles, and the front.

    Bars are two standard errors, of the error and of the time. The front joins the points that no other
    betters at the same time or less. A panel for each scenario that the grid has.
    """

    label_keys: ClassVar[tuple[str, ...]] = ("floor",)
    requires: ClassVar[dict[str, str]] = {"cpu_s_per_run": "summary"}

    metric: Expression = measure("mean(rmse)")
    """what is compared: an RMSE, a distance or an efficiency"""
    along: str = "N"
    """the filters' key that buys accuracy with time; its values stand beside points with room"""
    filters: tuple[str, ...] | None = None
    """labels to draw; default: all but the reference"""
    floor: str | None = None
    """label of the filter or bound that none can beat: a line; default: the reference"""
    y_label: str = ""
    """label of the vertical axis, with its unit; default: the metric"""
    log: bool = True
    """logarithmic vertical axis"""

    def conflicts(self, points: Sequence[Point]) -> dict[str, str]:
        """Require a grid that gives the key ``along`` of a shown filter several values.

        Return the reason by key, ``""`` for the figure as a whole; empty if all is well.
        """
        shown_labels = [
            label for label in points[0].filters if self.filters is None or label in self.filters
        ]
        # One filter that varies is enough: check the one with the most values.
        most_varied = max(
            shown_labels,
            key=lambda label: len(own_sizes(points, label, self.along)),
            default="",
        )
        return cost_conflicts(points, self.metric, self.along, {"along": most_varied})

    def default_caption(self, results: Results) -> str:
        """Return metric, filters and number of runs, and which filters are on the front.

        On the front are the filters, each at one of its sizes, that no other filter betters at the same
        CPU time or less.
        """
        scene = scenes(results)[0]  # the front is named for the first scenario alone
        all_curves = self._curves(results, scene)
        # By identity: spots hold arrays, which cannot be compared by `in`.
        identities_on_front = {id(spot) for spot in self._front(all_curves)}
        names = []
        for curve in all_curves:
            spots = [spot for spot in curve.spots if id(spot) in identities_on_front]
            if not spots:
                continue
            name = curve.name
            if not curve.is_fixed:  # the filter has several sizes: name those on the front
                name += (
                    f" with {self.along} = {joined(phrases.number(spot.size) for spot in spots)}"
                )
            names.append(name)
        labels = compared_labels(results, self.filters)
        words = f"{caption_parts.quantity(self.metric)} over CPU time per step"
        caption = caption_parts.sentence(
            f"{words} of {caption_parts.filters(labels)}, {caption_parts.runs(results)}"
        )
        if not names:
            return caption
        return f"{caption} On the front{grid_headings.at_point(scene)}: {'; '.join(names)}."

    def draw(self, results: Results) -> Figure:
        """Return one panel per scene: per combination of the values that the grid gives the scenario."""
        all_scenes = scenes(results)
        drawn = all_scenes[:MOST_PANELS]
        figure, axes = make_panels(len(drawn), 1, 4.2, sharey=True)  # 4.2 inches high
        headings = wrap_headings(panel_headings(results, drawn))
        for (ax,), scene, heading in zip(axes, drawn, headings, strict=True):
            self._draw_panel(ax, results, scene)
            ax.set_title(heading)
            ax.set_xlabel(COST)
        axes[0][0].set_ylabel(self.y_label or str(self.metric))
        add_title_and_legend(figure, self.title, number_of_points=len(all_scenes))
        # The filters' sizes, such as numbers of particles, are written beside the points last: the
        # legend changes where the points are, and so which texts have room.
        for (ax,), scene in zip(axes, drawn, strict=True):
            self._label_sizes(figure, ax, results, scene)
        return figure

    def _label_sizes(self, figure: Figure, ax: Axes, results: Results, scene: GridPoint) -> None:
        """Write the filters' sizes beside their points, where they have room.

        A size is a value of the filters' key ``along``, such as the number of particles. A filter with a
        single size has none beside it.
        """
        looks = self._looks(results)
        labels = []
        for curve in self._curves(results, scene):
            if curve.is_fixed:
                continue
            for spot in curve.spots:
                point = (MICRO * spot.cost.value, spot.error.value)
                color = {"color": looks[curve.label]["color"]}
                labels.append(PointLabel(text=phrases.number(spot.size), point=point, look=color))
        label_points(figure, ax, labels, _SIZE_POINTS, leave_out=True)

    def _looks(self, results: Results) -> dict[str, LineStyle]:
        """Return color and dash of each filter but the floor."""
        floor = self._floor(results)
        labels = compared_labels(results, self.filters)
        return results.line_styles([label for label in labels if label != floor])

    def _draw_panel(self, ax: Axes, results: Results, scene: GridPoint) -> None:
        """Draw the filters' curves, the front and the floor of one scene.

        ``scene`` has the values that the grid gives the scenario, by path.
        """
        drawn = self._curves(results, scene)
        floor = self._floor(results)
        looks = self._looks(results)
        # Step 1: curves; several of one filter have its color, and a marker each.
        curves_by_label: dict[str, int] = {}
        for curve in drawn:
            number = curves_by_label.get(curve.label, 0)
            curves_by_label[curve.label] = number + 1
            marker = _MARKERS[number % len(_MARKERS)]
            look = looks[curve.label] | {"marker": marker}
            _draw_curve(ax, curve, look)
        # Step 2: the front, in µs per step, the cheapest point first. Its last error is drawn on to the
        # largest CPU time.
        front_values = _values_of(self._front(drawn))
        times = list(front_values.time)
        errors = list(front_values.error)
        all_times = [spot.cost.value for spot in _spots_of(drawn)]
        if all_times:
            times.append(MICRO * max(all_times))
        if errors:
            errors.append(errors[-1])
        ax.step(times, errors, where="post", label="Front", **_FRONT)
        # Step 3: the floor.
        least = self._floor_value(results, scene, floor)
        if np.isfinite(least):
            ax.axhline(least, label=floor, **filter_colors.FLOOR)
        scales.set_plain_log_scale(ax.xaxis)
        if self.log:
            scales.set_plain_log_scale(ax.yaxis)
            zeros_on_log_axes.mark_zeros_of_lines(ax)

    def _floor(self, results: Results) -> str:
        """Return the label of the floor; the reference if no floor is named.

        If there is neither, it is "None". No filter has this label, so that no line is drawn.
        """
        return self.floor or str(results.config.get("reference"))

    def _floor_value(self, results: Results, scene: GridPoint, floor: str) -> float:
        """Return the floor's metric at the first point of the scene; NaN if it has none."""
        expressions = Evaluator(results, points_of(results, scene)[0])
        # A bound has no runs: its value is in summary.csv.
        stored = expressions.stored.get((floor, str(self.metric)))
        if stored is not None:
            return stored.value
        return expressions.term(self.metric.of(floor)).value

    def _curves(self, results: Results, scene: GridPoint) -> list[Curve]:
        """Return the curves of the shown filters but the floor, over their sizes (key ``along``)."""
        floor = self._floor(results)
        labels = [label for label in compared_labels(results, self.filters) if label != floor]
        return curves(results, scene, labels, self.metric, self.along)

    def _front(self, all_curves: Sequence[Curve]) -> list[Spot]:
        """Return the points of all curves that are better than all others of the same time or less."""
        return list(front(_spots_of(all_curves), self.metric.definition.more_is_better))


def _draw_curve(ax: Axes, curve: Curve, look: LineStyle) -> None:
    """Draw a filter's points with bars of two standard errors."""
    values = _values_of(curve.spots)
    ax.plot(values.time, values.error, markersize=3.5, label=curve.name, **look)
    error_bands_and_bars.draw_error_bars(
        ax,
        x=values.time,
        value=values.error,
        stderr=values.error_stderr,  # which the function doubles
        label=curve.name,
        color=look["color"],
        elinewidth=0.8,
        capsize=1.5,
        xerr=2.0 * values.time_stderr,
    )


def _spots_of(all_curves: Sequence[Curve]) -> list[Spot]:
    """Return the points of all curves, curve by curve: each is a filter at one of its sizes."""
    spots: list[Spot] = []
    for curve in all_curves:
        spots += curve.spots
    return spots


@dataclass(frozen=True, kw_only=True)
class _Values:
    """CPU times per step (µs) and errors with their standard errors: arrays (n,)."""

    time: Array
    time_stderr: Array
    error: Array
    error_stderr: Array


def _values_of(spots: Sequence[Spot]) -> _Values:
    """Return the CPU times per step, µs, and the errors of spots, with their standard errors.

    NaN, such as a missing standard error, is zero.
    """
    return _Values(
        time=MICRO * _numbers([spot.cost.value for spot in spots]),
        time_stderr=MICRO * _numbers([spot.cost.stderr for spot in spots]),
        error=_numbers([spot.error.value for spot in spots]),
        error_stderr=_numbers([spot.error.stderr for spot in spots]),
    )


def _numbers(values: list[float]) -> Array:
    """Return the values as an array (n,), with zero for NaN."""
    return np.nan_to_num(np.array(values, dtype=float))
