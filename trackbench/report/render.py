"""Files that follow from a results folder: tables, figures, verdicts, pairs.

Figures are drawn in parallel processes, while their parent writes everything else.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Future
from contextlib import ExitStack, contextmanager, suppress
from itertools import product
from pathlib import Path
from typing import Any, TypeAlias, cast

from trackbench.atomic_files import ensure_folder, remove, write_bytes, write_text
from trackbench.config.key_mistakes import unknown
from trackbench.csv_writer import write_csv
from trackbench.errors import Mark, Problem, UserError
from trackbench.execution.process_pool import pool, result_of
from trackbench.progress_bar import progress_bar
from trackbench.registry import is_plugin
from trackbench.report.figure_cache import FigureCache, Files
from trackbench.report.findings.ranking_table import ranking_tables
from trackbench.report.findings.sentences import answer, headline
from trackbench.report.kinds import FigureKind, TableKind, figure_folder
from trackbench.report.output_errors import as_figure, as_table, catch_errors
from trackbench.report.plotting import style
from trackbench.report.plotting.page_formats import SHEETS, Style, drawing_for, is_crowded
from trackbench.report.table import Table, TextTable
from trackbench.report.tables_and_figures import NO_FILTER_RAN, Results
from trackbench.report.verdicts.published_numbers import Verdicts, compare
from trackbench.report.verdicts.verdict_files import write_comparison, write_paired
from trackbench.results.file_names import FIGURE_FORMS, TABLE_FORMS
from trackbench.results.links import within


def draw_figure(spec: FigureKind, results: Results, formats: Sequence[str]) -> Files:
    """Draw a figure; return its format and the content of its file, for each of the ``formats``.

    The list is empty if the figure needs tracks and every filter failed, and if its panels are crowded
    on the page that `drawing_for` has set. Raises OutputError if the drawing fails.
    """
    with catch_errors(spec):
        if spec.shown_runs and not results.shown:
            return []
        with style.rc_context():
            figure = as_figure(spec.with_best(results).draw(results))
            contents = []
            if not is_crowded(figure):
                # The SVG comes first, as in the results in git: after a PNG matplotlib simplifies other
                # lines.
                for form in sorted(formats, key=lambda form: form != "svg"):
                    contents.append((form, style.content(figure, form)))
        style.close(figure)
        return contents


Draw: TypeAlias = Callable[[str, FigureKind], Files]
"""Function that returns a figure's files, from its name and the figure."""


@contextmanager
def drawing_pool(
    results: Results, formats: Sequence[str], processes: int = 1, fresh: bool = True
) -> Iterator[Draw]:
    """Begin to draw an experiment's figures in other processes; yield a function that returns them.

    The function returns one figure's files, by its name and the figure. It draws in this process the
    figures of plugins, whose code no other process has loaded, and those of a process that was killed.
    ``formats`` are some of `style.FORMATS`. ``processes`` is the number of processes;
    1 draws all figures in this one. Unless ``fresh``, figures in the cache are not drawn again.
    """
    # Step 1: figures that are in the cache, and those that other processes draw.
    figures: Mapping[str, FigureKind] = {}
    if formats:
        figures = results.parts("figures")
    cacheable: dict[str, FigureKind] = {}
    for name, spec in figures.items():
        if not is_plugin(type(spec).__module__):
            cacheable[name] = spec
    figure_cache = None
    if cacheable and not fresh:
        figure_cache = FigureCache.from_results(results)
    cached: dict[str, Files] = {}
    if figure_cache is not None:
        for name, spec in cacheable.items():
            files = figure_cache.get(spec, formats)
            if files:
                cached[name] = files
    sent: dict[str, FigureKind] = {}
    if processes > 1:
        sent = {name: spec for name, spec in cacheable.items() if name not in cached}
    begun: dict[str, Future[Files]] = {}

    def get_files(name: str, spec: FigureKind) -> Files:
        """Return the files of a figure: cached, drawn by another process, or drawn here."""
        if name in cached:
            return cached[name]
        try:
            files = result_of(begun[name])
        except (KeyError, BrokenExecutor):  # no process draws it, or it was killed
            files = draw_figure(spec, results, formats)
        if figure_cache is not None and name in cacheable:
            figure_cache.put(spec, files)
        return files

    # Step 2: begin to draw.
    with ExitStack() as stack:
        if sent:
            drawers = stack.enter_context(
                pool(
                    min(processes, len(sent)),
                    _open_in_drawer,
                    results.folder,
                    results.run_facts,
                    style.changed_settings(),
                )
            )
            with suppress(BrokenExecutor):  # a drawer was killed as it began
                for name, spec in sent.items():
                    begun[name] = drawers.submit(_draw_opened, spec, formats)
        yield get_files


_opened: list[Results] = []
"""The results that a process draws figures of: one folder, once it is open."""


def _open_in_drawer(folder: Path, facts: dict[str, Any], settings: dict[str, Any]) -> None:
    """Open the results in a process that draws figures.

    ``facts`` is `Results.run_facts`, the content of a manifest that is not written yet. ``settings`` are
    those of matplotlib that the parent process has changed.
    """
    if settings:
        import matplotlib as mpl

        cast(dict[str, Any], mpl.rcParams).update(settings)
    _opened[:] = [Results(folder, facts)]


