"""Figure kind `calibration`: rank histograms with their bands, and which are flat."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from trackbench.config.experiment import Point
from trackbench.config.table_and_figure_checks import missing_steps
from trackbench.errors import counted
from trackbench.evaluation.calibration_series import TENTHS
from trackbench.evaluation.metric_expression import OfRank
from trackbench.evaluation.uniformity_tests import Histogram
from trackbench.registry import register
from trackbench.report.figures import caption_parts
from trackbench.report.findings import grid_headings
from trackbench.report.findings.phrases import joined, named, verb
from trackbench.report.kinds import FigureKind
from trackbench.report.plotting import style
from trackbench.report.plotting.panels import MOST_PANELS, add_title_and_legend
from trackbench.report.plotting.style import Axes, Figure, LineStyle
from trackbench.report.tables_and_figures import Results
from trackbench.report.uniformity_of_ranks import check_rank, histogram, judge_histograms
from trackbench.statistics.student_t import deviations

_ALPHA = 0.01
"""Level of the tests of a caption, for all of them together."""
_LEAST_P = 1e-4
"""Least p-value that is written as a number."""


@register("figures", "calibration")
@dataclass(frozen=True, kw_only=True)
class CalibrationFigure(FigureKind):
    """Rank histograms: in which tenth of a filter's distribution the truth is; flat if calibrated.

    An overconfident filter has a U, an underconfident filter has a hump, and a bias shows as a slope
    (Talts et al. 2018, section 4.2). The gray band has 95 % of the bars of a calibrated filter, each by
    itself. It is binomial at a step. Over all steps it follows from the spread of the runs' own
    histograms.
    """

    columns: dict[str, OfRank]
    """heading: pit_nees (the whole state), pit_<component>; with @20 or @last at a step"""
    filters: tuple[str, ...] | None = None
    """labels to draw; default: all"""

    def __post_init__(self) -> None:
        for head, m in self.columns.items():
            check_rank(m, "columns", head)

    def conflicts(self, points: Sequence[Point]) -> dict[str, str]:
        """Reject steps outside the run."""
        return missing_steps("columns", self.columns.values(), points)

    def default_caption(self, results: Results) -> str:
        """Return which filters' histograms are flat, as far as the runs show, and which are not."""
        point = results.points()[0]
        histograms = []
        for label in results.chosen(self.filters):
            for heading, metric in self.columns.items():
                histograms.append((label, heading, histogram(results, point, label, metric)))
        # ``bad`` are the filters with a histogram that is significantly not flat, ``good`` the others.
        verdict = judge_histograms(histograms, _ALPHA)
        sentences = []
        if verdict.good:
            sentences.append(_say_of_ranks(verdict.good, "flat but for chance"))
        if verdict.bad:
            sentences.append(_say_of_ranks(list(verdict.bad), "not flat"))
        if not sentences:
            return ""
        where = f"At {grid_headings.heading(point)}: " if point else ""
        tests = f"({counted(verdict.tests, 'test')}, {_ALPHA:g} for all of them)"
        labels = caption_parts.filters(results.chosen(self.filters))
        words = f"Rank histograms of {labels}, {caption_parts.runs(results)}."
        return f"{words} {where}{'; '.join(sentences)} {tests}."

    def draw(self, results: Results) -> Figure:
        """Return a row of panels per filter (and point of the grid), a column per PIT.

        A PIT, probability integral transform, is the truth's rank in a filter's distribution, 0 to 1. A
        PIT at a step has one rank of each run. A PIT without a step has the ranks of all steps of a run.
        Only the first `MOST_PANELS` rows are shown, and the title says so.
        """
        all_rows = list(product(results.points(), results.chosen(self.filters)))
        shown = all_rows[:MOST_PANELS]
        height = 1.25 * len(shown) + 0.6  # inches
        figure, axes = style.subplots(
            len(shown), len(self.columns), height, sharex=True, squeeze=False
        )
        looks = results.line_styles(results.chosen(self.filters))
        for row, (point, label) in zip(axes, shown, strict=True):
            color = looks[label]["color"]
            for ax, metric in zip(row, self.columns.values(), strict=True):
                ranks = histogram(results, point, label, metric)
                if ranks.runs:
                    _draw_histogram(ax, ranks, color, over_steps=not metric.steps)
                else:
                    ax.set_axis_off()
            row_label = ", ".join(filter(None, [label, caption_parts.heading(results, point)]))
            row[0].set_ylabel(style.wrap_label(row_label, 16))
        for ax, heading in zip(axes[0], self.columns, strict=True):
            p_value = ax.get_title()  # set by `_draw_histogram`
            ax.set_title(f"{heading}\n{p_value}".strip())
        for ax in axes[-1]:
            ax.set_xlabel("Rank of the truth")
        return add_title_and_legend(figure, self.title, number_of_points=len(all_rows))


def _say_of_ranks(labels: list[str], adjective: str) -> str:
    """Return such as ``KF and EKF are flat but for chance``."""
    return f"{joined(map(named, labels))} {verb(labels)} {adjective}"


def _draw_histogram(ax: Axes, ranks: Histogram, color: str, over_steps: bool) -> None:
    """Draw the ten bars of a rank histogram, their expectation, its 95 % band, and the p-value if known.

    If ``over_steps``, the ranks are those of all steps of the runs. They depend on each other, so that
    the band is by the standard errors over the runs. Otherwise each run has one rank.
    """
    edges = np.arange(TENTHS + 1) / TENTHS
    level = 1.0 / TENTHS
    stderr = ranks.stderr
    if not over_steps:  # independent runs: binomial
        stderr = np.full(TENTHS, np.sqrt(level * (1.0 - level) / ranks.runs))
    width = deviations(0.95) * stderr
    ax.bar(edges[:-1], ranks.shares, 1.0 / TENTHS, align="edge", color=color, alpha=0.6, lw=0)
    bar_look: LineStyle = {"color": style.ANY, "alpha": 0.6, "lw": 0}
    ax.fill_between([], [], [], label="Share of the truths", **bar_look)
    # A band of steps takes a value at each edge: the one at the last edge is that of the last bar.
    low = np.append(level - width, level - width[-1])
    high = np.append(level + width, level + width[-1])
    band_look: LineStyle = {"color": "black", "alpha": 0.25, "lw": 0, "zorder": 3}
    ax.fill_between(edges, low, high, step="post", **band_look)
    ax.fill_between([], [], [], label="95 % band", **band_look)
    ax.axhline(level, color="black", linewidth=0.6, zorder=3, label="Calibrated filter")
    ax.set_xlim(0.0, 1.0)
    ax.set_xticks([0.0, 0.5, 1.0], ["0", "0.5", "1"])
    ax.tick_params(labelbottom=True)
    highest = max(float(ranks.shares.max()), float(high.max()))
    ax.set_ylim(0.0, max(2.0 * level, 1.1 * highest))
    if np.isnan(ranks.p):  # too few runs or places for a test
        return
    if ranks.p > _LEAST_P:
        ax.set_title(f"p = {ranks.p:.2g}")
    else:
        ax.set_title(f"p < {_LEAST_P:g}")
