"""Lines that would flatten the others: cut off, with a triangle where they leave the vertical axis."""

from collections.abc import Mapping, Sequence
from statistics import median
from typing import TYPE_CHECKING, Any

import numpy as np

from trackbench.core.arrays import Array
from trackbench.report.plotting.scales import DWARFED, line_coordinates
from trackbench.report.plotting.style import ANY, Axes

if TYPE_CHECKING:
    from matplotlib.lines import Line2D
else:
    Line2D = Any

_BULK = 0.95
"""Share of a filter's errors, those that are no spikes: a quantile."""


_SPIKE = 5.0
"""Multiple of this quantile of the filter's errors beyond which an error is a spike."""


def cut_dwarfing_lines(axes: Sequence[Axes], errors: Mapping[str, Array], extent: float) -> None:
    """Cut off lines that would flatten the others; a mark shows where each leaves the vertical axis.

    A filter's line is cut if its largest error is more than `DWARFED` times that of the median filter.
    It is also cut if it has a spike: its largest error is larger than the extent, and far larger than
    most of its errors. If all lines would be cut, none is.

    Parameters
    ----------
    axes
        axes with the lines, which have the filters' labels
    errors
        errors (n,) of each filter, by label
    extent
        largest less the least value of the truth, in the unit of the errors; infinite without a truth
    """
    largest: dict[str, float] = {}
    spiked: list[str] = []
    for label, values in errors.items():
        finite = np.abs(values[np.isfinite(values)])
        if not len(finite):
            continue
        largest[label] = float(finite.max())
        if finite.max() > max(extent, _SPIKE * float(np.quantile(finite, _BULK))):
            spiked.append(label)
    if not largest:
        return
    limit = DWARFED * median(largest.values())
    cut = [label for label in largest if largest[label] > limit or label in spiked]
    if len(cut) == len(largest):
        return
    for ax in axes:
        dwarfing = [line for line in ax.lines if line.get_label() in cut]
        if not dwarfing:
            continue
        # Step 1: the vertical axis shows the other lines, with a margin.
        heights = [line_coordinates(line)[1] for line in ax.lines if line not in dwarfing]
        least = np.nanmin(np.concatenate(heights))
        greatest = np.nanmax(np.concatenate(heights))
        margin = 0.05 * (greatest - least)
        bottom = least - margin
        top = greatest + margin
        ax.set_ylim(bottom, top)
        # Step 2: a triangle stands where a line first leaves the axis.
        for line in dwarfing:
            _mark_first_exit(ax, line, bottom, top)


def _mark_first_exit(ax: Axes, line: Line2D, bottom: float, top: float) -> None:
    """Draw a triangle at the edge of the axis where the line is first beyond ``bottom`` or ``top``.

    A line that stays between them gets no triangle: one that leaves the axis of the errors need not
    leave that of the estimates. The legend explains the triangle.
    """
    x, y = line_coordinates(line)
    outside = np.flatnonzero((y < bottom) | (y > top))
    if not len(outside):
        return
    first_outside = outside[0]
    inset = 0.03 * (top - bottom)
    if y[first_outside] > top:
        marker = "^"
        height = top - inset
    else:
        marker = "v"
        height = bottom + inset
    ax.plot(
        [x[first_outside]],
        [height],
        marker=marker,
        color=line.get_color(),
        linestyle="none",
        label="_cut",
    )
    # The legend has one mark for all filters, in a color of its own.
    ax.plot([], [], marker=marker, color=ANY, linestyle="none", label="Leaves the axis")
