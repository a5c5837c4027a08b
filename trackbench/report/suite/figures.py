"""Figures of a suite: the matrix of problems and filters, performance profiles, error over cost."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from math import log10, nan
from pathlib import Path
from typing import Any

import numpy as np

from trackbench.atomic_files import ensure_folder, write_bytes
from trackbench.report.plotting import style
from trackbench.report.plotting.point_labels import PointLabel, label_points
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
from trackbench.statistics.collapsed_runs import NOT_DEFINITE
from trackbench.statistics.significance_rules import ALIKE

_CELL_IN = 0.21
"""Height of a cell."""
_HEAD_IN = 1.5
"""Height of the filters' names and the legend."""
_WIDE_COLUMNS = 12
"""Columns of a matrix that are wide enough for names with a small slope."""
_GAP = 0.4
"""Space above the typical ratios, in cells."""
_CELL_POINTS = 6.5
_SHARE_OF_CELL = 0.92
"""Largest width of a text, of its cell's."""
_SHOWS_EQUAL = 1.005
"""Ratio up to which a cell shows 1.00."""
_LOSES = "×"
_COLLAPSES = "!"
_OVERCONFIDENT = "*"
_NOT_RUN = "#dcdcdc"
_BAND = "95 % over resampled runs"
"""Text of the profiles' bands in a legend."""
_COLORS = "viridis_r"
_FACTORS = (1.0, 1.1, 1.2, 1.5, 2.0, 3.0, 5.0, WORST)
"""Ticks of a performance profile."""
_SHOWN = 6
"""First filters of a performance profile, which have a color; others but the user's are gray."""
_OWN_LINE = 2.4
"""Width of the line of a user's own filter, in points."""


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
    """Return the problems sorted by class, so that similar classes are neighbors.

    On similar classes the same filters are good. Classes are sorted by the first principal component of
    their mean logarithms of the ratios. The problems of a class keep the suite's order.
    """
    _, problems, ratios = ratio_matrix(group)
    names = list(dict.fromkeys(group.classes[problem] for problem in problems))
    logs = np.log(ratios)
    # A row for each class, a column for each filter.
    means = np.array(
        [logs[:, [group.classes[p] == name for p in problems]].mean(axis=1) for name in names]
    )
    centered = means - means.mean(axis=0)
    # The first principal component is the first right singular vector. Its sign is the one that puts the
    # suite's first class before its last.
    _, _, components = np.linalg.svd(centered, full_matrices=False)
    places = np.round(centered @ components[0], 9)  # the same order on every machine
    if places[0] > places[-1]:
        places = -places
    rank = {name: (place, i) for i, (name, place) in enumerate(zip(names, places, strict=True))}
    return sorted(problems, key=lambda p: (rank[group.classes[p]], problems.index(p)))


