"""Figure kinds `calibration`, rank histograms, and `reliability`, coverage against level."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from trackbench.config.experiment import Point
from trackbench.core.arrays import Array
from trackbench.evaluation.calibration import TENTHS
from trackbench.evaluation.metric_expression import Measure, OfRank, measure
from trackbench.evaluation.uniformity_tests import Histogram
from trackbench.field_types import OpenShare
from trackbench.registry import register
from trackbench.report.figures import captions
from trackbench.report.figures.over_time import Curves
from trackbench.report.findings import phrases
from trackbench.report.findings.phrases import joined, named, percent, verb
from trackbench.report.kinds import FigureKind
from trackbench.report.plotting import style, svg_file
from trackbench.report.plotting.style import Axes, Figure, LineStyle
from trackbench.report.tables.calibration import (
    check_rank,
    histogram,
    judge_histograms,
    missing_steps,
    pits,
    shares_of_runs,
)
from trackbench.report.tables_and_figures import Results
from trackbench.results.points_json import GridPoint
from trackbench.statistics.kolmogorov_distance import kolmogorov_band

_ALPHA = 0.01
"""Level of the tests of a caption, for all of them together."""
_LEAST_P = 1e-4
"""Least p-value that is written as a number."""
_LEVELS = 101
"""Number of levels at which a coverage at a step is drawn."""
_NORMAL_95 = 1.959963984540054
"""Half-width of the 95 % interval of a standard normal."""


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
        verdict = judge_histograms(histograms, _ALPHA)
        sentences = []
        if verdict.good:
            sentences.append(_say_of_ranks(verdict.good, "flat but for chance"))
        if verdict.bad:
            sentences.append(_say_of_ranks(list(verdict.bad), "not flat"))
        if not sentences:
            return ""
        where = f"At {phrases.heading(point)}: " if point else ""
        tests = f"({verdict.tests} tests, {_ALPHA:g} for all of them)"
        labels = captions.filters(results.chosen(self.filters))
        words = f"Rank histograms of {labels}, {captions.runs(results)}."
        return f"{words} {where}{'; '.join(sentences)} {tests}."

    def draw(self, results: Results) -> Figure:
        """Return a row of panels per filter (and point of the grid), a column per PIT.

        A PIT, probability integral transform, is the truth's rank in a filter's distribution, 0 to 1.
        """
        all_rows = list(product(results.points(), results.chosen(self.filters)))
        shown = all_rows[: style.MOST_PANELS]
        height = 1.25 * len(shown) + 0.6  # inches
        figure, axes = style.subplots(
            len(shown), len(self.columns), height, sharex=True, squeeze=False
        )
        looks = results.line_styles(results.chosen(self.filters))
        for row, (point, label) in zip(axes, shown, strict=True):
            color = looks[label]["color"]
            for ax, metric in zip(row, self.columns.values(), strict=True):
                ranks = histogram(results, point, label, metric)
                if ranks.runs:  # a metric without a step has the ranks of all steps
                    _draw_histogram(ax, ranks, color, over_steps=not metric.steps)
                else:
                    ax.set_axis_off()
            row_label = ", ".join(filter(None, [label, captions.heading(results, point)]))
            row[0].set_ylabel(style.wrap_label(row_label, 16))
        for ax, heading in zip(axes[0], self.columns, strict=True):
            p_value = ax.get_title()  # set by `_draw_histogram`
            ax.set_title(f"{heading}\n{p_value}".strip())
        for ax in axes[-1]:
            ax.set_xlabel("Rank of the truth")
        return style.add_title_and_legend(figure, self.title, len(all_rows))


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
    width = _NORMAL_95 * stderr
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


@register("figures", "reliability")
@dataclass(frozen=True, kw_only=True)
class Reliability(Curves):
    """Share of truths within the regions of each level; on the diagonal if calibrated.

    The regions of `pit_nees` are those of the whole state, and those of a component are its central
    intervals. The gray band contains the whole line of a calibrated filter with 95 % probability
    (Kolmogorov's distance, Stephens 1970). Over all steps there is no such band; instead bars are two
    standard errors by the runs.
    """

    metric: OfRank = measure("pit_nees@last")
    """pit_nees (the whole state) or pit_<component>; with @20 or @last at a step"""
    level: OpenShare = 0.95
    """probability of the band"""
    x_label: str = "Level of the region"
    """label of the horizontal axis"""
    y_label: str = "Share of truths in it"
    """label of the vertical axis"""

    def __post_init__(self) -> None:
        check_rank(self.metric, "metric")

    def conflicts(self, points: Sequence[Point]) -> dict[str, str]:
        """Reject a step outside the run."""
        return missing_steps("metric", [self.metric], points)

    def default_caption(self, results: Results) -> str:
        """Return the share of the truths that each filter's 90 % region contains."""
        point = results.points()[0]
        shares = []
        for label, _ in self.labels_and_looks(results):
            coverage = _count_coverage(results, point, label, self.metric)
            if coverage.runs:
                share = float(np.interp(0.9, coverage.level, coverage.share))
                shares.append(f"{named(label)} {percent(share)}")
        if not shares:
            return ""
        where = phrases.at_point(point)
        words = f"Share of the truths within the regions of each level, {captions.runs(results)}."
        return f"{words} In the region of 90 %{where} are, of the truths: {', '.join(shares)}."

    def draw(self, results: Results) -> Figure:
        """Return one line per filter: the share of the truths within its regions of each level."""
        figure, panels = self.make_panels(results)
        for panel in panels:
            (ax,) = panel.axes
            ax.plot([0, 1], [0, 1], color="black", linewidth=0.6)  # a calibrated filter
            most_runs = 0
            for label, look in self.labels_and_looks(results):
                coverage = _count_coverage(results, panel.point, label, self.metric)
                if coverage.runs:
                    _draw_coverage(ax, coverage, label, look)
                    most_runs = max(most_runs, coverage.runs)
            # The band takes independent ranks, one of each run: those at a step.
            if most_runs and self.metric.steps:
                width = kolmogorov_band(most_runs, self.level)
                ends = np.array([0.0, 1.0])
                name = f"{100 * self.level:g} % band"
                ax.fill_between(ends, ends - width, ends + width, label=name, **style.BAND)
            ax.set(xlim=(0, 1), ylim=(0, 1), aspect="equal")
        self.keep_possible_scales(figure)
        style.legend_outside(figure)
        return figure


@dataclass(frozen=True, kw_only=True)
class _Coverage:
    """Share of truths within the regions of each level: arrays (n,), and the number of runs."""

    level: Array
    share: Array
    stderr: Array
    """zero for ranks at a step, which have the band of the whole line"""
    runs: int


def _draw_coverage(ax: Axes, coverage: _Coverage, label: str, look: LineStyle) -> None:
    """Draw a filter's line with two standard errors; ``look`` is its color and dash."""
    ax.plot(coverage.level, coverage.share, label=label, **look)
    svg_file.set_stderr(ax, label, coverage.stderr)
    low = coverage.share - 2 * coverage.stderr
    high = coverage.share + 2 * coverage.stderr
    # With "_" the bars are not in the legend. The interactive page finds the line by what follows.
    ax.vlines(coverage.level, low, high, color=look["color"], label=f"_{label}")


def _count_coverage(results: Results, point: GridPoint, label: str, metric: Measure) -> _Coverage:
    """Return the share of truths within a filter's regions of each level, at a point of the grid."""
    # The regions of a component are central intervals; those of the whole state grow from NEES = 0.
    is_central = metric.quantity != "nees"  # of pit_nees, or such as pit_px
    if metric.steps:
        return _coverage_at_step(pits(results, point, label, metric), is_central)
    return _coverage_over_steps(shares_of_runs(results, point, label, metric), is_central)


def _coverage_at_step(ranks: Array, is_central: bool) -> _Coverage:
    """Count coverage from the ranks of the truth (M,) at a step, 0 to 1; NaN for a run without a rank.

    If ``is_central``, the region of a level is the central interval, else the ranks from 0 to the level.
    """
    known = ranks[~np.isnan(ranks)]
    # The least level whose region contains the truth. A central interval of level p has the ranks
    # (1 - p) / 2 to (1 + p) / 2.
    least_levels = np.abs(2.0 * known - 1.0) if is_central else known
    level = np.linspace(0.0, 1.0, _LEVELS)
    number_within = np.searchsorted(np.sort(least_levels), level, side="right")
    return _Coverage(
        level=level,
        share=number_within / max(len(known), 1),
        stderr=np.zeros(_LEVELS),
        runs=len(known),
    )


def _coverage_over_steps(shares: Array, is_central: bool) -> _Coverage:
    """Count coverage from the shares of each run's ranks in each tenth, (TENTHS, M).

    If ``is_central``, the region of a level is the central interval, else the ranks from 0 to the level.
    """
    if is_central:
        # The first interval is the two tenths in the middle. Each further one has one more per side.
        middle = TENTHS // 2
        shares = shares[middle - 1 :: -1] + shares[middle:]
    # Runs without a rank are left out. The region of level 0 contains no truth. That of each further
    # level has one more row of the shares.
    known = shares[:, ~np.isnan(shares).any(axis=0)]
    within = np.vstack([np.zeros_like(known[:1]), np.cumsum(known, axis=0)])
    levels = len(within)
    runs = known.shape[1]
    share = np.zeros(levels)
    stderr = np.zeros(levels)
    if runs:
        share = within.mean(axis=1)
    if runs > 1:
        stderr = within.std(axis=1, ddof=1) / np.sqrt(runs)
    return _Coverage(level=np.linspace(0.0, 1.0, levels), share=share, stderr=stderr, runs=runs)
