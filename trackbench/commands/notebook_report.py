"""Report: what Python functions return and a notebook displays: sentences, tables and the key figure."""

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from trackbench.core.arrays import Array
from trackbench.report.findings.ranking_of_settings import Best, best_points
from trackbench.report.markdown_table import TextTable
from trackbench.report.notebook_html import results_html
from trackbench.report.pairs_of_filters import Pair
from trackbench.report.render import conclusions, ranking
from trackbench.report.table import Table
from trackbench.report.tables_and_figures import Results
from trackbench.report.verdicts.all_verdicts import Verdicts
from trackbench.report.verdicts.all_verdicts import compare as compare_with_published
from trackbench.report.verdicts.cpu_time_verdicts import time_line
from trackbench.report.verdicts.inconclusive_reasons import reasons
from trackbench.report.verdicts.verdict_counts import summary_lines
from trackbench.results.points_json import GridPoint

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


@dataclass(repr=False)
class Report:
    """Results of a run or of a stored folder: sentences, tables, verdicts, data frames, figures.

    A notebook displays it. `dir` lists what is public; ``results`` is for the package's own modules.
    """

    results: Results
    failed_filters: list[str]
    """filters that failed, a line each"""
    run_notes: list[str] = field(default_factory=list)
    """notes on the runs, a line each, such as on lost runs"""
    _compared: Verdicts | None = None
    """verdicts, if they are computed already"""

    def __dir__(self) -> list[str]:
        return [name for name in dir(type(self)) if not name.startswith("_")]

    def __repr__(self) -> str:
        failed = f"; {len(self.failed)} failed" if self.failed else ""
        return f"{repr(self.results).replace('Results', 'Report', 1)[:-1]}{failed}>"

    def _repr_html_(self) -> str:
        """Return what a notebook displays: sentences, tables and the key figure, as HTML."""
        notes = [f"Note on the data: {note}" for note in self.results.data_notes]
        lines = [f"{self.folder}/", *self.failed, *notes, *self.answer]
        lines += summary_lines(self.comparison)
        tables = self.ranking()
        tables = tables + [table.texts() for table in self.tables.values()]
        return results_html(self.results.title, lines, tables, self._repr_png_())

    def _repr_png_(self) -> bytes | None:
        return self.results._repr_png_()

    @property
    def folder(self) -> Path:
        """Results folder."""
        return self.results.folder

    @property
    def config(self) -> dict[str, Any]:
        """Config of the run, defaults included."""
        return self.results.config

    @property
    def manifest(self) -> dict[str, Any]:
        """Versions, machine and digests of the run."""
        return self.results.manifest

    @property
    def failed(self) -> list[str]:
        """Filters, tables, figures and other outputs that failed, a line each."""
        return [*self.failed_filters, *self.results.unmade_lines]

    @cached_property
    def answer(self) -> list[str]:
        """Conclusions beside the ranking, a sentence each."""
        return conclusions(self.results)

    def ranking(self, numbers: bool = False) -> list[TextTable]:
        """Return the ranking as a table with a row for each filter, the best first.

        Parameters
        ----------
        numbers
            for a grid: True also returns tables of each scenario, or of each filter's settings

        Returns
        -------
        list
            the ranking, for a grid that over all scenarios, and the further tables; empty if no filter
            has a number to rank, or if the ranking could not be computed, which `failed` then says
        """
        return ranking(self.results, numbers)

    @property
    def tables(self) -> dict[str, Table]:
        """Tables of the config by name."""
        return self.results.tables

    @cached_property
    def comparison(self) -> Verdicts:
        """Verdicts on published numbers and claims."""
        return self._compared or compare_with_published(self.results)

    @cached_property
    def notes(self) -> list[str]:
        """Lost runs, counts of verdicts, and reasons of those that are inconclusive."""
        return self.results.attempt("notes", self._collect_notes, self.run_notes)

    def _collect_notes(self) -> list[str]:
        """Return notes on runs, verdicts, CPU times and inconclusive verdicts, a line each."""
        return [
            *self.run_notes,
            *summary_lines(self.comparison),
            *time_line(self.results),
            *reasons(self.comparison, self.config["runs"]),
        ]

    @cached_property
    def best(self) -> list[Best]:
        """Best values of each filter in a sweep; empty without a sweep, or if they fail."""
        if not (self.folder / "sweep.csv").is_file():
            return []
        return self.results.attempt("best values", lambda: list(best_points(self.results)), [])

    def figure(self, name: str = "") -> "Figure":
        """Return a figure of the config for matplotlib.

        Parameters
        ----------
        name
            name of the figure; default: the key figure

        Returns
        -------
        matplotlib.figure.Figure
            the figure
        """
        return self.results.figure(name)

    @property
    def per_run(self) -> "pd.DataFrame":
        """Data frame ``filter,run,metric,value``."""
        return self.results.per_run

    @property
    def per_step(self) -> "pd.DataFrame":
        """Data frame ``filter,step,time,metric,value,stderr,runs``."""
        return self.results.per_step

    @property
    def summary(self) -> "pd.DataFrame":
        """Data frame ``filter,metric,value,stderr,runs,lost``."""
        return self.results.summary

    @property
    def timing(self) -> "pd.DataFrame":
        """Data frame of CPU times."""
        return self.results.timing

    @property
    def pairs(self) -> list[tuple[GridPoint, list[Pair]]]:
        """Differences of every two filters, by point of the grid."""
        return self.results.pairs

    def tracks(self, point: GridPoint | None = None) -> "dict[str, Array]":
        """Return the stored tracks at a point of the grid.

        Parameters
        ----------
        point
            values of the grid's paths; default: the first point

        Returns
        -------
        dict
            ``truth`` (NaN without one) and ``mean/<filter>`` (n_x, T + 1, r), ``measurements``
            (n_z, T, r), ``cov/<filter>`` (n_x, n_x, T + 1, r), ``steps`` and ``times``; names in
            ``components`` (n_x,) and ``measured`` (n_z,). After ``save_tracks`` r is the number of
            runs. Otherwise there are only the arrays and the first runs that the figures draw. A mean
            of which figures draw nothing but lines is then rounded to the resolution of a page, and NaN
            in the components that they do not draw
        """
        if point is None:
            point = self.results.points()[0]
        facts = self.results.facts(point)
        # The tracks that `save_tracks` stored, else those of the figures.
        arrays = self.results.tracks(point, every_run=True)
        if not arrays:
            return arrays
        names = {"components": np.array(facts.components), "measured": np.array(facts.measured)}
        return arrays | names
