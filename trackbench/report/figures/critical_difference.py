"""Figure kind `critical-difference`: mean ranks over runs, and who does not differ from whom."""

from dataclasses import dataclass

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.metric_expression import OfRun, measure
from trackbench.field_types import OpenShare
from trackbench.registry import register
from trackbench.report.figures import caption_parts
from trackbench.report.findings import grid_headings
from trackbench.report.kinds import FigureKind
from trackbench.report.plotting import style
from trackbench.report.plotting.panels import MOST_PANELS, set_title
from trackbench.report.plotting.style import Axes, Figure
from trackbench.report.tables_and_figures import Results
from trackbench.results.points_json import GridPoint


@register("figures", "critical-difference")
@dataclass(frozen=True, kw_only=True)
class CriticalDifference(FigureKind):
    """Mean rank of each filter over the runs; bars join filters that do not differ (Nemenyi test).

    Demsar 2006. A lost run has the worst rank.
    """

    filters: tuple[str, ...] | None = None
    """labels to rank; default: all"""
    metric: OfRun = measure("rmse")
    """metric of per_run.csv; smaller is better, unless of this one larger is"""
    alpha: OpenShare = 0.05
    """probability of a false difference anywhere in the figure"""

    def default_caption(self, results: Results) -> str:
        """Return metric, filters, number of runs and level of the test."""
        words = f"mean rank by {caption_parts.quantity(self.metric)}"
        caption = caption_parts.of_curves(results, words, results.chosen(self.filters))
        level = f"Nemenyi test at {100 * self.alpha:g} %"
        return f"{caption} A bar joins filters that do not differ significantly ({level})."

    def draw(self, results: Results) -> Figure:
        """Return a panel per point of the grid, one below the other."""
        points = results.points()[:MOST_PANELS]
        labels = results.chosen(self.filters)
        rows = (len(labels) + 1) // 2
        # In inches: the axis and the title, rows of labels, and bars above them.
        height = len(points) * (1.0 + 0.2 * rows + 0.14 * len(labels) / 2)
        figure, axes = style.subplots(len(points), 1, height, squeeze=False)
        for ax, point in zip(axes[:, 0], points, strict=True):
            self._draw_panel(ax, results, point, labels)
        set_title(figure, self.title, number_of_points=len(results.points()))
        return figure

    def _draw_panel(self, ax: Axes, results: Results, point: GridPoint, labels: list[str]) -> None:
        """Rank the filters at a point of the grid, and draw the ranks."""
        metric = str(self.metric)
        runs = results.runs(point)
        ranked = [label for label in labels if (label, metric) in runs]  # those that did not fail
        if len(ranked) < 2:
            ax.set_axis_off()
            return
        # Step 1: mean ranks, where the smallest value is best. A lost run is NaN, also with the other
        # sign, and NaN has the last rank.
        values = np.stack([runs[label, metric] for label in ranked])
        best = "smallest"
        if self.metric.definition.more_is_better:
            values = -values
            best = "largest"
        mean = mean_ranks(values)
        # Step 2: groups of filters whose mean ranks differ by at most the critical difference.
        number_of_runs = values.shape[1]
        critical = critical_difference(len(ranked), number_of_runs, self.alpha)
        groups = cliques(mean, critical)
        _draw_ranks(ax, ranked, mean, groups)
        title = f"Mean rank by {caption_parts.quantity(self.metric)} over {number_of_runs} runs "
        title += f"(1: the {best}), "
        title += f"critical difference {critical:.2f}"
        where = grid_headings.heading(point)
        if where:
            title += f": {where}"
        ax.set_title(style.wrapped(title), pad=14)


def mean_ranks(values: Array) -> Array:
    """Return the mean ranks of k filters over M runs; the smallest value is best.

    NaN has the worst rank. Equal values share the mean of their ranks.

    Parameters
    ----------
    values
        values (k, M) of the filters in each run

    Returns
    -------
    array (k,)
        mean ranks from 1 to k
    """
    values = np.where(np.isnan(values), np.inf, values)
    better = np.array([np.sum(values < row, axis=0) for row in values])
    equal = np.array([np.sum(values == row, axis=0) for row in values])  # at least 1: itself
    # Equal values have the ranks better + 1 to better + equal.
    return np.mean(better + 0.5 * (equal + 1), axis=1)


