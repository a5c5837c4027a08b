"""One look for every figure: a journal's page, colour-blind-safe, legible in grey."""

import io
import textwrap
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from trackbench.experiment.reading.points import single_paths
from trackbench.report.svg import compact

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe & Ito 2008, without its yellow, which disappears on paper.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#6F4E37", "#999999")
DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1.2, 1.2)), (0, (6, 1.5, 1.2, 1.5)))
FLOOR: dict[str, Any] = {"color": "black", "linestyle": (0, (6, 2)), "linewidth": 1.0}
BASELINE: dict[str, Any] = {"color": "#777777", "linestyle": (0, (1, 1.6)), "linewidth": 1.4}
TRUTH: dict[str, Any] = {"color": "black", "linewidth": 1.4, "linestyle": "-"}
WIDTH_IN = 7.0
FORMATS = {"png": {"Software": None}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}
"""Formats of a figure and what a file leaves unsaid, so that equal figures are equal files."""

_RC: Any = {
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.labelsize": 9,
    "legend.fontsize": 8,
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
    "path.simplify_threshold": 0.2,
}


def subplots(
    rows: int = 1,
    columns: int = 1,
    height_in: float = 3.2,
    width_in: float = WIDTH_IN,
    **kwargs: Any,
) -> Any:
    """A figure and its axes in the house style; nothing is shown on a screen."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    mpl.rcParams.update(_RC)
    size = (width_in, height_in)
    return plt.subplots(rows, columns, figsize=size, layout="constrained", **kwargs)


def line(index: int) -> dict[str, Any]:
    """Colour and dash of the filter that stands at ``index`` among the experiment's filters."""
    colour = COLOURS[index % len(COLOURS)]
    dash = DASHES[(index + index // len(COLOURS)) % len(DASHES)]
    return {"color": colour, "linestyle": dash}


def legend_outside(figure: "Figure", axes: "Axes | Sequence[Axes]") -> None:
    """One legend to the right of the axes, each label once."""
    found: dict[str, Any] = {}
    for ax in axes if isinstance(axes, Sequence) else [axes]:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    labels = [words(label) for label in found]
    figure.legend(found.values(), labels, loc="outside right upper", fontsize=8, frameon=False)


def heading(point: dict[str, Any]) -> str:
    """A grid point as the title of its panel: ``R = 0.1``."""
    return ", ".join(f"{name(path)} = {number(value)}" for path, value in point.items())


def name(path: str) -> str:
    """The last word of a grid's path, of the first of several that vary together."""
    return single_paths(path)[0].rpartition(".")[2]


def number(value: Any) -> str:
    """A grid's value: six digits of a number, words and truth values as they are."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return f"{value:g}" if is_number else str(value)


def plain_log_axis(ax: "Axes", most: float = 100.0) -> None:
    """Say 200 and not 2 x 10^2 on a logarithmic vertical axis that spans that factor at most."""
    from matplotlib.ticker import FuncFormatter, LogLocator

    low, high = ax.get_ylim()
    if high > most * low:
        return
    ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{y:g}"))
    ax.yaxis.set_minor_formatter(FuncFormatter(lambda y, _: ""))


def words(label: str, width: int = 24) -> str:
    """A label as it is written, in lines of so many characters; a dollar starts no formula."""
    return "\n".join(textwrap.wrap(label, width)).replace("$", r"\$")


@contextmanager
def quiet() -> Iterator[None]:
    """Draw without warnings: of a glyph that the font has not, of axes that end near 1e308."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def content(figure: "Figure", form: str) -> bytes:
    """The figure as a file's content in one of the `FORMATS`."""
    out = io.BytesIO()
    _spell_out(figure)
    # An SVG holds rasterised parts inside it; a screen needs no more than this of them.
    dpi = 150 if form == "svg" else None
    figure.savefig(out, format=form, metadata=FORMATS[form], dpi=dpi)
    return compact(out.getvalue()) if form == "svg" else out.getvalue()


def _spell_out(figure: "Figure") -> None:
    """Let a text with dollars that is no formula stand as it is written."""
    from matplotlib.mathtext import MathTextParser
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        if isinstance(text, Text) and "$" in text.get_text():
            try:
                MathTextParser("path").parse(text.get_text())
            except ValueError:
                text.set_parse_math(False)


def close(figure: "Figure") -> None:
    """Free the figure's memory."""
    from matplotlib import pyplot as plt

    plt.close(figure)
