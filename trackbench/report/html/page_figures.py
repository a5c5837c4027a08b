"""The figures of a report: as pictures on the page, with what to see in them."""

import inspect
from collections.abc import Iterator
from typing import Any, NamedTuple

from trackbench.report.html.svg import inline
from trackbench.report.kinds import FigureKind
from trackbench.report.parallel_drawing import drawn
from trackbench.report.plugin_exhibits import told
from trackbench.report.results import Results


class Drawing(NamedTuple):
    """A figure as it stands on the page."""

    name: str
    svg: Any
    heading: str
    """its name, where the picture has no title"""
    caption: str
    """what to see in it"""


def drawings(results: Results) -> list[Drawing]:
    """Return all figures, the key figure first; disallowed plugins' as stored."""
    from markupsafe import Markup

    found = []
    for name, spec, content in _pictures(results):
        asked = results.asked_figures.get(name, {})
        title, said = (results.filled(asked.get(key) or "") for key in ("title", "caption"))
        what = (inspect.getdoc(type(spec)) or "").partition("\n")[0] if spec is not None else ""
        caption = said or _told(results, name, spec) or what
        svg = Markup(inline(content, name, ". ".join(filter(None, [title or name, what]))))
        found.append(Drawing(name, svg, "" if title else f"{name}.", caption))
    return found


def _told(results: Results, name: str, spec: FigureKind | None) -> str:
    """Return the figure's caption, if it has one."""
    if spec is not None:
        with results.without(f"caption of figure {name}"), told(spec):
            return spec.tell(results)
    return ""


def key_picture(results: Results) -> bytes | None:
    """Return the SVG that the report begins with; None if there is none."""
    return next((content for _, _, content in _pictures(results)), None)


def _pictures(results: Results) -> Iterator[tuple[str, FigureKind | None, bytes]]:
    """Name, kind and SVG of each figure that is in the folder, or can be drawn."""
    specs, asked = results.parts("figures"), results.asked_figures
    for name in sorted(asked or specs, key=lambda name: name != results.key_figure):
        spec, path = specs.get(name), results.folder / "figures" / f"{name}.svg"
        is_own = path.is_file() and not (path.is_symlink() or path.parent.is_symlink())
        contents = [path.read_bytes()] if is_own else []
        failed = f"figure {name}" in results.unmade
        if not contents and spec is not None and name in asked and not failed:
            with results.without(f"figure {name}"):
                contents = [content for _, content in drawn(spec, results, ["svg"])]
        if contents:
            yield name, spec, contents[0]
