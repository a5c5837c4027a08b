"""What mkdocs calls: every page of the site comes from elsewhere in the repository, none is copied."""

import re
import sys
from functools import cache
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parent.parent.parent
sys.path.insert(0, str(ROOT))

from docs.site import gallery, numbers, problems, reference
from docs.site.blocks import blocks, fenced
from docs.site.pages import assistants_text, pages, rewritten

_AFTER = "## What it found\n"
"""Heading of README.md at which the page `found.md` begins; the front page ends before."""
_MORE = (
    "[What it found](found.md) · [Tutorial](tutorial.md) · [Standard problems](problems.md) · "
    "[Gallery](gallery/index.md)"
)
_BOOST = {"tutorial.md": 8, "ledger.md": 0.1, "benchmarks.md": 0.1, "changelog.md": 0.1}
"""Weight of a page's titles and words in a search; of a page for a reader's task 4, of others 1."""


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
    found = {"found.md": "# Findings\n\n" + _front()[1]}
    for uri, text in (reference.pages() | gallery.pages() | problems.pages() | found).items():
        files.append(File.generated(config, uri, content=text))
    for uri, path in (gallery.files() | _pictures()).items():
        files.append(File.generated(config, uri, abs_src_path=str(path)))
    files.append(File.generated(config, "llms.txt", content=assistants_text(_known())))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Fence the code, and let links lead where their ends are on the site."""
    uri = page.file.src_uri
    page.meta["search"] = {"boost": _BOOST.get(uri, 4 if uri in _tasks() else 1)}
    place = {uri: place for place, uri in pages().items()}.get(uri)
    if place is None:
        return markdown
    return _front()[0] if place == "README.md" else _linked(place)


def _linked(place: str) -> str:
    """Return a page with links to results at its numbers, for the site."""
    page = (ROOT / place).read_text(encoding="utf-8")
    page = numbers.linked(page, numbers.read(ROOT / place), numbers.results(place))
    return rewritten(fenced(page), place, pages()[place], _known())


@cache
def _front() -> tuple[str, str]:
    """Return the front page, of one screen, and what README.md says of the findings."""
    top, _, rest = _linked("README.md").partition(_AFTER)
    title, about, picture, *_ = top.split("\n\n")
    commands = blocks(top)[0]
    shown = "\n".join(top.splitlines()[commands.first : commands.last + 1])
    return "\n\n".join([title, about, picture, _MORE, shown, ""]), rest


@cache
def _tasks() -> frozenset[str]:
    """Return the pages of mkdocs.yml under "How to"."""
    config = (ROOT / "docs" / "mkdocs.yml").read_text(encoding="utf-8")
    return frozenset(
        re.findall(
            r": ([\w-]+\.md)$", config.partition("- How to:")[2].partition("- Problems:")[0], re.M
        )
    )


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
