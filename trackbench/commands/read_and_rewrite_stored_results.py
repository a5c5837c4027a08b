"""Commands on a stored results folder: report, compare, plot.

They compute no run and import nothing that could.
"""

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from trackbench.atomic_files import record_writes
from trackbench.commands.notebook_report import Report
from trackbench.commands.run_options import check_formats, check_list
from trackbench.commands.unknown_keywords import with_known_keywords
from trackbench.errors import Mark, Problem, UserError
from trackbench.report.folder_check import (
    check_folder,
    explain_content_errors,
    open_results,
    open_with_notes,
)
from trackbench.report.output_errors import PartialReportError
from trackbench.report.plotting.page_formats import Style
from trackbench.report.table_and_figure_files import write_figures
from trackbench.report.tables_and_figures import Results
from trackbench.report.verdicts.all_verdicts import Verdicts
from trackbench.report.verdicts.all_verdicts import compare as compare_with_published
from trackbench.report.verdicts.verdict_files import write_comparison, write_paired
from trackbench.results.lock import locked
from trackbench.results.manifest import write_manifest


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
    folder
        path of the results folder

    Returns
    -------
    Verdicts
        verdicts on published numbers and claims

    Raises
    ------
    UserError
        the folder has no readable results
    """
    if _is_read_only(folder):
        with explain_content_errors(folder):
            return compare_with_published(open_with_notes(Path(folder)))
    with _opened_for_rewriting(folder) as (results, paths):
        comparison = compare_with_published(results)
        write_comparison(results, comparison)
        write_paired(results)
        # The published files may have been edited: the manifest gets their digests, too.
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
    folder
        path of the results folder
    formats
        file formats: png, svg, pdf
    only
        names or types of the figures to draw; default: all
    allow_plugins
        also draw the figures of plugins, which runs their code
    style
        screen, or paper: NAME-column and NAME-page in a journal's widths, without titles

    Returns
    -------
    list
        the files written

    Raises
    ------
    PartialReportError
        a figure failed; the others are written
    """
    check_list("formats", formats)
    check_list("only", only)
    # Lists: an iterator could be read only once.
    formats = tuple(formats)
    only = tuple(only)
    check_formats(formats)
    with _opened_for_rewriting(folder, allow_plugins) as (results, _):
        written = write_figures(results, formats, only, style)
    return _raise_if_partial(results, written)


@with_known_keywords()
def report(folder: Path | str, allow_plugins: bool = False) -> list[Path]:
    """Write report.html of a results folder, or index.html and README.md over a folder of several.

    For a read-only folder the report goes into the working directory, as NAME-report.html.

    Parameters
    ----------
    folder
        path of a results folder, or of a folder of several
    allow_plugins
        also draw the figures of plugins, which runs their code

    Returns
    -------
    list
        the files written

    Raises
    ------
    PartialReportError
        a figure or sentence failed; the rest of the report is written
    """
    from trackbench.report.html.report_page import path_beside_read_only, write_report
    from trackbench.report.overview.index_page import write_overview

    folder = Path(folder)
    if not os.path.isfile(folder / "config.yaml"):  # unlike Path.is_file, quiet about any name
        _check_writable(folder)
        return write_overview(folder)
    if _is_read_only(folder):
        path = path_beside_read_only(folder)
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

    Yield the results and the list of the rewritten files, once no other run writes into the folder. At
    the end the manifest gets new digests of the files in the list, to which the caller may add some.
    Other files that changed since the run are noted and stay in the manifest as they were.
    ``allow_plugins`` allows the code of the config's plugins to run.
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
