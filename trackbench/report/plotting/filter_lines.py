"""Lines of filters: bands and bars of errors, gaps, gray lines, lines that leave the axis."""

from collections.abc import Mapping, Sequence
from math import ceil
from statistics import median
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.report.plotting import hover_values
from trackbench.report.plotting.scales import DWARFED, line_coordinates
from trackbench.report.plotting.style import ANY, SPREAD, Axes, LineStyle

if TYPE_CHECKING:
    from matplotlib.lines import Line2D
else:
    Line2D = Any

MOST_BANDS = 3
"""Number of filters up to which errors are bands; errors of more filters are bars."""
_BARS = 12
"""Bars along a line."""
_GRAY: LineStyle = {"color": "#c4c4c4", "linewidth": 0.8, "zorder": 1.5}
"""Look of a line that belongs to another panel."""
_GRAY_POINTS = 100
"""Largest number of points of a gray line."""
_BULK = 0.95
"""Share of a filter's errors, those that are no spikes: a quantile."""
_SPIKE = 5.0
"""Multiple of this quantile of the filter's errors beyond which an error is a spike."""
_MOST_ZEROS = 30
"""Triangles of a line's zeros below a logarithmic axis."""
_GAP = 3.0
"""Largest distance of two steps that a line spans, as a multiple of their median distance."""


def draw_filter_line(ax: Axes, x: Any, value: Array, look: LineStyle) -> bool:
    """Draw a filter's line through ``value`` over ``x``, (n,) each; return whether it has any value.

    A filter that lost all its runs has none. It is not drawn, so that the legend does not have it.
    ``look`` has the line's label, color and dash.
    """
    has_value = bool(np.isfinite(value).any())
    if has_value:
        ax.plot(x, value, **look)
    return has_value