def draw_matrix(group: SuiteScores) -> Figure:
    """Draw the ratio to the best of each problem (row) and filter (column).

    The color is logarithmic from 1 to `WORST`. The last row has the typical ratio, by which the
    filters are sorted. The legend below the matrix names the marks and colors.
    """
    labels = ordered_labels(group)
    problems = ordered_problems(group)
    cells = {(score.label, score.problem): score for score in group.of_role(FILTER)}
    # Step 1: the colors of the cells, then of the typical ratios.
    logs = np.full((len(problems) + 1, len(labels)), nan)
    for row, problem in enumerate(problems):
        for column, label in enumerate(labels):
            score = cells.get((label, problem))
            if score is not None and not score.is_left_out:
                logs[row, column] = log10(score.limited_ratio)
    typical = typical_ratios(group)
    logs[-1] = [log10(typical[label]) for label in labels]
    # Step 2: the matrix.
    from matplotlib import colormaps

    palette = colormaps[_COLORS].copy()
    palette.set_bad(_NOT_RUN)
    lowest = len(problems) + _GAP
    head_in = _HEAD_IN if len(labels) <= _WIDE_COLUMNS else _HEAD_IN + 0.15
    figure, ax = style.subplots(height_in=head_in + _CELL_IN * (lowest + 1))
    right = len(labels) - 0.5
    for top, rows in ((0.0, logs[:-1]), (lowest, logs[-1:])):
        ax.imshow(
            np.ma.masked_invalid(rows),
            aspect="auto",
            cmap=palette,
            vmin=0.0,
            vmax=log10(WORST),
            extent=(-0.5, right, top + len(rows) - 0.5, top - 0.5),
        )
    ax.set_xlim(-0.5, right)
    ax.set_ylim(lowest + 0.5, -0.5)
    # Step 3: the numbers and marks.
    for row, problem in enumerate(problems):
        for column, label in enumerate(labels):
            score = cells.get((label, problem))
            if score is not None and not score.is_left_out:
                slant = "italic" if _is_undecided(score) else "normal"
                _write_cell(ax, row, column, cell_text(score), logs[row, column], slant)
    for column, label in enumerate(labels):
        _write_cell(ax, lowest, column, _ratio_text(typical[label]), logs[-1, column])
    # Step 4: the names.
    ax.grid(visible=False)
    ax.set_yticks([*range(len(problems)), lowest], [*problems, "typical ratio"])
    ax.xaxis.tick_top()
    # The names of narrow columns are steeper, so that they keep apart.
    angle = 40 if len(labels) <= _WIDE_COLUMNS else 55
    ax.set_xticks(range(len(labels)), labels, rotation=angle, ha="left", rotation_mode="anchor")
    for label, text in zip(labels, ax.get_xticklabels(), strict=True):
        if label in group.added:
            text.set_fontweight("bold")
    ax.tick_params(length=0)
    for side in ax.spines.values():
        side.set_visible(False)
    _name_classes(ax, group, problems, right)
    _draw_legend(ax, group, palette)
    _fit_cells(figure, ax, len(labels))
    return figure


def _fit_cells(figure: Figure, ax: Axes, columns: int) -> None:
    """Write texts that are wider than their cell in smaller letters."""
    figure.draw_without_rendering()
    room = _SHARE_OF_CELL * ax.get_window_extent().width / columns
    for text in ax.texts:
        if text.get_horizontalalignment() == "center":  # a cell, not the name of a class
            width = text.get_window_extent().width
            if width > room:
                text.set_fontsize(float(text.get_fontsize()) * room / width)


def cell_text(score: Score) -> str:
    """Write the ratio of a cell, ``1.20``, with a mark if runs collapse or the filter is overconfident.

    A filter that lost all runs, or more than another, has a cross alone.
    """
    if score.failed or score.word == LOSES_MORE:
        return _LOSES
    text = _ratio_text(score.ratio_to_best.value)
    if score.collapsed or score.indefinite:
        return text + _COLLAPSES
    if score.consistency == "overconfident":
        return text + _OVERCONFIDENT
    return text


def _ratio_text(ratio: float) -> str:
    """Write a ratio with as many digits as a reader compares: ``1.25``, ``2.5``, ``25``, ``999+``."""
    # Limits at which rounding would add a digit, or fill the last one with a zero.
    if ratio < 1.995:
        return f"{ratio:.2f}"
    if ratio < 9.95:
        return f"{ratio:.1f}"
    if ratio < 999.5:
        return f"{ratio:.0f}"
    return "999+"


def _is_undecided(score: Score) -> bool:
    """Test whether a cell shows more than 1.00 without a significant difference from the best."""
    return score.word == ALIKE and score.limited_ratio > _SHOWS_EQUAL


def _write_cell(
    ax: Axes,
    row: float,
    column: float,
    text: str,
    log: float,
    slant: str = "normal",
) -> None:
    """Write a cell's text in black or white, whichever can be read on its color.

    ``log`` is the decimal logarithm of the ratio, which sets the color.
    """
    ink = "black"
    if log > 0.45 * log10(WORST):  # the dark end of the colors
        ink = "white"
    ax.text(
        column,
        row,
        text,
        ha="center",
        va="center",
        fontsize=_CELL_POINTS,
        fontstyle=slant,
        color=ink,
    )


def _name_classes(ax: Axes, group: SuiteScores, problems: Sequence[str], right: float) -> None:
    """Draw a line between classes, and their names on the right of the matrix."""
    start = 0  # the first row of the current class
    for row in range(1, len(problems) + 1):
        name = group.classes[problems[start]]
        if row < len(problems) and group.classes[problems[row]] == name:
            continue
        # The class ends above this row.
        middle = 0.5 * (start + row - 1)
        ax.text(right + 0.15, middle, name, ha="left", va="center", fontsize=_CELL_POINTS)
        if row < len(problems):
            ax.axhline(row - 0.5, color="white", linewidth=2.5)
        start = row


