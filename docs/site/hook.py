"""What mkdocs calls: every page of the site comes from elsewhere in the repository, none is copied."""

import html
import re
import sys
from functools import cache
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parent.parent.parent
sys.path.insert(0, str(ROOT))

from docs.site import gallery, narrow, numbers, problems, reference
from docs.site.blocks import blocks, fenced, with_separate_lists
from docs.site.pages import assistants_text, pages, rewritten

_AFTER = "## What it found\n"
"""Heading of README.md at which the page `found.md` begins; the front page ends before."""
_MORE = (
    "[Tutorial](tutorial.md) · [Which filter?](which-filter.md) · [What it found](found.md) · "
    "[Standard problems](problems.md) · [Gallery](gallery/index.md)"
)
_FINDINGS_ON_FRONT = re.compile(
    r"^- (\*\*\[.*?\]\((findings/[\w-]+)\.md\).*?)(?=^- |^$)", re.M | re.S
)
"""Findings in README.md: the text, which begins with a link to the page."""
_BOOST = {"tutorial.md": 8, "ledger.md": 0.1, "benchmarks.md": 0.1, "changelog.md": 0.1}
"""Weight of a page's titles and words in a search; of a page for a reader's task 4, of others 1."""


def on_config(config: Any) -> Any:
    """List the experiments of the gallery and the decisions in the menu."""
    decisions = sorted(uri for uri in pages().values() if uri.startswith("decisions/"))
    decisions.remove("decisions/index.md")
    for section in config.nav:
        for title, entries in section.items():
            if title == "Gallery":
                entries += [f"gallery/{e.name}.md" for e in gallery.experiments()]
            if title == "Design":
                (listed,) = (entry for entry in entries if "Decisions" in entry)
                listed["Decisions"] += decisions
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
    for uri, text in gallery.pictures().items():
        files.append(File.generated(config, uri, content=text))
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


def on_page_content(content: str, page: Any, **_: Any) -> str:
    """Fit the page to a phone and to paper."""
    pictures = gallery.files() | _pictures()
    scrolling = narrow.with_scrolling_pictures(content, page.file.src_uri, pictures)
    return narrow.with_whole_options(narrow.with_whole_numbers(scrolling))


def _linked(place: str) -> str:
    """Return a page with links to results at its numbers, for the site."""
    page = (ROOT / place).read_text(encoding="utf-8")
    page = numbers.linked(page, numbers.read(ROOT / place), numbers.results(place))
    page = with_separate_lists(fenced(page))
    return rewritten(page, place, pages()[place], _known())


@cache
def _front() -> tuple[str, str]:
    """Return the front page, and what README.md says of the findings.

    The front page has the first run with its screen, the picture of the filters on all problems, and the
    findings of README.md, each with the first picture of its page.
    """
    top, _, rest = _linked("README.md").partition(_AFTER)
    title, about, *_ = top.split("\n\n")
    # Step 1: the first run. Its screen is a table, which fits a phone.
    commands, screen, *_ = blocks(top)
    lines = top.splitlines()
    run = "\n".join(lines[commands.first : commands.last + 1])
    explained = "\n".join(lines[screen.last + 1 :]).strip().partition("\n\n")[0]
    parts = [title, about, _MORE, "## The first run", run, _screen(screen.text), explained]
    # Step 2: the picture of all problems, with its sentence.
    _, _, which = top.partition("## Which filter?\n")
    paragraphs = which.partition("\n## ")[0].strip().split("\n\n")
    parts += ["## Which filter?", *paragraphs[-1].split("\n"), paragraphs[0]]
    # Step 3: the findings.
    cards = []
    for text, page in _FINDINGS_ON_FRONT.findall(rest):
        picture = re.search(r"!\[[^\]]*\]\([^)]*\)", _linked(f"docs/{page}.md"))
        if picture:
            image = picture[0].replace("](../", "](")
            cards += [" ".join(text.split()), image]
    parts += ["## What it found", *cards, ""]
    return "\n\n".join(parts), rest


def _screen(text: str) -> str:
    """Return the ranking on a terminal as a table of HTML."""
    title, head, _, *rows = text.rstrip("\n").splitlines()
    cells = []
    for i, row in enumerate([head, *rows]):
        tag = "td" if i else "th"
        words = re.split(r"\s{2,}", row)
        cells.append("".join(f"<{tag}>{html.escape(word)}</{tag}>" for word in words))
    body = "".join(f"<tr>{row}</tr>" for row in cells[1:])
    return (
        f'<div class="screen" markdown="0"><p>{html.escape(title)}</p>'
        f'<table class="ranking"><thead><tr>{cells[0]}</tr></thead><tbody>{body}</tbody></table></div>'
    )


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
    """Pictures of the pages themselves, and of the standard suite."""
    found = {f"pictures/{path.name}": path for path in (ROOT / "docs" / "pictures").glob("*.*")}
    for path in (ROOT / "results" / "standard" / "figures").glob("*.svg"):
        found[f"pictures/{path.name}"] = path
    return found
