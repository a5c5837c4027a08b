"""Templates of pages: fill one, and write it to a file."""

import base64
import hashlib
import re
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trackbench.atomic_files import write_text
from trackbench.report.html.verdict_colors import VERDICT_COLORS
from trackbench.report.rounded_numbers import unsigned_zeros

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup

_TEMPLATES = Path(__file__).parent / "templates"


def write_page(path: Path, template: str, live: bool = True, **context: Any) -> Path:
    """Write a page from a template of this name, filled with the values in ``context``.

    The ``context`` must have every name that the template uses, except those set here. A ``live`` page
    has the script that reads values from figures. The page allows no script but its own, by the digest.
    """
    from markupsafe import Markup

    scripts = ["page.js"]
    if live:
        scripts.append("curves.js")
    script = "".join(map(_template_text, scripts))
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    page: dict[str, Any] = {
        "script": Markup(script),
        "style": Markup(_template_text("page.css")),
        "script_digest": f"sha256-{digest}",
        "verdicts": VERDICT_COLORS,
    }
    write_text(path, _environment().get_template(template).render(**page, **context))
    return path


@cache
def _template_text(name: str) -> str:
    return (_TEMPLATES / name).read_text(encoding="utf-8")


@cache
def _environment() -> "Environment":
    """Return the environment of the templates, which escapes every text that is not marked as safe."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,  # a name without a value is an error
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["breakable"] = _breakable
    environment.filters["unsigned_zeros"] = unsigned_zeros
    return environment


_LONGEST_WORD = 16
"""Characters of a word that stays on one line."""
_PIECE = re.compile(
    r".{1,24}?(?:"  # at most 24 characters
    r"[_/(\[=,](?=[\w-])"  # up to punctuation
    r"|\w\.(?=[a-zA-Z])"  # or a point that is none of a number
    r"|$)"  # or the end
    r"|.{24}",
    re.DOTALL,
)
"""A part of a longer word."""
_HYPHENED_NUMBER = re.compile(r"[\d.]+e-\d+")


def _breakable(text: str) -> "Markup":
    """Return the text for HTML, whose long words, such as paths of a config, may break into lines.

    Shorter words stay whole also where a table has little room, and so do numbers, which a browser
    would break after the hyphen of an exponent.
    """
    from markupsafe import Markup, escape

    words = []
    for word in text.split(" "):
        if len(word) > _LONGEST_WORD:
            words.append(Markup("<wbr>").join(_PIECE.findall(word)))
        elif _HYPHENED_NUMBER.search(word):
            words.append(Markup('<span class="whole">{}</span>').format(word))
        else:
            words.append(escape(word))
    return Markup(" ").join(words)
