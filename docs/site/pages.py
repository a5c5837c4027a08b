"""The pages that are written by hand: where each stands on the site, and what its links mean there."""

import posixpath
import re
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent
PAGES = {
    "README.md": "index.md",
    "experiments/README.md": "experiments.md",
    "results/README.md": "ledger.md",
    "experiments/data/README.md": "data.md",
    "benchmarks/results.md": "benchmarks.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
}
_LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(\s*([^)\s]+)((?:\s+\"[^\"]*\")?)\s*\)")
_OUTSIDE = ("http:", "https:", "mailto:")


def pages() -> dict[str, str]:
    """Map each page's path in the repository to its path on the site."""
    docs = ROOT / "docs"
    own = {
        f"docs/{name}": name
        for name in sorted(path.relative_to(docs).as_posix() for path in docs.rglob("*.md"))
    }
    return {place: uri for place, uri in (PAGES | own).items() if (ROOT / place).is_file()}


def rewritten(text: str, place: str, uri: str, known: dict[str, str]) -> str:
    """The page with links that hold on the site; to what is not there only their words are left.

    ``known`` are pages and pictures by their places; a results folder is its page in the gallery.
    """

    def link(found: re.Match[str]) -> str:
        mark, words, target, title = found.groups()
        path, _, anchor = target.partition("#")
        if target.startswith(_OUTSIDE) or not path:
            return found[0]
        there = posixpath.normpath(posixpath.join(posixpath.dirname(place), path))
        parts = there.split("/")
        if len(parts) == 2 and parts[0] == "results":
            there = f"results/{parts[1]}/"
        if there not in known:
            return words
        to = posixpath.relpath(known[there], posixpath.dirname(uri) or ".")
        return f"{mark}[{words}]({to}{'#' + anchor if anchor else ''}{title})"

    parts = re.split(r"(^```.*?^```$)", text, flags=re.MULTILINE | re.DOTALL)
    return "".join(p if p.startswith("```") else _LINK.sub(link, p) for p in parts)


def assistants_text(known: dict[str, str]) -> str:
    """The page for assistants as a text whose links lead to the site's pages."""
    place = "docs/for-assistants.md"
    text = rewritten((ROOT / place).read_text(encoding="utf-8"), place, "llms.txt", known)
    return re.sub(r"\]\(([\w/-]+)\.md", r"](\1.html", text)
