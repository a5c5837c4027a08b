"""PNG, SVG and PDF files of a figure: resolution, compression, metadata, layout.

A figure is laid out once for all formats. Equal figures are equal files.
"""

import io
import sys
from collections.abc import Iterable
from typing import Any

from trackbench.report.plotting import interactive_curves, svg_paths
from trackbench.report.plotting.page_formats import sheet
from trackbench.report.plotting.style import Figure

FORMATS = {"png": {"Software": None}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}
"""Formats of a figure's file, and the metadata that each leaves out: equal figures are equal files."""
_SVG_DPI = 150
"""Resolution of rasterized parts of an SVG; a screen needs no more."""
_COMPRESSION = 1
"""Compression of a PNG: files are a tenth larger than at 6, and take a third of the time less."""


def forms(formats: Iterable[str]) -> list[str]:
    """Return the `FORMATS` in which figures are written, each once.

    Parameters
    ----------
    formats
        formats of a command. The format ``tex`` of tables has its figures as PDF, which LaTeX includes

    Returns
    -------
    list of str
        formats in the given order
    """
    figure_formats: list[str] = []
    for name in formats:
        figure_format = "pdf" if name == "tex" else name
        if figure_format not in figure_formats:
            figure_formats.append(figure_format)
    return figure_formats


def content(figure: Figure, form: str) -> bytes:
    """Return the content of the figure's file.

    An SVG also has the values of the curves, which the interactive page reads.

    Parameters
    ----------
    figure
        figure to write; its layout is fixed
    form
        one of the `FORMATS`

    Returns
    -------
    bytes
        content of the file, equal for equal figures
    """
    if form != "svg":
        return matplotlib_file(figure, form)
    labels = interactive_curves.number_shapes(figure)
    svg = svg_paths.compact_paths(matplotlib_file(figure, form).decode())
    return interactive_curves.add_curve_data(svg, figure, labels).encode()


def lay_out(figure: Figure) -> Figure:
    """Return the figure, laid out by the rcParams that are set now, not those of the user later."""
    spell_out_texts(figure)
    figure.draw_without_rendering()
    return figure


def close(figure: Figure) -> None:
    """Free the memory of a figure that a plugin made by pyplot."""
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close(figure)


def matplotlib_file(figure: Figure, form: str) -> bytes:
    """Return the content of the figure's file, as matplotlib writes it.

    Parameters
    ----------
    figure
        figure to write; its layout is fixed
    form
        one of the `FORMATS`

    Returns
    -------
    bytes
        content of the file
    """
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    _fix_layout(figure)
    file = io.BytesIO()
    metadata = FORMATS[form]
    # SVG and PNG are not written by savefig, which draws the figure once more for the layout.
    if form == "svg":
        figure.dpi = _SVG_DPI
        svg_canvas: Any = FigureCanvasSVG(figure)  # has no types
        svg_canvas.print_svg(file, metadata=metadata)
    elif form == "png":
        figure.dpi = mpl.rcParams["savefig.dpi"]
        png_canvas: Any = FigureCanvasAgg(figure)
        png_canvas.print_png(file, metadata=metadata, pil_kwargs={"compress_level": _COMPRESSION})
    else:
        figure.savefig(file, format=form, metadata=metadata)
    return file.getvalue()


def _fix_layout(figure: Figure) -> None:
    """Lay the figure out by the sizes of the SVG's letters, and keep this layout for every format."""
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.layout_engine import PlaceHolderLayoutEngine

    engine: Any = figure.get_layout_engine()
    # A figure whose layout was fixed by the last line below has this engine.
    is_fixed = isinstance(engine, PlaceHolderLayoutEngine)
    if is_fixed:
        return
    spell_out_texts(figure)
    if engine is not None:
        FigureCanvasSVG(figure)  # which makes itself the figure's canvas
        figure.dpi = 72  # an SVG has so many units in an inch
        engine.execute(figure)
        figure.set_layout_engine("none")


def spell_out_texts(figure: Figure) -> None:
    """Let matplotlib draw texts as plain letters, not as formulas, where it can.

    These are powers of ten at ticks, if the font has raised digits, and texts with dollars that enclose
    no valid formula, which matplotlib would reject.

    Parameters
    ----------
    figure
        figure with everything drawn; it is changed
    """
    from matplotlib.mathtext import MathTextParser
    from matplotlib.text import Text

    from trackbench.report.plotting.raised_digits_formatter import raise_digits_of_ticks

    if sheet().has_raised_digits:
        raise_digits_of_ticks(figure)
    parser: Any = MathTextParser("path")
    for text in figure.findobj(Text):
        if isinstance(text, Text) and "$" in text.get_text():
            try:
                parser.parse(text.get_text())
            except ValueError:
                text.set_parse_math(False)
