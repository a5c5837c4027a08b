"""Page formats of figures: the report, or a column or page of a paper."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from trackbench.report.plotting.fonts import PAPER_TEXT, SCREEN_TEXT

if TYPE_CHECKING:
    from matplotlib.figure import Figure


Style: TypeAlias = Literal["screen", "paper"]
"""Purpose of figures: ``screen`` for the report, ``paper`` for LaTeX."""


@dataclass(frozen=True)
class Sheet:
    """Format of a page: inches, panels side by side, font size."""

    name: str
    """name of the format in file names; empty for the screen"""
    width_in: float
    """width of a figure, in inches"""
    across: int
    """largest number of panels beside each other"""
    heights: float
    """factor by which the heights of figures are multiplied"""
    titled: bool
    """whether figures show their titles; in a paper the caption does"""
    letters: tuple[tuple[str, Any], ...]
    """matplotlib's settings of text, by name"""
    has_raised_digits: bool = False
    """whether the font has all raised digits"""
    has_wider: bool = False
    """whether a wider format exists for figures that have no room here"""

    @property
    def ending(self) -> str:
        """Ending of the file names."""
        if not self.name:
            return ""
        return f"-{self.name}"


SCREEN = Sheet(
    name="",
    width_in=7.0,
    across=4,
    heights=1.0,
    titled=True,
    letters=SCREEN_TEXT,
    has_raised_digits=True,
)
COLUMN = Sheet(
    name="column",
    width_in=3.5,
    across=2,
    heights=0.75,
    titled=False,
    letters=PAPER_TEXT,
    has_wider=True,
)
PAGE = Sheet(
    name="page",
    width_in=7.2,
    across=4,
    heights=1.0,
    titled=False,
    letters=PAPER_TEXT,
)
SHEETS: dict[Style, tuple[Sheet, ...]] = {"screen": (SCREEN,), "paper": (COLUMN, PAGE)}
"""Formats in which each figure is written; a paper's figure may need the wider one."""

_SHEET: ContextVar[Sheet] = ContextVar("sheet", default=SCREEN)


def sheet() -> Sheet:
    """Return the current page format."""
    return _SHEET.get()


def is_crowded(figure: "Figure") -> bool:
    """Return whether the figure has too many panels side by side here, and a wider format exists.

    Parameters
    ----------
    figure
        figure with its axes

    Returns
    -------
    bool
        True if it has more columns of panels than the page format of `sheet` allows
    """
    column_counts = [0]
    for ax in figure.axes:
        spec = ax.get_subplotspec()
        if spec is not None:
            column_counts.append(spec.get_gridspec().ncols)
    return sheet().has_wider and max(column_counts) > sheet().across


@contextmanager
def drawing_for(page_format: Sheet) -> Iterator[None]:
    """Let `sheet` return this page format within the block, so that figures are drawn for it.

    Parameters
    ----------
    page_format
        format of the page: a screen, a page or a column of a paper
    """
    token = _SHEET.set(page_format)
    try:
        yield
    finally:
        _SHEET.reset(token)
