"""Page formats of figures: the report, or a column or page of a paper."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

if TYPE_CHECKING:
    from matplotlib.figure import Figure


Style: TypeAlias = Literal["screen", "paper"]
"""For the report, or for LaTeX."""


@dataclass(frozen=True)
class Sheet:
    """Format of a page: inches, panels side by side, font size."""

    name: str
    """what it is; nothing of a screen"""
    width_in: float
    across: int
    """panels beside each other at most"""
    heights: float
    """what the heights of figures are multiplied by"""
    titled: bool
    """whether figures say their titles; in a paper the caption does"""
    letters: tuple[tuple[str, Any], ...]
    """matplotlib's settings of text"""
    has_raised_digits: bool = False
    """whether the letters have them all"""
    has_wider: bool = False
    """whether there is another for what has no room here"""

    @property
    def ending(self) -> str:
        """Ending of the file names."""
        return f"-{self.name}" if self.name else ""


def _letters(points: float, smaller: float, **more: Any) -> tuple[tuple[str, Any], ...]:
    large = ("axes.titlesize", "axes.labelsize", "figure.titlesize", "figure.labelsize")
    sizes = dict.fromkeys(("font.size", *large), points)
    return tuple((sizes | {"legend.fontsize": smaller} | more).items())


_TIMES = {"font.family": "STIXGeneral", "mathtext.fontset": "stix"}
_IN_PAPER = _letters(8, 8, **_TIMES)

SCREEN = Sheet(
    name="",
    width_in=7.0,
    across=4,
    heights=1.0,
    titled=True,
    letters=_letters(9, 8, **{"font.family": "DejaVu Sans", "mathtext.fontset": "dejavusans"}),
    has_raised_digits=True,
)
COLUMN = Sheet("column", 3.5, 2, 0.75, False, _IN_PAPER, has_wider=True)
PAGE = Sheet("page", 7.2, 4, 1.0, False, _IN_PAPER)
SHEETS: dict[Style, tuple[Sheet, ...]] = {"screen": (SCREEN,), "paper": (COLUMN, PAGE)}

_SHEET: ContextVar[Sheet] = ContextVar("sheet", default=SCREEN)


def sheet() -> Sheet:
    """Return the current page format."""
    return _SHEET.get()


def is_crowded(figure: "Figure") -> bool:
    """Return whether so many panels stand beside each other that the figure is left to a wider sheet."""
    specs = [ax.get_subplotspec() for ax in figure.axes]
    most = max((s.get_gridspec().ncols for s in specs if s is not None), default=0)
    return sheet().has_wider and most > sheet().across


@contextmanager
def drawing_for(chosen: Sheet) -> Iterator[None]:
    """Draw for this sheet."""
    token = _SHEET.set(chosen)
    try:
        yield
    finally:
        _SHEET.reset(token)
