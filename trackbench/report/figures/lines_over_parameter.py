"""Lines of filters over a parameter: the best value of each is marked, unless the line is level."""

from dataclasses import dataclass

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.metric_expression import Measure
from trackbench.report.plotting import error_bands_and_bars, filter_lines, interactive_curves, style
from trackbench.report.plotting.style import Axes, LineStyle


def is_level(values: Array, stderrs: Array) -> bool:
    """Return True if a filter's values over a parameter do not depend on it.

    Parameters
    ----------
    values, stderrs
        values and standard errors (n,)

    Returns
    -------
    bool
        True if the range of the finite values is far below each of their standard errors, or if no value
        is finite
    """
    is_finite = np.isfinite(values)
    if not is_finite.any():
        return True
    finite_stderrs = np.nan_to_num(stderrs[is_finite])
    return bool(np.ptp(values[is_finite]) <= _LEVEL * finite_stderrs.min())


@dataclass(frozen=True, kw_only=True)
class Estimates:
    """A filter's estimates over a parameter: arrays (n,)."""

    x: Array
    """places on the horizontal axis"""
    value: Array
    stderr: Array


def draw_estimates(ax: Axes, estimates: Estimates, look: LineStyle, best: int | None) -> None:
    """Draw a filter's line with bars of two standard errors, and mark its best value.

    Parameters
    ----------
    ax
        axes to draw on
    estimates
        places, values and standard errors (n,) of the line
    look
        label, color and dash of the line
    best
        index of the best value; None marks none
    """
    x = estimates.x
    y = estimates.value
    has_value = filter_lines.draw_filter_line(ax, x, y, look)
    if not has_value:
        return
    label = look["label"]
    color = look["color"]
    error_bands_and_bars.draw_error_bars(
        ax, x, y, estimates.stderr, label, color, capsize=2, elinewidth=0.8
    )
    if best is not None:
        mark: LineStyle = {"linestyle": "", "marker": "o", "markersize": 6}
        # It is not in the legend. The interactive page finds the filter by its label.
        shape_label = interactive_curves.label_of_shape(label)
        ax.plot(x[best], y[best], color=color, zorder=3, label=shape_label, **mark)
        # The legend, which has each label once, has one mark for all filters, in a color of its own.
        ax.plot([], [], color=style.ANY, label="Best value", **mark)


def best_index(values: Array, metric: Measure) -> int:
    """Return the index of the best of a metric's values.

    The least value is best unless the metric's definition says otherwise.

    Parameters
    ----------
    values
        values (n,), of which some but not all may be NaN
    metric
        metric of the values

    Returns
    -------
    int
        index of the largest, of the least, or of the value nearest to zero or one
    """
    better = metric.definition.better
    if better == "higher":
        return int(np.nanargmax(values))
    if better == "one":
        return int(np.nanargmin(np.abs(values - 1.0)))
    if better == "zero":
        return int(np.nanargmin(np.abs(values)))
    return int(np.nanargmin(values))


_LEVEL = 0.1
"""Spread of a filter's values, as a multiple of their standard error, up to which none is the best."""
