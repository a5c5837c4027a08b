"""Figure kind `critical-difference`: mean ranks over runs, and who does not differ from whom."""

from dataclasses import dataclass

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.metric_expression import OfRun, measure
from trackbench.field_types import OpenShare
from trackbench.registry import register
from trackbench.report.findings import phrases
from trackbench.report.kinds import FigureKind
from trackbench.report.plotting import style
from trackbench.report.plotting.style import Axes, Figure
from trackbench.report.results import Results


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

    def draw(self, results: Results) -> Figure:
        """Return a panel per point of the grid, one below the other."""
        points = results.points()[: style.MOST_PANELS]
        labels = results.chosen(self.filters)
        height = len(points) * (1.0 + 0.2 * ((len(labels) + 1) // 2) + 0.14 * len(labels) / 2)
        figure, axes = style.subplots(len(points), 1, height, squeeze=False)
        for ax, point in zip(axes[:, 0], points, strict=True):
            runs = results.runs(point)
            ranked = [b for b in labels if (b, str(self.metric)) in runs]
            if len(ranked) < 2:
                ax.set_axis_off()
                continue
            larger = self.metric.family[0].more_is_better
            best, sign = ("largest", -1.0) if larger else ("smallest", 1.0)
            # Mean ranks, and the groups of filters closer than the critical difference.
            values = sign * np.stack([runs[b, str(self.metric)] for b in ranked])
            mean = mean_ranks(values)
            critical = critical_difference(len(ranked), values.shape[1], self.alpha)
            _panel(ax, ranked, mean, cliques(mean, critical))
            where = phrases.heading(point)
            words = f"Mean rank of {self.metric} over {values.shape[1]} runs (1: the {best})"
            words += f", critical difference {critical:.2f}{': ' if where else ''}{where}"
            ax.set_title(style.wrapped(words), pad=14)
        style.set_title(figure, self.title, len(results.points()))
        return figure


def mean_ranks(values: Array) -> Array:
    """Return mean ranks (k,) of k filters from values (k, M); NaN is worst, ties share."""
    worst = np.where(np.isnan(values), np.inf, values)
    better = [np.sum(worst < row, axis=0) for row in worst]
    equal = [np.sum(worst == row, axis=0) for row in worst]  # with itself
    return np.mean(np.array(better) + 0.5 * (np.array(equal) + 1), axis=1)


def critical_difference(k: int, runs: int, alpha: float) -> float:
    """Return the critical difference of mean ranks of k filters (Demsar 2006, section 3.2.2)."""
    q = range_quantile(1.0 - alpha, k) / np.sqrt(2.0)
    return q * float(np.sqrt(k * (k + 1) / (6.0 * runs)))


def range_quantile(level: float, k: int) -> float:
    """Return the quantile of the range of k standard normals: the studentized range of infinite freedom.

    Its distribution function (Tippett 1925, Biometrika 17, 364) by quadrature, inverted by bisection:
    scipy's takes half a second to import.
    """
    from scipy.special import ndtr

    nodes, weights = np.polynomial.legendre.leggauss(200)
    z = 9.0 * nodes
    density = 9.0 * weights * np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi)
    low, high = 0.0, 20.0
    for _ in range(60):
        q = 0.5 * (low + high)
        below = k * np.sum(density * (ndtr(z) - ndtr(z - q)) ** (k - 1))
        low, high = (q, high) if below < level else (low, q)
    return high


def cliques(mean: Array, critical: float) -> list[tuple[float, float]]:
    """Return the first and last mean rank of every largest group within the critical difference."""
    ranks = np.sort(mean)
    groups: list[tuple[float, float]] = []
    for first in ranks:
        last = ranks[ranks <= first + critical][-1]
        if last > first and (not groups or last > groups[-1][1]):
            groups.append((float(first), float(last)))
    return groups


def _panel(ax: Axes, labels: list[str], mean: Array, groups: list[tuple[float, float]]) -> None:
    """Draw ranks on the upper axis, labels left and right below it, bars for the groups."""
    k = len(labels)
    order = np.argsort(mean)
    half = (k + 1) // 2
    start = 0.5 + 0.35 * len(groups)
    for i, (low, high) in enumerate(groups):
        ax.plot([low - 0.03, high + 0.03], [0.4 + 0.35 * i] * 2, color="black", linewidth=3)
    for place, index in enumerate(order):
        left = place < half
        depth = start + (place if left else k - 1 - place) + 0.5
        side = 0.6 if left else k + 0.4
        ax.plot([mean[index]] * 2 + [side], [0, depth, depth], color="#444444", linewidth=0.8)
        text = style.wrap_label(f"{labels[index]} ({mean[index]:.2f})", 30)
        ax.text(side + (-0.1 if left else 0.1), depth, text, fontsize=8, va="center",
                ha="right" if left else "left")  # fmt: skip
    ax.set(xlim=(1 - 0.28 * k, k + 0.28 * k), ylim=(start + half + 0.3, 0))
    ax.set_xticks(range(1, k + 1))
    ax.xaxis.tick_top()
    ax.spines[["left", "bottom"]].set_visible(False)
    ax.spines["top"].set_visible(True)
    ax.spines["top"].set_bounds(1, k)
    ax.set_yticks([])
    ax.grid(visible=False)