def draw_error_band(
    ax: Axes,
    x: Array,
    value: Array,
    stderr: Array,
    look: LineStyle,
    line_index: int,
    lines: int,
    log: bool = False,
) -> None:
    """Draw two standard errors ``stderr`` around a filter's line, and explain them in legend and page.

    ``line_index`` is the index of the line among the ``lines`` lines of the panel. The errors of up to
    three lines are bands. More bands would lie over each other to a gray, so the errors of more lines
    are bars at some of the x, and no two lines have their bars at equal x. On a logarithmic axis
    (``log``) no band or bar reaches below a tenth of the value.
    """
    # The page shows the standard errors of the line with this label.
    hover_values.set_stderr(ax, look["label"], stderr)
    if not (stderr > 0.0).any():  # a single run has no standard error
        return
    low = value - 2 * stderr
    high = value + 2 * stderr
    if log:
        low = np.maximum(low, 0.1 * value)
    color = look["color"]
    # They are not in the legend. The interactive page finds the line by their label.
    label = hover_values.label_of_shape(look["label"])
    if lines <= MOST_BANDS:
        ax.fill_between(x, low, high, alpha=0.15, lw=0, color=color, label=label)
        ax.fill_between([], [], [], color="#888888", alpha=0.4, lw=0, label=SPREAD)
    else:
        # Lines begin at different x, so that their bars lie beside each other.
        period = max(1, len(x) // _BARS)
        chosen = slice(line_index * period // lines, None, period)
        ax.vlines(x[chosen], low[chosen], high[chosen], linewidth=1.0, color=color, label=label)
        explain_error_bars(ax)


def draw_error_bars(
    ax: Axes, x: Array, value: Array, stderr: Array, label: str, color: str, **look: Any
) -> None:
    """Draw a bar of two standard errors ``stderr`` at each point of the line ``label``.

    The interactive page gets the standard errors, too. ``look`` are further arguments of matplotlib's
    ``Axes.errorbar``.
    """
    hover_values.set_stderr(ax, label, stderr)
    if not (stderr > 0.0).any():  # a single run has no standard error
        return
    # They are not in the legend. The interactive page finds the line by their label.
    shape_label = hover_values.label_of_shape(label)
    ax.errorbar(x, value, 2.0 * stderr, fmt="none", color=color, label=shape_label, **look)
    explain_error_bars(ax)


def explain_error_bars(ax: Axes) -> None:
    """Explain bars of two standard errors in the legend."""
    ax.plot([], [], linestyle="", color="#888888", marker="|", markersize=8, label=SPREAD)


def insert_gaps(steps: Array, *series: Array) -> tuple[Array, ...]:
    """Return each series (n,) with a NaN inserted in every gap between the steps (n,).

    A gap is wider than three times the median distance of successive steps.
    """
    distances = np.diff(steps)
    if not len(distances):
        return tuple(np.array(values, dtype=float) for values in series)
    is_gap = distances > _GAP * np.median(distances)
    behind = np.flatnonzero(is_gap) + 1  # index of the first step behind each gap
    return tuple(np.insert(np.asarray(values, dtype=float), behind, np.nan) for values in series)


def draw_gray_line(ax: Axes, x: Array, value: Array, steps: int = 1) -> None:
    """Draw the line of another panel's filter in gray, behind the lines of this panel.

    It has at most 100 points, each the mean over a window of successive values. ``steps`` is the number
    of steps of which each given value is the mean already.
    """
    if not len(x):
        return
    length = ceil(len(x) / _GRAY_POINTS)  # values in a window
    starts = np.arange(0, len(x), length)
    lengths = np.diff([*starts, len(x)])  # the last window may be shorter
    mean_x = np.add.reduceat(x, starts) / lengths
    mean_value = np.add.reduceat(value, starts) / lengths  # NaN, a gap, if the window has a NaN
    # With "_" the many gray lines are not in the legend, and belong to no curve of the page. An empty
    # line gives them one entry, as the legend has each label once.
    ax.plot(mean_x, mean_value, label="_gray", **_GRAY)
    label = "Other filters"
    if length * steps > 1:
        label += f", means over {length * steps} steps"
    ax.plot([], [], label=label, **_GRAY)


def cut_dwarfing_lines(axes: Sequence[Axes], errors: Mapping[str, Array], extent: float) -> None:
    """Cut off lines that would flatten the others; a mark shows where each leaves the vertical axis.

    ``errors`` (n,) are those of each filter, by label. ``extent`` is the largest less the least value of
    the truth; infinite without a truth. A filter's line is cut if its largest error is more than
    `DWARFED` times that of the median filter. It is also cut if it has a spike: its largest error is
    larger than the extent, and far larger than most of its errors. If all lines would be cut, none is.
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


class Zeros(NamedTuple):
    """Places of a line's zeros on the horizontal axis, (n,), and the line's color."""

    x: Array
    color: Any


def mark_zeros(ax: Axes, zeros_of_lines: Sequence[Zeros]) -> None:
    """Draw a triangle at the lower edge of a logarithmic axis at each place of a zero.

    A zero, or an error that is only rounding, lies below every logarithmic axis. Of many zeros of a
    line, every second, third, ... has a triangle. One that several lines share has a color of its own.
    """
    thinned = [
        Zeros(x=zeros.x[:: ceil(len(zeros.x) / _MOST_ZEROS) or 1], color=zeros.color)
        for zeros in zeros_of_lines
    ]
    places = [zeros.x for zeros in thinned if len(zeros.x)]
    if not places:
        return
    at_lower_edge: LineStyle = {"marker": "v", "markersize": 4.0, "linestyle": "none"}
    below: LineStyle = {"clip_on": False, "transform": ax.get_xaxis_transform(), "label": "_zero"}
    x, lines_at_x = np.unique(np.concatenate(places), return_counts=True)
    shared = x[lines_at_x > 1]
    for zeros in [*thinned, Zeros(x=shared, color=ANY)]:
        # Of a line the places that it does not share; the last item has those that are shared.
        own = zeros.x if zeros.color == ANY else np.setdiff1d(zeros.x, shared)
        if len(own):
            ax.plot(own, np.zeros(len(own)), color=zeros.color, **at_lower_edge, **below)
    ax.plot([], [], color=ANY, label="Zero, below the axis", **at_lower_edge)


def mark_zeros_of_lines(ax: Axes) -> None:
    """Mark the zeros of all lines on a logarithmic vertical axis, which cannot show them.

    Lines that are not in the legend are left out; their labels begin with ``_``.
    """
    if ax.get_yscale() != "log":
        return
    zeros_of_lines = []
    for line in ax.lines:
        # A line by `axhline` has its x as a share of the axis, and so no place.
        has_x_in_data = line.get_transform().contains_branch_seperately(ax.transData)[0]
        if has_x_in_data and not str(line.get_label()).startswith("_"):
            x, y = line_coordinates(line)
            zeros_of_lines.append(Zeros(x=x[y == 0.0], color=line.get_color()))
    mark_zeros(ax, zeros_of_lines)


def draw_lone_points(ax: Axes, x: Array, value: Array, color: Any) -> None:
    """Draw a dot at each finite value (n,) without a finite neighbor, which a line would not show."""
    is_known = np.isfinite(value)
    padded = np.concatenate([[False], is_known, [False]])
    is_alone = is_known & ~padded[:-2] & ~padded[2:]
    if is_alone.any():
        ax.plot(
            x[is_alone], value[is_alone], marker=".", color=color, linestyle="none", label="_alone"
        )
