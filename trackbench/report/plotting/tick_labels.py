"""Labels of ticks: which values have a label, plain numbers or powers of ten, and the minus sign."""

from collections.abc import Sequence

import numpy as np

from trackbench.core.arrays import Array
from trackbench.report.plotting.raised_digits import power_of_ten
from trackbench.report.plotting.style import Axes

_MOST_VALUE_TICKS = 10
"""Values up to which each has a tick of its own."""
_PLAIN_POWERS = 3.0
"""Span, as a power of ten, up to which powers of ten are plain numbers."""
_DIGIT_IN = 0.085
"""Width of a digit of a tick's label."""


def with_true_minus(text: str) -> str:
    """Return a number with the minus sign of matplotlib's axes in place of a hyphen."""
    return text.replace("-", "\N{MINUS SIGN}")


def value_texts(values: Sequence[float]) -> list[str]:
    """Return the labels of ticks: plain numbers, or 10⁻⁶ if all are powers of ten or zero.

    Powers of ten are plain numbers, too, if the largest is at most 1000 times the least.

    Parameters
    ----------
    values
        values at the ticks

    Returns
    -------
    list of str
        one label for each value
    """
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
    ax
        axes whose horizontal axis has its scale already
    places
        ascending places (n,) of the values
    texts
        labels of the n values
    width_in
        width of the axes in inches
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


def set_few_ticks(ax: Axes, expected: float = 0.0) -> None:
    """Label a narrow horizontal axis at the expected value, and at the round value farthest from it.

    Parameters
    ----------
    ax
        axes with everything drawn
    expected
        value to label. If it is not on the axis, the round value nearest to it has a label instead
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
