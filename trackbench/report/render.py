"""Everything that follows from a results folder: tables, figures, verdicts, pairs, the report."""

from collections.abc import Collection, Iterable, Iterator
from itertools import product
from pathlib import Path

from trackbench.atomic_files import (
    ensure_folder,
    remove,
    within,
    write_bytes,
    write_csv,
    write_text,
)
from trackbench.config.build import unknown
from trackbench.errors import Mark, Problem, UserError
from trackbench.report.figure_drawing import Draw, Files, draw_figure, drawing_pool
from trackbench.report.kinds import figure_folder
from trackbench.report.plotting import style
from trackbench.report.plotting.page_formats import SHEETS, Style, drawing_for
from trackbench.report.results import Results
from trackbench.report.table import Table
from trackbench.report.verdicts.files import write_comparison, write_paired
from trackbench.report.verdicts.numbers import Comparison, compare
from trackbench.results.folder_contents import FIGURE_FORMS, TABLE_FORMS


def render(
    results: Results, formats: Collection[str], processes: int = 1, fresh: bool = True
) -> tuple[dict[str, Table], Comparison]:
    """Write all of it, with so many processes; returns the tables by name and the verdicts.

    Unless ``fresh``, figures that were drawn before are taken as they were.
    """
    with drawing_pool(results, style.forms(formats), processes, fresh) as draw:
        tables = write_tables(results, tex="tex" in formats)
        write_paired(results)
        comparison = compare(results)
        write_comparison(results, comparison)
        write_figures(results, formats, draw=draw)
    return tables, comparison


def write_tables(results: Results, tex: bool = False) -> dict[str, Table]:
    """Write the tables as CSV, Markdown and, if wanted, LaTeX; return the tables by name."""
    for place, table in _table_files(results):
        group, _, name = place.rpartition("/")
        folder = ensure_folder(within(results.target, group))
        write_csv(folder / f"{name}.csv", table.csv_header, table.csv_rows())
        write_text(folder / f"{name}.md", table.markdown())
        if tex:
            write_text(folder / f"{name}.tex", table.texts().tex(name))
    for name in results.parts("tables").keys() - results.tables.keys():
        _remove(results.target, "tables", name, TABLE_FORMS)
    return results.tables


def _table_files(results: Results) -> Iterator[tuple[str, Table]]:
    """Yield tables by their paths in the folder, without the ending.

    A table with CPU times stands in ``run/tables/``, and without them in ``tables/``.
    """
    specs = results.parts("tables")
    for name, table in results.tables.items():
        reproducible = specs[name].without_cpu_times()
        if reproducible is not specs[name]:
            yield f"run/tables/{name}", table
            table = reproducible and results.with_units(reproducible.table(results))
        if table is not None:
            yield f"tables/{name}", table


def _remove(target: Path, group: str, name: str, forms: Iterable[str]) -> None:
    """Remove earlier files of a table or figure that cannot be made now."""
    for place, form in product((group, f"run/{group}"), forms):
        path = within(target, place) / f"{name}.{form}"
        if path.is_file():
            remove(path)


def write_figures(
    results: Results,
    formats: Iterable[str],
    only: Collection[str] = (),
    look: Style = "screen",
    draw: Draw | None = None,
) -> list[Path]:
    """Write ``figures/`` in each format; ``only`` picks figures by name or kind.

    They are drawn here, or by ``draw``. For a paper each is drawn as wide as a column, if its panels
    have room there, and as wide as a page.
    """
    figures, written = results.parts("figures"), []
    for name in only:
        known = [*figures, *{spec.kind for spec in figures.values()}]
        if name not in known:
            raise UserError(Problem(Mark(f"--only {name}"), "", unknown(name, known)))
    forms = style.forms(formats)
    wanted = [n for n, spec in figures.items() if not only or n in only or spec.kind in only]
    for name, page in product(wanted if forms else (), SHEETS[look]):
        contents: Files = []
        spec = figures[name]
        with results.without(f"figure {name}"), drawing_for(page):
            contents = draw(name, spec) if draw else draw_figure(spec, results, forms)
        for form, content in contents:
            folder = ensure_folder(within(results.folder, figure_folder(spec)))
            path = folder / f"{name}{page.ending}.{form}"
            write_bytes(path, content)
            written.append(path)
        if f"figure {name}" in results.unmade:
            _remove(results.folder, "figures", f"{name}{page.ending}", FIGURE_FORMS)
    return written
