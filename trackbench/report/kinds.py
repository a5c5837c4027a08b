"""Base classes of tables and figures."""

from abc import abstractmethod
from dataclasses import dataclass, is_dataclass, replace
from typing import TYPE_CHECKING, Any

from trackbench.config.experiment import DrawnExhibit, Exhibit
from trackbench.evaluation.metric_expression import Measure
from trackbench.report.best_filters_in_figures import with_best_filters
from trackbench.report.table import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from trackbench.report.tables_and_figures import Results


@dataclass(frozen=True, kw_only=True)
class TableKind(Exhibit):
    """A table: a frozen dataclass of options, and the rows it makes of a results folder."""

    title: str = ""
    """caption"""

    @abstractmethod
    def table(self, results: "Results") -> Table:
        """Fill the table from a results folder.

        Any error that the method raises is reported as one line about this table. The other outputs are
        written.

        Parameters
        ----------
        results
            results folder. ``results.points()`` are the points of the grid, ``results.runs(point)`` the
            values (M,) of the runs at one of them, by filter and metric, and
            ``results.columns("per_step", point)`` the columns of that file

        Returns
        -------
        Table
            keys and cells of the rows, and notes below them
        """

    def without_cpu_times(self) -> "TableKind | None":
        """Return the table without columns that depend on CPU times; None if all columns do.

        A table with CPU times is written to ``run/tables/``, and without them to ``tables/``. A kind
        whose columns can be left out overrides this method, which leaves out none.

        Returns
        -------
        TableKind or None
            the table, or a copy with fewer columns; None if the table is written to ``run/tables/``
            alone
        """
        if shows_cpu_times(self):
            return None
        return self


@dataclass(frozen=True, kw_only=True)
class FigureKind(DrawnExhibit):
    """A figure: a frozen dataclass of options, and what it draws of a results folder."""

    title: str = ""
    """heading"""
    caption: str = ""
    """what to see in it, said below it in the report; default: what its numbers tell"""

    def default_caption(self, results: "Results") -> str:
        """Return a caption for the figure of these results; empty if the kind needs none.

        The report shows it below the figure, unless the config has a ``caption``.

        Parameters
        ----------
        results
            results folder, as in `TableKind.table`

        Returns
        -------
        str
            sentences that say what is drawn, each with a capital letter and a full stop
        """
        return ""

    def with_best(self, results: "Results") -> "FigureKind":
        """Return the figure, with the best filters added to its key ``filters`` if it compares several.

        They are the best filter of each scenario, or if none is best the one with the best number. A
        figure of one filter, or of all of them, is returned as it is.

        Parameters
        ----------
        results
            results folder, whose rankings name the best filters

        Returns
        -------
        FigureKind
            the figure itself, or a copy with more ``filters``
        """
        if self.filters is None or len(self.filters) < 2:
            return self
        changed: Any = {"filters": with_best_filters(results, self.filters)}
        return replace(self, **changed)

    @abstractmethod
    def draw(self, results: "Results") -> "Figure":
        """Draw the figure from a results folder.

        Any error that the method raises is reported as one line about this figure. The other outputs are
        written.

        Parameters
        ----------
        results
            results folder, as in `TableKind.table`. ``results.line_styles(labels)`` has color and dash
            of each filter that the figure draws

        Returns
        -------
        matplotlib.figure.Figure
            figure, such as of ``trackbench.report.plotting.style.subplots``
        """


def shows_cpu_times(exhibit: Exhibit) -> bool:
    """Test whether a table or figure names CPU times in a key or in its ``requires``."""
    return "cpu_s_per_run" in exhibit.requires or _has_cpu_time(exhibit)


def _has_cpu_time(value: Any) -> bool:
    """Test whether a value of a table's or figure's key is a CPU time, or contains one."""
    if isinstance(value, Measure):
        return value.is_cpu_time
    if isinstance(value, dict):
        return any(map(_has_cpu_time, value.values()))
    return is_dataclass(value) and _has_cpu_time(vars(value))
