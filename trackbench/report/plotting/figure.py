"""A drawn figure as a file's content: laid out once for all formats; equal figures are equal files."""

import io
import re
from collections.abc import Sequence
from typing import Any

from matplotlib.axis import Axis
from matplotlib.ticker import Formatter, LogFormatterMathtext

from trackbench.report.plotting.canvas import Figure
from trackbench.report.plotting.page_formats import sheet

_FORMULA = re.compile(r"\$\\mathdefault\{(.*)\}\$")
_POWER = re.compile(r"\^\{(-?\d+)\}")
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def power_of_ten(exponent: int) -> str:
    """Return a label as those of logarithmic axes are."""
    formula = rf"$\mathdefault{{10^{{{exponent}}}}}$"
    return spelt(formula) if sheet().has_raised_digits else formula


def in_letters(figure: Figure) -> None:
    """Let all logarithmic axes say their powers in letters; the font has to have raised digits."""
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
    found = _FORMULA.fullmatch(formula)
    if found is None:
        return formula
    text = found[1].replace(r"\times", "×")
    text = _POWER.sub(lambda power: power[1].translate(_RAISED), text)
    return formula if re.search(r"[\\^{}]", text) else text.replace("-", "−")


FORMATS = {"png": {"Software": None}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}
"""Formats of a figure and what a file leaves unsaid."""
_SVG_DPI = 150  # of rasterised parts inside it; a screen needs no more
_COMPRESSION = 1  # of PNG: the files are a tenth larger than at 6, for two thirds of the time


def saved(figure: Figure, form: str) -> bytes:
    """Return the figure's file in one of the `FORMATS`."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    _settle(figure)
    out, unsaid = io.BytesIO(), FORMATS[form]
    # Not by savefig, which draws all of it once more for the sake of the layout.
    if form == "svg":
        figure.dpi = _SVG_DPI
        vectors: Any = FigureCanvasSVG(figure)  # has no types
        vectors.print_svg(out, metadata=unsaid)
    elif form == "png":
        figure.dpi = mpl.rcParams["savefig.dpi"]
        pixels: Any = FigureCanvasAgg(figure)
        pixels.print_png(out, metadata=unsaid, pil_kwargs={"compress_level": _COMPRESSION})
    else:
        figure.savefig(out, format=form, metadata=unsaid)
    return out.getvalue()


def _settle(figure: Figure) -> None:
    """Let everything have its place, by the SVG's letters whatever the format is, and keep it."""
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.layout_engine import PlaceHolderLayoutEngine

    engine: Any = figure.get_layout_engine()
    if isinstance(engine, PlaceHolderLayoutEngine):
        return
    spell_out(figure)
    if engine is not None:
        FigureCanvasSVG(figure)
        figure.dpi = 72
        engine.execute(figure)
        figure.set_layout_engine("none")


def spell_out(figure: Figure) -> None:
    """Let a text with dollars that is no formula stand as it is written, and so powers of ten."""
    from matplotlib.mathtext import MathTextParser
    from matplotlib.text import Text

    from trackbench.report.plotting.figure import in_letters

    if sheet().has_raised_digits:
        in_letters(figure)
    parser: Any = MathTextParser("path")
    for text in figure.findobj(Text):
        if isinstance(text, Text) and "$" in text.get_text():
            try:
                parser.parse(text.get_text())
            except ValueError:
                text.set_parse_math(False)
