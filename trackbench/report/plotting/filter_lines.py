"""Lines of filters: with gaps where steps are missing, and dots for lone values."""

from typing import Any

import numpy as np

from trackbench.core.arrays import Array
from trackbench.report.plotting.style import Axes, LineStyle

_GAP = 3.0
"""Largest distance of two steps that a line spans, as a multiple of their median distance."""


def draw_filter_line(ax: Axes, x: Any, value: Array, look: LineStyle) -> bool:
    """Draw a filter's line.

    A filter that lost all its runs has no value. It is not drawn, so that the legend does not have it.

    Parameters
    ----------
    ax
        axes to draw on
    x, value
        places and values (n,), NaN where the line has a gap
    look
        label, color and dash of the line

    Returns
    -------
    bool
        True if the line has any finite value
    """
    has_value = bool(np.isfinite(value).any())
    if has_value:
        ax.plot(x, value, **look)
    return has_value


def insert_gaps(steps: Array, *series: Array) -> tuple[Array, ...]:
    """Return each series with a NaN inserted in every gap between the steps.

    A gap is wider than three times the median distance of successive steps.

    Parameters
    ----------
    steps
        ascending steps (n,)
    *series
        series (n,) of values at these steps

    Returns
    -------
    tuple of array (n + g,)
        series with g gaps
    """
    distances = np.diff(steps)
    if not len(distances):
        return tuple(np.array(values, dtype=float) for values in series)
    is_gap = distances > _GAP * np.median(distances)
    behind = np.flatnonzero(is_gap) + 1  # index of the first step behind each gap
    return tuple(np.insert(np.asarray(values, dtype=float), behind, np.nan) for values in series)


def draw_lone_points(ax: Axes, x: Array, value: Array, color: Any) -> None:
    """Draw a dot at each finite value without a finite neighbor, which a line would not show.

    Parameters
    ----------
    ax
        axes to draw on
    x, value
        places and values (n,)
    color
        color of the dots
    """
    is_known = np.isfinite(value)
    padded = np.concatenate([[False], is_known, [False]])
    is_alone = is_known & ~padded[:-2] & ~padded[2:]
    if is_alone.any():
        ax.plot(
            x[is_alone], value[is_alone], marker=".", color=color, linestyle="none", label="_alone"
        )
