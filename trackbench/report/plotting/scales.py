"""Scales of axes: logarithmic ones, which numbers they can show, their labels; and units of lengths."""

from collections.abc import Sequence
from statistics import median_low
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np

from trackbench.core.arrays import Array
from trackbench.durations import time_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
else:
    Axes = Axis = Figure = Line2D = Any


_ZERO = 0.2
"""Place of zero on a logarithmic axis, as a multiple of the least positive value."""
_ROUNDING = 1e-9
"""Share of the second value of a series below which the first one is only rounding."""
_LABELED = 1e6
"""Span of an axis up to which 1, 2 and 5 times a power of ten are labeled."""
_FEWEST_TICKS = 3
"""Labeled ticks that a logarithmic axis has at least."""
_MOST_VALUE_TICKS = 10
"""Values up to which each has a tick of its own."""
_PLAIN_POWERS = 3.0
"""Span, as a power of ten, up to which powers of ten are plain numbers."""
_DIGIT_IN = 0.085
"""Width of a digit of a tick's label."""
_WIDE = 10.0
"""Ratio of the largest to the least number from which on an axis is logarithmic."""
DWARFED = 20.0
"""Ratio of the largest curve's maximum to that of the median curve."""

_LATE = 100.0
"""Distance of a time axis from 0, in spans of the axis, from which on times are counted from later"""
_START_OF_TIMES: "WeakKeyDictionary[Axes, float]" = WeakKeyDictionary()
"""Time from which the times of a horizontal axis are counted, by axes."""

_LONG_M = 2000.0
"""Length from which on an axis is in km."""


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


def without_rounding(values: Array) -> Array:
    """Return errors of successive steps (n,) for a logarithmic axis.

    NaN stands for zeros, and for the first error if the state was known exactly there, so that it is
    only rounding. Errors that are small beside those of a later divergence stay.
    """
    shown = np.where(values > 0.0, values, np.nan)
    if len(shown) > 1 and shown[0] < _ROUNDING * shown[1]:
        shown[0] = np.nan
    return shown


def places_with_zero(values: Array) -> Array:
    """Return the places (n,) of numbers (n,), none negative, on a logarithmic axis.

    A positive number is its own place. Zero, which has none, stands left of all others, at `_ZERO` times
    the least of them. If all numbers are zero, their place is 1.
    """
    positive = values[values > 0.0]
    if not len(positive):
        return np.ones(values.shape)
    return np.where(values > 0.0, values, _ZERO * positive.min())


def set_log_scale_with_zero(ax: Axes, values: Array) -> None:
    """Make the horizontal axis logarithmic, with the tick "0" and a break if a value is zero.

    ``values`` (n,) are the different values on the axis in ascending order, so that only the first may
    be zero. It is drawn at its place by `places_with_zero`.
    """
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

    from trackbench.report.plotting.canvas import power_of_ten

    ax.set_xscale("log")
    if values[0] > 0.0:
        return
    place_of_zero = places_with_zero(values)[0]
    if len(values) > 1:  # the break is in the middle between zero and the least positive value
        _draw_axis_break(ax, float(np.sqrt(place_of_zero * values[1])))
    # A tick at the next power of ten from each number on. 1e-9 allows for rounding of the logarithm.
    exponents = np.unique(np.ceil(np.log10(values[1:]) - 1e-9))
    ax.xaxis.set_major_locator(FixedLocator([place_of_zero, *10.0**exponents]))
    ax.xaxis.set_minor_locator(NullLocator())

    def tick_label(x: float, _: object) -> str:
        """Write a power of ten, or 0 at the place that stands for zero."""
        if np.isclose(x, place_of_zero):
            return "0"
        return power_of_ten(round(np.log10(x)))

    ax.xaxis.set_major_formatter(FuncFormatter(tick_label))


def _draw_axis_break(ax: Axes, place: float) -> None:
    """Draw the two strokes of a broken axis over the horizontal axis at x = ``place``."""
    ax.text(
        place,
        0.0,
        "//",
        transform=ax.get_xaxis_transform(),
        horizontalalignment="center",
        verticalalignment="center",
        bbox={"color": "white", "pad": 0.5},
        label="_break",
        zorder=5,
    )


def with_true_minus(text: str) -> str:
    """Return a number with the minus sign of matplotlib's axes in place of a hyphen."""
    return text.replace("-", "\N{MINUS SIGN}")


def value_texts(values: Sequence[float]) -> list[str]:
    """Return the labels of ticks at ``values``: plain numbers, or 10⁻⁶ if all are powers of ten or zero.

    Powers of ten are plain numbers, too, if the largest is at most 1000 times the least.
    """
    from trackbench.report.plotting.canvas import power_of_ten

    positive = np.array([value for value in values if value > 0.0])
    exponents = np.round(np.log10(positive))
    are_powers = bool(len(positive)) and np.allclose(positive, 10.0**exponents, rtol=1e-9)
    if not (are_powers and np.ptp(exponents) > _PLAIN_POWERS and min(values) >= 0.0):
        return [with_true_minus(f"{value:g}") for value in values]
    return [power_of_ten(round(np.log10(value))) if value > 0.0 else "0" for value in values]


