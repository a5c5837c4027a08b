"""Figure kind `nis`: normalized innovations squared over time, averaged, with their bands."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.metric_expression import measured
from trackbench.field_types import Count
from trackbench.registry import register
from trackbench.report.figures import caption_parts
from trackbench.report.figures.over_time import OverTime
from trackbench.report.figures.panels_of_points_and_filters import Panel
from trackbench.report.plotting import style
from trackbench.report.plotting.style import Axes, Figure
from trackbench.report.tables_and_figures import Results
from trackbench.statistics.consistency_bands import AcceptedNis, nis_band

_ENOUGH = 60
"""Measured components whose average is worth a point: its standard deviation is sqrt(2 / 60) or 18 %."""
_FEWEST_POINTS = 10
"""Points of a line of which a point may have fewer measured components."""


@register("figures", "nis")
@dataclass(frozen=True, kw_only=True)
class Nis(OverTime):
    """Normalized innovation squared over the number of components, with a consistent filter's band.

    A point is the average over the runs and over successive steps. The gray band has 95 % of the points
    of a consistent filter (Bar-Shalom, Li & Kirubarajan 2001, section 5.4.2). Each gate has a lower band
    of its own, because the measurements that it accepts have a smaller NIS. More than 5 filters over
    more than 150 steps have a panel each, with the other filters in gray.
    """

    requires: ClassVar[dict[str, str]] = {"anis": "per_step", "innovations": "per_step"}

    y_label: str = "NIS per component"
    """label of the vertical axis"""
    log: bool = True
    """logarithmic vertical axis"""
    over: Count | None = None
    """number of steps that are averaged together; default: as many as have 60 measured components,
    or a tenth of all steps if that is fewer"""

    @property
    def drawn_metric(self) -> str:
        """Metric of per_step.csv without which a filter has no line."""
        return "anis"

    def default_caption(self, results: Results) -> str:
        """Return filters, number of runs and what the band is."""
        labels = [label for label, _ in self.labels_and_looks(results)]
        words = f"normalized innovation squared per component over {self.x_words}"
        caption = caption_parts.of_curves(results, words, labels)
        return f"{caption} The band has 95 % of the points of a consistent filter."

    def draw(self, results: Results) -> Figure:
        """Return one line per filter."""
        panel_labels = self.panel_labels(results, self.count_steps(results, measured("anis")))
        figure, panels = self.make_panels_over_time(results, panel_labels)
        for panel in panels:
            self._draw_panel(panel, results, panel_labels)
        return self.finish(figure, panel_labels)

    def _draw_panel(self, panel: Panel, results: Results, panel_labels: list[str]) -> None:
        """Draw averages of each filter's NIS per component, and a band for each gate.

        A gate rejects measurements with a large NIS, so that a consistent filter with a gate has a lower
        band than one without. ``panel_labels`` are the filters with a panel of their own; empty if all
        share one.
        """
        (ax,) = panel.axes
        facts = results.facts(panel.point)
        every_nis = self.metric_series(results, panel.point, measured("anis"))
        every_innovations = self.metric_series(results, panel.point, measured("innovations"))
        bands: dict[AcceptedNis | None, _Band] = {}  # by gate; None for filters without one
        for nis, innovations in zip(every_nis, every_innovations, strict=True):
            if not len(nis.rows):
                continue
            # Step 1: the line of the filter, averages over ``steps`` steps. By default these are as many
            # as have `_ENOUGH` measured components, so that a point has little scatter, if they leave a
            # line of ten points or more. ``components`` is the number that all runs together have
            # measured at each step.
            components = innovations.rows["value"] * innovations.rows["runs"]
            enough_steps = round(_ENOUGH / float(components.mean()))
            most_steps = len(components) // _FEWEST_POINTS
            steps = self.over or max(1, min(enough_steps, most_steps))
            averages = _average_steps(nis.rows[self.x], nis.rows["value"], components, steps)
            dotted = nis.look | {"marker": "o", "markersize": 2}
            x = averages.x
            self.draw_curve(ax, x, averages.value, dotted, panel.label, panel_labels, steps)
            # Step 2: the band of its gate, as long as the longest line of a filter with this gate.
            gate = facts.accepted_nis(nis.look["label"])
            if gate not in bands:
                bands[gate] = _Band(averages=averages, look=_band_look(gate, nis.look))
            elif len(x) > len(bands[gate].averages.x):
                bands[gate] = replace(bands[gate], averages=averages)
        for gate, band in bands.items():
            _draw_band(ax, gate, band)
        ax.axhline(1.0, color="black", linewidth=0.6)


@dataclass(frozen=True, kw_only=True)
class _Averages:
    """Averages over successive steps: arrays (n,)."""

    x: Array
    """middle of the steps on the horizontal axis"""
    value: Array
    """average over the measured components"""
    components: Array
    """number of measured components in the steps and runs of each average"""


@dataclass(frozen=True, kw_only=True)
class _Band:
    """Band in which the averages of a consistent filter are."""

    averages: _Averages
    look: style.LineStyle


def _average_steps(x: Array, value: Array, components: Array, steps: int) -> _Averages:
    """Average ``value`` (T,) over windows of ``steps`` successive steps.

    Each value counts by the number of its measured ``components`` (T,). ``x`` (T,) are the places of the
    steps on the horizontal axis. A last window of fewer steps is left out, unless it is the only one.
    """
    last_start = max(len(x) - steps, 0)
    windows = [slice(start, start + steps) for start in range(0, last_start + 1, steps)]
    sums = np.array([(value[window] * components[window]).sum() for window in windows])
    numbers = np.array([components[window].sum() for window in windows])
    middles = np.array([x[window].mean() for window in windows])
    return _Averages(x=middles, value=sums / numbers, components=numbers)


def _band_look(gate: AcceptedNis | None, filter_look: style.LineStyle) -> style.LineStyle:
    """Return the look of a gate's band: the color of the gate's first filter; gray without a gate."""
    if gate is None:
        return style.BAND
    return {"color": filter_look.get("color"), "alpha": 0.15, "linewidth": 0.0}


def _draw_band(ax: Axes, gate: AcceptedNis | None, band: _Band) -> None:
    """Draw the 95 % band of what a gate accepts; without a gate that of all measurements.

    The width of a band at an average depends on the number of measured components in the average.
    """
    # The numbers are whole but for rounding: per_step.csv has their mean over the runs.
    numbers = [round(number) for number in band.averages.components]
    low, high = np.array([nis_band(number, gate) for number in numbers]).T
    label = "95 % band"
    if gate is not None:
        label += f", gate {gate.gate:g}"
    ax.fill_between(band.averages.x, low, high, label=label, **band.look)
