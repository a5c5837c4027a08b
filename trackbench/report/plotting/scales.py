"""Scales and limits of axes: logarithmic ones and what they can show; meters or kilometers."""

from collections.abc import Sequence
from statistics import median_low
from typing import TYPE_CHECKING, Any

import numpy as np

from trackbench.core.arrays import Array
from trackbench.report.plotting.tick_labels import with_true_minus

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
else:
    Axes = Axis = Figure = Line2D = Any


_LABELED = 1e6
"""Ratio of an axis's ends up to which 1, 2 and 5 times a power of ten are labeled."""
_FEWEST_TICKS = 3
"""Labeled ticks that a logarithmic axis has at least."""
_WIDE = 10.0
"""Ratio of the largest to the least number from which on an axis is logarithmic."""
DWARFED = 20.0
"""Ratio of the largest curve's maximum to that of the median curve."""
_LONG_M = 2000.0
"""Length from which on an axis is in km."""
_MARGIN = 0.05
"""Share of an axis between its ends and the first and last value."""


def length_unit(extent_m: float) -> tuple[float, str]:
    """Return meters per unit of an axis of this extent, and the unit's name: m or km."""
    if extent_m >= _LONG_M:
        return 1000.0, "km"
    return 1.0, "m"


def has_logarithm(values: Array) -> bool:
    """Return whether a logarithmic axis can show numbers: one is positive, and none is negative."""
    finite = values[np.isfinite(values)]
    return bool((finite > 0.0).any() and not (finite < 0.0).any())


def are_wide(values: Sequence[float]) -> bool:
    """Return whether positive numbers are spread so widely that their axis is logarithmic."""
    return len(values) > 0 and 0.0 < _WIDE * min(values) <= max(values)


def one_dwarfs(curves: Sequence[Array]) -> bool:
    """Return whether the largest of several curves would make the others flat on a linear axis.

    It does if its maximum is more than `DWARFED` times the median of the curves' maxima.
    """
    maxima = [float(np.nanmax(curve)) for curve in curves if np.isfinite(curve).any()]
    return len(maxima) > 1 and max(maxima) > DWARFED * median_low(maxima)


def line_coordinates(line: Line2D) -> tuple[Array, Array]:
    """Return the coordinates x and y of a line, (n,) each."""
    x = np.asarray(line.get_xdata(), dtype=float)
    y = np.asarray(line.get_ydata(), dtype=float)
    return x, y


def drawn_values(axis: Any) -> Array:
    """Return the finite coordinates of all lines on an axis and on those that share it.

    Ends of error bars do not count: on a logarithmic axis they are cut off.

    Parameters
    ----------
    axis
        ``xaxis`` or ``yaxis`` of an axes

    Returns
    -------
    array (n,)
        coordinates, in the units of the data
    """
    ax = axis.axes
    if axis.axis_name == "x":
        dimension = 0
        sharing = ax.get_shared_x_axes()
    else:
        dimension = 1
        sharing = ax.get_shared_y_axes()
    coordinates = [np.empty(0)]
    for other in sharing.get_siblings(ax):
        caps = _caps_of_error_bars(other)
        for line in other.lines:
            # For x and y, whether the line's coordinate is in units of the data.
            in_data = line.get_transform().contains_branch_seperately(other.transData)
            if line not in caps and in_data[dimension]:
                coordinates.append(line_coordinates(line)[dimension])
    values = np.concatenate(coordinates)
    return values[np.isfinite(values)]


def _caps_of_error_bars(ax: Axes) -> list[Any]:
    """Return the short lines at the ends of all error bars."""
    caps: list[Any] = []
    for container in ax.containers:
        if hasattr(container, "has_yerr"):  # a container of error bars
            _, bar_caps, _ = container.lines  # type: ignore[attr-defined]
            caps += bar_caps
    return caps


def set_possible_log_scale(axis: Any) -> bool:
    """Make an axis logarithmic if the drawn values allow it, else linear.

    Parameters
    ----------
    axis
        ``xaxis`` or ``yaxis`` of an axes with everything drawn

    Returns
    -------
    bool
        True if the axis is logarithmic now
    """
    is_logarithmic = has_logarithm(drawn_values(axis))
    scale = "log" if is_logarithmic else "linear"
    if axis.get_scale() != scale:
        if axis.axis_name == "x":
            axis.axes.set_xscale(scale)
        else:
            axis.axes.set_yscale(scale)
    return is_logarithmic


def set_plain_log_scale(axis: Axis, largest_ratio: float = 100.0) -> None:
    """Make an axis logarithmic if it can be, with plain numbers: 200 instead of 2 x 10^2.

    Parameters
    ----------
    axis
        ``xaxis`` or ``yaxis`` of an axes with everything drawn
    largest_ratio
        largest ratio of the axis's ends with plain numbers, at most `_LABELED`. A wider axis keeps
        matplotlib's powers of ten
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

    if not set_possible_log_scale(axis):
        return
    low, high = axis.get_view_interval()
    if high > min(largest_ratio, _LABELED) * low:
        # On an axis wider than `_LABELED`, matplotlib's LogLocator skips some powers of ten. Together
        # with ticks at 2 and 5 times a power it would then return no tick at all.
        return
    ticks = np.array(LogLocator(subs=(1.0, 2.0, 5.0)).tick_values(low, high))
    if np.sum((low <= ticks) & (ticks <= high)) < _FEWEST_TICKS:
        # A narrow axis has ticks as a linear one: 6, 7, 8.
        axis.set_major_locator(MaxNLocator(nbins=5, steps=[1, 2, 2.5, 5, 10]))
        axis.set_minor_locator(NullLocator())
    else:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: with_true_minus(f"{value:g}")))
    axis.set_minor_formatter(FuncFormatter(lambda value, _: ""))


def set_limits_with_margin(ax: Axes, places: Array) -> None:
    """Let a horizontal axis end a small share of its length beyond the first and last place.

    Parameters
    ----------
    ax
        axes whose horizontal axis has its scale already
    places
        places (n,) of what is drawn; positive on a logarithmic axis
    """
    first = float(places.min())
    last = float(places.max())
    if first == last:  # matplotlib sets the limits around a single place
        return
    if ax.get_xscale() == "log":
        factor = (last / first) ** _MARGIN
        ax.set_xlim(first / factor, last * factor)
    else:
        margin = _MARGIN * (last - first)
        ax.set_xlim(first - margin, last + margin)


def set_legible_vertical_axes(figure: Figure, log: bool) -> None:
    """Give logarithmic vertical axes plain numbers; let linear ones begin at 0.

    Parameters
    ----------
    figure
        figure with everything drawn; it is changed
    log
        True to make the axes logarithmic where they can be. A linear axis of lines with negative values
        stays as it is
    """
    for ax in figure.axes:
        if log:
            set_plain_log_scale(ax.yaxis)
        elif not (drawn_values(ax.yaxis) < 0.0).any():
            ax.set_ylim(bottom=0)
