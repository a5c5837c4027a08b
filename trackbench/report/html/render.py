"""A page from its template: self-contained, with a script that nothing can be added to."""

import base64
import hashlib
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trackbench.atomic_files import write_text

if TYPE_CHECKING:
    from jinja2 import Environment
import inspect
from collections.abc import Iterator
from typing import NamedTuple

from trackbench.report.html.svg import inline
from trackbench.report.kinds import FigureKind, figure_folder
from trackbench.report.parallel_drawing import draw_figure
from trackbench.report.plugin_exhibits import catch_plugin_errors
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
        asked = results.figure_configs.get(name, {})
        title, said = (results.fill_title(asked.get(key) or "") for key in ("title", "caption"))
        what = (inspect.getdoc(type(spec)) or "").partition("\n")[0] if spec is not None else ""
        caption = said or _caption(results, name, spec) or what
        svg = Markup(inline(content, name, ". ".join(filter(None, [title or name, what]))))
        found.append(Drawing(name, svg, "" if title else f"{name}.", caption))
    return found


def _caption(results: Results, name: str, spec: FigureKind | None) -> str:
    """Return the figure's caption, if it has one."""
    if spec is not None:
        with results.without(f"caption of figure {name}"), catch_plugin_errors(spec):
            return spec.with_best(results).default_caption(results)
    return ""


def key_picture(results: Results) -> bytes | None:
    """Return the SVG that the report begins with; None if there is none."""
    return next((content for _, _, content in _pictures(results)), None)


def _pictures(results: Results) -> Iterator[tuple[str, FigureKind | None, bytes]]:
    """Name, kind and SVG of each figure that is in the folder, or can be drawn."""
    specs, asked = results.parts("figures"), results.figure_configs
    names = [*(name for name in specs if name not in asked), *asked]
    for name in sorted(names, key=lambda name: name != results.key_figure):
        spec = specs.get(name)
        place = Path("figures" if spec is None else figure_folder(spec)) / f"{name}.svg"
        path, parts = results.folder / place, (place, *place.parents[:-1])
        is_own = path.is_file() and not any((results.folder / p).is_symlink() for p in parts)
        contents = [path.read_bytes()] if is_own else []
        failed = f"figure {name}" in results.unmade
        if not contents and spec is not None and name in asked and not failed:
            with results.without(f"figure {name}"):
                contents = [content for _, content in draw_figure(spec, results, ["svg"])]
        if contents:
            yield name, spec, contents[0]


_TEMPLATES = Path(__file__).parent / "templates"
VERDICTS = {
    "equal": "good",
    "agrees": "good",
    "holds": "good",
    "compatible": "fair",
    "differs": "bad",
    "fails": "bad",
    "inconclusive": "open",
}
"""Verdicts and how they look."""


def write_page(path: Path, template: str, live: bool = True, **context: Any) -> Path:
    """Write a page; ``live`` ones have the script of figures."""
    from markupsafe import Markup

    script = "".join(map(_text, ("page.js", "curves.js") if live else ("page.js",)))
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    page = {
        "style": Markup(_text("page.css")),
        "script": Markup(script),
        "script_digest": f"sha256-{digest}",
        "verdicts": VERDICTS,
    }
    write_text(path, _environment().get_template(template).render(**page, **context))
    return path


@cache
def _text(name: str) -> str:
    return (_TEMPLATES / name).read_text(encoding="utf-8")


@cache
def _environment() -> "Environment":
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    return Environment(
        loader=FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
