"""Commands on a stored results folder; they compute no run and import nothing that could."""

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from trackbench.atomic_files import record_writes
from trackbench.errors import Mark, Problem, UserError
from trackbench.report.open import (
    check_folder,
    explain_content_errors,
    open_results,
    open_with_notes,
)
from trackbench.report.plotting.page_formats import Style
from trackbench.report.plugin_exhibits import PartialReportError
from trackbench.report.render import write_figures
from trackbench.report.results import Results
from trackbench.report.verdicts.files import write_comparison, write_paired
from trackbench.report.verdicts.numbers import Comparison
from trackbench.report.verdicts.numbers import compare as hold_against_published
from trackbench.results.folder_contents import locked, write_manifest


def load(folder: Path | str) -> Results:
    """Return the results of an earlier run, as data frames."""
    return open_results(Path(folder))


def compare(folder: Path | str) -> Comparison:
    """Compare a results folder with the published numbers; writes comparison.csv and paired.csv.

    The current published files are used and recorded in the manifest. A read-only folder stays
    unchanged.
    """
    if _is_read_only(folder):
        with explain_content_errors(folder):
            return hold_against_published(open_with_notes(Path(folder)))
    with _written_again(folder) as (results, paths):
        comparison = hold_against_published(results)
        write_comparison(results, comparison)
        write_paired(results)
        paths += [results.folder / name for name in results.config["published"]]
    return comparison


def plot(
    folder: Path | str,
    formats: Sequence[str] = ("png", "svg"),
    only: Sequence[str] = (),
    allow_plugins: bool = False,
    style: Style = "screen",
) -> list[Path]:
    """Draw the figures of a results folder again; return the files written.

    ``style="paper"`` writes NAME-column and NAME-page in a journal's widths, without titles. Figures of
    plugins are drawn only if plugins are allowed. If one of them fails, the others are written first and
    then PartialReportError is raised.
    """
    with _written_again(folder, allow_plugins) as (results, _):
        written = write_figures(results, formats, only, style)
    return _whole(results, written)


def report(folder: Path | str, allow_plugins: bool = False) -> list[Path]:
    """Write report.html of a results folder, or index.html and README.md over a folder of several.

    For a read-only folder the report goes into the working directory, as NAME-report.html.
    """
    from trackbench.report.html.index_page import write_overview
    from trackbench.report.html.report_page import write_report

    folder = Path(folder)
    if not os.path.isfile(folder / "config.yaml"):  # unlike Path.is_file, quiet about any name
        _check_writable(folder)
        return write_overview(folder)
    if _is_read_only(folder):
        here = Path(f"{folder.resolve().name}-report.html")
        with explain_content_errors(folder):
            results = open_with_notes(folder, allow_plugins)
            return _whole(results, [write_report(results, path=here)])
    with _written_again(folder, allow_plugins) as (results, _):
        written = [write_report(results)]
    return _whole(results, written)


def _whole(results: Results, written: list[Path]) -> list[Path]:
    """Return the written files; raises PartialReportError if a plugin's are missing."""
    if results.unmade:
        raise PartialReportError(results.unmade_lines, written)
    return written


def _check_writable(folder: Path | str) -> None:
    if _is_read_only(folder):
        raise UserError(Problem(Mark(f"{folder}/"), "", "may not be written in"))


def _is_read_only(folder: Path | str) -> bool:
    return os.path.isdir(folder) and not os.access(folder, os.W_OK)


@contextmanager
def _written_again(
    folder: Path | str, allow_plugins: bool = False
) -> Iterator[tuple[Results, list[Path]]]:
    """Open results for rewriting some of their files; update the manifest afterwards.

    Waits for a run that writes into the folder. Other files that changed since the run are noted and
    stay in the manifest as they were.
    """
    folder = Path(folder)
    check_folder(folder)
    _check_writable(folder)
    with locked(folder, lambda line: print(line, file=sys.stderr)), explain_content_errors(folder):
        results = open_with_notes(folder, allow_plugins)
        with record_writes() as paths:
            try:
                yield results, paths
            finally:
                write_manifest(results.folder, results.manifest, paths)
