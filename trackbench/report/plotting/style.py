"""Style, layout and files of all figures: a journal's page, color-blind-safe, legible in gray.

A figure is laid out once for all formats. Equal figures are equal files.
"""

import io
import sys
import textwrap
import warnings
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypeAlias, cast

import numpy as np

from trackbench.core.arrays import Array
from trackbench.report.plotting import svg_file
from trackbench.report.plotting.page_formats import sheet

# Types for signatures: matplotlib takes long to import, and only what draws has to.
if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes
    from matplotlib.axis import Axis as Axis
    from matplotlib.figure import Figure as Figure
else:
    Axes = Axis = Figure = Any


# Okabe & Ito 2008, without its yellow, which disappears on paper.
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#6F4E37", "#999999")
DASHES: tuple[Any, ...] = (
    *("-", (0, (5, 1.5)), (0, (1.2, 1.2)), (0, (6, 1.5, 1.2, 1.5)), (0, (9, 1.5))),
    *((0, (2.5, 2.5)), (0, (6, 1.2, 1.2, 1.2, 1.2, 1.2)), (0, (9, 1.5, 3, 1.5))),
)
LineStyle: TypeAlias = dict[str, Any]
"""Keyword arguments with which matplotlib draws a line or a marker."""
FLOOR: LineStyle = {"color": "black", "linestyle": (0, (6, 2)), "linewidth": 1.0}
EXACT: LineStyle = {"color": "black", "linestyle": (0, (4, 3)), "linewidth": 0.9}
BASELINE: LineStyle = {"color": "#777777", "linestyle": (0, (1, 1.6)), "linewidth": 1.4}
ANY, MANEUVER = "#555555", "#f3d9a4"
"""Colors of what is no filter's own: of any filter in a legend, of spans of maneuvers."""
_FAULTS = ("#f4cccc", "#c9daf8", "#d9ead3", "#fff2cc")
BAND: LineStyle = {"color": "black", "alpha": 0.15, "lw": 0}
"""Look of where a filter without fault is found."""
TRUTH: LineStyle = {"color": "black", "linewidth": 1.4, "linestyle": "-"}


def fault(number: int) -> LineStyle:
    """Return the look of the time of a sensor's fault; a fault may be within another."""
    return {"color": _FAULTS[number % len(_FAULTS)], "alpha": 0.7, "lw": 1, "zorder": 0}


SPREAD = "± 2 standard errors"
_MOST_BANDS = 3
_BARS = 12  # along a line
_GRAY: LineStyle = {"color": "#c4c4c4", "linewidth": 0.8, "zorder": 1.5}
_GRAY_POINTS = 100  # of a line at most
_GAP = 3.0  # usual distances of steps that a line spans at most

