"""Files that follow from a results folder: tables, figures, verdicts, pairs.

Figures are drawn in parallel processes, while their parent writes everything else. The cache of drawn
figures is keyed by results, options of the figure, source code, plugins that have run, and settings of
matplotlib.
"""

import hashlib
import json
import os
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Future
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from itertools import product
from pathlib import Path
from typing import Any, TypeAlias, cast

import trackbench
from trackbench.atomic_files import (
    ensure_folder,
    record_writes,
    remove,
    within,
    write_bytes,
    write_csv,
    write_text,
)
from trackbench.config.mistakes import unknown
from trackbench.errors import Mark, Problem, UserError, WriteError
from trackbench.execution.cache import figure_cache_folder
from trackbench.execution.engines import pool, result_of
from trackbench.execution.queue import progress_bar
from trackbench.field_types import require_regular_file
from trackbench.plugins.load import loaded_identities
from trackbench.registry import is_plugin
from trackbench.report.findings.ranking_table import ranking_tables
from trackbench.report.findings.sentences import answer
from trackbench.report.kinds import FigureKind, TableKind, figure_folder
from trackbench.report.paired import compared_statistics
from trackbench.report.plotting import style
from trackbench.report.plotting.page_formats import SHEETS, Style, drawing_for, is_crowded
from trackbench.report.results import Results, as_figure, as_table, catch_errors
from trackbench.report.table import Table, TextTable
from trackbench.report.verdicts.files import write_comparison, write_paired
from trackbench.report.verdicts.numbers import Verdicts, compare
from trackbench.results.folder_contents import FIGURE_FORMS, RUN_FILES, TABLE_FORMS

Files: TypeAlias = list[tuple[str, bytes]]
"""Format and content."""
_PARTS = ("tables", "figures")
"""Each is made by its own keys alone, and a figure by looks of lines and statistics of columns, too."""
_FACTS = ("steps", "loops_over_runs", "deterministic", "failed")
"""What figures take from the manifest."""


@dataclass(frozen=True)
class KeptFigures:
    """The figures of one state of a results folder, each under the digest of all it could show."""

    made_of: str
    """digest of what any figure may be made of beside its own keys"""

    @classmethod
    def of(cls, results: Results) -> "KeptFigures | None":
        """Return the cache of these results; None if a settings file sets up matplotlib."""
        if any(path.is_file() for path in _set_ups()):
            return None
        libraries = [version(name) for name in ("matplotlib", "numpy", "scipy")]
        words = {key: value for key, value in results.config.items() if key not in _PARTS}
        facts = [results.manifest.get(name) for name in _FACTS]
        looks = {label: results.line_style(label) for label in results.labels}
        # Code of a plugin, or of a notebook, may change how matplotlib draws any figure.
        settings = {name: repr(value) for name, value in style.changed_settings().items()}
        made_by = [libraries, words, facts, looks, compared_statistics(results.config), _sources()]
        made_by += [settings, loaded_identities()]
        digest = hashlib.sha256(json.dumps(made_by, default=str).encode())
        names = (*RUN_FILES, "tuning.csv", *results.config.get("published", ()))
        _add(digest, (results.folder / name for name in names))
        return cls(digest.hexdigest())

    def get(self, spec: FigureKind, formats: Sequence[str]) -> Files | None:
        """Return a figure's files; None if not all of them are there."""
        try:
            paths = [(form, require_regular_file(self._path(spec, form))) for form in formats]
            return [(form, path.read_bytes()) for form, path in paths]
        except OSError:
            return None

    def put(self, spec: FigureKind, files: Files) -> None:
        """Keep a figure's files; what cannot be kept will be drawn again."""
        # They are none of the results folder's files.
        with record_writes(), suppress(OSError, WriteError):
            for form, content in files:
                path = self._path(spec, form)
                path.parent.mkdir(parents=True, exist_ok=True)
                write_bytes(path, content)

    def _path(self, spec: FigureKind, form: str) -> Path:
        key = hashlib.sha256(f"{self.made_of} {spec!r}".encode()).hexdigest()
        return figure_cache_folder() / key[:2] / f"{key}.{form}"


@cache
def _sources() -> str:
    """Digest of the package's own source."""
    digest = hashlib.sha256()
    _add(digest, sorted(Path(trackbench.__file__).parent.rglob("*.py")))
    return digest.hexdigest()


def _add(digest: "hashlib._Hash", paths: Iterable[Path]) -> None:
    for path in paths:
        digest.update(f"\n{path.name}\n".encode())
        digest.update(path.read_bytes() if path.is_file() else b"")


def _set_ups() -> Iterator[Path]:
    """Yield where matplotlib looks for a settings file."""
    yield Path("matplotlibrc")
    if "MATPLOTLIBRC" in os.environ:
        named = Path(os.environ["MATPLOTLIBRC"])
        yield from (named, named / "matplotlibrc")
    home = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    own = os.environ.get("MPLCONFIGDIR")
    folders = (own, Path(home) / "matplotlib", Path.home() / ".matplotlib")
    yield from (Path(folder) / "matplotlibrc" for folder in folders if folder)


