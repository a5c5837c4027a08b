"""Figures drawn side by side: by processes of their own, while their parent writes all the rest."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Future
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, TypeAlias

from trackbench.execution.engines import pool, result_of
from trackbench.registry import is_plugin
from trackbench.report.figure_cache import Files, KeptFigures
from trackbench.report.kinds import FigureKind
from trackbench.report.plotting import style
from trackbench.report.plotting.page_formats import is_crowded
from trackbench.report.plugin_exhibits import as_figure, catch_plugin_errors
from trackbench.report.results import Results


def draw_figure(spec: FigureKind, results: Results, formats: Sequence[str]) -> Files:
    """Return a figure as the content of a file, for each format; none of tracks if every filter failed.

    Raises OutputError if the code of a kind of one's own fails.
    """
    with catch_plugin_errors(spec):
        return _drawn(spec, results, formats)


def _drawn(spec: FigureKind, results: Results, formats: Sequence[str]) -> Files:
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
    own = {name: spec for name, spec in figures.items() if not is_plugin(type(spec).__module__)}
    store = KeptFigures.of(results) if own and not fresh else None
    kept = {
        name: files for name, spec in own.items() if store and (files := store.get(spec, formats))
    }
    sent = {n: s for n, s in own.items() if n not in kept} if processes > 1 else {}
    begun: dict[str, Future[Files]] = {}

    def draw(name: str, spec: FigureKind) -> Files:
        if name in kept:
            return kept[name]
        try:
            files = result_of(begun[name])
        except (KeyError, BrokenExecutor):  # none that draws it, or it was killed
            files = draw_figure(spec, results, formats)
        if store and name in own:
            store.put(spec, files)
        return files

    with ExitStack() as stack:
        if sent:
            begin = (_init_worker, results.folder, results.run_facts)
            drawers = stack.enter_context(pool(min(processes, len(sent)), *begin))
            with suppress(BrokenExecutor):  # a drawer was killed as it began
                for name, spec in sent.items():
                    begun[name] = drawers.submit(_draw, spec, formats)
        yield draw


_opened: list[Results] = []


def _init_worker(folder: Path, facts: dict[str, Any]) -> None:
    _opened[:] = [Results(folder, facts)]


def _draw(spec: FigureKind, formats: Sequence[str]) -> Files:
    return draw_figure(spec, _opened[0], formats)
