"""Figure kinds of innovations: `nis` over time and `autocorrelation` by lag, with their bands."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.metric_expression import measured
from trackbench.evaluation.predictive_scores import LAGS
from trackbench.field_types import Count
from trackbench.registry import register
from trackbench.report.figures.over_time import Curves, OverTime
from trackbench.report.plotting import filter_lines, style
from trackbench.report.plotting.style import Figure
from trackbench.report.results import Results
from trackbench.report.tables.consistency import autocorrelation_band
from trackbench.statistics.intervals import AcceptedNis, anees_band

_ENOUGH = 60  # measured components whose average is worth a point


@register("figures", "nis")
@dataclass(frozen=True, kw_only=True)
class Nis(OverTime):
    """Normalized innovation squared over the number of components, with a consistent filter's band.

    Averages over runs and over successive steps, so many that each is of some components; the gray band
    has 95 % of them (Bar-Shalom, Li & Kirubarajan 2001, section 5.4.2). Each gate
    has a lower band of its own, as what it accepts has a smaller NIS. More than 5 filters over more than
    150 steps have a panel each, with the other filters in gray.
    """

    requires: ClassVar[dict[str, str]] = {"anis": "per_step", "innovations": "per_step"}

    y_label: str = "NIS per component"
    """label of the vertical axis"""
    log: bool = True
    """logarithmic vertical axis"""
    over: Count | None = None
    """steps that are averaged together; default: as many as measure 60 components"""

    def draw(self, results: Results) -> Figure:
        """Return one line per filter."""
        titles = self.panel_titles(results, self.steps_of(results, measured("anis")))
        figure, panels = self.panels_over_time(results, titles)
        for (ax,), point, title in panels:
            bands: dict[AcceptedNis | None, tuple[Array, Array]] = {}
            looks: dict[AcceptedNis | None, dict[str, Any]] = {None: style.BAND}
            every = (self.lines(results, point, measured(m)) for m in ("anis", "innovations"))
            for (rows, look), (numbers, _) in zip(*every, strict=True):
                if len(rows):
                    count = numbers["value"] * numbers["runs"]
                    over = self.over or max(1, round(_ENOUGH / float(count.mean())))
                    k, value, number = _averages(rows[self.x], rows["value"], count, over)
                    dotted = look | {"marker": "o", "markersize": 2}
                    self.curve(ax, (k, value), dotted, title, titles, over)
                    accepted = results.facts(point).accepted_nis(look["label"])
                    band = bands.get(accepted, (np.empty(0), np.empty(0)))
                    # The band of a gate has the color of its first filter.
                    of_gate = {"color": look.get("color"), "alpha": 0.15, "linewidth": 0.0}
                    looks.setdefault(accepted, of_gate)
                    bands[accepted] = max(band, (k, number), key=lambda b: len(b[0]))
            for accepted, (k, number) in bands.items():
                if accepted is None:
                    limits = [anees_band(1, round(n)) for n in number]
                    name = "95 % band"
                else:
                    limits = [accepted.band(round(n)) for n in number]
                    name = f"95 % band, gate {accepted.gate:g}"
                low, high = np.array(limits).T
                ax.fill_between(k, low, high, label=name, **looks[accepted])
            ax.axhline(1.0, color="black", linewidth=0.6)
        return self.finish(figure, titles)


def _averages(k: Array, value: Array, count: Array, over: int) -> tuple[Array, Array, Array]:
    """Average so many successive steps: middle step, average, number of components."""
    ends = range(0, len(k) - over + 1, over) if len(k) >= over else [0]
    parts = [slice(i, i + over) for i in ends]
    numbers = np.array([count[p].sum() for p in parts])
    averages = np.array([(value[p] * count[p]).sum() for p in parts]) / numbers
    return np.array([k[p].mean() for p in parts]), averages, numbers


@register("figures", "autocorrelation")
@dataclass(frozen=True, kw_only=True)
class Autocorrelation(Curves):
    """Autocorrelation of whitened innovations by lag, in measurements; white ones stay in the band."""

    requires: ClassVar[dict[str, str]] = {
        "innovations": "per_run",
        **{f"autocorrelation_{lag}": "per_run" for lag in range(1, LAGS + 1)},
    }

    x_label: str = "Lag in measurements"
    """label of the horizontal axis"""
    y_label: str = "Autocorrelation"
    """label of the vertical axis"""

    def draw(self, results: Results) -> Figure:
        """Draw a point per lag, one line per filter, and the band 1.96 / sqrt(number)."""
        figure, panels = self.panels(results)
        lags = np.arange(1, LAGS + 1)
        for (ax,), point in panels:
            ax.axhline(0.0, color="black", linewidth=0.6)
            runs, widths = results.runs(point), []
            for label, look in self.labels(results):
                if (label, "innovations") in runs:
                    value = [_mean(runs.get((label, f"autocorrelation_{lag}"))) for lag in lags]
                    look = {"label": label, "marker": "o", "markersize": 3, **look}
                    filter_lines.draw_filter_line(ax, lags, np.array(value), look)
                    widths.append(autocorrelation_band(runs[label, "innovations"]))
            if widths and min(widths) < np.inf:
                ax.axhspan(-min(widths), min(widths), label="95 % band", **style.BAND)
            ax.set_xticks(lags)
        self.keep_possible_scales(figure)
        style.legend_outside(figure)
        return figure


def _mean(values: Array | None) -> float:
    """Average the runs that have a value."""
    known = np.empty(0) if values is None else values[~np.isnan(values)]
    return float(known.mean()) if len(known) else np.nan
