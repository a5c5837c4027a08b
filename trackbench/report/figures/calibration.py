"""Figure kinds `calibration`, rank histograms, and `reliability`, coverage against level."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from trackbench.config.experiment import Point
from trackbench.core.arrays import Array
from trackbench.evaluation.consistency_and_calibration import TENTHS
from trackbench.evaluation.metric_expression import Measure, OfRank, measure
from trackbench.evaluation.uniformity_tests import Histogram, kolmogorov_band
from trackbench.field_types import OpenShare
from trackbench.registry import register
from trackbench.report.figures.over_time import Curves
from trackbench.report.findings import phrases
from trackbench.report.findings.phrases import joined, named, percent, verb
from trackbench.report.kinds import FigureKind
from trackbench.report.plotting import style, svg_file
from trackbench.report.plotting.style import Axes, Figure
from trackbench.report.results import Results
from trackbench.report.tables.calibration import (
    check_rank,
    histogram,
    judged,
    pits,
    shares_of_runs,
    steps_that_are_not,
)
from trackbench.results.point_facts import GridPoint

_ALPHA, _LEAST_P = 0.01, 1e-4
_LEVELS = 101
_NORMAL_95 = 1.959963984540054


@register("figures", "calibration")
@dataclass(frozen=True, kw_only=True)
class CalibrationFigure(FigureKind):
    """Rank histograms: in which tenth of a filter's distribution the truth is; flat if calibrated.

    A filter that is too certain has a U, one that is not certain enough a hump, one with a bias a slope
    (Talts et al. 2018, section 4.2). The gray band has 95 % of the bars of a calibrated filter, each by
    itself: binomial at a step, by the spread of the runs' own histograms over all steps.
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
        return steps_that_are_not("columns", self.columns.values(), points)

    def default_caption(self, results: Results) -> str:
        """Return which ranks are uniform, as far as the runs show, and which are not."""
        point = results.points()[0]
        ranks = []
        for label, (head, m) in product(results.chosen(self.filters), self.columns.items()):
            ranks.append((label, head, histogram(results, point, label, m)))
        verdict = judged(ranks, _ALPHA)
        parts = {"flat but for chance": verdict.good, "not flat": list(verdict.bad)}
        words = [f"{joined(map(named, b))} {verb(b)} {what}" for what, b in parts.items() if b]
        where = f"At {phrases.heading(point)}: " if point else ""
        tests = f"({verdict.tests} tests, {_ALPHA:g} for all of them)"
        return f"{where}{'; '.join(words)} {tests}." if words else ""

    def draw(self, results: Results) -> Figure:
        """Return a row of panels per filter (and point of the grid), a column per PIT."""
        every = list(product(results.points(), results.chosen(self.filters)))
        rows = every[: style.MOST_PANELS]
        shape, height = (len(rows), len(self.columns)), 1.25 * len(rows) + 0.6
        figure, axes = style.subplots(*shape, height, sharex=True, squeeze=False)
        for line, (point, label) in zip(axes, rows, strict=True):
            for ax, m in zip(line, self.columns.values(), strict=True):
                ranks = histogram(results, point, label, m)
                if not ranks.runs:
                    ax.set_axis_off()
                else:
                    _bars(ax, ranks, results.line_style(label)["color"], over_steps=not m.steps)
            head = ", ".join(filter(None, [label, phrases.heading(point)]))
            line[0].set_ylabel(style.wrap_label(head, 16))
        for ax, head in zip(axes[0], self.columns, strict=True):
            ax.set_title(f"{head}\n{ax.get_title()}".strip())
        for ax in axes[-1]:
            ax.set_xlabel("Rank of the truth")
        style.set_title(figure, self.title, len(every))
        return figure


