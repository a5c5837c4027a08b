"""Figures of a suite: the matrix of problems and filters, performance profiles, error over cost."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite, log10, nan
from pathlib import Path
from typing import Any

import numpy as np

from trackbench.atomic_files import ensure_folder, write_bytes
from trackbench.report.plotting import style
from trackbench.report.plotting.style import Axes, Figure
from trackbench.report.suite.scores import (
    FILTER,
    LOSES_MORE,
    WORST,
    Score,
    SuiteScores,
    ordered_labels,
    profile,
    profile_bands,
    ratio_matrix,
    relative_costs,
    typical_ratios,
)

_CELL_IN = 0.29
"""Height of a cell, which is at most twice as wide."""
_NOT_RUN = "#dcdcdc"
_COLORS = "viridis_r"
_SHOWN = 6
"""Filters of a performance profile that have a color; the others are gray."""


@dataclass(frozen=True, kw_only=True)
class SuiteFigure:
    """A drawn figure of a suite."""

    name: str
    caption: str
    svg: bytes


def draw_figures(
    folder: Path, groups: Sequence[SuiteScores], formats: Sequence[str]
) -> list[SuiteFigure]:
    """Draw the figures of each group into ``folder/figures``; return them as SVG with captions."""
    drawn = []
    for group in groups:
        if not group.of_role(FILTER):
            continue
        parts = (
            ("matrix", draw_matrix, matrix_caption(group)),
            ("profile", draw_profile, profile_caption(group)),
            ("cost", draw_cost, cost_caption(group)),
        )
        for kind, draw, caption in parts:
            name = f"{group.group}-{kind}"
            with style.rc_context():
                figure = draw(group)
                contents = {"svg": style.content(figure, "svg")}
                for form in formats:
                    if form not in contents and form != "tex":
                        contents[form] = style.content(figure, form)
                style.close(figure)
            for form in formats:
                if form in contents:
                    target = ensure_folder(folder / "figures") / f"{name}.{form}"
                    write_bytes(target, contents[form])
            drawn.append(SuiteFigure(name=name, caption=caption, svg=contents["svg"]))
    return drawn


def ordered_problems(group: SuiteScores) -> list[str]:
    """Return the problems by class; neighboring classes are those on which the same filters are good.

    Classes are ordered by the first principal component of the mean logarithms of the ratios, and the
    problems of a class stay in the suite's order.
    """
    labels, problems, ratios = ratio_matrix(group)
    names = list(dict.fromkeys(group.classes[problem] for problem in problems))
    logs = np.log(ratios)
    means = np.array(
        [logs[:, [group.classes[p] == name for p in problems]].mean(axis=1) for name in names]
    )
    centered = means - means.mean(axis=0)
    # The first principal component, with the sign that puts the easiest class for the best filter first.
    component = np.linalg.svd(centered, full_matrices=False)[2][0]
    places = np.round(centered @ component, 9)
    best = labels.index(ordered_labels(group)[0])
    if np.dot(places, means[:, best]) < 0.0:
        places = -places
    rank = {name: (place, i) for i, (name, place) in enumerate(zip(names, places, strict=True))}
    return sorted(problems, key=lambda p: (rank[group.classes[p]], problems.index(p)))


def draw_matrix(group: SuiteScores) -> Figure:
    """Draw the ratio to the best of each filter (row) on each problem (column).

    The color is logarithmic from 1 to `WORST`. A cross marks a filter that loses more runs or whose
    runs collapse, a point an overconfident one. Gray cells were not run.
    """
    labels = ordered_labels(group)
    problems = ordered_problems(group)
    cells = {(score.label, score.problem): score for score in group.of_role(FILTER)}
    colors = np.full((len(labels), len(problems)), nan)
    for i, label in enumerate(labels):
        for j, problem in enumerate(problems):
            score = cells.get((label, problem))
            if score is not None and not score.is_left_out:
                colors[i, j] = log10(score.limited_ratio)
    height = 1.9 + _CELL_IN * len(labels)
    figure, ax = style.subplots(height_in=height)
    shown = np.ma.masked_invalid(colors)
    from matplotlib import colormaps

    palette = colormaps[_COLORS].copy()
    palette.set_bad(_NOT_RUN)
    image = ax.imshow(shown, aspect="auto", cmap=palette, vmin=0.0, vmax=log10(WORST))
    for i, label in enumerate(labels):
        for j, problem in enumerate(problems):
            _write_cell(ax, i, j, cells.get((label, problem)), colors[i, j])
    ax.grid(visible=False)
    ax.set_yticks(range(len(labels)), labels)
    ax.set_xticks(range(len(problems)), problems, rotation=60, ha="right", rotation_mode="anchor")
    ax.tick_params(length=0)
    _separate_classes(ax, group, problems, len(labels))
    bar = figure.colorbar(image, ax=ax, label="error / error of the best filter", pad=0.01)
    ticks = [1.0, 1.2, 1.5, 2.0, 3.0, 5.0, WORST]
    bar.set_ticks([log10(tick) for tick in ticks])
    bar.set_ticklabels([*(f"{tick:g}" for tick in ticks[:-1]), f"{WORST:g} or more"])
    return figure


def _write_cell(ax: Axes, row: int, column: int, score: Score | None, color: float) -> None:
    """Write a cell's ratio and marks."""
    if score is None or not isfinite(color):
        return
    ink = "white" if color > 0.45 * log10(WORST) else "black"
    text = ""
    if score.failed or score.word == LOSES_MORE or score.collapsed:
        text = "×"
    elif score.ratio_to_best.value < WORST:
        digits = 2 if score.ratio_to_best.value < 1.095 else 1
        text = f"{score.ratio_to_best.value:.{digits}f}".rstrip("0").rstrip(".")
    if score.consistency == "overconfident":
        text += "·"
    ax.text(column, row, text, ha="center", va="center", fontsize=5.5, color=ink)


