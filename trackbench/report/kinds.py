"""Bases of tables and figures."""

from abc import abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING

from trackbench.config.experiment import DrawnExhibit, Exhibit
from trackbench.report.table import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from trackbench.report.results import Results


@dataclass(frozen=True, kw_only=True)
class TableKind(Exhibit):
    """A table: a frozen dataclass of options, and the rows it makes of a results folder."""

    title: str = ""
    """caption"""

    @abstractmethod
    def table(self, results: "Results") -> Table:
        """Return the table from a results folder."""


@dataclass(frozen=True, kw_only=True)
class FigureKind(DrawnExhibit):
    """A figure: a frozen dataclass of options, and what it draws of a results folder."""

    title: str = ""
    """heading"""
    caption: str = ""
    """what to see in it, said below it in the report; default: what its numbers tell"""

    def tell(self, results: "Results") -> str:
        """Return the figure's default caption; empty if its kind says enough."""
        return ""

    @abstractmethod
    def draw(self, results: "Results") -> "Figure":
        """Return the figure from a results folder."""
