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


class Canvas(Figure):
    """A figure that a notebook shows, whether pyplot is used in it or not."""

    def __init__(self, width_in: float, height_in: float) -> None:
        super().__init__(figsize=(width_in, height_in), layout="constrained")
        FigureCanvasAgg(self)

    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        """Return the picture, and its size on the page in pixels, which are 1/100 in."""
        return png(self), {"width": round(100 * self.get_figwidth())}


def png(figure: Figure) -> bytes:
    """Return a figure for a screen."""
    out = io.BytesIO()
    figure.savefig(out, format="png", metadata={"Software": None}, dpi=_DPI)
    return out.getvalue()


_FORMULA = re.compile(r"\$\\mathdefault\{(.*)\}\$")
_POWER = re.compile(r"\^\{(-?\d+)\}")
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def power_of_ten(exponent: int) -> str:
    """Return a label as those of logarithmic axes are."""
    formula = rf"$\mathdefault{{10^{{{exponent}}}}}$"
    return spelt(formula) if sheet().has_raised_digits else formula


def in_letters(figure: Figure) -> None:
    """Write the powers on logarithmic axes as raised digits, which the font must have."""
    for ax in figure.axes:
        for axis in (ax.xaxis, ax.yaxis):
            major, minor = axis.get_major_formatter(), axis.get_minor_formatter()
            if isinstance(major, LogFormatterMathtext):
                axis.set_major_formatter(_Letters(major))
            if isinstance(minor, LogFormatterMathtext):
                axis.set_minor_formatter(_Letters(minor))


class _Letters(Formatter):
    """Formatter that writes another formatter's powers of ten in raised digits."""

    def __init__(self, formulas: Formatter) -> None:
        self._formulas = formulas

    def __call__(self, x: float, pos: int | None = None) -> str:
        return spelt(self._formulas(x, pos))

    def set_locs(
        self, locs: Sequence[float]
    ) -> None:  # by which some ticks are left without a label
        self._formulas.set_locs(locs)  # type: ignore[arg-type]

    def set_axis(self, axis: Axis | Any) -> None:
        super().set_axis(axis)
        self._formulas.set_axis(axis)


def spelt(formula: str) -> str:
    r"""Return ``$\mathdefault{2\times10^{-3}}$`` as 2×10⁻³; what is more than that stays a formula."""
    match = _FORMULA.fullmatch(formula)
    if match is None:
        return formula
    text = match[1].replace(r"\times", "×")
    text = _POWER.sub(lambda power: power[1].translate(_RAISED), text)
    return formula if re.search(r"[\\^{}]", text) else text.replace("-", "−")