def _separate_classes(ax: Axes, group: SuiteScores, problems: Sequence[str], rows: int) -> None:
    """Draw a line between classes, and their names above the matrix."""
    start = 0
    for j in range(1, len(problems) + 1):
        name = group.classes[problems[start]]
        if j < len(problems) and group.classes[problems[j]] == name:
            continue
        middle = 0.5 * (start + j - 1)
        ax.text(middle, -0.75, name, ha="left", va="bottom", fontsize=6, rotation=35)
        if j < len(problems):
            ax.axvline(j - 0.5, color="white", linewidth=2.0)
        start = j


def matrix_caption(group: SuiteScores) -> str:
    """Return how to read the matrix."""
    return (
        f"{group.title}: error of each filter over that of the best filter of the problem. ×: loses "
        "all runs or significantly more than another filter, or some runs collapse. ·: overconfident. "
        "Gray: cannot be run on this problem; scores.csv has the reason. Filters are sorted by their "
        "typical ratio."
    )


def draw_profile(group: SuiteScores) -> Figure:
    """Draw for each filter the share of problems on which it is within a factor of the best."""
    labels, _, ratios = ratio_matrix(group)
    factors = np.logspace(0.0, log10(0.999 * WORST), 200)
    shares = profile(ratios, factors)
    low, high = profile_bands(group, factors)
    order = [labels.index(label) for label in ordered_labels(group)]
    figure, ax = style.subplots(height_in=3.4)
    for place, i in reversed([*enumerate(order)]):
        if place < _SHOWN:
            look = style.line(place)
            ax.fill_between(
                factors, low[i], high[i], step="post", alpha=0.15, lw=0, color=look["color"]
            )
            ax.step(factors, shares[i], where="post", label=labels[i], **look)
        else:
            ax.step(factors, shares[i], where="post", color="#c4c4c4", linewidth=0.8, zorder=1.5)
    if len(order) > _SHOWN:
        ax.plot([], [], color="#c4c4c4", linewidth=0.8, label="other filters")
    ax.set_xscale("log")
    ticks = [1.0, 1.2, 1.5, 2.0, 3.0, 5.0, WORST]
    ax.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    ax.minorticks_off()
    ax.set_xlim(1.0, WORST)
    ax.set_ylim(0.0, 1.02)
    ax.set_xlabel("factor to the error of the best filter")
    ax.set_ylabel("share of problems within the factor")
    handles, names = ax.get_legend_handles_labels()
    rank = {labels[i]: place for place, i in enumerate(order)}
    ranked = sorted(zip(names, handles, strict=True), key=lambda pair: rank.get(pair[0], len(rank)))
    ax.legend([handle for _, handle in ranked], [name for name, _ in ranked], loc="lower right")
    return figure


def profile_caption(group: SuiteScores) -> str:
    """Return how to read the profiles."""
    return (
        f"{group.title}: share of problems on which a filter's error is at most so many times that of "
        "the best filter. Higher is better. Bands: 95 % over resampled runs. A problem on which a "
        "filter cannot be run, or loses significantly more runs, counts as not within any factor."
    )


def draw_cost(group: SuiteScores) -> Figure:
    """Draw each filter's typical ratio over its CPU time in those of the fastest filter."""
    typical = typical_ratios(group)
    costs = relative_costs(group)
    figure, ax = style.subplots(height_in=3.4)
    for label in ordered_labels(group):
        if label not in costs:
            continue
        ax.plot(
            costs[label], typical[label], marker="o", markersize=4, color="#0072B2", linestyle=""
        )
        place: Any = (costs[label], typical[label])
        ax.annotate(label, place, (4.0, 2.0), textcoords="offset points", fontsize=6.5)
    ax.set_xscale("log")
    ax.set_yscale("log")
    ticks = [
        tick
        for tick in (1.0, 1.2, 1.5, 2.0, 3.0, 5.0, WORST)
        if tick <= 1.2 * max(typical.values())
    ]
    ax.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    ax.minorticks_off()
    ax.set_xlabel("CPU time / that of the fastest filter, median over the problems")
    ax.set_ylabel("error / that of the best filter,\ngeometric mean over the problems")
    return figure


def cost_caption(group: SuiteScores) -> str:
    """Return how to read error over cost."""
    return (
        f"{group.title}: error and CPU time of each filter over all problems. Lower and further left "
        f"is better. A ratio counts as {WORST:g} at most, also of a filter that fails or cannot be run. "
        "A filter for one run loops over the runs in Python."
    )
