"""Figure kinds over time: `rmse-vs-time`, `estimates`; what they share with others of curves."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal, Self

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.metric_expression import Measure, OfStep, measure
from trackbench.field_types import Count
from trackbench.registry import register
from trackbench.report.findings import phrases
from trackbench.report.kinds import FigureKind
from trackbench.report.plotting import filter_lines, scales, style
from trackbench.report.plotting.style import Axes, Figure
from trackbench.report.results import Results
from trackbench.results.frames import Columns
from trackbench.results.point_facts import GridPoint

_MOST_CURVES, _MOST_STEPS = 5, 150
"""Most filters, or most steps, that are drawn in one panel."""


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

    def labels(self, results: Results, exact: bool = False) -> Iterator[tuple[str, GridPoint]]:
        """Yield each label to draw with its line style; the floor and the baseline last."""
        references = {self.baseline: style.BASELINE, self.floor: style.FLOOR}
        drawn = results.chosen(self.filters, exact)
        for label in (b for b in drawn if b not in references):
            yield label, results.line_style(label)
        for name, look in references.items():
            if name in results.labels:
                yield str(name), look

    @property
    def x_name(self) -> str:
        """Label of the horizontal axis."""
        return self.x_label

    def panels(
        self, results: Results, rows: int = 1, **layout: Any
    ) -> tuple[Figure, list[tuple[list[Axes], dict[str, Any]]]]:
        """Return a column of panels per grid point; those of one row share their vertical axis."""
        points = results.points()[: style.MOST_PANELS]
        height = 3.2 if rows == 1 else 2.4 * rows
        if len(points) > 4:
            height *= 0.75
        figure, axes = style.make_panels(
            len(points), rows, height, sharex=rows > 1, sharey=rows == 1, **layout
        )
        heads = style.wrap_headings([phrases.heading(point) for point in points])
        for column, head in zip(axes, heads, strict=True):
            column[0].set_title(head)
            column[-1].set_xlabel(self.x_name)
            for ax in column if self.log else ():
                ax.set_yscale("log")
        if self.y_label:
            axes[0][0].set_ylabel(self.y_label)
        style.set_title(figure, self.title, len(results.points()))
        return figure, [(list(column), p) for column, p in zip(axes, points, strict=True)]

    def lines(
        self, results: Results, point: GridPoint, metric: Measure
    ) -> Iterator[tuple[Columns, dict[str, Any]]]:
        """Yield each label's series of a metric at a grid point, and its line style."""
        rows = results.columns("per_step", point).where(metric=str(metric))
        for label, look in self.labels(results, exact=True):
            yield rows.where(filter=label), {"label": label, **look}

    def with_axis(self, metric: Measure, curves: Sequence[Array]) -> Self:
        """Return the figure with its vertical axis labeled, logarithmic if one curve dwarfs the rest.

        An axis that shows a negative number is linear, and one with a label of its own as asked for.
        """
        fits = scales.has_logarithm(np.concatenate([np.empty(0), *curves]))
        log = fits and (self.log or (not self.y_label and scales.one_dwarfs(curves)))
        return replace(self, y_label=self.y_label or phrases.axis_of(metric), log=log)

    def finish(self, figure: Figure, titles: Collection[str] = ()) -> Figure:
        """Return the figure with legible vertical axes and a legend of all labels but the ``titles``."""
        for ax in figure.axes:
            if self.log:
                scales.plain_log_axis(ax.yaxis)
            elif not (scales.drawn_values(ax.yaxis) < 0.0).any():
                ax.set_ylim(bottom=0)
        style.legend_outside(figure, titles)
        return figure

    def keep_possible_scales(self, figure: Figure) -> None:
        """Leave only those vertical axes logarithmic that can show what is drawn."""
        for ax in figure.axes:
            if ax.get_yscale() == "log":
                scales.log_scale(ax.yaxis)


