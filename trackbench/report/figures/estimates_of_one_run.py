"""Figure kind `estimates`: truth and estimates of one component in one run, and their errors."""

import re
from dataclasses import dataclass
from math import ceil
from typing import ClassVar

import numpy as np

from trackbench.core.arrays import Array
from trackbench.field_types import Count
from trackbench.registry import register
from trackbench.report.figures import caption_parts
from trackbench.report.figures.over_time import OverTime
from trackbench.report.figures.panels_of_points_and_filters import (
    Panel,
    leftmost_panels,
    panel_points,
)
from trackbench.report.findings import metric_phrases
from trackbench.report.plotting import cut_off_lines, filter_lines, style
from trackbench.report.plotting.legend import legend_outside
from trackbench.report.plotting.page_formats import sheet
from trackbench.report.plotting.style import Axes, Figure
from trackbench.report.tables_and_figures import Results


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
        """Return which component, filters and run are shown."""
        name, _ = results.facts(results.points()[0]).component(self.component - 1)
        labels = [label for label, _ in self.labels_and_looks(results)]
        filters = caption_parts.filters([label for label in labels if label in results.filters])
        words = f"Estimates of {name} by {filters} in run {self.run}{caption_parts.panels(results)}"
        return f"{words}, and their errors where there is a truth."

    def draw(self, results: Results) -> Figure:
        """Return one line per filter over the truth's points; errors only where there is a truth."""
        component = self.component - 1
        tracks = [results.tracks(point) for point in panel_points(results)]
        has_truth = any(self._has_truth(arrays) for arrays in tracks)
        panel_labels = self._panel_labels(results, tracks[0])
        # Step 1: empty panels; with a truth each has axes for estimates, and below for errors.
        if has_truth:
            across = min(len(tracks), sheet().across)
            rows_of_panels = ceil(len(tracks) / across)
            figure, panels = self.make_panels_over_time(
                results, panel_labels, 2, height_ratios=[3, 2] * rows_of_panels
            )
        else:
            figure, panels = self.make_panels_over_time(results, panel_labels, 1)
        # Step 2: lines. Filters have a panel each only if the grid has a single point: then ``tracks``
        # has one item, which all panels show.
        tracks_of_panels = tracks * len(panel_labels) if panel_labels else tracks
        for panel, arrays in zip(panels, tracks_of_panels, strict=True):
            if not arrays:  # every filter failed here
                continue
            facts = results.facts(panel.point)
            is_angle = facts.components[component] in (facts.angles or ())
            if is_angle:
                continued = _without_jumps(arrays, component, self.run - 1)
                self._draw_panel(panel, results, continued, panel_labels)
            else:
                self._draw_panel(panel, results, arrays, panel_labels)
        # Step 3: labels of the vertical axes.
        name, unit = results.facts(panels[0].point).component(component)
        y_label = self.y_label or metric_phrases.in_unit(name, unit)
        # The unit of a component that has none may stand in the label: `Angle (rad)`.
        unit_in_label = re.search(r"\(([^()]+)\)$", y_label)
        if unit_in_label is not None:
            unit = unit_in_label[1]
        error_label = metric_phrases.in_unit("Estimate \N{MINUS SIGN} truth", unit)
        if panel_labels:
            figure.supylabel(f"{y_label}\n{error_label}" if has_truth else y_label)
        else:
            for panel in leftmost_panels(panels):
                # Without a truth a panel has no axes for errors.
                for ax, text in zip(panel.axes, (y_label, error_label), strict=False):
                    ax.set_ylabel(text)
            figure.align_ylabels()
        self.drop_impossible_log_scales(figure)
        self.label_clock_times_from_start(figure)
        legend_outside(figure, panel_labels)
        return figure

    def _has_truth(self, arrays: dict[str, Array]) -> bool:
        """Return whether the truth of the shown run and component is known at some step.

        ``arrays`` are a grid point's tracks; empty if every filter failed there.
        """
        if not arrays:
            return False
        return bool(np.isfinite(arrays["truth"][self.component - 1, :, self.run - 1]).any())

    def _panel_labels(self, results: Results, arrays: dict[str, Array]) -> list[str]:
        """Return the labels that get a panel each; empty if all filters share one.

        ``arrays`` are the tracks of the first grid point.
        """
        steps: dict[str, int] = {}
        for label, _ in self.labels_and_looks(results):
            if f"mean/{label}" in arrays:
                steps[label] = len(arrays["steps"])
        return self.panel_labels(results, steps)

    def _draw_panel(
        self, panel: Panel, results: Results, arrays: dict[str, Array], panel_labels: list[str]
    ) -> None:
        """Draw truth, estimates and errors into a panel from the tracks ``arrays`` of its grid point.

        The tracks have the axes (component, step, run). ``panel_labels`` are the filters with a panel of
        their own; empty if all share one.
        """
        component = self.component - 1
        run = self.run - 1
        k = arrays[f"{self.x}s"]  # steps or times, the horizontal axis
        steps = arrays["steps"]
        truth = arrays["truth"][component, :, run]
        is_known = np.isfinite(truth)
        has_truth = is_known.any()
        if panel.label and has_truth:
            # A filter's own panel has its errors only: its estimates would look like all others.
            estimate_axes: list[Axes] = []
            error_axes = panel.axes
        else:
            estimate_axes = panel.axes[:1]
            error_axes = panel.axes[1:]
        # Step 1: the truth, which is zero where errors are drawn.
        if has_truth:
            for ax in estimate_axes:
                ax.plot(k, truth, label="Truth", marker="o", markersize=2.5, **style.TRUTH)
        for ax in error_axes:
            ax.set_yscale("linear")  # also with the key `log`, as errors may be negative
            ax.axhline(0.0, **style.TRUTH | {"linewidth": 0.8})
        # Step 2: lines of the filters. Without a truth they begin behind a prior that is given: it is no
        # estimate, and may be far from all that follows.
        start = results.facts(panel.point).scenario.get("start") or {}
        first = 1 if not has_truth and start.get("kind") == "given" else 0
        errors: dict[str, Array] = {}
        for label, look in self.labels_and_looks(results):
            if f"mean/{label}" not in arrays:
                continue
            mean = arrays[f"mean/{label}"][component, :, run]
            known_k, error = filter_lines.insert_gaps(
                steps[is_known], k[is_known], (mean - truth)[is_known]
            )
            errors[label] = error
            line_look = {"label": label, **look}
            for ax in estimate_axes:
                self.draw_curve(ax, k[first:], mean[first:], line_look, panel.label, panel_labels)
            for ax in error_axes:
                self.draw_curve(ax, known_k, error, line_look, panel.label, panel_labels)
        # Step 3: a line of very large errors would flatten the others in a shared panel. It is cut off.
        # A panel with one filter in color shows all of it.
        if not panel_labels:
            # The range of the truth, with which an error is compared; without truth none is too large.
            extent = float(np.ptp(truth[is_known])) if has_truth else np.inf
            cut_off_lines.cut_dwarfing_lines(panel.axes, errors, extent)


def _without_jumps(tracks: dict[str, Array], component: int, run: int) -> dict[str, Array]:
    """Return the tracks with the angle ``component`` of one run unwrapped: jumps by a turn are removed.

    ``run`` is its index, from 0. Each filter's estimates are shifted by whole turns to lie near the
    truth.
    """
    continued = dict(tracks)
    continued["truth"] = _continue_angle(tracks["truth"], component, run)
    truth = continued["truth"][component, :, run]
    for name in tracks:
        if name.startswith("mean/"):
            means = _continue_angle(tracks[name], component, run)
            differences = means[component, :, run] - truth
            known = differences[np.isfinite(differences)]
            if len(known):
                # Shift the whole estimate by so many turns that most of it is near the truth.
                turns = np.round(np.median(known) / (2.0 * np.pi))
                means[component, :, run] -= 2.0 * np.pi * turns
            continued[name] = means
    return continued


def _continue_angle(states: Array, component: int, run: int) -> Array:
    """Return a copy of states (n, T + 1, runs) with the angle ``component`` of one run unwrapped."""
    continued = np.array(states)
    angle = continued[component, :, run]
    is_known = np.isfinite(angle)
    angle[is_known] = np.unwrap(angle[is_known])
    return continued