def _draw_legend(ax: Axes, group: SuiteScores, palette: Any) -> None:
    """Explain the colors, and the marks that occur, below the matrix."""
    from matplotlib.patches import Patch

    shades = ((1.0, "as good as the best filter"), (2.0, "2 times its error"), (5.0, "5 times"))
    handles = [
        Patch(facecolor=palette(log10(ratio) / log10(WORST)), label=text) for ratio, text in shades
    ]
    handles.append(Patch(facecolor=palette(1.0), label=f"{WORST:g} times or more, or loses runs"))
    scores = group.of_role(FILTER)
    if any(score.is_left_out for score in scores):
        handles.append(Patch(facecolor=_NOT_RUN, label="cannot be run"))
    texts = [cell_text(score) for score in scores if not score.is_left_out]
    collapse_meaning = "some runs collapse"
    if any(score.indefinite for score in scores):
        collapse_meaning += f", or the covariance is {NOT_DEFINITE}"
    marks = (
        (_LOSES, "loses all runs, or more than another"),
        (_COLLAPSES, collapse_meaning),
        (_OVERCONFIDENT, "overconfident"),
    )
    for mark, meaning in marks:
        if any(text.endswith(mark) for text in texts):
            handles.append(Patch(facecolor="none", edgecolor="none", label=f"{mark}  {meaning}"))
    undecided = "1.20  undecided by these runs"
    if any(map(_is_undecided, scores)):
        handles.append(Patch(facecolor="none", edgecolor="none", label=undecided))
    legend = ax.legend(
        handles=handles,
        loc="upper center",
        bbox_to_anchor=(0.5, -0.02),
        ncols=3,
        frameon=False,
        fontsize=_CELL_POINTS,
        handlelength=1.0,
        borderaxespad=0.0,
    )
    for text in legend.get_texts():
        if text.get_text() == undecided:
            text.set_fontstyle("italic")


def matrix_caption(group: SuiteScores) -> str:
    """Return how to read the matrix."""
    indefinite = ""
    if any(score.indefinite for score in group.of_role(FILTER)):
        indefinite = f", or the covariance is {NOT_DEFINITE}"
    return (
        f"{group.title}: error of each filter (column) over that of the best filter of the problem "
        f"(row). {_LOSES}: loses all runs, or significantly more than another filter. "
        f"{_COLLAPSES}: in some runs the error is far beyond what the covariance says{indefinite}. "
        f"{_OVERCONFIDENT}: overconfident. Italic: the runs do not decide whether the filter is worse "
        "than the best. 999+: 1000 times or more. Gray: cannot be run on this problem; scores.csv has "
        "the reason. Filters are sorted by their typical ratio, the geometric mean of the column, in "
        f"which a number counts as {WORST:g} at most, and a cross or a gray cell as {WORST:g}."
    )


def draw_profile(group: SuiteScores) -> Figure:
    """Draw for each filter the share of problems on which it is within a factor of the best."""
    labels, _, ratios = ratio_matrix(group)
    # Up to just below `WORST`, which counts as not within any factor.
    factors = np.logspace(0.0, log10(0.999 * WORST), 200)
    shares = profile(ratios, factors)
    low, high = profile_bands(group, factors)
    order = [labels.index(label) for label in ordered_labels(group)]
    figure, ax = style.subplots(height_in=3.4)
    # The first filters and the user's own have a color; the user's own have a thick line, too.
    colored = order[:_SHOWN] + [i for i in order[_SHOWN:] if labels[i] in group.added]
    # Gray lines are below. A later line has dashes, through which an equal line below it is seen.
    for i in [*(i for i in order if i not in colored), *colored]:
        if i in colored:
            look = style.line(colored.index(i))
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
    style.set_title(figure, group.title)
    style.legend_outside(figure, order=[labels[i] for i in order])
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
            color=style.COLORS[1 if is_own else 0],
            linestyle="",
        )
        text = label
        if left_out[label]:
            text += f" ({number - left_out[label]} of {number})"
        look = {"fontweight": "bold" if is_own else "normal"}
        names.append(PointLabel(text=text, point=(costs[label], typical[label]), look=look))
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
