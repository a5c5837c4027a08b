"""Where the findings speak of an experiment."""

import re

from docs.site.pages import ROOT


def link(name: str) -> str:
    """Return links from the gallery to an experiment's section in the findings, and to errata."""
    for path in sorted((ROOT / "docs" / "findings").glob("*.md")):
        heads = re.findall(r"^##+ (.+)$", path.read_text(encoding="utf-8"), re.MULTILINE)
        mine = [head for head in heads if f"`{name}`" in head]
        errata = [head for head in heads if head.startswith("Errata")]
        # A page on one paper has the paper's name, with which the names of its experiments begin.
        if mine or name.startswith(path.stem):
            page = f"../findings/{path.name}"
            anchor = f"#{_anchor(mine[0])}" if mine else ""
            links = [f"[Findings]({page}{anchor})"]
            links += [f"[errata]({page}#{_anchor(head)})" for head in errata]
            return ", ".join(links) + "."
    return ""


def _anchor(head: str) -> str:
    """Return the site's anchor of a heading."""
    return re.sub(r"[^\w\- ]", "", head.lower()).strip().replace(" ", "-")
