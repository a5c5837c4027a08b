"""Processes that draw an experiment's figures in parallel, while their parent writes everything else."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Future
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, TypeAlias, cast

from trackbench.execution.process_pool import pool, result_of
from trackbench.registry import is_plugin
from trackbench.report.figure_cache import FigureCache, Files
from trackbench.report.figure_drawing import draw_figure
from trackbench.report.kinds import FigureKind
from trackbench.report.plotting import style
from trackbench.report.tables_and_figures import Results

Draw: TypeAlias = Callable[[str, FigureKind], Files]
"""Function that returns a figure's files, from its name and the figure."""


@contextmanager
def drawing_pool(
    results: Results, formats: Sequence[str], processes: int = 1, fresh: bool = True
) -> Iterator[Draw]:
    """Begin to draw an experiment's figures in other processes; yield a function that returns them.

    The function returns one figure's files, by its name and the figure. It draws in this process the
    figures of plugins, whose code no other process has loaded, and those of a process that was killed.
    ``formats`` are some of `file_formats.FORMATS`. ``processes`` is the number of processes;
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

    # Step 2: begin to draw. Each process first calls `_open_in_drawer` with the arguments behind it.
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
