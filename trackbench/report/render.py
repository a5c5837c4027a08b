"""Everything that follows from a results folder: tables, figures, verdicts, pairs, conclusions."""

from collections.abc import Collection

from trackbench.progress_bar import progress_bar
from trackbench.report.drawing_pool import drawing_pool
from trackbench.report.figure_cache import Files
from trackbench.report.findings.best_filter_sentences import answer, headline
from trackbench.report.findings.ranking_table import ranking_tables
from trackbench.report.kinds import FigureKind
from trackbench.report.markdown_table import TextTable
from trackbench.report.plotting import file_formats
from trackbench.report.table import Table
from trackbench.report.table_and_figure_files import write_figures, write_tables
from trackbench.report.tables_and_figures import Results
from trackbench.report.verdicts.all_verdicts import Verdicts, compare
from trackbench.report.verdicts.verdict_files import write_comparison, write_paired


def render(
    results: Results,
    formats: Collection[str],
    processes: int = 1,
    fresh: bool = True,
    progress: bool = False,
) -> tuple[dict[str, Table], Verdicts]:
    """Write tables, figures, verdicts and pairs into the results folder.

    Parameters
    ----------
    results
        results folder
    formats
        formats of the figures; ``tex`` is that of tables
    processes
        number of processes that draw figures
    fresh
        whether figures in the cache are drawn again
    progress
        whether a bar counts the figures

    Returns
    -------
    tuple[dict[str, Table], Verdicts]
        tables by name, and the verdicts.
    """
    # An output that fails is noted in the results, and the others are written.
    with drawing_pool(results, file_formats.forms(formats), processes, fresh) as get_files:
        tables = write_tables(results, tex="tex" in formats)
        comparison = Verdicts(rows=[], claims=[], ranks=[])
        with results.continued_after_failure("pairs"):
            write_paired(results)
        with results.continued_after_failure("verdicts"):
            comparison = compare(results)
            write_comparison(results, comparison)
        number = 0
        if formats:
            number = len(results.parts("figures"))
        caption = f"{results.config['name']}: drawing"
        with progress_bar(number, "figure", progress and number > 0, desc=caption) as bar:

            def get_files_and_count(name: str, spec: FigureKind) -> Files:
                files = get_files(name, spec)
                bar.update(1)
                return files

            write_figures(results, formats, draw=get_files_and_count)
    return tables, comparison


def conclusions(results: Results) -> list[str]:
    """Return the sentences on the filters; empty if they cannot be computed."""
    return results.attempt("conclusions", lambda: answer(results), [])


def best_filter(results: Results) -> str:
    """Return the sentence on the best filter; empty if it fails, or no filter is best."""
    return results.attempt("headline", lambda: headline(results), "")


def ranking(results: Results, numbers: bool = False) -> list[TextTable]:
    """Return the tables of the ranking; none if they fail.

    With ``numbers`` there are further tables: the numbers of each scenario of the grid, or the ranking
    of each filter's settings.
    """
    return results.attempt("ranking", lambda: ranking_tables(results, numbers), [])
