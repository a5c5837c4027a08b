"""Lines of filters: with gaps where steps are missing, and dots for lone values."""

from typing import Any

import numpy as np

from trackbench.core.arrays import Array
from trackbench.report.plotting.style import Axes, LineStyle

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


def draw_lone_points(ax: Axes, x: Array, value: Array, color: Any) -> None:
    """Draw a dot at each finite value (n,) without a finite neighbor, which a line would not show."""
    is_known = np.isfinite(value)
    padded = np.concatenate([[False], is_known, [False]])
    is_alone = is_known & ~padded[:-2] & ~padded[2:]
    if is_alone.any():
        ax.plot(
            x[is_alone], value[is_alone], marker=".", color=color, linestyle="none", label="_alone"
        )
