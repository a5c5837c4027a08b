"""Axis of time: times of a clock, such as seconds since 1970, are counted from the start of the axis."""

from weakref import WeakKeyDictionary

import numpy as np

from trackbench.durations import time_text
from trackbench.report.plotting.style import Axes, Figure
from trackbench.report.plotting.tick_labels import with_true_minus

_LATE = 100.0
"""Distance of a time axis from 0, in spans of the axis, from which on times are counted from later"""
_START_OF_TIMES: "WeakKeyDictionary[Axes, float]" = WeakKeyDictionary()
"""Time from which the times of a horizontal axis are counted, by axes."""


def count_times_from_start(figure: Figure, x_name: str) -> None:
    """Count the times of a clock, as seconds since 1970, from a round time at the start of the axis.

    The label of the axis then names the start. Axes with small times stay as they are.

    Parameters
    ----------
    figure
        figure with everything drawn; it is changed
    x_name
        label of the axes of time, whose ticks are in s. Axes that share their horizontal axis with one
        that has it change, too
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
        # For `start_of_times`, as long as the axes exist: the interactive page counts times alike.
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
