"""Logarithmic axes: when an axis is one, which numbers it can show, and how it is labeled."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from statistics import median, median_low
from typing import TYPE_CHECKING, Any

import numpy as np

from trackbench.core.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.lines import Line2D
else:
    Axes = Axis = Line2D = Any


_ZERO = 0.2
"""Place of zero on a logarithmic axis, as a multiple of the least positive value."""
_ROUNDING = 1e-12
_LABELED = 1e6
"""Span of an axis up to which 1, 2 and 5 times a power of ten are labeled."""
_DWARFED = 20.0
"""Ratio of the largest curve's maximum to that of the median curve."""


def has_logarithm(values: Array) -> bool:
    """Return whether a logarithmic axis can show numbers: one is positive, and none is negative."""
    finite = values[np.isfinite(values)]
    return bool((finite > 0.0).any() and not (finite < 0.0).any())


def spans(values: Sequence[float], factor: float) -> bool:
    """Return whether numbers are positive and the largest is at least ``factor`` times the least."""
    return len(values) > 0 and 0.0 < factor * min(values) <= max(values)


def one_dwarfs(curves: Sequence[Array]) -> bool:
    """Return whether positive curves would be flat on a linear axis beside the largest."""
    largest = [float(np.nanmax(y)) for y in curves if np.isfinite(y).any()]
    return len(largest) > 1 and max(largest) > _DWARFED * median_low(largest)


def cut(axes: Sequence[Axes], errors: Mapping[str, Array]) -> None:
    """Cut off lines that would flatten the others; a mark shows where each leaves the vertical axis.

    ``errors`` are those of each filter, by label. A filter's line is cut if its largest error dwarfs the
    median filter's.
    """
    largest = {
        label: float(np.nanmax(np.abs(e))) for label, e in errors.items() if np.isfinite(e).any()
    }
    if not largest:
        return
    most = _DWARFED * median(largest.values())
    for ax in axes:
        leaving = [line for line in ax.lines if largest.get(str(line.get_label()), 0.0) > most]
        if not leaving:
            continue
        stay = np.concatenate([_data(line)[1] for line in ax.lines if line not in leaving])
        low, high = np.nanmin(stay), np.nanmax(stay)
        margin = 0.05 * (high - low)
        low, high = low - margin, high + margin
        ax.set_ylim(low, high)
        for line in leaving:
            x, y = _data(line)
            outside = np.flatnonzero((y < low) | (y > high))[:1]
            inside = 0.03 * (high - low)
            is_above = (y[outside] > high).any()
            marker, edge = ("^", high - inside) if is_above else ("v", low + inside)
            look: dict[str, Any] = {
                "marker": marker,
                "color": line.get_color(),
                "linestyle": "none",
            }
            ax.plot(x[outside], np.full(len(outside), edge), label="_cut", **look)


def _data(line: Line2D) -> tuple[Array, Array]:
    """Coordinates of a line."""
    return np.asarray(line.get_xdata(), dtype=float), np.asarray(line.get_ydata(), dtype=float)


def without_rounding(values: Array) -> Array:
    """Return the numbers (n,) with NaN for those that are exactly known, and so only rounding."""
    return np.where(values > _ROUNDING * np.nanmax(values), values, np.nan)


def moved_zero(values: Array) -> Array:
    """Return the places (n,) of numbers on a logarithmic axis: zero stands at the left, apart."""
    positive = values[values > 0.0]
    return np.where(values > 0.0, values, _ZERO * positive.min() if len(positive) else 1.0)


def log_axis_with_zero(ax: Axes, values: Array) -> None:
    """Make the horizontal axis logarithmic; of ascending numbers (n,) the first may be zero."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

    from trackbench.report.plotting.canvas import power_of_ten

    ax.set_xscale("log")
    if values[0] > 0.0:
        return
    zero = moved_zero(values)[0]
    decades = np.unique(np.ceil(np.log10(values[1:]) - 1e-9))
    ax.xaxis.set_major_locator(FixedLocator([zero, *10.0**decades]))
    ax.xaxis.set_minor_locator(NullLocator())

    def words(x: float, _: object) -> str:
        return "0" if np.isclose(x, zero) else power_of_ten(round(np.log10(x)))

    ax.xaxis.set_major_formatter(FuncFormatter(words))


def drawn_values(axis: Any) -> Array:
    """Return the finite coordinates (n,) of all lines on an axis and on those that share it.

    Ends of error bars do not count: on a logarithmic axis they are cut off.
    """
    ax, name = axis.axes, axis.axis_name
    alike = ax.get_shared_x_axes() if name == "x" else ax.get_shared_y_axes()
    coordinates = [np.empty(0)]
    for other in alike.get_siblings(ax):
        coordinates += list(_coordinates(other, name))
    values = np.concatenate(coordinates)
    return values[np.isfinite(values)]


def _coordinates(ax: Axes, name: str) -> Iterator[Array]:
    bars: list[Any] = [b for b in ax.containers if hasattr(b, "has_yerr")]
    caps = [*chain.from_iterable(bar.lines[1] for bar in bars)]
    for line in ax.lines:
        in_data = line.get_transform().contains_branch_seperately(ax.transData)
        if line not in caps and in_data[name == "y"]:
            yield _data(line)[name == "y"]


def log_scale(axis: Any) -> bool:
    """Make an axis logarithmic if what is drawn has logarithms, else linear; return which."""
    fits = has_logarithm(drawn_values(axis))
    scale = "log" if fits else "linear"
    if axis.get_scale() != scale:
        set_scale = axis.axes.set_xscale if axis.axis_name == "x" else axis.axes.set_yscale
        set_scale(scale)
    return fits


def plain_log_axis(axis: Axis, most: float = 100.0) -> None:
    """Make an axis logarithmic as far as it can be; write 200 instead of 2 x 10^2 up to this span."""
    from matplotlib.ticker import FuncFormatter, LogLocator

    if not log_scale(axis):
        return
    low, high = axis.get_view_interval()
    if high > min(most, _LABELED) * low:
        return  # beyond, matplotlib leaves ticks between powers of ten out, and all with them
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(FuncFormatter(lambda value, _: ""))