def set_ticks_at_values(ax: Axes, places: Array, texts: Sequence[str], width_in: float) -> None:
    """Put a tick at each value that the horizontal axis is about, and a label where it has room.

    The first and the last value always have a label. If there are more than 10 values, or one of them
    alone, the axis keeps its usual ticks.

    Parameters
    ----------
    ax : axes whose horizontal axis has its scale already
    places : ascending places of the values, (n,)
    texts : labels of the values
    width_in : width of the axes in inches
    """
    from matplotlib.ticker import FixedFormatter, FixedLocator, NullLocator

    if not 1 < len(places) <= _MOST_VALUE_TICKS:
        return
    # Step 1: where the middle of each label is, in inches.
    scaled = np.asarray(places, dtype=float)
    if ax.get_xscale() == "log":
        scaled = np.log10(scaled)
    middles = width_in * (scaled - scaled[0]) / (scaled[-1] - scaled[0])
    half_widths = [0.5 * _DIGIT_IN * (len(text) + 1) for text in texts]  # with a space
    # Step 2: labels from left to right that overlap neither the one before nor the last one.
    last = len(places) - 1
    labeled = [0]  # indices of the values with a label
    for index in range(1, last):
        is_free = True
        for other in (labeled[-1], last):
            distance = abs(middles[index] - middles[other])
            is_free &= bool(distance >= half_widths[index] + half_widths[other])
        if is_free:
            labeled.append(index)
    labeled.append(last)
    ax.xaxis.set_major_locator(FixedLocator([float(value) for value in places]))
    ax.xaxis.set_major_formatter(
        FixedFormatter([text if index in labeled else "" for index, text in enumerate(texts)])
    )
    ax.xaxis.set_minor_locator(NullLocator())


def line_coordinates(line: Line2D) -> tuple[Array, Array]:
    """Return the coordinates x and y of a line, (n,) each."""
    x = np.asarray(line.get_xdata(), dtype=float)
    y = np.asarray(line.get_ydata(), dtype=float)
    return x, y


def drawn_values(axis: Any) -> Array:
    """Return the finite coordinates (n,) of all lines on an axis and on those that share it.

    Ends of error bars do not count: on a logarithmic axis they are cut off.
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
    """Make an axis logarithmic if the drawn values allow it, else linear; return whether it is."""
    is_logarithmic = has_logarithm(drawn_values(axis))
    scale = "log" if is_logarithmic else "linear"
    if axis.get_scale() != scale:
        if axis.axis_name == "x":
            axis.axes.set_xscale(scale)
        else:
            axis.axes.set_yscale(scale)
    return is_logarithmic


def set_plain_log_scale(axis: Axis, most: float = 100.0) -> None:
    """Make an axis logarithmic if it can be, with plain numbers: 200 instead of 2 x 10^2.

    Numbers are plain only if the axis spans at most the factor ``most``, and at most `_LABELED`.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

    if not set_possible_log_scale(axis):
        return
    low, high = axis.get_view_interval()
    if high > min(most, _LABELED) * low:
        # Beyond, matplotlib leaves out ticks between powers of ten, and all ticks with them.
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


def count_times_from_start(figure: Figure, x_name: str) -> None:
    """Count the times of a clock, as seconds since 1970, from a round time at the start of the axis.

    The axes of time have the label ``x_name``, or share their horizontal axis with one that has it. The
    label then names the start. Axes with small times stay as they are.
    """
    from matplotlib.ticker import FuncFormatter

    axes_of_time = set()
    for ax in figure.axes:
        if ax.get_xlabel() == x_name:
            axes_of_time |= {ax, *ax.get_shared_x_axes().get_siblings(ax)}
    for ax in axes_of_time:
        low, high = ax.get_xlim()
        if not is_late(low, high):
            continue
        # The last tick below the axis, in whole seconds.
        ticks = ax.get_xticks()
        below = ticks[ticks <= low]
        start = float(np.floor(below[-1] if len(below) else low))

        def tick_label(time: float, _: object, start: float = start) -> str:
            return with_true_minus(f"{time - start:.6g}")

        ax.xaxis.set_major_formatter(FuncFormatter(tick_label))
        _START_OF_TIMES[ax] = start
        if ax.get_xlabel() == x_name:
            ax.set_xlabel(f"{x_name} after {time_text(start)} s")


def is_late(first: float, last: float) -> bool:
    """Return whether times from first to last, s, are those of a clock, such as seconds since 1970.

    They are then best counted from the first.
    """
    return first > _LATE * (last - first)


def start_of_times(ax: Axes) -> float:
    """Return the time from which the times of the horizontal axis are counted; usually 0."""
    return _START_OF_TIMES.get(ax, 0.0)


def set_few_ticks(ax: Axes, expected: float = 0.0) -> None:
    """Label a narrow horizontal axis at the expected value, and at the round value farthest from it.

    If the expected value is not on the axis, the round value nearest to it has a label.
    """
    low, high = ax.get_xlim()
    ax.locator_params(axis="x", nbins=2)
    ticks = [tick for tick in ax.get_xticks() if low <= tick <= high]
    if len(ticks) > 1:
        farthest = max(ticks, key=lambda tick: abs(tick - expected))
        nearest = min(ticks, key=lambda tick: abs(tick - expected))
        if low <= expected <= high:
            nearest = expected
        ticks = sorted({nearest, farthest})
    ax.set_xticks(ticks, [with_true_minus(f"{tick:g}") for tick in ticks])
    ax.set_xlim(low, high)
