"""Subclasses of matplotlib: the figure that is drawn, and labels of ticks with raised digits.

A power of ten is written in letters, 10⁻³, because matplotlib parses formulas slowly.
"""

import io
import re
from collections.abc import Sequence
from typing import Any

from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import Formatter, LogFormatterMathtext

from trackbench.report.plotting.page_formats import sheet

_DPI = 150
"""Resolution of a figure in a notebook."""


class Canvas(Figure):
    """A figure that a notebook shows, whether pyplot is used in it or not."""

    def __init__(self, width_in: float, height_in: float) -> None:
        super().__init__(figsize=(width_in, height_in), layout="constrained")
        FigureCanvasAgg(self)

    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        """Return the PNG file, and the width on the page in pixels, which are 1/100 in."""
        width = round(100 * self.get_figwidth())
        return png(self), {"width": width}


def png(figure: Figure) -> bytes:
    """Return a figure for a screen, as the content of a PNG file; equal figures have equal files."""
    file = io.BytesIO()
    # Without "Software", which names the version of matplotlib.
    figure.savefig(file, format="png", metadata={"Software": None}, dpi=_DPI)
    return file.getvalue()


_FORMULA = re.compile(r"\$\\mathdefault\{(.*)\}\$")
_POWER = re.compile(r"\^\{(-?\d+)\}")
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def power_of_ten(exponent: int) -> str:
    """Return a power of ten as logarithmic axes write it: in letters if the font can, else a formula."""
    formula = rf"$\mathdefault{{10^{{{exponent}}}}}$"
    if sheet().has_raised_digits:
        return raise_digits(formula)
    return formula


def raise_digits_of_ticks(figure: Figure) -> None:
    """Write the powers on logarithmic axes as raised digits, which the font must have."""
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


def raise_digits(formula: str) -> str:
    r"""Return ``$\mathdefault{2\times10^{-3}}$`` as 2×10⁻³; any other formula stays as it is."""
    match = _FORMULA.fullmatch(formula)
    if match is None:
        return formula
    text = match[1].replace(r"\times", "×")
    text = _POWER.sub(lambda power: power[1].translate(_RAISED), text)
    is_still_formula = re.search(r"[\\^{}]", text) is not None
    if is_still_formula:
        return formula
    return text.replace("-", "−")
