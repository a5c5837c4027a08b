"""Where the numbers and verdicts of a page come from: ``docs/findings/numbers/PAGE.csv``.

A page is plain Markdown. Its file has a row per measured number or verdict, in the page's order:
the text, a folder of results/, and what it is there. Where the text alone stands twice between its
neighbors, words around it are added and the number is in braces: ``filter has {43.6} m``.

For editing, `linked` writes each number as a link, and `unlinked` takes the links out again:
``[0.34 ± 0.01](../../results/hdepf/ "PF; mean(rmse)")``.
"""

import csv
import re
from collections.abc import Iterable, Sequence
from itertools import count
from pathlib import Path
from typing import NamedTuple

FINDINGS = Path(__file__).resolve().parent.parent / "findings"
LINK = re.compile(r'\[([^\]\[]+)\]\((?:\.\./)*results/(?:([^/)]+)/)? "([^"]+)"\)')
_CODE = re.compile(r"^```.*?^```$|`[^`]*`|(?<=\])\([^()]*\)", re.MULTILINE | re.DOTALL)
Span = tuple[int, int]


class Row(NamedTuple):
    """A number or verdict of a page: its text, the results folder, and what it is there."""

    text: str
    folder: str
    source: str


class UnclearError(Exception):
    """A row whose text stands nowhere on its page, or more than once between its neighbors."""


def read(page: Path) -> list[Row]:
    """Return the rows of a page of findings, of docs or of README.md; none if it has no file."""
    file = _file(page)
    known = (FINDINGS, FINDINGS.parent, FINDINGS.parent.parent)
    if page.parent not in known or not file.is_file():
        return []
    with file.open(encoding="utf-8", newline="") as lines:
        return [Row(row["text"], row["folder"], row["source"]) for row in csv.DictReader(lines)]


def _file(page: Path) -> Path:
    return FINDINGS / "numbers" / f"{page.stem}.csv"


def results(page: Path | str) -> str:
    """Return the path from a page to results/."""
    if Path(page).name == "README.md":
        return "results/"
    return "../../results/" if Path(page).parent.name == FINDINGS.name else "../results/"


def write(page: Path, rows: Iterable[Row]) -> None:
    """Replace the rows of a page."""
    with _file(page).open("w", encoding="utf-8", newline="") as lines:
        csv.writer(lines, lineterminator="\n").writerows([Row._fields, *rows])


def spans(page: str, rows: Sequence[Row]) -> list[Span]:
    """Return where each row stands on the page; in their order there is one way to place them all.

    Raises
    ------
    UnclearError
        If there is no way, or another one.
    """
    blank = _blank(page)
    matches = [_matches(row.text, blank) for row in rows]
    first: list[Span] = []
    for row, found in zip(rows, matches, strict=True):
        after = first[-1][1] if first else 0
        later = [span for span in found if span[0] >= after]
        if not later:
            line = page.count("\n", 0, after) + 1
            raise UnclearError(f"line {line} or later: {row.text!r} ({row.source}) is not there")
        first.append(later[0])
    before = len(page)
    for row, found, span in reversed([*zip(rows, matches, first, strict=True)]):
        last = [other for other in found if other[1] <= before][-1]
        if last != span:
            lines = [page.count("\n", 0, start) + 1 for start, _ in (span, last)]
            raise UnclearError(f"lines {lines}: {row.text!r} ({row.source}) stands twice")
        before = last[0]
    return first


def linked(page: str, rows: Sequence[Row], to: str = "../../results/") -> str:
    """Return the page with a link for each row; ``to`` leads to results/."""
    for (start, end), row in reversed([*zip(spans(page, rows), rows, strict=True)]):
        folder = f"{to}{row.folder}{'/' if row.folder else ''}"
        page = f'{page[:start]}[{page[start:end]}]({folder} "{row.source}"){page[end:]}'
    return page


def unlinked(page: str) -> tuple[str, list[Row]]:
    """Return a page without its links to results, and a row for each of them."""
    at: list[Span] = []
    plain, end = "", 0
    links = [*LINK.finditer(page)]
    for link in links:
        plain += page[end : link.start()]
        at.append((len(plain), len(plain) + len(link[1])))
        plain += link[1]
        end = link.end()
    plain += page[end:]
    blank = _blank(plain)
    after = [*(end for _, end in at), 0]
    before = [*(start for start, _ in at[1:]), len(plain)]
    rows = []
    for i, link in enumerate(links):
        text = _clear(blank, at[i], (after[i - 1], before[i]))
        rows.append(Row(text, link[2] or "", link[3]))
    return plain, rows


def _clear(blank: str, at: Span, window: Span) -> str:
    """Return the text, with as many words around it as make it stand once in the window."""
    for words in count():
        text = " ".join(blank[at[0] : at[1]].split())
        if words:
            before = blank[: at[0]].split(" ")[-words - 1 :]
            after = blank[at[1] :].split(" ")[: words + 1]
            text = " ".join(f"{' '.join(before)}{{{text}}}{' '.join(after)}".split())
        found = _matches(text, blank)
        if [s for s in found if s[0] >= window[0] and s[1] <= window[1]] == [at]:
            return text
        if words > 40:
            raise UnclearError(f"{text!r} cannot be found again")
    raise AssertionError


def _blank(page: str) -> str:
    """Return the page with blanks in place of code, targets of links and links to results."""
    page = LINK.sub(lambda link: " " * len(link[0]), page)
    return _CODE.sub(lambda code: re.sub(r"[^\n]", " ", code[0]), page)


def _matches(text: str, blank: str) -> list[Span]:
    """Return where a row's text stands, as a whole number or word with its standard error."""
    before, brace, rest = text.partition("{")
    inner, _, after = rest.partition("}")
    if not brace:
        before, inner = "", text
    # A verdict may begin a sentence.
    word = f"(?i:{re.escape(inner[0])}){_spaced(inner[1:])}"
    number = rf"(?<![\w.+-])(?<!± )({word})(?!\.?\w)(?!\s+±)"
    pattern = f"(?={_spaced(before)}{number}{_spaced(after)})"
    return [match.span(1) for match in re.finditer(pattern, blank)]


def _spaced(words: str) -> str:
    """Return a pattern of the words, on one line or more."""
    return r"\s+".join(map(re.escape, re.split(r"\s+", words)))
