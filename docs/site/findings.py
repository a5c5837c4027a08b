"""Where the findings speak of an experiment."""

import re

from docs.site.pages import ROOT


def link(name: str) -> str:
    """Return links from the gallery to an experiment's section in the findings, and to errata."""
    for path in sorted((ROOT / "docs" / "findings").glob("*.md")):
        heads = re.findall(r"^##+ (.+)$", path.read_text(encoding="utf-8"), re.MULTILINE)
        mine = [head for head in heads if f"`{name}`" in head]
        errata = [head for head in heads if head.startswith("Errata")]
        if mine:
            links = [("Findings", mine[0]), *(("errata", head) for head in errata)]
            page = f"../findings/{path.name}"
            return ", ".join(f"[{word}]({page}#{_anchor(head)})" for word, head in links) + "."
    return ""


def _anchor(head: str) -> str:
    """Return the site's anchor of a heading."""
    return re.sub(r"[^\w\- ]", "", head.lower()).strip().replace(" ", "-")