def draw_figure(spec: FigureKind, results: Results, formats: Sequence[str]) -> Files:
    """Draw a figure as the content of a file, for each format; none of tracks if every filter failed.

    Raises OutputError if the drawing fails.
    """
    with catch_errors(spec):
        if spec.shown_runs and not results.shown:
            return []
        with style.rc_context():
            figure = as_figure(spec.with_best(results).draw(results))
            # The SVG first, as git has it: after a PNG matplotlib simplifies other lines.
            forms = () if is_crowded(figure) else sorted(formats, key=lambda form: form != "svg")
            contents = [(form, style.content(figure, form)) for form in forms]
        style.close(figure)
        return contents


Draw: TypeAlias = Callable[[str, FigureKind], Files]
"""A figure's files, by its name and what it is."""


@contextmanager
def drawing_pool(
    results: Results, formats: Sequence[str], processes: int = 1, fresh: bool = True
) -> Iterator[Draw]:
    """Let so many processes begin with an experiment's figures; what they cannot draw is drawn here.

    Unless ``fresh``, those that were drawn before are not drawn again.
    """
    figures = results.parts("figures") if formats else {}
    cacheable = {
        name: spec for name, spec in figures.items() if not is_plugin(type(spec).__module__)
    }
    store = KeptFigures.of(results) if cacheable and not fresh else None
    cached = {
        name: files
        for name, spec in cacheable.items()
        if store and (files := store.get(spec, formats))
    }
    sent = {n: s for n, s in cacheable.items() if n not in cached} if processes > 1 else {}
    begun: dict[str, Future[Files]] = {}

    def draw(name: str, spec: FigureKind) -> Files:
        if name in cached:
            return cached[name]
        try:
            files = result_of(begun[name])
        except (KeyError, BrokenExecutor):  # none that draws it, or it was killed
            files = draw_figure(spec, results, formats)
        if store and name in cacheable:
            store.put(spec, files)
        return files

    with ExitStack() as stack:
        if sent:
            begin = (_init_worker, results.folder, results.run_facts, style.changed_settings())
            drawers = stack.enter_context(pool(min(processes, len(sent)), *begin))
            with suppress(BrokenExecutor):  # a drawer was killed as it began
                for name, spec in sent.items():
                    begun[name] = drawers.submit(_draw, spec, formats)
        yield draw


_opened: list[Results] = []


def _init_worker(folder: Path, facts: dict[str, Any], settings: dict[str, Any]) -> None:
    """Open the results in a process that draws, under matplotlib's settings of its parent."""
    if settings:
        import matplotlib as mpl

        cast(dict[str, Any], mpl.rcParams).update(settings)
    _opened[:] = [Results(folder, facts)]


def _draw(spec: FigureKind, formats: Sequence[str]) -> Files:
    return draw_figure(spec, _opened[0], formats)


def render(
    results: Results,
    formats: Collection[str],
    processes: int = 1,
    fresh: bool = True,
    progress: bool = False,
) -> tuple[dict[str, Table], Verdicts]:
    """Write all of it, with so many processes; returns the tables by name and the verdicts.

    Unless ``fresh``, figures that were drawn before are taken as they were. ``progress``: with a bar.
    """
    with drawing_pool(results, style.forms(formats), processes, fresh) as draw:
        tables = write_tables(results, tex="tex" in formats)
        comparison = Verdicts([], [], [])
        with results.without("pairs"):
            write_paired(results)
        with results.without("verdicts"):
            comparison = compare(results)
            write_comparison(results, comparison)
        figures = len(results.parts("figures")) if formats else 0
        what = f"{results.config['name']}: drawing"
        with progress_bar(figures, "figure", progress and figures > 0, desc=what) as bar:

            def drawn(name: str, spec: FigureKind) -> Files:
                files = draw(name, spec)
                bar.update(1)
                return files

            write_figures(results, formats, draw=drawn)
    return tables, comparison


def conclusions(results: Results) -> list[str]:
    """Return the sentences on the filters; none if they fail."""
    return results.attempt("conclusions", lambda: answer(results), [])


def ranking(results: Results, numbers: bool = False) -> list[TextTable]:
    """Return the tables of the ranking; none if they fail."""
    return results.attempt("ranking", lambda: ranking_tables(results, numbers), [])


def write_tables(results: Results, tex: bool = False) -> dict[str, Table]:
    """Write the tables as CSV, Markdown and, if wanted, LaTeX; return the tables by name."""
    specs = results.parts("tables")
    for name, spec in specs.items():
        files: list[tuple[str, Table]] = []
        with results.without(f"table {name}", spec):
            files = [*_table_files(results, name, spec)]
        for group, table in files:
            folder = ensure_folder(within(results.target, group))
            write_csv(folder / f"{name}.csv", table.csv_header, table.csv_rows())
            write_text(folder / f"{name}.md", table.markdown())
            if tex:
                write_text(folder / f"{name}.tex", table.texts().tex(name))
        if not files:
            _remove(results.target, "tables", name, TABLE_FORMS)
    return results.tables


def _table_files(results: Results, name: str, spec: TableKind) -> Iterator[tuple[str, Table]]:
    """Yield a table by its folders; none if the table failed.

    A table with CPU times stands in ``run/tables/``, and without them in ``tables/``.
    """
    table = results.tables.get(name)
    if table is None:
        return
    reproducible = spec.without_cpu_times()
    if reproducible is not spec:
        yield "run/tables", table
        if reproducible is None:
            return
        table = results.with_units(as_table(reproducible.table(results), spec))
    yield "tables", table


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