def critical_difference(k: int, runs: int, alpha: float) -> float:
    """Return the critical difference of mean ranks of k filters (Demsar 2006, section 3.2.2)."""
    q = range_quantile(1.0 - alpha, k) / np.sqrt(2.0)
    return q * float(np.sqrt(k * (k + 1) / (6.0 * runs)))


def range_quantile(level: float, k: int) -> float:
    """Return the quantile of the range of k standard normals: the studentized range of infinite freedom.

    The distribution function (Tippett 1925, Biometrika 17, 364) is computed by quadrature, and inverted
    by bisection. scipy has the quantile, too, but takes half a second to import.

    Parameters
    ----------
    level
        probability of a smaller range
    k
        number of normal variables, at least 2

    Returns
    -------
    float
        quantile, in standard deviations
    """
    from scipy.special import ndtr

    # Pr(range <= q) = k int phi(z) (Phi(z) - Phi(z - q))^(k - 1) dz, from -9 to 9.
    nodes, weights = np.polynomial.legendre.leggauss(200)
    z = 9.0 * nodes
    density = 9.0 * weights * np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi)
    # 60 halvings of this interval, which contains the quantile, are exact to rounding.
    low = 0.0
    high = 20.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        probability = k * np.sum(density * (ndtr(z) - ndtr(z - middle)) ** (k - 1))
        if probability < level:
            low = middle
        else:
            high = middle
    return high


def cliques(mean: Array, critical: float) -> list[tuple[float, float]]:
    """Return the first and last mean rank of each group of filters that a bar joins.

    The mean ranks of a group lie within the critical difference, and no larger group contains it.

    Parameters
    ----------
    mean
        mean ranks (k,) of the filters
    critical
        critical difference of mean ranks

    Returns
    -------
    list of (float, float)
        first and last mean rank of each group of different ranks, in ascending order
    """
    ranks = np.sort(mean)
    groups: list[tuple[float, float]] = []
    for first in ranks:
        last = ranks[ranks <= first + critical][-1]
        # A group that ends where the one before ends is contained in it.
        is_contained = bool(groups) and last <= groups[-1][1]
        if last > first and not is_contained:
            groups.append((float(first), float(last)))
    return groups


def _draw_ranks(
    ax: Axes, labels: list[str], mean: Array, groups: list[tuple[float, float]]
) -> None:
    """Draw ranks on the upper axis, labels left and right below it, bars for the groups.

    ``mean`` has the mean rank of each label, ``groups`` the first and last mean rank of each group.
    """
    k = len(labels)
    # The better half of the labels, and one more of an odd number. Depths are below the axis.
    half = (k + 1) // 2
    top_of_labels = 0.5 + 0.35 * len(groups)
    # Step 1: bars for the groups.
    for number, (low, high) in enumerate(groups):
        depth = 0.4 + 0.35 * number
        ax.plot([low - 0.03, high + 0.03], [depth, depth], color="black", linewidth=3)
    # Step 2: a line from each rank to its label; the better half is on the left.
    for position, index in enumerate(np.argsort(mean)):  # position 0 is the best
        rank = mean[index]
        if position < half:
            row = position
            side = 0.6
            text_place = side - 0.1
            alignment = "right"
        else:
            row = k - 1 - position  # the worst is on top
            side = k + 0.4
            text_place = side + 0.1
            alignment = "left"
        depth = top_of_labels + row + 0.5
        ax.plot([rank, rank, side], [0, depth, depth], color="#444444", linewidth=0.8)
        text = style.wrap_label(f"{labels[index]} ({rank:.2f})", 30)
        ax.text(text_place, depth, text, fontsize=8, va="center", ha=alignment)
    # Step 3: the upper axis alone.
    ax.set(xlim=(1 - 0.28 * k, k + 0.28 * k), ylim=(top_of_labels + half + 0.3, 0))
    ax.set_xticks(range(1, k + 1))
    ax.xaxis.tick_top()
    ax.spines[["left", "bottom"]].set_visible(False)
    ax.spines["top"].set_visible(True)
    ax.spines["top"].set_bounds(1, k)
    ax.set_yticks([])
    ax.grid(visible=False)
