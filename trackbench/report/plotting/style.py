"""Style of all figures: grid, spines, widths of lines, looks of truth and bands, lines of long texts."""

import sys
import textwrap
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypeAlias, cast

from trackbench.report.plotting.page_formats import sheet

# Types for signatures: matplotlib takes long to import, and only what draws has to.
if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes
    from matplotlib.axis import Axis as Axis
    from matplotlib.figure import Figure as Figure
else:
    Axes = Axis = Figure = Any


LineStyle: TypeAlias = dict[str, Any]
"""Keyword arguments with which matplotlib draws a line or a marker."""
ANY = "#555555"
"""Color in a legend that stands for every filter."""
MANEUVER = "#dde5b6"
"""Color of the time of a maneuver, far from the color of every filter."""
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
        number of axes below and beside each other
    height_in
        height of the figure in inches. A page format may scale it
    width_in
        width of the figure in inches; None means the width of the page
    **kwargs
        further arguments of matplotlib's ``Figure.subplots``, such as ``sharex``

    Returns
    -------
    figure : matplotlib.figure.Figure
        figure with a constrained layout
    axes : matplotlib.axes.Axes, or array of them
        axes as ``Figure.subplots`` returns them: one alone, (n,) in one row or column, else (rows,
        columns)
    """
    from trackbench.report.plotting.notebook_figure import Canvas

    figure = Canvas(width_in or sheet().width_in, height_in * sheet().heights)
    axes = figure.subplots(rows, columns, **kwargs)
    return figure, axes


_LETTERS_PER_IN = 11.5
"""Letters of a title that have room in an inch."""


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
"""Settings of matplotlib that concern the screen alone, and change no file."""


def changed_settings() -> dict[str, Any]:
    """Return matplotlib's settings in this process that differ from its own defaults.

    Code of a plugin or a notebook has changed them, or a settings file of the user, ``matplotlibrc``.
    """
    if "matplotlib" not in sys.modules:
        return {}
    import matplotlib as mpl

    # The methods of `dict` print no warning for an old name.
    defaults = dict(dict.items(cast(dict[str, Any], mpl.rcParamsDefault)))
    settings = dict(dict.items(cast(dict[str, Any], mpl.rcParams)))
    changed: dict[str, Any] = {}
    for name, value in settings.items():
        default = defaults.get(name)
        # Values of any type, such as lists and cycles of colors, are compared by their texts.
        if name not in _SCREEN_SETTINGS and repr(value) != repr(default):
            changed[name] = value
    return changed
