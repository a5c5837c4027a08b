"""Formatter of matplotlib that writes the powers of ten of another one in raised digits."""

from collections.abc import Sequence
from typing import Any

from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import Formatter, LogFormatterMathtext

from trackbench.report.plotting.raised_digits import raise_digits


def raise_digits_of_ticks(figure: Figure) -> None:
    """Write the powers on logarithmic axes as raised digits, which the font must have.

    Parameters
    ----------
    figure
        figure whose axes are changed
    """
    for ax in figure.axes:
        for axis in (ax.xaxis, ax.yaxis):
            major = axis.get_major_formatter()
            if isinstance(major, LogFormatterMathtext):
                axis.set_major_formatter(_RaisedDigitsFormatter(major))
            minor = axis.get_minor_formatter()
            if isinstance(minor, LogFormatterMathtext):
                axis.set_minor_formatter(_RaisedDigitsFormatter(minor))


class _RaisedDigitsFormatter(Formatter):
    """Formatter that writes another formatter's powers of ten in raised digits."""

    def __init__(self, formatter: Formatter) -> None:
        self._formatter = formatter

    def __call__(self, x: float, pos: int | None = None) -> str:
        return raise_digits(self._formatter(x, pos))

    def set_locs(self, locs: Sequence[float]) -> None:
        # The other formatter needs them: it leaves some ticks without a label.
        self._formatter.set_locs(locs)  # type: ignore[arg-type]

    def set_axis(self, axis: Axis | Any) -> None:
        super().set_axis(axis)
        self._formatter.set_axis(axis)
