"""A drawn figure as a file's content: laid out once for all formats; equal figures are equal files."""

import io
from typing import Any

from trackbench.report.plotting.artist_types import Figure
from trackbench.report.plotting.page_formats import sheet

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

    from trackbench.report.plotting.tick_labels import in_letters

    if sheet().has_raised_digits:
        in_letters(figure)
    parser: Any = MathTextParser("path")
    for text in figure.findobj(Text):
        if isinstance(text, Text) and "$" in text.get_text():
            try:
                parser.parse(text.get_text())
            except ValueError:
                text.set_parse_math(False)
