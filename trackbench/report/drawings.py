"""The figures of a report: as pictures on the page, with what to see in them."""

import inspect
from collections.abc import Iterator
from typing import Any, NamedTuple

from trackbench.evaluation.measure import measured
from trackbench.report.drawers import drawn
from trackbench.report.kinds import FigureKind
from trackbench.report.results import Results
from trackbench.report.style import MOST_PANELS
from trackbench.report.svg import inline
from trackbench.report.sweep import Sweep
from trackbench.report.sweep_figures import file_name


class Drawing(NamedTuple):
    """A figure as it stands on the page."""

    name: str
    svg: Any
    heading: str
    """its name, where the picture has no title"""
    caption: str
    """what to see in it"""


def drawings(results: Results) -> list[Drawing]:
    """All figures, the key figure first; those of plugins that may not run as they are in the folder."""
    from markupsafe import Markup

    found = []
    for name, spec, content in _pictures(results):
        asked = results.asked_figures.get(name, {})
        title, said = (results.filled(asked.get(key) or "") for key in ("title", "caption"))
        what = (inspect.getdoc(type(spec)) or "").partition("\n")[0] if spec is not None else ""
        caption = said or (spec.tell(results) if spec is not None else "") or what
        svg = Markup(inline(content, name, ". ".join(filter(None, [title or name, what]))))
        found.append(Drawing(name, svg, "" if title else f"{name}.", caption))
    return found


def key_picture(results: Results) -> bytes | None:
    """The SVG that the report begins with; None if there is none."""
    return next((content for _, _, content in _pictures(results)), None)


def _pictures(results: Results) -> Iterator[tuple[str, FigureKind | None, bytes]]:
    """Name, kind and SVG of each figure that is in the folder, or can be drawn."""
    specs, asked = results.parts("figures"), results.asked_figures
    for name in sorted(asked or specs, key=lambda name: name != results.key_figure):
        spec, path = specs.get(name), results.folder / "figures" / f"{name}.svg"
        contents = [path.read_bytes()] if path.is_file() else []
        if not contents and spec is not None and name in asked:
            contents = [content for _, content in drawn(spec, results, ["svg"])]
        if contents:
            yield name, spec, contents[0]
    if (results.folder / "sweep.csv").is_file():
        yield from _of_sweep(results)


def _of_sweep(results: Results) -> Iterator[tuple[str, None, bytes]]:
    """Figures of a sweep's metrics over all steps, the error's first; there are more in the folder."""
    whole = [m for m in map(measured, Sweep(results).metrics) if not m.window and m.steps is None]
    for metric in whole[:MOST_PANELS]:
        path = results.folder / "figures" / f"{file_name(str(metric))}.svg"
        if path.is_file():
            yield path.stem, None, path.read_bytes()
