"""Compare the numbers of README.md, docs/findings/ and docs/which-filter.md with results/.

``docs/findings/numbers/PAGE.csv`` has a row for each (`docs.site.numbers`): its text on the page, a
results folder and what it is there. ``PF; mean(rmse)`` is an expression of a filter. A third part gives
the values of a point of the grid (``0.1; 10``); ``z;`` in front asks for its z from zero, ``percent;``
for a hundred times the number, and ``half;`` for half of it. ``claim; TEXT OF THE CLAIM`` is the
verdict on a claim, ``number; TABLE; ROW; FILTER; METRIC`` that on a printed number, and ``measured;``
in place of ``number;`` is the number beside the printed one. ``most; TEXT OF THE CLAIM`` is the end of
the interval that the claim's note compares with the printed size. ``notes; TABLE; PATTERN`` is the
groups of a regular expression in a table's file. ``decided; TEXT OF THE CLAIM`` is the number of
standard errors by which the claim is decided. ``count; numbers; agrees; fragile`` counts verdicts of a
folder, or of all: of ``numbers``, ``words`` on a bias or ``claims``. The word may be left out; a paper
may stand in place of ``fragile``. The numbers of a suite have words of their own
(`tests.suite_scores`).

``python -m tests.prose`` (in ``make reproduce``) lists what changed, and records the numbers that
need the runs in ``results/quoted.csv``. To edit a page, run it with ``--links PAGE``: each number
becomes a link, ``[0.34 ± 0.01](../../results/hdepf/ "PF; mean(rmse)")``. Move, add and delete links as
you write. ``--write`` takes the links into the page's file again, and writes the texts anew, with as
many decimals as they had.
"""

import argparse
import csv
import re
import sys
from collections.abc import Iterator
from functools import cache
from math import nan
from pathlib import Path
from typing import NamedTuple

from docs.site import numbers
from docs.site.numbers import LINK
from tests.quoted import Quoted, has_runs, recorded, write_record
from tests.suite_scores import is_suite, suite_number
from trackbench.config.published_numbers_and_claims import split_cell
from trackbench.evaluation.metric_expression import measure
from trackbench.report.expressions import Evaluator
from trackbench.report.tables_and_figures import Results
from trackbench.statistics.verdict_meanings import NUMBER_WORDS
from trackbench.yaml_scalars import scalar

HERE = Path(__file__).resolve().parent.parent
FINDINGS = tuple(
    path
    for path in sorted((HERE / "docs" / "findings").glob("*.md"))
    if path.stem != "audit"  # of other packages: test_audit.py ties it to its own results
)
PAGES = (*FINDINGS, HERE / "docs" / "which-filter.md")
"""Pages each of whose measured numbers is tied to results."""
TEXTS = (*PAGES, HERE / "README.md")
_PRINTED_AT = ("paper", "table", "row", "filter", "metric")
_NUMBER = re.compile(r"([+-]?)(\d+(?: \d{3})*(?:\.\d+)?(?:e[+-]?\d+)?)")


class Tied(NamedTuple):
    """A number of the prose: where, as written, as the results have it, and what it is."""

    line: int
    written: str
    found: str
    source: str


def tied(path: Path) -> Iterator[Tied]:
    """Every tied number of a text."""
    page, rows = path.read_text(encoding="utf-8"), numbers.read(path)
    for (start, end), row in zip(numbers.spans(page, rows), rows, strict=True):
        written = " ".join(page[start:end].split())
        found = as_found(written, row.folder, row.source)
        yield Tied(page.count("\n", 0, start) + 1, written, found, f"{row.folder}: {row.source}")


def as_found(written: str, folder: str, title: str) -> str:
    """The text with the numbers of the results in it, to the decimals that it has; or the verdict."""
    what, _, of = title.partition("; ")
    if what in ("claim", "number"):
        word = verdict(what, folder, of)
        return word.capitalize() if written[:1].isupper() else word
    found = iter(values(folder, title))
    return _NUMBER.sub(lambda match: like(match, next(found, nan)), written)


def like(match: re.Match[str], value: float) -> str:
    """A number as another one is written: decimals or digits, sign, exponent."""
    sign, text = match.groups()
    mantissa, exponent, _ = text.replace(" ", "").partition("e")
    decimals = len(mantissa.partition(".")[2])
    form = f"{'+' if sign == '+' else ''}{',' if ' ' in text else ''}.{decimals}"
    out = f"{value:{form}{'e' if exponent else 'f'}}".replace(",", " ")
    if exponent:
        head, _, tail = out.partition("e")
        out = f"{head}e{int(tail)}"
    return out