def _bars(ax: Axes, ranks: Histogram, color: str, over_steps: bool) -> None:
    """Draw ten bars about their common expectation, the band, the p-value."""
    edges, level = np.arange(TENTHS + 1) / TENTHS, 1.0 / TENTHS
    at_step = np.full(TENTHS, np.sqrt(level * (1.0 - level) / ranks.runs))
    width = _NORMAL_95 * (ranks.stderr if over_steps else at_step)
    ax.bar(edges[:-1], ranks.shares, 1.0 / TENTHS, align="edge", color=color, alpha=0.6, lw=0)
    low, high = (np.append(level + s * width, level + s * width[-1]) for s in (-1.0, 1.0))
    ax.fill_between(edges, low, high, step="post", color="black", alpha=0.25, lw=0, zorder=3)
    ax.axhline(level, color="black", linewidth=0.6, zorder=3)
    ax.set_xlim(0.0, 1.0)
    highest = max(float(ranks.shares.max()), float(high.max()))
    ax.set_ylim(0.0, max(2.0 * level, 1.1 * highest))
    ax.set_title(f"p = {ranks.p:.2g}" if ranks.p > _LEAST_P else f"p < {_LEAST_P:g}")


@register("figures", "reliability")
@dataclass(frozen=True, kw_only=True)
class Reliability(Curves):
    """Share of truths within the regions of each level; on the diagonal if calibrated.

    Of `pit_nees` regions of the whole state, of a component its central intervals. The gray band holds
    the whole line of a calibrated filter in 95 % (Kolmogorov's distance, Stephens 1970); over all steps,
    where there is no such band, bars are two standard errors by the runs.
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
        return steps_that_are_not("metric", [self.metric], points)

    def default_caption(self, results: Results) -> str:
        """Return the coverage of the 90 % region."""
        point, parts = results.points()[0], []
        for label, _ in self.labels(results):
            level, share, _, runs = _coverage(results, point, label, self.metric)
            if runs:
                parts.append(f"{named(label)} {percent(float(np.interp(0.9, level, share)))}")
        where = f" at {phrases.heading(point)}" if point else ""
        what = f"In the region of 90 %{where} are, of the truths"
        return f"{what}: {', '.join(parts)}." if parts else ""

    def draw(self, results: Results) -> Figure:
        """Return one line per filter."""
        figure, panels = self.panels(results)
        for (ax,), point in panels:
            ax.plot([0, 1], [0, 1], color="black", linewidth=0.6)
            most = 0
            for label, look in self.labels(results):
                level, share, error, runs = _coverage(results, point, label, self.metric)
                if runs:
                    ax.plot(level, share, label=label, **look)
                    svg_file.set_stderr(ax, label, error)
                    low, high = share - 2 * error, share + 2 * error
                    ax.vlines(level, low, high, color=look["color"], label=f"_{label}")
                    most = max(most, runs)
            if most and self.metric.steps:
                width = kolmogorov_band(most, self.level)
                name, ends = f"{100 * self.level:g} % band", np.array([0.0, 1.0])
                ax.fill_between(ends, ends - width, ends + width, label=name, **style.BAND)
            ax.set(xlim=(0, 1), ylim=(0, 1), aspect="equal")
        self.keep_possible_scales(figure)
        style.legend_outside(figure)
        return figure


def _coverage(
    results: Results, point: GridPoint, label: str, m: Measure
) -> tuple[Array, Array, Array, int]:
    """Count truths within: levels, shares, standard errors (zero at a step), number of runs."""
    central = m.family[1] != "nees"
    if m.steps:
        values = pits(results, point, label, m)
        values = values[~np.isnan(values)]
        within = np.sort(np.abs(2.0 * values - 1.0) if central else values)
        level = np.linspace(0.0, 1.0, _LEVELS)
        share = np.searchsorted(within, level, side="right") / max(len(within), 1)
        return level, share, np.zeros(_LEVELS), len(within)
    shares = shares_of_runs(results, point, label, m)
    if central:  # the two tenths in the middle, and ever more on either side
        shares = shares[TENTHS // 2 - 1 :: -1] + shares[TENTHS // 2 :]
    shares = shares[:, ~np.isnan(shares).any(axis=0)]
    inside = np.vstack([np.zeros_like(shares[:1]), np.cumsum(shares, axis=0)])
    runs = shares.shape[1]
    error = inside.std(axis=1, ddof=1) / np.sqrt(runs) if runs > 1 else np.zeros(len(inside))
    level = np.linspace(0.0, 1.0, len(inside))
    return level, inside.mean(axis=1) if runs else np.zeros(len(inside)), error, runs
