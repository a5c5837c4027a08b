"""Figure of a suite: the matrix of problems and filters, with its cells, legend and caption."""

from collections.abc import Sequence
from math import log10, nan
from typing import Any

import numpy as np

from trackbench.report.figures.heat_map_cells import fit_texts_in_cells
from trackbench.report.plotting import style
from trackbench.report.plotting.style import Axes, Figure
from trackbench.report.suite.scores import (
    FILTER,
    LOSES_MORE,
    WORST,
    Score,
    SuiteScores,
    ordered_labels,
    ratio_matrix,
    typical_ratios,
)
from trackbench.statistics.indefinite_covariances import NOT_DEFINITE
from trackbench.statistics.significance_rules import ALIKE

COLORS = "viridis_r"
_CELL_IN = 0.21
"""Height of a cell."""
_HEAD_IN = 1.5
"""Height of the filters' names and the legend."""
_WIDE_COLUMNS = 12
"""Columns of a matrix that are wide enough for names with a small slope."""
_GAP = 0.4
"""Space above the typical ratios, in cells."""
_CELL_POINTS = 6.5
"""Size of the letters, in points."""
_SHOWS_EQUAL = 1.005
"""Ratio up to which a cell shows 1.00."""
_LOSES = "×"
"""Mark in place of the ratio: the filter lost all runs, or significantly more than some other one."""
_COLLAPSES = "!"
_OVERCONFIDENT = "*"
"""Marks behind the ratio."""
_NOT_RUN = "#dcdcdc"
"""Color of a cell whose filter cannot be run."""
_DARK = 0.45
"""Share of the color scale, which is dark at `WORST`, from which on black letters cannot be read."""


def ordered_problems(group: SuiteScores) -> list[str]:
    """Return the problems sorted by class, so that similar classes are neighbors.

    On similar classes the same filters are good. A ratio is a filter's error over that of the best
    filter of the problem. It is limited to 1 to `WORST`, also of a filter without an error, so that its
    logarithm is finite. Classes are sorted by the first principal component of their mean logarithms.
    The problems of a class keep the suite's order.
    """
    _, problems, ratios = ratio_matrix(group)
    names = list(dict.fromkeys(group.classes[problem] for problem in problems))
    logs = np.log(ratios)
    # Mean logarithms over the problems of each class: a row for each class, a column for each filter.
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
    # Step 1: the colors of the cells, then of the typical ratios. NaN is gray: the filter was not run.
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

    palette = colormaps[COLORS].copy()
    palette.set_bad(_NOT_RUN)
    lowest = len(problems) + _GAP  # place of the row of typical ratios, below a gap
    # Names of many columns are steeper, and so higher.
    head_in = _HEAD_IN if len(labels) <= _WIDE_COLUMNS else _HEAD_IN + 0.15
    figure, ax = style.subplots(height_in=head_in + _CELL_IN * (lowest + 1))
    right = len(labels) - 0.5  # edge of the last column: the middle of a cell has its index
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
        if label in group.added:  # the user's own filter
            text.set_fontweight("bold")
    ax.tick_params(length=0)
    for side in ax.spines.values():
        side.set_visible(False)
    _name_classes(ax, group, problems, right)
    _draw_legend(ax, group, palette)
    fit_texts_in_cells(figure, ax, len(labels))
    return figure


def cell_text(score: Score) -> str:
    """Write the ratio of a cell, ``1.20``, with a mark if runs collapse or the filter is overconfident.

    Runs with a covariance that is not positive definite have the mark of collapsed ones. A filter that
    was run and has no error, as it raised or lost all runs, has a cross alone. So has one that lost
    significantly more runs than some other filter.
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

    ``row`` is a place on the vertical axis. It is no whole number for the row of typical ratios, which
    stands below the problems and a gap. ``log`` is the decimal logarithm of the ratio, 0 at least, which
    sets the color. ``slant`` is matplotlib's font style.
    """
    ink = "black"
    if log > _DARK * log10(WORST):
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
    """Draw a line between classes of problems, and their names on the right of the matrix.

    ``problems`` are the rows, those of a class below each other. ``right`` is the x of the right edge.
    """
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
    """Explain the colors of the ``palette``, and the marks that occur, below the matrix.

    A filter has the mark for lost runs, as `cell_text` writes it, if it lost all runs, or significantly
    more than some other filter.
    """
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