@dataclass(frozen=True, kw_only=True)
class OverTime(Curves):
    """Keys shared by those whose horizontal axis are the steps."""

    x: Literal["step", "time"] = "step"
    """what the horizontal axis counts: steps, or seconds"""

    @property
    def x_name(self) -> str:
        """Label of the horizontal axis."""
        return self.x_label or {"step": "Step k", "time": "Time (s)"}[self.x]

    def panel_titles(self, results: Results, steps: Mapping[str, int]) -> list[str]:
        """Return the labels that get a panel each; an empty list if all share one panel.

        Panels need many filters, many ``steps`` (by label) and a single grid point. The floor, the
        baseline, exact filters and labels without steps get none.
        """
        references = (self.floor, self.baseline, *results.exact)
        filters = [label for label in steps if steps[label] and label not in references]
        crowded = len(filters) > _MOST_CURVES and max(steps.values()) > _MOST_STEPS
        return filters if crowded and len(results.points()) == 1 else []

    def steps_of(self, results: Results, metric: OfStep) -> dict[str, int]:
        """Return how many steps of the first point have the metric, by label."""
        lines = self.lines(results, results.points()[0], metric)
        return {look["label"]: len(rows) for rows, look in lines}

    def panels_over_time(
        self, results: Results, titles: Sequence[str], rows: int = 1, **layout: Any
    ) -> tuple[Figure, list[tuple[list[Axes], GridPoint, str]]]:
        """Return a figure and its empty panels, each with axes, grid point and title.

        There is a panel for each title, of the first grid point. Without titles each grid point has a
        column of ``rows`` panels, and the title is empty.
        """
        if not titles:
            figure, panels = self.panels(results, rows, **layout)
            return figure, [(axes, point, "") for axes, point in panels]
        figure, panels = style.make_panels(
            len(titles), 1, 1.9, balanced=True, sharex=True, sharey=True
        )
        across = panels[0][0].get_gridspec().ncols
        for i, ((ax,), label) in enumerate(zip(panels, titles, strict=True)):
            ax.set_title(style.wrapped(label, across))
            if i + across >= len(titles):  # no panel is below
                ax.set_xlabel(self.x_name)
                ax.tick_params(labelbottom=True)
            if self.log:
                ax.set_yscale("log")
        figure.supylabel(self.y_label)
        style.set_title(figure, self.title)
        point = results.points()[0]
        return figure, [([ax], point, label) for (ax,), label in zip(panels, titles, strict=True)]

    def shade(self, ax: Axes, rows: Columns, fault: Mapping[str, Any], number: int) -> None:
        """Shade the steps of a fault among those of some rows, each fault in a color of its own."""
        first, last = fault["steps"] or (fault["from"], fault["to"])
        at = rows["time" if fault["steps"] is None else "step"]
        inside = at >= (-np.inf if first is None else first)
        inside &= at <= (np.inf if last is None else last)
        if inside.any():
            x = rows[self.x][inside]
            ax.axvspan(x.min(), x.max(), label=fault["name"], **style.fault_look(number))

    def series(self, rows: Columns) -> tuple[Array, ...]:
        """Return abscissas, values and standard errors, with NaN in gaps of the steps."""
        return filter_lines.insert_gaps(
            rows["step"], *(rows[c] for c in (self.x, "value", "stderr"))
        )

    def curve(
        self,
        ax: Axes,
        line: Sequence[Array],
        look: style.LineStyle,
        title: str,
        titles: Collection[str],
        steps: int = 1,
    ) -> bool:
        """Draw the line ``x, y`` of the filter ``look["label"]``; return whether it is in its own look.

        It is gray if the filter is one of the ``titles`` but not ``title``, that of this panel. Each
        value is that of so many ``steps``.
        """
        x, y, *_ = line
        label = look["label"]
        if label in titles and label != title:
            filter_lines.draw_gray_line(ax, x, y, steps)
            return False
        return filter_lines.draw_filter_line(
            ax, x, y, look | {"linestyle": "-"} if label == title else look
        )


@register("figures", "rmse-vs-time")
@dataclass(frozen=True, kw_only=True)
class RmseVsTime(OverTime):
    """A metric over steps or time, a line a filter, with two standard errors on either side.

    Faults of sensors are shaded.

    More than 5 filters over more than 150 steps have a panel each, with the other filters in gray.
    """

    metric: OfStep = measure("rmse")
    """metric of per_step.csv"""

    def draw(self, results: Results) -> Figure:
        """Return one line per filter."""
        curves: list[Array] = []
        for point in results.points()[: style.MOST_PANELS]:
            curves += [rows["value"] for rows, _ in self.lines(results, point, self.metric)]
        return self.with_axis(self.metric, curves)._drawn(results)

    def _drawn(self, results: Results) -> Figure:
        titles = self.panel_titles(results, self.steps_of(results, self.metric))
        figure, panels = self.panels_over_time(results, titles)
        for (ax,), point, title in panels:
            lines = list(self.lines(results, point, self.metric))
            number = 1 if titles else len(lines)
            for i, fault in enumerate(results.facts(point).scenario.get("faults", ())):
                self.shade(ax, lines[0][0], fault, i)
            for i, (rows, look) in enumerate(lines):
                k, value, stderr = self.series(rows)
                if self.log and scales.has_logarithm(value):
                    value = scales.without_rounding(value)  # as the error of a known first state
                if self.curve(ax, (k, value), look, title, titles):
                    filter_lines.draw_error_band(ax, k, value, stderr, look, i, number, self.log)
        return self.finish(figure, titles)


