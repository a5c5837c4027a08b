"""Style, layout and files of all figures: a journal's page, color-blind-safe, legible in gray.

A figure is laid out once for all formats. Equal figures are equal files.
"""

import io
import sys
import textwrap
import warnings
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from math import ceil
from typing import TYPE_CHECKING, Any, TypeAlias, cast

from trackbench.report.plotting import svg_file
from trackbench.report.plotting.page_formats import sheet

# Types for signatures: matplotlib takes long to import, and only what draws has to.
if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes
    from matplotlib.axis import Axis as Axis
    from matplotlib.figure import Figure as Figure
else:
    Axes = Axis = Figure = Any


# Okabe & Ito 2008. Brown and indigo stand for its yellow, which disappears on paper, and its black.
# Olive and wine are from Tol's muted scheme (2021).
COLORS = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#56B4E9",
    "#E69F00",
    "#6F4E37",
    "#332288",
    "#999933",
    "#882255",
)
"""Colors of filters. References and bounds are black or gray, filters never are."""
DASHES: tuple[Any, ...] = (
    "-",
    (0, (5, 1.5)),
    (0, (1.2, 1.2)),
    (0, (6, 1.5, 1.2, 1.5)),
    (0, (9, 1.5)),
    (0, (2.5, 2.5)),
    (0, (6, 1.2, 1.2, 1.2, 1.2, 1.2)),
    (0, (9, 1.5, 3, 1.5)),
)
LineStyle: TypeAlias = dict[str, Any]
"""Keyword arguments with which matplotlib draws a line or a marker."""
FLOOR: LineStyle = {"color": "black", "linestyle": (0, (6, 2)), "linewidth": 1.0}
BASELINE: LineStyle = {"color": "#777777", "linestyle": (0, (1, 1.6)), "linewidth": 1.4}
_REFERENCE_DASHES: tuple[Any, ...] = (
    (0, (6, 2)),
    (0, (1.5, 1.5)),
    (0, (8, 1.5, 1.5, 1.5)),
    (0, (3, 3)),
    (0, (8, 1.5, 1.5, 1.5, 1.5, 1.5)),
)
"""Dashes of black lines, of which `FLOOR` has the first."""
ANY = "#555555"
"""Color in a legend that stands for every filter."""
MANEUVER = "#dde5b6"
"""Color of the time of a maneuver, far from the color of every filter."""
_FAULTS = ("#f4cccc", "#c9daf8", "#d9ead3", "#fff2cc")
"""Colors of the times of sensors' faults."""
BAND: LineStyle = {"color": "black", "alpha": 0.15, "lw": 0}
"""Look of the region in which a consistent filter is found."""
TRUTH: LineStyle = {"color": "black", "linewidth": 1.4, "linestyle": "-"}
TRUTH_BELOW: LineStyle = {"color": "#b3b3b3", "linewidth": 3.0, "linestyle": "-", "zorder": 0.8}
"""Look of a true path below the estimates of one run."""
SPREAD = "± 2 standard errors"
"""Text of bands and bars in a legend."""

_RC_PARAMS: Any = {
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.2,
    "legend.frameon": False,
    "savefig.dpi": 200,
    "svg.hashsalt": "trackbench",
    "svg.fonttype": "none",
    "pdf.fonttype": 42,
    "path.simplify_threshold": 0.2,
}


def subplots(
    rows: int = 1,
    columns: int = 1,
    height_in: float = 3.2,
    width_in: float | None = None,
    **kwargs: Any,
) -> Any:
    """Return a new figure, as wide as the page, and its axes.

    pyplot does not know the figure, so that a notebook shows it once.

    Parameters
    ----------
    rows, columns
        Number of axes below and beside each other.
    height_in
        Height of the figure in inches. A page format may scale it.
    width_in
        Width of the figure in inches. Default: the width of the page.
    **kwargs
        Further arguments of matplotlib's ``Figure.subplots``, such as ``sharex``.

    Returns
    -------
    figure : matplotlib.figure.Figure
    axes : matplotlib.axes.Axes, or an array of them (rows, columns) as ``Figure.subplots`` returns it
    """
    from trackbench.report.plotting.canvas import Canvas

    figure = Canvas(width_in or sheet().width_in, height_in * sheet().heights)
    axes = figure.subplots(rows, columns, **kwargs)
    return figure, axes


