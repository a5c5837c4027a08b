"""suite.html: the scores of a suite on one page."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from trackbench.report.html.page_templates import write_page
from trackbench.report.html.svg import inline
from trackbench.report.markdown_table import TextTable
from trackbench.report.suite.figure_files import SuiteFigure
from trackbench.report.suite.scores import SuiteScores


def write_suite_page(
    path: Path,
    *,
    title: str,
    version: int,
    runs_and_seeds: str,
    groups: Sequence[SuiteScores],
    sentences: Sequence[str],
    tables: Sequence[TextTable],
    smoothers: Sequence[TextTable],
    figures: Sequence[SuiteFigure],
    left_out: Sequence[str],
) -> Path:
    """Write suite.html: sentences and tables first, then figures, smoothers, links to the problems.

    ``version`` is that of the suite, ``runs_and_seeds`` are words on its numbers of runs and seeds, and
    ``groups`` are its groups of problems with their scores.
    ``smoothers`` are the tables of smoothers. ``left_out`` are lines on what the suite could not run.
    """
    from markupsafe import Markup

    pictures: list[dict[str, Any]] = []
    for figure in figures:
        svg = Markup(inline(figure.svg, figure.name, figure.caption))
        pictures.append({"name": figure.name, "svg": svg, "heading": "", "caption": figure.caption})
    problems = {group.title: group.problems for group in groups if group.problems}
    return write_page(
        path,
        template="suite.html",
        live=False,  # without the script of interactive figures
        title=title,
        version=version,
        runs_and_seeds=runs_and_seeds,
        sentences=sentences,
        tables=tables,
        smoothers=smoothers,
        figures=pictures,
        problems=problems,
        left_out=left_out,
    )
