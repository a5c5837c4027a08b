"""Measure the words: first lines name their subject, sentences of the docs state what is the case.

That docstrings of functions begin with a verb is checked by ruff (D401).
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

HERE = Path(__file__).resolve().parent.parent
PACKAGE = sorted((HERE / "trackbench").rglob("*.py"))
DOCS = sorted(p for p in (HERE / "docs").rglob("*.md"))
BANNED = ("What", "Whether", "Of", "Where", "That", "How", "The same", "All of", "None")
NEGATION = re.compile(
    r"\b(not|no|none|never|nothing|nobody|nor|neither|cannot|without|\w+n't)\b", re.IGNORECASE
)


def docstrings() -> Iterator[tuple[str, str]]:
    """Yield place and first line of each docstring of modules, classes and functions."""
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef)
    for path in PACKAGE:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, kinds) and (text := ast.get_docstring(node)):
                yield f"{path.relative_to(HERE)}:{getattr(node, 'lineno', 1)}", text.split("\n")[0]


def sentences(path: Path) -> Iterator[str]:
    """Yield the sentences of a page, without code, tables, headings and the targets of links."""
    text = re.sub(r"```.*?```|<!--.*?-->", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
    text = re.sub(r"^(#.*|\|.*|    .*)$", "\n", text, flags=re.MULTILINE)
    text = re.sub(r"!?\[([^\]]*)\]\((?:[^()]|\([^()]*\))*\)", r"\1", text)
    for paragraph in re.split(r"\n\s*\n|\n(?=\s*(?:[-*]|\d+\.) )", text):
        words = re.sub(r"^\s*(?:[-*>]|\d+\.)\s+", "", " ".join(paragraph.split()))
        yield from (
            s for s in re.split(r"(?<=[.!?:;])\s+(?=[A-Z`*\[\"(])", words) if len(s.split()) > 2
        )


def share(hits: int, total: int) -> float:
    return 100 * hits / max(total, 1)


def test_first_lines_name_their_subject() -> None:
    assert [
        f"{at}: {line}" for at, line in docstrings() if re.match(rf"({'|'.join(BANNED)})\b", line)
    ] == []


def test_docs_say_what_is() -> None:
    """Sentences with a negation are at most 15 %, openings by What, Of, Where or That 1 %."""
    every = [s for path in DOCS for s in sentences(path)]
    assert share(sum(bool(NEGATION.search(s)) for s in every), len(every)) <= 15
    assert (
        share(sum(s.split()[0] in ("What", "Of", "Where", "That") for s in every), len(every)) <= 1
    )