def count(folder: str, what: str, word: str = "", mark: str = "") -> int:
    """Return how many verdicts of a folder, or of all, have the word; ``mark``: fragile, or a paper."""
    found = [row for row in verdict_rows(folder, what) if word in ("", row["verdict"])]
    if mark == "fragile":
        return sum(row["fragile"] == "yes" for row in found)
    return sum(mark in ("", row["paper"]) for row in found)


@cache
def verdict_rows(folder: str, what: str) -> list[dict[str, str]]:
    """Return the verdicts; on a printed number that of its best reading, as in the ledger."""
    name = "claims.csv" if what == "claims" else "comparison.csv"
    rows = [
        row
        for path in sorted((HERE / "results").glob(f"{folder or '*'}/{name}"))
        for row in csv.DictReader(path.read_text(encoding="utf-8").splitlines())
    ]
    if what == "claims":
        return rows
    best: dict[tuple[str, ...], dict[str, str]] = {}
    for row in sorted(rows, key=_rank):
        if row["published"].endswith("biased") == (what == "words"):
            best.setdefault(tuple(row[key] for key in _PRINTED_AT), row)
    return [*best.values()]


def _rank(row: dict[str, str]) -> tuple[int, float]:
    word = NUMBER_WORDS.index(row["verdict"])
    if row["published"].endswith("biased") or not row["measured"]:
        return word, 0.0
    return word, abs(float(row["measured"]) - float(row["published"]))


def values(folder: str, title: str) -> tuple[float, ...]:
    """Value and standard error, or z alone, or a count of verdicts."""
    parts = re.split(r"\s*[;|]\s*", title)
    if is_suite(folder):
        return (suite_number("; ".join(parts), folder),)
    if parts[0] == "count":
        return (float(count(folder, *parts[1:])),)
    if parts[0] == "notes":
        text = (HERE / "results" / folder / "tables" / f"{parts[1]}.md").read_text(encoding="utf-8")
        found = re.search(title.split("; ", 2)[2], text, re.MULTILINE)
        return tuple(map(float, found.groups())) if found else ()
    if parts[0] == "most":
        note = _judged("claim", folder, title.partition("; ")[2])["note"]
        return tuple(map(float, re.findall(r"at most ([-+.\de]+) %", note)))
    if parts[0] == "decided":
        return (float(_judged("claim", folder, title.partition("; ")[2])["z"]),)
    if parts[0] == "measured":
        row = _judged("number", folder, title.partition("; ")[2])
        return float(row["measured"]), float(row["stderr"])
    if parts[0] == "percent":
        return tuple(100 * value for value in values(folder, title.partition("; ")[2]))
    if parts[0] == "half":
        return tuple(value / 2 for value in values(folder, title.partition("; ")[2]))
    wants_z = parts[0] == "z"
    label, expression, *point = parts[1:] if wants_z else parts
    expressions = _expressions(folder, "; ".join(point))
    stored = expressions.results.columns("summary", expressions.point)
    rows = stored.where(filter=label, metric=expression)
    if len(rows) and not wants_z:
        return float(rows["value"][0]), float(rows["stderr"][0])
    if has_runs(folder):
        term = expressions.term(measure(expression).of(label))
        quoted[folder, title] = (term.z(),) if wants_z else tuple(term.estimate)
    elif (folder, title) in recorded():
        quoted[folder, title] = recorded()[folder, title]
    else:
        raise ValueError(f"{title!r} is not recorded: run {folder}, then python -m tests.prose")
    return quoted[folder, title]


quoted: Quoted = {}
"""Numbers of the prose that summary.csv does not have."""


def verdict(what: str, folder: str, of: str) -> str:
    """Return the word of claims.csv or comparison.csv, and ``fragile``."""
    row = _judged(what, folder, of)
    return row["verdict"] + (", fragile" if row["fragile"] == "yes" else "")


def _judged(what: str, folder: str, of: str) -> dict[str, str]:
    """Return the row of claims.csv or comparison.csv, of readings the best one's."""
    name, keys = {
        "claim": ("claims.csv", ("claim",)),
        "number": ("comparison.csv", ("table", "row", "filter", "metric")),
    }[what]
    rows = [r for r in _rows(folder, name) if "; ".join(r[k] for k in keys) == of]
    rows = [r for r in rows if r.get("best", "yes") == "yes"]
    if len(rows) != 1:
        raise ValueError(f"results/{folder}/{name} has {len(rows)} verdicts on {of!r}")
    return rows[0]


@cache
def _rows(folder: str, name: str) -> list[dict[str, str]]:
    with (HERE / "results" / folder / name).open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@cache
