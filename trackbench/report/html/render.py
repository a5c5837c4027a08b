"""A page from its template: self-contained, with a script that nothing can be added to."""

import base64
import hashlib
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trackbench.atomic_files import write_text

if TYPE_CHECKING:
    from jinja2 import Environment

_TEMPLATES = Path(__file__).parent / "templates"
VERDICTS = {
    "agrees": "good",
    "holds": "good",
    "compatible": "fair",
    "near": "fair",
    "differs": "bad",
    "fails": "bad",
    "chosen": "open",
    "not decided": "open",
    "not measured": "open",
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
