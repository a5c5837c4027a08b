"""Zeros on logarithmic axes, which cannot show them: at a place behind a break, or triangles below."""

from collections.abc import Sequence
from math import ceil
from typing import Any, NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.report.plotting.raised_digits import power_of_ten
from trackbench.report.plotting.scales import line_coordinates
from trackbench.report.plotting.style import ANY, Axes, LineStyle

_ZERO = 0.2
"""Place of zero on a logarithmic axis, as a multiple of the least positive value."""
_ROUNDING = 1e-9
"""Share of the second value of a series below which the first one is only rounding."""
_MOST_ZEROS = 30
"""Triangles of a line's zeros below a logarithmic axis."""


def without_rounding(values: Array) -> Array:
    """Return errors of successive steps for a logarithmic axis.

    Parameters
    ----------
    values
        errors (n,)

    Returns
    -------
    array (n,)
        errors with NaN for zeros, and for the first error if the state was known exactly there, so that
        it is only rounding. Errors that are small beside those of a later divergence stay
    """
    shown = np.where(values > 0.0, values, np.nan)
    if len(shown) > 1 and shown[0] < _ROUNDING * shown[1]:
        shown[0] = np.nan
    return shown


def places_with_zero(values: Array) -> Array:
    """Return the places of numbers on a logarithmic axis.

    Parameters
    ----------
    values
        numbers (n,), none negative

    Returns
    -------
    array (n,)
        places. A positive number is its own place. Zero, which has none, stands left of all others, at
        `_ZERO` times the least of them. If all numbers are zero, their place is 1
    """
    positive = values[values > 0.0]
    if not len(positive):
        return np.ones(values.shape)
    return np.where(values > 0.0, values, _ZERO * positive.min())


def set_log_scale_with_zero(ax: Axes, values: Array) -> None:
    """Make the horizontal axis logarithmic, with the tick "0" and a break if a value is zero.

    Parameters
    ----------
    ax
        axes to change
    values
        different values (n,) on the axis in ascending order, so that only the first may be zero. It is
        drawn at its place by `places_with_zero`
    """
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

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
        label="_break",  # only names the text: no legend has it, and no code looks for it
        zorder=5,
    )


class Zeros(NamedTuple):
    """Places of a line's zeros on the horizontal axis, (n,), and the line's color."""

    x: Array
    color: Any


def mark_zeros(ax: Axes, zeros_of_lines: Sequence[Zeros]) -> None:
    """Draw a triangle at the lower edge of a logarithmic axis at each place of a zero.

    A zero, or an error that is only rounding, lies below every logarithmic axis. Of many zeros of a
    line, every second, third, ... has a triangle. One that several lines share has a color of its own.

    Parameters
    ----------
    ax
        axes whose vertical axis is logarithmic
    zeros_of_lines
        places of each line's zeros, and its color
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

    Parameters
    ----------
    ax
        axes with everything drawn; a linear one stays as it is. Lines that are not in the legend are
        left out; their labels begin with ``_``
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


def all_start_at_zero(curves: Sequence[Array]) -> bool:
    """Return whether every curve has a first error of zero, as all filters know the first state.

    A logarithmic axis then shows all lines from the next step on, and needs no mark.

    Parameters
    ----------
    curves
        errors (n,) of each line; lines without a finite one do not count

    Returns
    -------
    bool
        True if each first error is zero or only rounding; False without curves
    """
    firsts = []  # of each line with a value, whether its first error is zero or only rounding
    for value in curves:
        if np.isfinite(value).any():
            # `without_rounding` has NaN for these errors.
            is_zero = np.isfinite(value) & np.isnan(without_rounding(value))
            firsts.append(bool(is_zero[0]))
    return len(firsts) > 0 and all(firsts)