def _expressions(folder: str, point: str) -> Evaluator:
    results = Results(HERE / "results" / folder)
    wanted = [scalar(value) for value in split_cell(point)]
    points = [p for p in results.points() if not wanted or list(p.values()) == wanted]
    if not points:
        raise ValueError(f"results/{folder} has no point {point}")
    return Evaluator(results, points[0])


def _anew(link: re.Match[str]) -> str:
    written, folder, title = link.groups(default="")
    return link[0].replace(f"[{written}]", f"[{as_found(written, folder, title)}]", 1)


VERDICTS = re.compile(
    r"\b(holds?|fails?|inconclusive|undecided|fragile|agrees?|compatible|differs?)\b"
)
SHARES = re.compile(
    r"\b(half|twice|thirds?|quarters?|fifths?|tenths?|dozen|times (as|more|less|that))\b"
)
_NO_RESULT = re.compile(r"`[^`]*`|\[[^]]*\]\([^)]*\)|\([^()]*(printed|paper)[^()]*\)")
"""Code, other links, and what parentheses say of the paper."""
_EXEMPT = ("Errata", "Open points")
_BARE = re.compile(r"(?<![\w.])\d+(?: \d{3})*(?:\.\d+)?(?:e[+-]?\d+)?(?![\w])")


def untied(path: Path) -> Iterator[tuple[int, str]]:
    """Yield line and text of verdict words and measured numbers that no link ties to results.

    Numbers of the configs and of what is published are settings. Errata and open points argue with the
    paper's own numbers.
    """
    settings, exempt = _settings(), False
    paragraphs = without_tied(path).split("\n\n")
    page = "\n\n".join(_NO_RESULT.sub(_blank, paragraph) for paragraph in paragraphs)
    for i, line in enumerate(page.splitlines(), start=1):
        if line.startswith("#"):
            exempt = any(word in line for word in _EXEMPT)
            continue
        if exempt:
            continue
        for pattern in (VERDICTS, SHARES):
            yield from ((i, match[0]) for match in pattern.finditer(line))
        for match in _BARE.finditer(line):
            if float(match[0].replace(" ", "")) not in settings:
                yield i, match[0]


def without_tied(path: Path) -> str:
    """Return a page with blanks in place of its tied numbers."""
    page = path.read_text(encoding="utf-8")
    for start, end in numbers.spans(page, numbers.read(path)):
        page = page[:start] + re.sub(r"\S", " ", page[start:end]) + page[end:]
    return page


def _blank(match: re.Match[str]) -> str:
    return re.sub(r"\S", " ", match[0])


@cache
def _settings() -> frozenset[float]:
    """Every number in the configs and in what is published, and the whole ones up to twelve."""
    files = [
        *(HERE / "experiments").rglob("*.yaml"),
        *(HERE / "experiments").rglob("published/*.csv"),
    ]
    text = " ".join(file.read_text(encoding="utf-8") for file in files)
    return frozenset(
        {float(n) for n in re.findall(r"\d+(?:\.\d+)?(?:e[+-]?\d+)?", text)} | {*range(13)}
    )


def written(path: Path) -> None:
    """Take a page's links into its file, each with the number that results have."""
    page = numbers.linked(
        path.read_text(encoding="utf-8"), numbers.read(path), numbers.results(path)
    )
    page, rows = numbers.unlinked(LINK.sub(_anew, page))
    path.write_text(page, encoding="utf-8")
    numbers.write(path, rows)


def main() -> int:
    """List what changed, or write it; exit code 1 if a number is stale and not written."""
    as_written = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(
        prog="python -m tests.prose", description=__doc__, formatter_class=as_written
    )
    parser.add_argument("paths", nargs="*", type=Path, default=TEXTS)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--links", action="store_true")
    options = parser.parse_args()
    paths = [path.resolve() for path in options.paths]
    for path in paths if options.links else ():
        page = path.read_text(encoding="utf-8")
        page = numbers.linked(page, numbers.read(path), numbers.results(path))
        path.write_text(page, encoding="utf-8")
        numbers.write(path, [])
    if options.links:
        return 0
    if options.write:
        for path in paths:
            written(path)
    stale = [(path, t) for path in paths for t in tied(path) if t.written != t.found]
    if {*TEXTS} <= {*paths}:
        write_record(quoted)
    for path, t in stale:
        print(f"{path}:{t.line}: {t.written} is now {t.found} ({t.source})")
    for path in paths:
        for line, text in untied(path) if path in PAGES else ():
            print(f"{path}:{line}: {text!r} is tied to no result")
    return int(bool(stale))


if __name__ == "__main__":
    sys.exit(main())