_RC: Any = {
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
    """Return a figure and its axes, unknown to pyplot, so that notebooks show it once."""
    from trackbench.report.plotting.canvas import Canvas

    figure = Canvas(width_in or sheet().width_in, height_in * sheet().heights)
    return figure, figure.subplots(rows, columns, **kwargs)


def line(index: int) -> LineStyle:
    """Return color and dash of the filter at ``index`` among the experiment's filters."""
    color = COLORS[index % len(COLORS)]
    dash = DASHES[(index + index // len(COLORS)) % len(DASHES)]
    return {"color": color, "linestyle": dash}


def filter_line(ax: Axes, x: Any, value: Array, look: LineStyle) -> bool:
    """Draw a filter's line; return whether it has any value.

    A filter that lost all its runs has none, and no line in the legend.
    """
    is_drawn = bool(np.isfinite(value).any())
    if is_drawn:
        ax.plot(x, value, **look)
    return is_drawn


def error_band(
    ax: Axes,
    x: Array,
    value: Array,
    stderr: Array,
    look: LineStyle,
    place: int,
    places: int,
    log: bool = False,
) -> None:
    """Draw two standard errors around line ``place``; explain the band in legend and page.

    A band; where there are more than three, which would lie over each other to a gray, bars at some
    of the x, no two lines' at the same. On a logarithmic axis none reaches below a tenth of the value.
    """
    svg_file.set_stderr(ax, look["label"], stderr)
    low, high = value - 2 * stderr, value + 2 * stderr
    if log:
        low = np.maximum(low, 0.1 * value)
    whose = {"color": look["color"], "label": f"_{look['label']}"}
    if places <= _MOST_BANDS:
        ax.fill_between(x, low, high, alpha=0.15, lw=0, **whose)
        ax.fill_between([], [], [], color="#888888", alpha=0.4, lw=0, label=SPREAD)
        return
    every = max(1, len(x) // _BARS)
    chosen = slice(place * every // places, None, every)
    ax.vlines(x[chosen], low[chosen], high[chosen], linewidth=1.0, **whose)
    ax.plot([], [], linestyle="", color="#888888", marker="|", markersize=8, label=SPREAD)


def error_bars(
    ax: Axes, x: Array, value: Array, stderr: Array, label: str, color: str, **look: Any
) -> None:
    """Draw two standard errors as a bar at each point of the line ``label``, for the page too."""
    svg_file.set_stderr(ax, label, stderr)
    ax.errorbar(x, value, 2.0 * stderr, fmt="none", color=color, label=f"_{label}", **look)


def with_gaps(steps: Array, *series: Array) -> tuple[Array, ...]:
    """Return the series with a NaN in each gap, which is wider than three usual distances of steps."""
    jumps = np.diff(steps)
    wide = jumps > _GAP * np.median(jumps) if len(jumps) else np.zeros(0, dtype=bool)
    places = np.flatnonzero(wide) + 1
    return tuple(np.insert(np.asarray(s, dtype=float), places, np.nan) for s in series)


def gray_line(ax: Axes, x: Array, value: Array, steps: int = 1) -> None:
    """Draw the line of another panel's filter behind, as means over windows of successive values.

    Each value is that of so many ``steps``.
    """
    if not len(x):
        return
    over = -(-len(x) // _GRAY_POINTS)
    starts = np.arange(0, len(x), over)
    lengths = np.diff([*starts, len(x)])
    # A window with a NaN is a gap.
    means = (np.add.reduceat(series, starts) / lengths for series in (x, value))
    ax.plot(*means, label="_gray", **_GRAY)
    words = f", means over {over * steps} steps" if over * steps > 1 else ""
    ax.plot([], [], label=f"Other filters{words}", **_GRAY)


def legend_outside(figure: Figure, without: Collection[str] = ()) -> None:
    """Draw one legend below the axes, each label once, in as many columns as fit."""
    handles = _legend(figure, without)
    if not handles:
        return
    columns = _columns(list(handles), figure.get_figwidth())
    rows = -(-len(handles) // columns)
    lines = rows * (1 + max(label.count("\n") for label in handles))
    figure.set_figheight(figure.get_figheight() + _LINE_IN * lines + 0.1)
    place: Any = {"loc": "outside lower center", "ncols": columns, "columnspacing": 1.5}
    figure.legend(handles.values(), handles.keys(), **place)


_LETTERS_PER_IN = 11.5
_LETTER_IN, _LINE_IN, _HANDLE_IN = 0.066, 0.165, 0.55
"""What takes room in a legend: a letter, a line, and the drawn line with the space beside it."""


def _columns(labels: Sequence[str], width_in: float) -> int:
    """Choose the number of legend columns, which are filled downwards."""
    widths = [_HANDLE_IN + _LETTER_IN * max(map(len, b.split("\n"))) for b in labels]
    for rows in range(1, len(labels) + 1):
        if sum(max(widths[i : i + rows]) for i in range(0, len(labels), rows)) <= width_in:
            break
    return -(-len(labels) // rows)


def _legend(figure: Figure, without: Collection[str]) -> dict[str, Any]:
    """Collect the lines by label; the first of each label."""
    handles: dict[str, Any] = {}
    for ax in figure.axes:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            if label not in without:
                handles.setdefault(wrap_label(label), handle)
    last = {label: handles.pop(label) for label in [SPREAD] if label in handles}
    return handles | last


MOST_PANELS = 12
_MOSAIC = 3


def panels(
    number: int, rows: int, height_in: float, balanced: bool = False, **kwargs: Any
) -> tuple[Figure, Any]:
    """Return a figure and the axes (number, rows) of so many panels, four beside each other at most.

    ``balanced`` draws 6 panels as 3 and 3, not as 4 and 2.
    """
    across = min(number, sheet().across)
    blocks = -(-number // across)
    if balanced:
        across = -(-number // blocks)
    figure, axes = subplots(rows * blocks, across, height_in * blocks, squeeze=False, **kwargs)
    panes = axes.reshape(blocks, rows, across).swapaxes(1, 2).reshape(-1, rows)
    for ax in panes[number:].flat:
        ax.set_axis_off()
    return figure, panes[:number]


def panel_grid(number: int, row_in: float, beside_in: float) -> tuple[Figure, list[Axes]]:
    """Return a figure with axes in rows of three, and the blank axes of the last row."""
    across = min(max(number, 1), _MOSAIC)
    rows = -(-max(number, 1) // across)
    figure, axes = subplots(rows, across, beside_in + row_in * rows, squeeze=False)
    for ax in axes.flat[number:]:
        ax.set_axis_off()
    return figure, list(axes.flat)


def title(figure: Figure, text: str, points: int = 1) -> None:
    """Set the heading, with the number of shown grid points if there are too many."""
    part = f"the first {MOST_PANELS} of {points} points" if points > MOST_PANELS else ""
    if not sheet().titled:
        text = ""
    if text or part:
        figure.suptitle(": ".join(filter(None, [text, part])))


def finished(figure: Figure, text: str, points: int = 1) -> Figure:
    """Give the figure its heading and its legend."""
    title(figure, text, points)
    legend_outside(figure)
    return figure


def headings(texts: Sequence[str]) -> list[str]:
    """Return the titles of panels beside each other, wrapped to the room."""
    return [wrapped(text, min(len(texts), sheet().across)) for text in texts]


def wrapped(text: str, across: int = 1) -> str:
    """Return a text in lines that have room over one of so many panels beside each other."""
    return wrap_label(text, int(_LETTERS_PER_IN * sheet().width_in) // across)


def wrap_label(label: str, width: int = 24) -> str:
    """Return a label as it is written, in lines of so many characters; a dollar starts no formula."""
    return "\n".join(textwrap.wrap(label, width)).replace("$", r"\$")


@contextmanager
def rc_context() -> Iterator[None]:
    """Draw in the house style, and leave the user's as it was.

    Without warnings: of a glyph that the font has not, of axes that end near 1e308.
    """
    import matplotlib as mpl

    with warnings.catch_warnings(), mpl.rc_context(_RC | dict(sheet().letters)):
        warnings.simplefilter("ignore")
        yield


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
        if name not in _OF_THE_SCREEN and repr(value) != repr(default):
            changed[name] = value
    return changed


_OF_THE_SCREEN = {"backend", "backend_fallback", "interactive", "toolbar"}
"""Settings of matplotlib that change no file."""


def forms(formats: Iterable[str]) -> list[str]:
    """Return the formats of figures among those of tables and figures: what is for LaTeX is a PDF."""
    return list(dict.fromkeys("pdf" if form == "tex" else form for form in formats))


def content(figure: Figure, form: str) -> bytes:
    """Return the figure as a file's content in one of the `FORMATS`."""
    if form != "svg":
        return saved(figure, form)
    labels = svg_file.mark(figure)
    svg = svg_file.compact(saved(figure, form).decode())
    return svg_file.marked(svg, figure, labels).encode()


def lay_out(figure: Figure) -> Figure:
    """Return the figure, laid out here and now: what is left for later would be in the user's style."""
    spell_out(figure)
    figure.draw_without_rendering()
    return figure


def close(figure: Figure) -> None:
    """Free the memory of a figure that a plugin made by pyplot."""
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close(figure)


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

    from trackbench.report.plotting.canvas import in_letters

    if sheet().has_raised_digits:
        in_letters(figure)
    parser: Any = MathTextParser("path")
    for text in figure.findobj(Text):
        if isinstance(text, Text) and "$" in text.get_text():
            try:
                parser.parse(text.get_text())
            except ValueError:
                text.set_parse_math(False)
