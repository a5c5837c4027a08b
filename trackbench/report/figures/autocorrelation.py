"""Figure kind `autocorrelation`: that of whitened innovations by lag, with the band of white ones."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.anis_and_autocorrelation import LAGS
from trackbench.registry import register
from trackbench.report.figures import caption_parts
from trackbench.report.figures.over_time import Curves
from trackbench.report.plotting import filter_lines, style
from trackbench.report.plotting.legend import legend_outside
from trackbench.report.plotting.style import Figure
from trackbench.report.tables_and_figures import Results
from trackbench.statistics.consistency_bands import autocorrelation_band


@register("figures", "autocorrelation")
@dataclass(frozen=True, kw_only=True)
class Autocorrelation(Curves):
    """Autocorrelation of whitened innovations by lag, in measurements; white ones are in the band."""

    requires: ClassVar[dict[str, str]] = {
        "innovations": "per_run",
        **{f"autocorrelation_{lag}": "per_run" for lag in range(1, LAGS + 1)},
    }

    x_label: str = "Lag in measurements"
    """label of the horizontal axis"""
    y_label: str = "Autocorrelation"
    """label of the vertical axis"""

    def default_caption(self, results: Results) -> str:
        """Return filters, number of runs and what the band is."""
        labels = [label for label, _ in self.labels_and_looks(results)]
        words = "autocorrelation of the whitened innovations by lag"
        caption = caption_parts.of_curves(results, words, labels)
        return f"{caption} The band has 95 % of the points of white innovations."

    def draw(self, results: Results) -> Figure:
        """Draw a point per lag, one line per filter, and the band 1.96 / sqrt(number of innovations)."""
        figure, panels = self.make_panels(results)
        lags = np.arange(1, LAGS + 1)
        for panel in panels:
            (ax,) = panel.axes
            ax.axhline(0.0, color="black", linewidth=0.6)
            runs = results.runs(panel.point)  # values (M,) by label and metric
            widths: list[float] = []
            for label, line_style in self.labels_and_looks(results):
                if (label, "innovations") not in runs:
                    continue
                values = [
                    _mean_over_runs(runs.get((label, f"autocorrelation_{lag}"))) for lag in lags
                ]
                look = {"label": label, "marker": "o", "markersize": 3, **line_style}
                filter_lines.draw_filter_line(ax, lags, np.array(values), look)
                widths.append(autocorrelation_band(runs[label, "innovations"]))
            # The band is that of the filter with the most innovations. Without any there is none.
            width = min(widths, default=np.inf)
            if width < np.inf:
                ax.axhspan(-width, width, label="95 % band", **style.BAND)
            ax.set_xticks(lags)
        self.drop_impossible_log_scales(figure)
        legend_outside(figure)
        return figure


def _mean_over_runs(values: Array | None) -> float:
    """Average the runs' values (M,) that are known; NaN if there is none."""
    if values is None:
        return np.nan
    known = values[~np.isnan(values)]
    if not len(known):
        return np.nan
    return float(known.mean())
