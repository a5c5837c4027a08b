"""Cells of a heat map: their texts, and letters that fit into them, black or white."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from trackbench.core.arrays import Array
from trackbench.report.plotting.style import Axes, Figure
from trackbench.report.rounded_numbers import rounded
from trackbench.statistics.sample_statistics import Estimate

_DIGIT_IN = 0.05
"""Width of a digit in a cell."""
_SHARE_OF_CELL = 0.92
"""Largest width of a text, of its cell's."""


def cell_texts(rows: Sequence[Sequence[Estimate]]) -> list[list[str]]:
    """Return the texts of the cells: a value, and below it its standard error."""
    return [[rounded(*cell, digits=3).replace(" ± ", "\n± ") for cell in row] for row in rows]


def has_room(texts: Sequence[Sequence[str]], cell_in: float) -> bool:
    """Return whether all texts have room in cells.

    Parameters
    ----------
    texts
        texts of the cells, row by row
    cell_in
        width of a cell in inches

    Returns
    -------
    bool
        True if the longest line of any text has room
    """
    longest = 0
    for row in texts:
        for text in row:
            longest = max(longest, *(len(line) for line in text.split("\n")))
    return longest * _DIGIT_IN <= cell_in


def write_cells(
    ax: Axes,
    values: Array,
    texts: Sequence[Sequence[str]],
    image: Any,
    size: float = 6.5,
) -> None:
    """Write texts into the cells with finite values: black, or white on dark colors.

    Parameters
    ----------
    ax
        axes with the map
    values
        values (rows, columns) of the cells
    texts
        texts of the cells, row by row
    image
        map that ``Axes.imshow`` returned
    size
        size of the letters in points
    """
    colors = image.cmap(image.norm(values))
    for (row, column), value in np.ndenumerate(values):
        if not np.isfinite(value):
            continue
        red, green, blue, _ = colors[row, column]
        # Luma of ITU-R BT.601, from 0 to 1.
        brightness = 0.299 * red + 0.587 * green + 0.114 * blue
        ax.text(
            column,
            row,
            texts[row][column],
            ha="center",
            va="center",
            fontsize=size,
            color="white" if brightness < 0.5 else "black",
        )


def fit_texts_in_cells(figure: Figure, ax: Axes, columns: int) -> None:
    """Write texts that are wider than their cell in smaller letters.

    Parameters
    ----------
    figure
        figure with everything drawn
    ax
        axes with the map
    columns
        number of columns of the map
    """
    figure.draw_without_rendering()
    room = _SHARE_OF_CELL * ax.get_window_extent().width / columns
    for text in ax.texts:
        if text.get_horizontalalignment() == "center":  # a cell, not the name of a class
            width = text.get_window_extent().width
            if width > room:
                text.set_fontsize(float(text.get_fontsize()) * room / width)