def line(index: int) -> LineStyle:
    """Return the color and dash of number ``index``, from 0.

    The first 10 numbers have different colors. The first 80 differ in color or dash.
    """
    color = COLORS[index % len(COLORS)]
    # The 8 dashes take turns, with one more turn in each round of the 10 colors. Without it the looks
    # would repeat after 40 numbers.
    dash = DASHES[(index + index // len(COLORS)) % len(DASHES)]
    return {"color": color, "linestyle": dash}


def reference_line(index: int) -> LineStyle:
    """Return the look of the reference or bound at ``index`` among those of an experiment."""
    return FLOOR | {"linestyle": _REFERENCE_DASHES[index % len(_REFERENCE_DASHES)]}


def number_lines(labels: Sequence[str], figures: Iterable[Collection[str]]) -> dict[str, int]:
    """Return a number for `line` of each label, so that a label has one color in every figure.

    Parameters
    ----------
    labels
        All labels that need a color, in their order.
    figures
        The labels of each figure.

    Returns
    -------
    numbers : dict
        Labels of one figure have different colors, unless the figure has more labels than there are
        colors, or no color is left that a label has in no other figure.
    """
    # Figures with enough colors for their labels.
    small_figures = [figure for figure in figures if len(figure) <= len(COLORS)]
    numbers: dict[str, int] = {}
    for index, label in enumerate(labels):
        # Colors of labels so far that some figure draws beside this one.
        taken_colors = set()
        for figure in small_figures:
            if label in figure:
                taken_colors |= {
                    numbers[other] % len(COLORS) for other in figure if other in numbers
                }
        # One number of each color, from the label's own index on; the first with a free color.
        candidates = range(index, index + len(COLORS))
        free = [number for number in candidates if number % len(COLORS) not in taken_colors]
        numbers[label] = next(iter(free), index)
    return numbers


def distinct_looks(usual_looks: Mapping[str, LineStyle]) -> dict[str, LineStyle]:
    """Return the looks of one figure's labels, in which no two filters have the same color.

    ``usual_looks`` are those that the labels have in other figures. A label keeps its usual look unless
    a label before it has this color. If there are more filters than colors, two filters of one color
    have different dashes. Black and gray looks stay as they are.
    """
    looks: dict[str, LineStyle] = {}
    colors: set[str] = set()
    waiting: list[str] = []
    # Step 1: usual looks; the first label of a color keeps it.
    for label, look in usual_looks.items():
        color = look["color"]
        if color in COLORS and color in colors:
            waiting.append(label)
        else:
            looks[label] = look
            colors.add(color)
    # Step 2: the other labels have a new color, else a color with another dash.
    all_looks = [line(number) for number in range(len(COLORS) * len(DASHES))]
    for label in waiting:
        new_colors = [look for look in all_looks if look["color"] not in colors]
        new_looks = [look for look in all_looks if look not in looks.values()]
        look = [*new_colors, *new_looks, usual_looks[label]][0]
        looks[label] = look
        colors.add(look["color"])
    return {label: looks[label] for label in usual_looks}


def fault_look(number: int) -> LineStyle:
    """Return the look of the time of a sensor's fault."""
    return {"color": _FAULTS[number % len(_FAULTS)], "alpha": 0.7, "lw": 1, "zorder": 0}


def legend_outside(
    figure: Figure, without: Collection[str] = (), order: Sequence[str] = ()
) -> None:
    """Draw one legend below the axes, each label once, in as many columns as fit.

    The figure grows by its height. Labels in ``without`` are left out. Those in ``order`` come first, in
    this order.
    """
    handles = _handles_by_label(figure, without)
    if not handles:
        return
    first = {label: handles[label] for label in map(wrap_label, order) if label in handles}
    handles = first | handles
    columns = _count_legend_columns(list(handles), figure.get_figwidth())
    rows = ceil(len(handles) / columns)
    # Every row is as high as the label with the most lines.
    text_lines = rows * (1 + max(label.count("\n") for label in handles))
    # 0.1 inches keep the legend apart from the axes.
    figure.set_figheight(figure.get_figheight() + _LINE_IN * text_lines + 0.1)
    figure.legend(
        handles.values(),
        handles.keys(),
        loc="outside lower center",
        ncols=columns,
        columnspacing=1.5,
    )


_LETTERS_PER_IN = 11.5
"""Letters of a title that have room in an inch."""
_LETTER_IN = 0.066
"""Width of a letter in a legend."""
_LINE_IN = 0.165
"""Height of a line in a legend."""
_HANDLE_IN = 0.55
"""Width of a drawn line in a legend, with the space beside it."""


def _count_legend_columns(labels: Sequence[str], width_in: float) -> int:
    """Return the largest number of legend columns, which are filled downwards, that fit the width."""
    widths = []
    for label in labels:
        letters = max(len(text_line) for text_line in label.split("\n"))
        widths.append(_HANDLE_IN + _LETTER_IN * letters)
    # The fewest rows that fit; if none do, one column.
    for rows in range(1, len(labels) + 1):
        columns = [widths[first : first + rows] for first in range(0, len(labels), rows)]
        if sum(max(column) for column in columns) <= width_in:
            break
    return ceil(len(labels) / rows)


def _handles_by_label(figure: Figure, without: Collection[str]) -> dict[str, Any]:
    """Return the first drawn artist of each label in the figure, by the label as `wrap_label` writes it.

    Labels in ``without`` are left out. The label of two standard errors comes last.
    """
    handles: dict[str, Any] = {}
    for ax in figure.axes:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            if label not in without:
                handles.setdefault(wrap_label(label), handle)
    if SPREAD in handles:
        handles[SPREAD] = handles.pop(SPREAD)
    return handles


MOST_PANELS = 12
"""Largest number of grid points, or of other things that have a panel each, that a figure shows."""
MOSAIC = 3
"""Panels in a row of a `panel_grid`."""


def make_panels(
    number: int, rows: int, height_in: float, balanced: bool = False, **kwargs: Any
) -> tuple[Figure, Any]:
    """Return a figure and the axes (number, rows) of its panels.

    Each of the ``number`` panels has ``rows`` axes below each other and is ``height_in`` inches high. As
    many panels are side by side as the page format allows: four on a screen. ``balanced`` draws 6 panels
    as 3 and 3, not as 4 and 2. ``kwargs`` are further arguments of matplotlib's ``Figure.subplots``.
    """
    across = min(number, sheet().across)  # panels side by side
    blocks = ceil(number / across)  # rows of panels
    if balanced:
        across = ceil(number / blocks)
    figure, axes = subplots(rows * blocks, across, height_in * blocks, squeeze=False, **kwargs)
    # From (blocks * rows, across) to (panels, rows), where a panel is a column of a block.
    panels = axes.reshape(blocks, rows, across).swapaxes(1, 2).reshape(-1, rows)
    for ax in panels[number:].flat:
        ax.set_axis_off()
    return figure, panels[:number]


def panel_grid(
    number: int, row_in: float, extra_in: float, **layout: Any
) -> tuple[Figure, list[Axes]]:
    """Return a figure and a list of at least ``number`` axes in rows of three.

    The list ends with the axes that fill the last row, which are blank. The figure is as high as its
    rows, ``row_in`` each, and ``extra_in`` for titles and labels, in inches. ``layout`` has further
    arguments of matplotlib's ``Figure.subplots``.
    """
    shown = max(number, 1)
    across = min(shown, MOSAIC)
    rows = ceil(shown / across)
    figure, axes = subplots(rows, across, extra_in + row_in * rows, squeeze=False, **layout)
    for ax in axes.flat[number:]:
        ax.set_axis_off()
    return figure, list(axes.flat)


def set_title(figure: Figure, text: str, points: int = 1) -> None:
    """Set the figure's title ``text``, with a remark if not all grid points are shown.

    ``points`` is the number of grid points. A page format for papers has the text in the caption.
    """
    parts = []
    if text and sheet().titled:
        parts.append(text)
    if points > MOST_PANELS:
        parts.append(f"the first {MOST_PANELS} of {points} points")
    if parts:
        figure.suptitle(": ".join(parts))


def add_title_and_legend(figure: Figure, text: str, points: int = 1) -> Figure:
    """Give the figure its title ``text`` and its legend, and return it.

    ``points`` is the number of grid points: the title has a remark if the figure does not show them all.
    """
    set_title(figure, text, points)
    legend_outside(figure)
    return figure


def wrap_headings(texts: Sequence[str]) -> list[str]:
    """Return the titles of panels beside each other, in lines that have room over a panel."""
    across = min(len(texts), sheet().across)
    return [wrapped(text, across) for text in texts]


def wrapped(text: str, across: int = 1) -> str:
    """Return a text in lines that have room over one of ``across`` panels beside each other."""
    letters_of_page = int(_LETTERS_PER_IN * sheet().width_in)
    return wrap_label(text, letters_of_page // across)


def wrap_label(label: str, width: int = 24) -> str:
    """Return a label in lines of at most ``width`` letters, in which a dollar starts no formula."""
    return "\n".join(textwrap.wrap(label, width)).replace("$", r"\$")


@contextmanager
def rc_context() -> Iterator[None]:
    """Set matplotlib's rcParams to the style of all figures within the block, and ignore all warnings.

    Warnings are those of a letter that the font lacks, and of axes that end near 1e308.
    """
    import matplotlib as mpl

    with warnings.catch_warnings(), mpl.rc_context(_RC_PARAMS | dict(sheet().letters)):
        warnings.simplefilter("ignore")
        yield


_SCREEN_SETTINGS = {"backend", "backend_fallback", "interactive", "toolbar"}
"""Settings of matplotlib that change no file."""


def changed_settings() -> dict[str, Any]:
    """Return matplotlib's settings that a plugin or a notebook has changed in this process."""
    if "matplotlib" not in sys.modules:
        return {}
    import matplotlib as mpl

    # The methods of `dict` print no warning for an old name.
    defaults = dict(dict.items(cast(dict[str, Any], mpl.rcParamsDefault)))
    settings = dict(dict.items(cast(dict[str, Any], mpl.rcParams)))
    changed: dict[str, Any] = {}
    for name, value in settings.items():
        default = defaults.get(name)
        if name not in _SCREEN_SETTINGS and repr(value) != repr(default):
            changed[name] = value
    return changed


FORMATS = {"png": {"Software": None}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}
"""Formats of a figure's file, and the metadata that each leaves out: equal figures are equal files."""
_SVG_DPI = 150
"""Resolution of rasterized parts of an SVG; a screen needs no more."""
_COMPRESSION = 1
"""Compression of a PNG: files are a tenth larger than at 6, and take a third of the time less."""


def forms(formats: Iterable[str]) -> list[str]:
    """Return the `FORMATS` in which figures are written, each once, for the ``formats`` of a command.

    The format ``tex`` of tables has its figures as PDF, which LaTeX includes.
    """
    figure_formats: list[str] = []
    for name in formats:
        figure_format = "pdf" if name == "tex" else name
        if figure_format not in figure_formats:
            figure_formats.append(figure_format)
    return figure_formats


def content(figure: Figure, form: str) -> bytes:
    """Return the content of the figure's file in one of the `FORMATS`.

    An SVG also has the values of the curves, which the interactive page reads.
    """
    if form != "svg":
        return matplotlib_file(figure, form)
    labels = svg_file.number_shapes(figure)
    svg = svg_file.compact_paths(matplotlib_file(figure, form).decode())
    return svg_file.add_curve_data(svg, figure, labels).encode()


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
    """Return the content of the figure's file in one of the `FORMATS`, as matplotlib writes it."""
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
    """
    from matplotlib.mathtext import MathTextParser
    from matplotlib.text import Text

    from trackbench.report.plotting.canvas import raise_digits_of_ticks

    if sheet().has_raised_digits:
        raise_digits_of_ticks(figure)
    parser: Any = MathTextParser("path")
    for text in figure.findobj(Text):
        if isinstance(text, Text) and "$" in text.get_text():
            try:
                parser.parse(text.get_text())
            except ValueError:
                text.set_parse_math(False)
