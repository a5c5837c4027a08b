"""Heat maps of a sweep over two paths of the grid: one per filter, with the best cell framed."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.metric_expression import Measure
from trackbench.report.figures.heat_map_cells import cell_texts, write_cells
from trackbench.report.figures.lines_over_parameter import best_index
from trackbench.report.plotting import filter_colors, style
from trackbench.report.plotting.style import Axes
from trackbench.statistics.sample_statistics import Estimate

_MOST_TEXT = 8
"""Values along an axis up to which a heat map shows its numbers."""


def draw_heat_maps(
    axes: Sequence[Axes],
    fields: Mapping[str, list[list[Estimate]]],
    columns: Sequence[str],
    rows: Sequence[str],
    framed_metric: Measure | None,
) -> Any:
    """Draw a heat map of each filter's field, on one color scale.

    Parameters
    ----------
    axes
        axes, at least one for each field
    fields
        rows of estimates by filter, from the lowest row on
    columns, rows
        texts of the values along both axes
    framed_metric
        metric by which the best cell of each filter is framed; None frames no cell

    Returns
    -------
    matplotlib.image.AxesImage or None
        last image, whose colors are those of all; None without any field
    """
    values_by_label: dict[str, Array] = {}
    for label, cells in fields.items():
        values_by_label[label] = np.array([[cell.value for cell in row] for row in cells])
    least = min((np.nanmin(values) for values in values_by_label.values()), default=0.0)
    greatest = max((np.nanmax(values) for values in values_by_label.values()), default=0.0)
    image = None
    # Blank axes may fill the last row.
    for ax, (label, values) in zip(axes, values_by_label.items(), strict=False):
        image = ax.imshow(values, origin="lower", aspect="auto", vmin=least, vmax=greatest)
        ax.set_xticks(range(len(columns)), columns)
        ax.set_yticks(range(len(rows)), rows)
        ax.set_title(style.wrap_label(label))
        ax.grid(visible=False)
        # A panel among several is narrower, and has room for half as many numbers.
        most_text = _MOST_TEXT if len(axes) == 1 else _MOST_TEXT // 2
        if max(values.shape) <= most_text:
            write_cells(ax, values, cell_texts(fields[label]), image, 7)  # letters of 7 points
        if framed_metric is not None:
            best = best_index(values.ravel(), framed_metric)
            row, column = np.unravel_index(best, values.shape)
            outline_cell(ax, int(row), int(column))
    return image


def outline_cell(ax: Axes, row: int, column: int) -> None:
    """Draw a frame around a cell of a heat map.

    Parameters
    ----------
    ax
        axes with the map
    row, column
        indices of the cell
    """
    from matplotlib.patches import Rectangle

    lower_left = (column - 0.5, row - 0.5)
    frame = Rectangle(
        lower_left, 1, 1, fill=False, edgecolor=filter_colors.COLORS[1], linewidth=2, zorder=5
    )
    frame.set_clip_on(False)
    ax.add_patch(frame)
