"""Commands on a stored results folder: report, compare, plot.

They compute no run and import nothing that could.
"""

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from trackbench.atomic_files import record_writes
from trackbench.commands.keyword_arguments import with_known_keywords
from trackbench.core.arrays import Array
from trackbench.errors import Mark, Problem, UserError
from trackbench.report.folder_check import (
    check_folder,
    explain_content_errors,
    open_results,
    open_with_notes,
)
from trackbench.report.notebook_tables import results_html
from trackbench.report.output_errors import PartialReportError
from trackbench.report.pairs_of_filters import Pair
from trackbench.report.plotting.page_formats import Style
from trackbench.report.render import conclusions, ranking
from trackbench.report.sweep_files import Best, best_points
from trackbench.report.table import Table
from trackbench.report.table_and_figure_files import write_figures
from trackbench.report.tables_and_figures import Results
from trackbench.report.text_table import TextTable
from trackbench.report.verdicts.cpu_time_verdicts import time_line
from trackbench.report.verdicts.inconclusive_reasons import reasons
from trackbench.report.verdicts.published_numbers import Verdicts
from trackbench.report.verdicts.published_numbers import compare as compare_with_published
from trackbench.report.verdicts.verdict_counts import summary_lines
from trackbench.report.verdicts.verdict_files import write_comparison, write_paired
from trackbench.results.lock import locked
from trackbench.results.manifest import write_manifest
from trackbench.results.point_facts import GridPoint

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
        lines = [f"{self.folder}/", *self.failed, *self.answer, *summary_lines(self.comparison)]
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
            the ranking, for a grid that over all scenarios, and the further tables; empty if they fail
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
            runs. Otherwise figures decide on the arrays and runs; lines are rounded.
        """
        if point is None:
            point = self.results.points()[0]
        facts = self.results.facts(point)
        arrays = self.results.tracks(point, every_run=True)
        if not arrays:
            return arrays
        names = {"components": np.array(facts.components), "measured": np.array(facts.measured)}
        return arrays | names


@with_known_keywords()
def load(folder: Path | str) -> Report:
    """Read the results of an earlier run."""
    results = open_results(Path(folder))
    failed = [f"{row['filter']} failed: {row['reason']}" for row in results.failed]
    return Report(results=results, failed_filters=failed)


@with_known_keywords()
def compare(folder: Path | str) -> Verdicts:
    """Compare a results folder with the published numbers; writes comparison.csv and paired.csv.

    The current published files are used and recorded in the manifest. A read-only folder stays
    unchanged.

    Parameters
    ----------
    folder : path of the results folder

    Returns
    -------
    Verdicts : verdicts on published numbers and claims

    Raises
    ------
    UserError : the folder has no readable results
    """
    if _is_read_only(folder):
        with explain_content_errors(folder):
            return compare_with_published(open_with_notes(Path(folder)))
    with _opened_for_rewriting(folder) as (results, paths):
        comparison = compare_with_published(results)
        write_comparison(results, comparison)
        write_paired(results)
        paths += [results.folder / name for name in results.config["published"]]
    return comparison


@with_known_keywords()
def plot(
    folder: Path | str,
    formats: Sequence[str] = ("png", "svg"),
    only: Sequence[str] = (),
    allow_plugins: bool = False,
    style: Style = "screen",
) -> list[Path]:
    """Draw the figures of a results folder again.

    Parameters
    ----------
    folder : path of the results folder
    formats : file formats: png, svg, pdf
    only : names or types of the figures to draw; default: all
    allow_plugins : also draw the figures of plugins, which runs their code
    style : screen, or paper: NAME-column and NAME-page in a journal's widths, without titles

    Returns
    -------
    list : the files written

    Raises
    ------
    PartialReportError : a figure failed; the others are written
    """
    with _opened_for_rewriting(folder, allow_plugins) as (results, _):
        written = write_figures(results, formats, only, style)
    return _raise_if_partial(results, written)


@with_known_keywords()
def report(folder: Path | str, allow_plugins: bool = False) -> list[Path]:
    """Write report.html of a results folder, or index.html and README.md over a folder of several.

    For a read-only folder the report goes into the working directory, as NAME-report.html.

    Parameters
    ----------
    folder : path of a results folder, or of a folder of several
    allow_plugins : also draw the figures of plugins, which runs their code

    Returns
    -------
    list : the files written

    Raises
    ------
    PartialReportError : a figure or sentence failed; the rest of the report is written
    """
    from trackbench.report.html.report_page import write_report
    from trackbench.report.overview.index_page import write_overview

    folder = Path(folder)
    if not os.path.isfile(folder / "config.yaml"):  # unlike Path.is_file, quiet about any name
        _check_writable(folder)
        return write_overview(folder)
    if _is_read_only(folder):
        path = Path(f"{folder.resolve().name}-report.html")
        with explain_content_errors(folder):
            results = open_with_notes(folder, allow_plugins)
            return _raise_if_partial(results, [write_report(results, path=path)])
    with _opened_for_rewriting(folder, allow_plugins) as (results, _):
        written = [write_report(results)]
    return _raise_if_partial(results, written)


def _raise_if_partial(results: Results, written: list[Path]) -> list[Path]:
    """Return the ``written`` files; raise PartialReportError if any other output failed.

    ``results`` record the outputs that failed, with their reasons. The error has the written files, too.
    """
    if results.unmade:
        raise PartialReportError(results.unmade_lines, written)
    return written


def _check_writable(folder: Path | str) -> None:
    if _is_read_only(folder):
        raise UserError(Problem(Mark(f"{folder}/"), "", "may not be written in"))


def _is_read_only(folder: Path | str) -> bool:
    return os.path.isdir(folder) and not os.access(folder, os.W_OK)


@contextmanager
def _opened_for_rewriting(
    folder: Path | str, allow_plugins: bool = False
) -> Iterator[tuple[Results, list[Path]]]:
    """Open results for rewriting some of their files; update the manifest afterwards.

    Yield the results and the list of the rewritten files, once no other run writes into the folder.
    Other files that changed since the run are noted and stay in the manifest as they were.
    """
    folder = Path(folder)
    check_folder(folder)
    _check_writable(folder)
    with locked(folder, lambda line: print(line, file=sys.stderr)), explain_content_errors(folder):
        results = open_with_notes(folder, allow_plugins)
        with record_writes() as paths:
            try:
                yield results, paths
            finally:  # files may have been written before an error
                write_manifest(results.folder, results.manifest, paths)
