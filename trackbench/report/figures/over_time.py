"""Keys, axes and panels that figures with a line per filter share, over steps or time and others."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil
from typing import Any, ClassVar, Literal, NamedTuple, Self

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.metric_expression import Measure, OfStep
from trackbench.report.figures.panels_of_points_and_filters import (
    Panel,
    make_panels_of_filters,
    make_panels_of_points,
)
from trackbench.report.findings import metric_phrases
from trackbench.report.kinds import FigureKind
from trackbench.report.plotting import filter_lines, scales
from trackbench.report.plotting.legend import legend_outside
from trackbench.report.plotting.panels import MOST_PANELS, set_title
from trackbench.report.plotting.style import Axes, Figure, LineStyle
from trackbench.report.plotting.time_axis import count_times_from_start
from trackbench.report.tables_and_figures import Results
from trackbench.results.points_json import GridPoint
from trackbench.results.rows_and_columns import Columns

_MOST_CURVES = 5
"""Largest number of filters that are drawn in one panel if they have many steps."""
_MOST_STEPS = 150
"""Largest number of steps that are drawn in one panel if there are many filters."""
_GRAY: LineStyle = {"color": "#c4c4c4", "linewidth": 0.8, "zorder": 1.5}
"""Look of a line that belongs to another panel."""
_GRAY_POINTS = 100
"""Largest number of points of a gray line."""


class MetricSeries(NamedTuple):
    """Rows of per_step.csv with a metric of one filter at one grid point, and the filter's look."""

    rows: Columns
    look: LineStyle
    """color and dash, and the filter's ``label``"""


@dataclass(frozen=True, kw_only=True)
class Curves(FigureKind):
    """Keys shared by the kinds that draw a line per filter in a panel per grid point."""

    label_keys: ClassVar[tuple[str, ...]] = ("floor", "baseline")

    filters: tuple[str, ...] | None = None
    """labels to draw; default: all"""
    x_label: str = ""
    """label of the horizontal axis; default: what it is"""
    y_label: str = ""
    """label of the vertical axis, with its unit; default: the metric, or a component with a unit"""
    log: bool = False
    """logarithmic vertical axis; without `y_label` also where one filter's errors dwarf the others'"""
    floor: str | None = None
    """label of the filter that none can beat: drawn black and dashed"""
    baseline: str | None = None
    """label of the filter that every other should beat: drawn gray and dotted"""

    def labels_and_looks(
        self, results: Results, with_exact_errors: bool = False
    ) -> Iterator[tuple[str, LineStyle]]:
        """Yield each label to draw with its line style.

        The config's ``baseline``, the filter that every other should beat, and its ``floor``, the filter
        that none can beat, come last. They are drawn even if ``filters`` does not name them.

        Parameters
        ----------
        results
            results folder
        with_exact_errors
            True to draw labels of exact errors, such as ``KF, exact``, too, if ``filters`` names no
            labels

        Yields
        ------
        label : str
            label of a filter, a bound or exact errors
        look : LineStyle
            color and dash, as keyword arguments of matplotlib's ``Axes.plot``
        """
        references = [label for label in (self.baseline, self.floor) if label in results.labels]
        chosen = results.chosen(self.filters, with_exact_errors)
        # A filter without a value of the figure's metric has no line.
        if self.drawn_metric:
            rows = results.columns("per_step").where(metric=self.drawn_metric)
            labels_with_values = set(rows["filter"].tolist())
            chosen = [label for label in chosen if label in labels_with_values]
        labels = [label for label in chosen if label not in references]
        labels += [str(label) for label in references]
        yield from results.line_styles(labels, self.floor, self.baseline).items()

    @property
    def drawn_metric(self) -> str:
        """Metric of per_step.csv without which a filter has no line; empty if there is none."""
        return ""

    @property
    def has_integer_x(self) -> bool:
        """True if the horizontal axis counts something, such as steps."""
        return False

    @property
    def x_name(self) -> str:
        """Label of the horizontal axis."""
        return self.x_label

    def make_panels(
        self, results: Results, rows: int = 1, **layout: Any
    ) -> tuple[Figure, list[Panel]]:
        """Return a figure with an empty panel per grid point, of 12 points at most.

        Parameters
        ----------
        results
            results folder
        rows
            number of axes below each other in each panel. A single row shares its vertical axis. Several
            rows share their horizontal axis with the panels above and below
        **layout
            further arguments of matplotlib's ``Figure.subplots``, such as ``height_ratios``

        Returns
        -------
        figure : matplotlib.figure.Figure
            figure with its title
        panels : list of Panel
            panels, whose labels are empty, as all filters share a panel
        """
        figure, panels = make_panels_of_points(results, self.x_name, self.y_label, rows, **layout)
        for panel in panels:
            for ax in panel.axes:
                self._set_scales(ax)
        set_title(figure, self.title, number_of_points=len(results.points()))
        return figure, panels

    def _set_scales(self, ax: Axes) -> None:
        """Make the vertical axis logarithmic if wanted; give a counting horizontal axis whole ticks."""
        if self.log:
            ax.set_yscale("log")
        if self.has_integer_x:
            locator: Any = ax.xaxis.get_major_locator()
            locator.set_params(integer=True)

    def metric_series(
        self, results: Results, point: GridPoint, metric: Measure
    ) -> Iterator[MetricSeries]:
        """Yield each label's series of a metric at a grid point, and its line style.

        Parameters
        ----------
        results
            results folder
        point
            one of ``results.points()``
        metric
            metric of per_step.csv

        Yields
        ------
        MetricSeries
            rows of the label, none if the filter has no such metric, and its look with the ``label``
        """
        rows = results.columns("per_step", point).where(metric=str(metric))
        for label, look in self.labels_and_looks(results, with_exact_errors=True):
            yield MetricSeries(rows=rows.where(filter=label), look={"label": label, **look})

    def with_vertical_axis(self, metric: Measure, curves: Sequence[Array]) -> Self:
        """Return the figure with its vertical axis labeled, logarithmic if one curve dwarfs the rest.

        An axis that shows a negative number is linear. An axis with a ``y_label`` is logarithmic only if
        ``log`` is set.

        Parameters
        ----------
        metric
            metric that is drawn; it gives the default label with its unit
        curves
            values of all lines, an array (n,) each, in the unit of the metric

        Returns
        -------
        Curves
            copy with the keys ``y_label`` and ``log`` set
        """
        can_be_logarithmic = scales.has_logarithm(np.concatenate([np.empty(0), *curves]))
        is_wanted = self.log or (not self.y_label and scales.one_dwarfs(curves))
        y_label = self.y_label or metric_phrases.axis_of(metric)
        return replace(self, y_label=y_label, log=can_be_logarithmic and is_wanted)

    def finish(self, figure: Figure, panel_labels: Collection[str] = ()) -> Figure:
        """Return the figure with legible vertical axes and a legend.

        A logarithmic axis has plain numbers. A linear one begins at 0 unless a line has negative values.

        Parameters
        ----------
        figure
            figure with everything drawn; it is changed
        panel_labels
            filters whose own panel has their label as its title, so that the legend leaves them out

        Returns
        -------
        matplotlib.figure.Figure
            the figure itself
        """
        scales.set_legible_vertical_axes(figure, self.log)
        legend_outside(figure, panel_labels)
        return figure

    def drop_impossible_log_scales(self, figure: Figure) -> None:
        """Make each logarithmic vertical axis linear that cannot show what is drawn on it.

        A logarithmic axis can show numbers of which one is positive and none is negative.

        Parameters
        ----------
        figure
            figure with everything drawn; it is changed
        """
        for ax in figure.axes:
            if ax.get_yscale() == "log":
                scales.set_possible_log_scale(ax.yaxis)


