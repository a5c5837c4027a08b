"""What tables and figures are."""

from abc import abstractmethod
from typing import TYPE_CHECKING

from trackbench.experiment.reading.definition import DrawnExhibit, Exhibit
from trackbench.report.table import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from trackbench.report.results import Results


class TableKind(Exhibit):
    """A table: a frozen dataclass of options, and the rows it makes of a results folder."""

    @abstractmethod
    def table(self, results: "Results") -> Table:
        """The table from a results folder."""


class FigureKind(DrawnExhibit):
    """A figure: a frozen dataclass of options, and what it draws of a results folder."""

    @abstractmethod
    def draw(self, results: "Results") -> "Figure":
        """The figure from a results folder."""
