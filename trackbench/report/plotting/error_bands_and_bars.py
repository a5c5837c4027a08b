"""Two standard errors around a filter's line: a shaded band, or bars."""

from typing import Any

import numpy as np

from trackbench.core.arrays import Array
from trackbench.report.plotting import interactive_curves
from trackbench.report.plotting.style import SPREAD, Axes, LineStyle

MOST_BANDS = 3
"""Number of filters up to which errors are bands; errors of more filters are bars."""


_BARS = 12
"""Bars along a line."""


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
    """Draw two standard errors around a filter's line, and explain them in legend and page.

    The errors of up to three lines are bands. More bands would lie over each other to a gray, so the
    errors of more lines are bars at some of the x, and no two lines have their bars at equal x.

    Parameters
    ----------
    ax
        axes with the line
    x, value, stderr
        places on the horizontal axis, values and their standard errors, (n,) each
    look
        ``label`` and ``color`` of the line
    line_index
        index of the line among those of the panel
    lines
        number of lines of the panel
    log
        True for a logarithmic axis, on which no band or bar reaches below a tenth of the value
    """
    # The page shows the standard errors of the line with this label.
    interactive_curves.set_stderr(ax, look["label"], stderr)
    if not (stderr > 0.0).any():  # a single run has no standard error
        return
    low = value - 2 * stderr
    high = value + 2 * stderr
    if log:
        low = np.maximum(low, 0.1 * value)
    color = look["color"]
    # They are not in the legend. The interactive page finds the line by their label.
    label = interactive_curves.label_of_shape(look["label"])
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
    """Draw a bar of two standard errors at each point of a line.

    The interactive page gets the standard errors, too.

    Parameters
    ----------
    ax
        axes with the line
    x, value, stderr
        places on the horizontal axis, values and their standard errors, (n,) each
    label
        label of the line
    color
        color of the bars
    **look
        further arguments of matplotlib's ``Axes.errorbar``
    """
    interactive_curves.set_stderr(ax, label, stderr)
    if not (stderr > 0.0).any():  # a single run has no standard error
        return
    # They are not in the legend. The interactive page finds the line by their label.
    shape_label = interactive_curves.label_of_shape(label)
    ax.errorbar(x, value, 2.0 * stderr, fmt="none", color=color, label=shape_label, **look)
    explain_error_bars(ax)


def explain_error_bars(ax: Axes) -> None:
    """Explain bars of two standard errors in the legend."""
    ax.plot([], [], linestyle="", color="#888888", marker="|", markersize=8, label=SPREAD)
