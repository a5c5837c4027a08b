"""Figures of a suite over all its problems: performance profiles, and error over CPU time."""

from collections import Counter
from math import log10

import numpy as np

from trackbench.report.plotting import filter_colors, style
from trackbench.report.plotting.legend import legend_outside
from trackbench.report.plotting.panels import set_title
from trackbench.report.plotting.point_labels import PointLabel, label_points
from trackbench.report.plotting.style import Figure
from trackbench.report.suite.scores import (
    FILTER,
    WORST,
    SuiteScores,
    ordered_labels,
    profile,
    profile_bands,
    ratio_matrix,
    relative_costs,
    typical_ratios,
)

_BAND = "95 % over resampled runs"
"""Text of the profiles' bands in a legend."""
_FACTORS = (1.0, 1.1, 1.2, 1.5, 2.0, 3.0, 5.0, WORST)
"""Ticks of a performance profile."""
_SHOWN = 6
"""First filters of a performance profile, which have a color; others but the user's are gray."""
_OWN_LINE = 2.4
"""Width of the line of a user's own filter, in points."""


def draw_profile(group: SuiteScores) -> Figure:
    """Draw the performance profile of each filter.

    It is the share of problems on which the filter's error is at most a factor times that of the best
    filter, over this factor.
    """
    labels, _, ratios = ratio_matrix(group)
    # Up to just below `WORST`, which counts as not within any factor.
    factors = np.logspace(0.0, log10(0.999 * WORST), 200)
    shares = profile(ratios, factors)
    low, high = profile_bands(group, factors)
    order = [labels.index(label) for label in ordered_labels(group)]  # the best first
    figure, ax = style.subplots(height_in=3.4)
    # The first filters and the user's own have a color; the user's own have a thick line, too.
    colored = order[:_SHOWN] + [i for i in order[_SHOWN:] if labels[i] in group.added]
    # Gray lines are drawn first, below. A later line may have dashes, through which an equal line below
    # it is seen.
    for i in [*(i for i in order if i not in colored), *colored]:
        if i in colored:
            look = filter_colors.line(colored.index(i))
            if labels[i] in group.added:
                look["linewidth"] = _OWN_LINE
            ax.fill_between(
                factors, low[i], high[i], step="post", alpha=0.15, lw=0, color=look["color"]
            )
            ax.step(factors, shares[i], where="post", label=labels[i], **look)
        else:
            ax.step(factors, shares[i], where="post", color="#c4c4c4", linewidth=0.8, zorder=1.5)
    if len(order) > len(colored):
        ax.plot([], [], color="#c4c4c4", linewidth=0.8, label="other filters")
    ax.fill_between([], [], [], color="#888888", alpha=0.4, lw=0, label=_BAND)
    ax.set_xscale("log")
    # The axis ends behind the last step of a curve.
    last = 1.0
    for curve in (*shares, *low, *high):
        # The first factor at which the curve has its last value.
        index = np.flatnonzero(curve == curve[-1])[0]
        last = max(last, float(factors[index]))
    right = next((tick for tick in _FACTORS if tick >= max(1.05 * last, 1.5)), WORST)
    ticks = [tick for tick in _FACTORS if tick <= right]
    if right > 2.0:  # the label of 1.1 has no room beside that of 1
        ticks.remove(1.1)
    ax.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    ax.minorticks_off()
    ax.set_xlim(1.0, right)
    ax.set_ylim(0.0, 1.04)  # a line at 1 is not on the frame
    ax.set_xlabel("Factor to the error of the best filter")
    ax.set_ylabel("Share of problems within the factor")
    set_title(figure, group.title)
    legend_outside(figure, order=[labels[i] for i in order])
    return figure


def profile_caption(group: SuiteScores) -> str:
    """Return how to read the profiles."""
    return (
        f"{group.title}: share of problems on which a filter's error is at most so many times that of "
        "the best filter. Higher is better. Bands: 95 % over resampled runs. A problem on which a "
        "filter cannot be run, or loses significantly more runs, counts as not within any factor."
    )


def draw_cost(group: SuiteScores) -> Figure:
    """Draw each filter's typical ratio to the best over its CPU time, as a multiple of the fastest's."""
    typical = typical_ratios(group)
    costs = relative_costs(group)
    figure, ax = style.subplots(height_in=3.4)
    number = len({score.problem for score in group.of_role(FILTER)})
    left_out = Counter(score.label for score in group.of_role(FILTER) if score.is_left_out)
    names: list[PointLabel] = []
    for label in ordered_labels(group):
        if label not in costs:
            continue
        is_own = label in group.added
        ax.plot(
            costs[label],
            typical[label],
            marker="o",
            markersize=4,
            color=filter_colors.COLORS[1 if is_own else 0],
            linestyle="",
        )
        text = label
        if left_out[label]:
            text += f" ({number - left_out[label]} of {number})"
        look = {"fontweight": "bold" if is_own else "normal"}
        names.append(PointLabel(text=text, point=(costs[label], typical[label]), look=look))
    ax.set_xscale("log")
    ax.set_yscale("log")
    # Ratios are limited to `WORST`, and so are their means.
    ticks = [
        tick
        for tick in (1.0, 1.2, 1.5, 2.0, 3.0, 5.0, WORST)
        if tick <= 1.2 * max(typical.values())
    ]
    ax.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    ax.minorticks_off()
    ax.set_xlabel("CPU time / that of the fastest filter, median over the problems")
    ax.set_ylabel("Error / that of the best filter,\ngeometric mean over the problems")
    label_points(figure, ax, names, font_size=6.5)
    return figure


def cost_caption(group: SuiteScores) -> str:
    """Return how to read error over cost."""
    return (
        f"{group.title}: error and CPU time of each filter over all problems. Lower and further left "
        f"is better. A ratio counts as {WORST:g} at most, also of a filter that fails or cannot be run. "
        "A label with \u201c5 of 9\u201d is of a filter that runs on 5 of 9 problems: the others count "
        f"as {WORST:g}. A filter for one run loops over the runs in Python, and the time of a program "
        "includes the exchange of lines."
    )