def _draw_opened(spec: FigureKind, formats: Sequence[str]) -> Files:
    return draw_figure(spec, _opened[0], formats)


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
    results : results folder
    formats : formats of the figures; ``tex`` is that of tables
    processes : number of processes that draw figures
    fresh : whether figures in the cache are drawn again
    progress : whether a bar counts the figures

    Returns
    -------
    Tables by name, and the verdicts.
    """
    # An output that fails is noted in the results, and the others are written.
    with drawing_pool(results, style.forms(formats), processes, fresh) as get_files:
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


def write_tables(results: Results, tex: bool = False) -> dict[str, Table]:
    """Write the tables as CSV, Markdown and, if ``tex``, LaTeX; return the tables by name."""
    specs = results.parts("tables")
    for name, spec in specs.items():
        tables_by_folder: dict[str, Table] = {}
        with results.continued_after_failure(f"table {name}", spec):
            tables_by_folder = dict(_tables_by_folder(results, name, spec))
        for folder_name, table in tables_by_folder.items():
            folder = ensure_folder(within(results.target, folder_name))
            write_csv(folder / f"{name}.csv", table.csv_header, table.csv_rows())
            write_text(folder / f"{name}.md", table.markdown())
            if tex:
                # LaTeX needs two labels: a table may be in both folders, with CPU times and without.
                label = f"{results.config['name']}-{name}"
                if folder_name.startswith("run/"):
                    label += "-times"
                write_text(folder / f"{name}.tex", table.texts().tex(label))
        if not tables_by_folder:
            _remove_earlier_files(results.target, "tables", name, TABLE_FORMS)
    return results.tables


def _tables_by_folder(results: Results, name: str, spec: TableKind) -> Iterator[tuple[str, Table]]:
    """Yield each folder that the table ``name`` is written to, with the table there; none if it failed.

    A table with CPU times is written to ``run/tables/``, and without these columns to ``tables/``.
    """
    table = results.tables.get(name)
    if table is None:
        return
    # The table itself if it has no CPU times, None if it has nothing else.
    reproducible = spec.without_cpu_times()
    if reproducible is not spec:
        yield "run/tables", table
        if reproducible is None:
            return
        # `as_table` validates the table; `spec` shows if an error in it is that of a plugin.
        table = results.with_units(as_table(reproducible.table(results), spec))
    yield "tables", table


def _remove_earlier_files(target: Path, group: str, name: str, forms: Iterable[str]) -> None:
    """Remove earlier files of a table or figure that cannot be made now.

    ``target`` is the results folder, ``group`` is "tables" or "figures", ``name`` is the name of the
    files without the ending, and ``forms`` are the endings. `within` rejects a folder that is a link,
    which may lead out of the results folder.
    """
    for folder_name, form in product((group, f"run/{group}"), forms):
        path = within(target, folder_name) / f"{name}.{form}"
        if path.is_file():
            remove(path)


def write_figures(
    results: Results,
    formats: Iterable[str],
    only: Collection[str] = (),
    look: Style = "screen",
    draw: Draw | None = None,
) -> list[Path]:
    """Write ``figures/`` in each format.

    For a paper each figure is drawn as wide as a column, if its panels have room there, and as wide as a
    page.

    Parameters
    ----------
    results : results folder
    formats : formats of the figures, such as svg and png
    only : names or kinds of the figures that are written; default: all
    look : "screen" or "paper", which the figures are drawn for
    draw : function that returns a figure's files; default: they are drawn here

    Returns
    -------
    Paths of the files.

    Raises
    ------
    UserError : a word of ``only`` is no figure's name or kind, or none of that figure's filters ran
    """
    figures = results.parts("figures")
    known = [*figures, *{spec.kind for spec in figures.values()}]
    for word in only:
        if word in results.idle_figures:
            raise UserError(Problem(Mark(f"--only {word}"), "", NO_FILTER_RAN))
        if word not in known:
            raise UserError(Problem(Mark(f"--only {word}"), "", unknown(word, known)))
    forms = style.forms(formats)
    wanted: list[str] = []
    if forms:
        for name, spec in figures.items():
            if not only or name in only or spec.kind in only:
                wanted.append(name)
    written = []
    # For a paper a figure is drawn for several page widths.
    for name, page in product(wanted, SHEETS[look]):
        spec = figures[name]
        output = f"figure {name}"
        files: Files = []
        with results.continued_after_failure(output), drawing_for(page):
            files = draw(name, spec) if draw else draw_figure(spec, results, forms)
        for form, content in files:
            folder = ensure_folder(within(results.folder, figure_folder(spec)))
            path = folder / f"{name}{page.ending}.{form}"
            write_bytes(path, content)
            written.append(path)
        if output in results.unmade:
            _remove_earlier_files(results.folder, "figures", f"{name}{page.ending}", FIGURE_FORMS)
    return written
