"""Experiments of a folder, opened with their verdicts; those without their runs are left out."""

from pathlib import Path
from typing import TypeAlias
from urllib.parse import quote

from trackbench.errors import Problem, UserError
from trackbench.report.folder_check import explain_content_errors, open_with_notes
from trackbench.report.overview.find_results_folders import find_results_folders
from trackbench.report.tables_and_figures import Results
from trackbench.report.verdicts.all_verdicts import Verdicts, compare

Overview: TypeAlias = list[tuple[Results, Verdicts]]
"""Experiments of a folder, each with its verdicts."""


def relative_link(path: Path) -> str:
    """Write a relative path as a link: a folder may be called ``javascript:x`` or ``a#b``."""
    name = path.as_posix()
    quoted = quote(name)
    if quoted == name:
        return name
    # With "./" a browser takes no part of the name as a protocol.
    return f"./{quoted}"


def open_experiments(folder: Path) -> tuple[Overview, int]:
    """Open the experiments of a folder with their verdicts.

    Return also how many are left out because their runs are missing. Raises UserError for any other
    mistake, and if no experiment is left.
    """
    opened: Overview = []
    problems: list[Problem | str] = []
    without_runs: list[Problem | str] = []
    for candidate in find_results_folders(folder):
        results = None
        try:
            with explain_content_errors(candidate):
                results = open_with_notes(candidate)
                opened.append((results, compare(results)))
        except UserError as error:
            if results and not results.has_runs:
                without_runs += error.problems
            else:
                problems += error.problems
    if problems or not opened:
        raise UserError(*problems, *without_runs)
    return opened, len(without_runs)
