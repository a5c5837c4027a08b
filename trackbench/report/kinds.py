"""What tables and figures are: frozen dataclasses of options that make something of a results folder."""

from abc import abstractmethod
from typing import TYPE_CHECKING

from trackbench.experiment.reading.definition import DrawnExhibit, Exhibit
from trackbench.report.table import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from trackbench.report.results import Results


class TableKind(Exhibit):
    """Base of the tables."""

    @abstractmethod
    def table(self, results: "Results") -> Table:
        """The table from a results folder."""


class FigureKind(DrawnExhibit):
    """Base of the figures."""

    @abstractmethod
    def draw(self, results: "Results") -> "Figure":
        """The figure from a results folder."""