@register("figures", "estimates")
@dataclass(frozen=True, kw_only=True)
class EstimatesOfOneRun(OverTime):
    """Truth and every filter's estimate of one component in one run; below, the estimates' errors.

    More than 5 filters over more than 150 steps have a panel each, which has the errors only. In one
    panel, estimates that dwarf the others' are cut off, with a mark where they leave it.
    """

    run: Count = 1
    """number of the run, from 1"""
    component: Count = 1
    """number of the state's component, from 1"""
    numbers: ClassVar[tuple[str, ...]] = ("run", "component")

    @property
    def shown_runs(self) -> int:
        """Runs whose tracks must be kept."""
        return self.run

    def default_caption(self, results: Results) -> str:
        """Return which component and run is shown."""
        name, _ = results.facts(results.points()[0]).component(self.component - 1)
        return f"Estimates of {name} in run {self.run}, and their errors where there is a truth."

    def draw(self, results: Results) -> Figure:
        """Return one line per filter over the truth's points; errors only where there is a truth."""
        tracks = [results.tracks(p) for p in results.points()[: style.MOST_PANELS]]
        c, run = self.component - 1, self.run - 1
        known = any(np.isfinite(t["truth"][c, :, run]).any() for t in tracks if t)
        shown = [label for label, _ in self.labels(results) if f"mean/{label}" in tracks[0]]
        steps = {label: len(tracks[0]["steps"]) for label in shown}
        titles = self.panel_titles(results, steps)
        layout = {"height_ratios": [3, 2] * -(-len(tracks) // 4)} if known else {}
        figure, panels = self.panels_over_time(results, titles, 2 if known else 1, **layout)
        for (axes, point, title), arrays in zip(panels, tracks * max(len(titles), 1), strict=True):
            if arrays:  # not every filter failed here
                facts = results.facts(point)
                is_angle = facts.components[c] in (facts.angles or ())
                curves = _without_jumps(arrays, c, run) if is_angle else arrays
                self._panel(axes, results, curves, c, run, title, titles)
        name, unit = results.facts(panels[0][1]).component(c)
        label = self.y_label or (phrases.in_unit(name, unit) if unit else "")
        error = phrases.in_unit("Estimate - truth", unit)
        if known and titles:
            figure.supylabel(f"{label}\n{error}".lstrip())
        else:
            panels[0][0][0].set_ylabel(label)
        if known and not titles:
            panels[0][0][1].set_ylabel(error)
            figure.align_ylabels()
        self.keep_possible_scales(figure)
        style.legend_outside(figure, titles)
        return figure

    def _panel(
        self,
        axes: list[Axes],
        results: Results,
        tracks: dict[str, Array],
        c: int,
        run: int,
        title: str,
        titles: list[str],
    ) -> None:
        k, truth = tracks[f"{self.x}s"], tracks["truth"][c, :, run]
        steps, scored = tracks["steps"], np.isfinite(truth)
        known = scored.any()
        # A filter's own panel has its errors only, next to which its estimates would all look alike.
        below = axes if title and known else axes[1:]
        if known and axes[0] not in below:
            axes[0].plot(k, truth, label="Truth", marker="o", markersize=2.5, **style.TRUTH)
        for ax in below:
            ax.set_yscale("linear")
            ax.axhline(0.0, **style.TRUTH | {"linewidth": 0.8})
        largest: dict[str, Array] = {}
        for label, look in self.labels(results):
            if f"mean/{label}" in tracks:
                mean = tracks[f"mean/{label}"][c, :, run]
                errors = filter_lines.insert_gaps(steps[scored], k[scored], (mean - truth)[scored])
                largest[label] = errors[1]
                for ax in axes:
                    line = errors if ax in below else (k, mean)
                    self.curve(ax, line, {"label": label, **look}, title, titles)
        if not titles:
            filter_lines.cut_dwarfing_lines(axes, largest)


def _without_jumps(tracks: dict[str, Array], c: int, run: int) -> dict[str, Array]:
    """Return the tracks, with the angle of one run continued where it jumps by a turn."""
    out = dict(tracks)
    for name in ("truth", *(name for name in tracks if name.startswith("mean/"))):
        rows = np.array(tracks[name])
        angle, truth = rows[c, :, run], out["truth"][c, :, run]
        known = np.isfinite(angle)
        angle[known] = np.unwrap(angle[known])
        both = known & np.isfinite(truth)
        if name != "truth" and both.any():
            # Shift the whole estimate by so many turns that most of it is near the truth.
            turns = np.round(np.median((angle - truth)[both]) / (2.0 * np.pi))
            angle -= 2.0 * np.pi * turns
        out[name] = rows
    return out
