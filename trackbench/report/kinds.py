"""Base classes of tables and figures."""

from abc import abstractmethod
from dataclasses import dataclass, is_dataclass, replace
from typing import TYPE_CHECKING, Any

from trackbench.config.experiment import DrawnExhibit, Exhibit
from trackbench.evaluation.metric_expression import Measure
from trackbench.report.findings.ranking import rankings
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
        """Fill the table from a results folder."""

    def without_cpu_times(self) -> "TableKind | None":
        """Return the table without columns that depend on CPU times; None if all columns do."""
        return None if shows_cpu_times(self) else self


@dataclass(frozen=True, kw_only=True)
class FigureKind(DrawnExhibit):
    """A figure: a frozen dataclass of options, and what it draws of a results folder."""

    title: str = ""
    """heading"""
    caption: str = ""
    """what to see in it, said below it in the report; default: what its numbers tell"""

    def default_caption(self, results: "Results") -> str:
        """Return a caption for the figure of these results; empty if the kind needs none."""
        return ""

    def with_best(self, results: "Results") -> "FigureKind":
        """Return the figure; if it compares some of the filters, the best ones are among them."""
        if self.filters is None or len(self.filters) < 2:
            return self
        leaders = [s.best or next(iter(s.order), None) for s in rankings(results)]
        best = [c.label for c in leaders if c is not None]
        more: Any = {"filters": tuple(dict.fromkeys([*self.filters, *best]))}
        return replace(self, **more)

    @abstractmethod
    def draw(self, results: "Results") -> "Figure":
        """Draw the figure from a results folder."""


def shows_cpu_times(exhibit: Exhibit) -> bool:
    """Return whether a table or figure names CPU times in a key or in its ``requires``."""
    return "cpu_s_per_run" in exhibit.requires or _has_cpu_time(exhibit)


def figure_folder(figure: Exhibit) -> str:
    """Return the folder of a figure within a results folder."""
    return "run/figures" if shows_cpu_times(figure) else "figures"


def _has_cpu_time(value: Any) -> bool:
    if isinstance(value, Measure):
        return value.is_cpu_time
    if isinstance(value, dict):
        return any(map(_has_cpu_time, value.values()))
    return is_dataclass(value) and _has_cpu_time(vars(value))
