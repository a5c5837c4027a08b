"""Panels of a figure: how many, how many in a row, and the titles of the figure and of its panels."""

from collections.abc import Sequence
from math import ceil
from typing import Any

from trackbench.report.plotting.legend import legend_outside
from trackbench.report.plotting.page_formats import sheet
from trackbench.report.plotting.style import Axes, Figure, subplots, wrapped

MOST_PANELS = 12
"""Largest number of grid points, or of other things that have a panel each, that a figure shows."""
MOSAIC = 3
"""Panels in a row of a `panel_grid`."""


def make_panels(
    number: int, rows: int, height_in: float, balanced: bool = False, **kwargs: Any
) -> tuple[Figure, Any]:
    """Return a figure and the axes of its panels.

    As many panels are side by side as the page format allows: four on a screen.

    Parameters
    ----------
    number
        number of panels
    rows
        number of axes below each other in each panel
    height_in
        height of a panel in inches
    balanced
        True to draw 6 panels as 3 and 3, not as 4 and 2
    **kwargs
        further arguments of matplotlib's ``Figure.subplots``

    Returns
    -------
    figure : matplotlib.figure.Figure
        figure whose surplus axes are blank
    axes : array (number, rows)
        axes of the panels
    """
    across = min(number, sheet().across)  # panels side by side
    blocks = ceil(number / across)  # rows of panels
    if balanced:
        across = ceil(number / blocks)
    figure, axes = subplots(rows * blocks, across, height_in * blocks, squeeze=False, **kwargs)
    # From (blocks * rows, across) to (panels, rows), where a panel is a column of a block.
    panels = axes.reshape(blocks, rows, across).swapaxes(1, 2).reshape(-1, rows)
    for ax in panels[number:].flat:
        ax.set_axis_off()
    return figure, panels[:number]


def panel_grid(
    number: int, row_in: float, extra_in: float, **layout: Any
) -> tuple[Figure, list[Axes]]:
    """Return a figure and a list of axes in rows of three.

    Parameters
    ----------
    number
        number of axes that are needed
    row_in, extra_in
        height of each row, and height for titles and labels, in inches
    **layout
        further arguments of matplotlib's ``Figure.subplots``

    Returns
    -------
    figure : matplotlib.figure.Figure
        figure as high as its rows and ``extra_in``
    axes : list of Axes
        at least ``number`` axes. The list ends with blank axes that fill the last row
    """
    shown = max(number, 1)
    across = min(shown, MOSAIC)
    rows = ceil(shown / across)
    figure, axes = subplots(rows, across, extra_in + row_in * rows, squeeze=False, **layout)
    for ax in axes.flat[number:]:
        ax.set_axis_off()
    return figure, list(axes.flat)


def set_title(figure: Figure, text: str, number_of_points: int = 1) -> None:
    """Set the figure's title, with a remark if it shows fewer than all grid points.

    A figure shows at most `MOST_PANELS` grid points: of more, the title says ``the first 12 of 20
    points``.

    Parameters
    ----------
    figure
        figure to change
    text
        title; a page format for papers leaves it out, as it has the text in the caption
    number_of_points
        number of all grid points
    """
    parts = []
    if text and sheet().titled:
        parts.append(text)
    if number_of_points > MOST_PANELS:
        parts.append(f"the first {MOST_PANELS} of {number_of_points} points")
    if parts:
        figure.suptitle(": ".join(parts))


def add_title_and_legend(figure: Figure, text: str, number_of_points: int = 1) -> Figure:
    """Give the figure its title ``text`` and its legend, and return it.

    If ``number_of_points``, that of all grid points, is more than `MOST_PANELS`, the title says how many
    are shown.
    """
    set_title(figure, text, number_of_points)
    legend_outside(figure)
    return figure


def wrap_headings(texts: Sequence[str]) -> list[str]:
    """Return the titles of panels beside each other, in lines that have room over a panel."""
    across = min(len(texts), sheet().across)
    return [wrapped(text, across) for text in texts]
