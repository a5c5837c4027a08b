"""Files of tables and figures: written to their folders, and removed if they can no longer be made."""

from collections.abc import Collection, Iterable, Iterator
from itertools import product
from pathlib import Path

from trackbench.atomic_files import ensure_folder, remove, write_bytes, write_text
from trackbench.config.did_you_mean import unknown
from trackbench.csv_writer import write_csv
from trackbench.errors import Mark, Problem, UserError
from trackbench.report.drawing_pool import Draw
from trackbench.report.figure_cache import Files
from trackbench.report.figure_drawing import draw_figure
from trackbench.report.kinds import TableKind, shows_cpu_times
from trackbench.report.latex_table import table_label
from trackbench.report.plotting import file_formats
from trackbench.report.plotting.page_formats import SHEETS, Style, drawing_for
from trackbench.report.plugin_tables_and_figures import as_table
from trackbench.report.table import Table
from trackbench.report.tables_and_figures import NO_FILTER_RAN, Results
from trackbench.results.file_names import FIGURE_FORMS, TABLE_FORMS, output_folder
from trackbench.results.links import within


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
                has_cpu_times = folder_name.startswith("run/")
                label = table_label(results.config["name"], name, has_cpu_times)
                write_text(folder / f"{name}.tex", table.texts().tex(label))
        if not tables_by_folder:
            _remove_earlier_files(results.target, "tables", name, TABLE_FORMS)
    # Computed at the first use, above. Tables that failed are not among them.
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
        yield output_folder("tables", shows_cpu_times=True), table
        if reproducible is None:
            return
        # `as_table` validates the table; `spec` shows if an error in it is that of a plugin.
        table = results.with_units(as_table(reproducible.table(results), spec))
    yield output_folder("tables", shows_cpu_times=False), table


def _remove_earlier_files(target: Path, group: str, name: str, forms: Iterable[str]) -> None:
    """Remove earlier files of a table or figure that cannot be made now.

    ``target`` is the results folder, ``group`` is "tables" or "figures", ``name`` is the name of the
    files without the ending, and ``forms`` are the endings. Files that show CPU times are in
    ``run/tables`` or ``run/figures``. `within` rejects a folder that is a link, which may lead out of
    the results folder.
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

    For a paper each figure is drawn as wide as a column and as wide as a page. If its panels have no
    room in a column, there is no file of that width: `draw_figure` returns none.

    Parameters
    ----------
    results
        results folder
    formats
        formats of the figures, such as svg and png
    only
        names or kinds of the figures that are written; default: all
    look
        "screen" or "paper", which the figures are drawn for
    draw
        function that returns a figure's files for the current page width; default: `draw_figure`

    Returns
    -------
    list[Path]
        paths of the files.

    Raises
    ------
    UserError
        a word of ``only`` is no figure's name or kind, or none of that figure's filters ran
    """
    figures = results.parts("figures")
    known = [*figures, *{spec.kind for spec in figures.values()}]
    for word in only:
        if word in results.idle_figures:
            raise UserError(Problem(Mark(f"--only {word}"), "", NO_FILTER_RAN))
        if word not in known:
            raise UserError(Problem(Mark(f"--only {word}"), "", unknown(word, known)))
    forms = file_formats.forms(formats)
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
            folder = ensure_folder(
                within(results.folder, output_folder("figures", shows_cpu_times(spec)))
            )
            path = folder / f"{name}{page.ending}.{form}"
            write_bytes(path, content)
            written.append(path)
        if output in results.unmade:
            _remove_earlier_files(results.folder, "figures", f"{name}{page.ending}", FIGURE_FORMS)
    return written
