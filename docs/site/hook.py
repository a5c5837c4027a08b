"""What mkdocs calls: every page of the site comes from elsewhere in the repository, none is copied."""

import sys
from functools import cache
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parent.parent.parent
sys.path.insert(0, str(ROOT))

from docs.site import gallery, numbers, problems, reference
from docs.site.blocks import fenced
from docs.site.pages import assistants_text, pages, rewritten

_BEFORE = "## What it is\n"
"""Heading of README.md that the table of problems stands before on the front page."""


def on_config(config: Any) -> Any:
    """Let the reference be listed as far as it goes."""
    listed = set(_listed(config.nav))
    more = [uri for uri in pages().values() if uri not in listed]
    for section in config.nav:
        for title, entries in section.items():
            if title == "Gallery":
                entries += [f"gallery/{e.name}.md" for e in gallery.experiments()]
            if title == "Reference":
                entries += more
    return config


def on_files(files: Files, config: Any) -> Files:
    """Bring the pages."""
    for place, uri in pages().items():
        files.append(File.generated(config, uri, abs_src_path=str(ROOT / place)))
    for uri, text in (reference.pages() | gallery.pages() | problems.pages()).items():
        files.append(File.generated(config, uri, content=text))
    for uri, path in (gallery.files() | _pictures()).items():
        files.append(File.generated(config, uri, abs_src_path=str(path)))
    files.append(File.generated(config, "llms.txt", content=assistants_text(_known())))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Fence the code, and let links lead where their ends are on the site."""
    places = {uri: place for place, uri in pages().items()}
    place = places.get(page.file.src_uri)
    if place is None:
        return markdown
    markdown = numbers.linked(markdown, numbers.read(ROOT / place), numbers.results(place))
    text = rewritten(fenced(markdown), place, page.file.src_uri, _known())
    if place == "README.md":
        text = text.replace(_BEFORE, problems.section() + _BEFORE)
    return text


@cache
def _known() -> dict[str, str]:
    """Where on the site pages, results and pictures of the repository are."""
    found = dict(pages())
    for e in gallery.experiments():
        found[f"results/{e.name}/"] = f"gallery/{e.name}.md"
    for uri, path in (gallery.files() | _pictures()).items():
        found[path.relative_to(ROOT).as_posix()] = uri
    return found


def _pictures() -> dict[str, Path]:
    """Pictures of the pages themselves."""
    return {f"pictures/{path.name}": path for path in (ROOT / "docs" / "pictures").glob("*.*")}


def _listed(nav: Any) -> list[str]:
    if isinstance(nav, str):
        return [nav]
    inner = nav.values() if isinstance(nav, dict) else nav
    return [uri for part in inner for uri in _listed(part)]
