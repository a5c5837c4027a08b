"""Figure kind `reliability`: share of truths in the regions of each level, coverage against level."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackbench.config.experiment import Point
from trackbench.config.table_and_figure_checks import missing_steps
from trackbench.core.arrays import Array
from trackbench.evaluation.calibration_series import TENTHS
from trackbench.evaluation.metric_expression import Measure, OfRank, measure
from trackbench.field_types import OpenShare
from trackbench.registry import register
from trackbench.report.figures import caption_parts
from trackbench.report.figures.over_time import Curves
from trackbench.report.findings import grid_headings
from trackbench.report.findings.phrases import named, percent
from trackbench.report.plotting import interactive_curves, style
from trackbench.report.plotting.legend import legend_outside
from trackbench.report.plotting.style import Axes, Figure, LineStyle
from trackbench.report.tables_and_figures import Results
from trackbench.report.uniformity_of_ranks import check_rank, pits, shares_of_runs
from trackbench.results.points_json import GridPoint
from trackbench.statistics.kolmogorov_distance import kolmogorov_band

_LEVELS = 101
"""Number of levels at which a coverage at a step is drawn."""


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
        where = grid_headings.at_point(point)
        words = (
            f"Share of the truths within the regions of each level, {caption_parts.runs(results)}."
        )
        return f"{words} In the region of 90 %{where} are, of the truths: {', '.join(shares)}."

    def draw(self, results: Results) -> Figure:
        """Draw one line per filter: the share of the truths within its regions of each level.

        At a step there is also the band that contains the whole line of a calibrated filter with the
        probability of the config's key ``level``.
        """
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
        self.drop_impossible_log_scales(figure)
        legend_outside(figure)
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
    interactive_curves.set_stderr(ax, label, coverage.stderr)
    low = coverage.share - 2 * coverage.stderr
    high = coverage.share + 2 * coverage.stderr
    # The bars are not in the legend. The interactive page finds the line by their label.
    shape_label = interactive_curves.label_of_shape(label)
    ax.vlines(coverage.level, low, high, color=look["color"], label=shape_label)


def _count_coverage(results: Results, point: GridPoint, label: str, metric: Measure) -> _Coverage:
    """Return the share of truths within a filter's regions of each level, at a point of the grid."""
    # The regions of a component are central intervals; those of the whole state grow from NEES = 0.
    is_central = metric.quantity != "nees"  # of pit_nees, or such as pit_px
    if metric.steps:
        return _coverage_at_step(pits(results, point, label, metric), is_central)
    return _coverage_over_steps(shares_of_runs(results, point, label, metric), is_central)


def _coverage_at_step(ranks: Array, is_central: bool) -> _Coverage:
    """Count coverage from the ranks of the truth (M,) at a step; NaN for a run without a rank.

    A rank is a share of the filter's distribution, 0 to 1. If ``is_central``, the region of a level is
    the central interval, else the ranks from 0 to the level.
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
        # No bars: the figure's band around the diagonal shows the scatter of these independent ranks.
        stderr=np.zeros(_LEVELS),
        runs=len(known),
    )


def _coverage_over_steps(shares: Array, is_central: bool) -> _Coverage:
    """Count coverage from the shares of each run's ranks in each tenth, (TENTHS, M).

    If ``is_central``, the region of a level is the central interval, else the ranks from 0 to the level.
    """
    if is_central:
        # The first interval is the two tenths in the middle. Each further one has one more per side.
        # Row i of the sum is what interval i adds, (TENTHS / 2, M).
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