@dataclass(frozen=True, kw_only=True)
class OverTime(Curves):
    """Keys shared by those whose horizontal axis are the steps."""

    x: Literal["step", "time"] = "step"
    """what the horizontal axis counts: steps, or seconds"""

    @property
    def x_name(self) -> str:
        """Label of the horizontal axis."""
        if self.x_label:
            return self.x_label
        return {"step": "Step k", "time": "Time (s)"}[self.x]

    @property
    def x_words(self) -> str:
        """Words of a caption for the horizontal axis."""
        return {"step": "the steps", "time": "time"}[self.x]

    @property
    def has_integer_x(self) -> bool:
        """True if the horizontal axis counts steps."""
        return self.x == "step"

    def finish(self, figure: Figure, panel_labels: Collection[str] = ()) -> Figure:
        """Return the figure with legible axes and a legend, as `Curves.finish` does."""
        self.label_clock_times_from_start(figure)
        return super().finish(figure, panel_labels)

    def label_clock_times_from_start(self, figure: Figure) -> None:
        """Label the times of a clock, such as seconds since 1970, by the time since the axis begins.

        An axis of steps, or of small times, stays as it is.

        Parameters
        ----------
        figure
            figure with everything drawn; it is changed
        """
        if self.x == "time":
            count_times_from_start(figure, self.x_name)

    def panel_labels(self, results: Results, steps: Mapping[str, int]) -> list[str]:
        """Return the labels of the filters that get a panel each.

        Each filter gets a panel if there are many filters, many steps and a single grid point: several
        grid points have a panel each already. The floor, the baseline, exact errors and labels without
        steps get no panel. They are reference lines, which every panel shows.

        Parameters
        ----------
        results
            results folder
        steps
            number of steps by label, as `count_steps` returns it

        Returns
        -------
        list of str
            labels with a panel of their own; empty if all share one panel
        """
        references = (self.floor, self.baseline, *results.exact)
        filters = [label for label in steps if steps[label] and label not in references]
        is_crowded = len(filters) > _MOST_CURVES and max(steps.values()) > _MOST_STEPS
        if is_crowded and len(results.points()) == 1:
            return filters
        return []

    def count_steps(self, results: Results, metric: OfStep) -> dict[str, int]:
        """Return the number of steps at which each label has the metric, at the first grid point.

        Parameters
        ----------
        results
            results folder
        metric
            metric of per_step.csv

        Returns
        -------
        dict
            number of steps by label, 0 for a label without the metric
        """
        first_point = results.points()[0]
        all_series = self.metric_series(results, first_point, metric)
        return {series.look["label"]: len(series.rows) for series in all_series}

    def values_of_curves(self, results: Results, metric: OfStep) -> list[Array]:
        """Return the values of a metric of per_step.csv for every line of the figure.

        Parameters
        ----------
        results
            results folder
        metric
            metric of per_step.csv

        Returns
        -------
        list of array (n,)
            values at the n steps of each label at each grid point that is drawn, in the unit of the
            metric
        """
        curves: list[Array] = []
        for point in results.points()[:MOST_PANELS]:
            all_series = self.metric_series(results, point, metric)
            curves += [series.rows["value"] for series in all_series]
        return curves

    def make_panels_over_time(
        self, results: Results, panel_labels: Sequence[str], rows: int = 1, **layout: Any
    ) -> tuple[Figure, list[Panel]]:
        """Return a figure with an empty panel for each of ``panel_labels``, of the first grid point.

        Parameters
        ----------
        results
            results folder
        panel_labels
            filters with a panel of their own, as the method `panel_labels` returns them. If there are
            none, the figure is that of the method `make_panels`: a panel of ``rows`` axes for each grid
            point
        rows
            number of axes below each other in a panel; it counts only without ``panel_labels``
        **layout
            further arguments of matplotlib's ``Figure.subplots``; they count only without
            ``panel_labels``

        Returns
        -------
        figure : matplotlib.figure.Figure
            figure with its title
        panels : list of Panel
            panels in the order of ``panel_labels``, or of the grid points
        """
        if not panel_labels:
            return self.make_panels(results, rows, **layout)
        first_point = results.points()[0]
        figure, panels = make_panels_of_filters(
            panel_labels, first_point, self.x_name, self.y_label
        )
        for panel in panels:
            for ax in panel.axes:
                self._set_scales(ax)
        set_title(figure, self.title)
        return figure, panels

    def series_with_gaps(self, rows: Columns) -> tuple[Array, ...]:
        """Return the places, values and standard errors of rows of per_step.csv, with gaps.

        A NaN is inserted where steps are missing, so that the line has a gap.

        Parameters
        ----------
        rows
            rows of per_step.csv of one filter and metric, by ascending steps

        Returns
        -------
        x : array (n,)
            steps, or times in s if the key ``x`` is ``time``
        value, stderr : array (n,)
            values and standard errors, in the unit of the metric
        """
        return filter_lines.insert_gaps(rows["step"], rows[self.x], rows["value"], rows["stderr"])

    def draw_curve(
        self,
        ax: Axes,
        x: Array,
        value: Array,
        look: LineStyle,
        panel_label: str,
        panel_labels: Collection[str],
        steps: int = 1,
    ) -> bool:
        """Draw the line of the filter ``look["label"]``.

        Other filters with a panel of their own are gray lines here.

        Parameters
        ----------
        ax
            axes of the panel
        x
            places (n,) on the horizontal axis, as `series_with_gaps` returns them
        value
            values (n,) of the filter
        look
            label, color and dash of the filter
        panel_label
            filter of this panel; empty if all filters share it
        panel_labels
            filters with a panel of their own
        steps
            number of steps of which each value is the mean

        Returns
        -------
        bool
            True if the line is drawn in this look. A gray line, and a filter without any value, returns
            False: it gets no band and no marks
        """
        label = look["label"]
        if label == panel_label:  # the only line in color needs no dash
            return filter_lines.draw_filter_line(ax, x, value, look | {"linestyle": "-"})
        if label in panel_labels:
            draw_gray_line(ax, x, value, steps)
            return False
        return filter_lines.draw_filter_line(ax, x, value, look)


def draw_gray_line(ax: Axes, x: Array, value: Array, steps: int = 1) -> None:
    """Draw the line of another panel's filter in gray, behind the lines of this panel.

    It has at most 100 points, each the mean over a window of successive values.

    Parameters
    ----------
    ax
        axes of the panel
    x, value
        places and values (n,) of the line; without any nothing is drawn
    steps
        number of steps of which each given value is the mean already
    """
    if not len(x):
        return
    length = ceil(len(x) / _GRAY_POINTS)  # values in a window
    starts = np.arange(0, len(x), length)
    lengths = np.diff([*starts, len(x)])  # the last window may be shorter
    mean_x = np.add.reduceat(x, starts) / lengths
    mean_value = np.add.reduceat(value, starts) / lengths  # NaN, a gap, if the window has a NaN
    # With "_" the many gray lines are not in the legend, and belong to no curve of the page. An empty
    # line gives them one entry, as the legend has each label once.
    ax.plot(mean_x, mean_value, label="_gray", **_GRAY)
    label = "Other filters"
    if length * steps > 1:
        label += f", means over {length * steps} steps"
    ax.plot([], [], label=label, **_GRAY)
