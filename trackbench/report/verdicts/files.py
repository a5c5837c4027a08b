"""The verdicts as files, and notes on the inconclusive ones.

The files are comparison.csv, comparison.md and claims.csv; paired.csv has the pairs.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import chain
from math import isfinite, isnan
from typing import Any, NamedTuple

from trackbench.atomic_files import remove, write_csv, write_text
from trackbench.config.published import PublishedNumber
from trackbench.errors import counted
from trackbench.report.findings.phrases import run_count
from trackbench.report.paired import COLUMNS
from trackbench.report.results import Results
from trackbench.report.table import Text, TextTable, rounded
from trackbench.report.verdicts.claims import ClaimVerdict, noted
from trackbench.report.verdicts.cpu_times import time_verdicts, write_time_verdicts
from trackbench.report.verdicts.numbers import Compared, Ranked, Reproduced, Verdicts
from trackbench.results.folder_contents import DIGITS, TIME_VERDICTS
from trackbench.statistics.rules import (
    DECIDED,
    HOW_DECIDED,
    MEANINGS,
    UNDECIDED,
    Verdict,
    runs_that_decide,
)

_VERBS = ("agrees", "differs", "holds", "fails")


class Tally(NamedTuple):
    """So many verdicts of one word: ``18``, ``differs``, ``differ``, ``(3 fragile)``."""

    number: int
    word: str
    verb: str
    fragile: int


class Bar(NamedTuple):
    """The verdicts on numbers, or on claims."""

    title: str
    parts: list[Tally]

    @property
    def words(self) -> str:
        """Bar as a line: ``11 claims: 10 agree (2 fragile), 1 differs``."""
        parts = (
            f"{p.number} {p.verb}{f' ({p.fragile} fragile)' * bool(p.fragile)}" for p in self.parts
        )
        return f"{self.title}: {', '.join(parts)}"


def parts(verdicts: Iterable[Compared | ClaimVerdict]) -> list[Tally]:
    """Return the parts in a fixed order, without those of which there is none."""
    rows = list(verdicts)
    numbers = Counter(row.verdict.word for row in rows)
    fragile = Counter(row.verdict.word for row in rows if row.verdict.fragile)
    tallies = []
    for word in ("equal", "agrees", "compatible", "differs", "holds", "fails", UNDECIDED):
        if n := numbers[word]:
            verb = word.removesuffix("s") if n > 1 and word in _VERBS else word
            tallies.append(Tally(n, word, verb, fragile[word]))
    return tallies


def bars(comparison: Verdicts) -> list[Bar]:
    """Return a bar of the numbers, one of the words on a bias, one of the claims, without empty ones."""
    best, claims = [number.best for number in comparison.numbers], comparison.claims
    # Words on a bias are counted apart from numbers.
    words = [row for row in best if isinstance(row.published.value, str)]
    numbers = [row for row in best if not isinstance(row.published.value, str)]
    margin = " on a bias, by a margin chosen here"
    every = [
        Bar(counted(len(numbers), "published number"), parts(numbers)),
        Bar(counted(len(words), "published word") + margin, parts(words)),
        Bar(counted(len(claims), "claim"), parts(claims)),
    ]
    return [bar for bar in every if bar.parts]


NUMBER_HEADER = [
    *["table", "filter", "metric", "published", "measured", "stderr", "z", "verdict", "note"],
    *["paper", "row", "label", "expression", "runs", "published_runs"],
    *["z_without_batch", "fragile", "best"],
]
CLAIM_HEADER = [
    *["claim", "verdict", "z", "paired", "note"],
    *["paper", "source", "z_without_batch", "fragile"],
]
FILES = ("comparison.csv", "comparison.md", "claims.csv")


def write_comparison(results: Results, comparison: Verdicts) -> None:
    """Write the verdicts, or take away old ones if nothing is published about the experiment."""
    folder = results.target
    write_time_verdicts(results)
    if not (comparison.rows or comparison.claims or comparison.left_out):
        for name in FILES:
            remove(folder / name)
        return
    numbers, claims = number_rows(comparison), claim_rows(comparison)
    write_csv(folder / "comparison.csv", NUMBER_HEADER, (row.values() for row in numbers))
    write_csv(folder / "claims.csv", CLAIM_HEADER, (row.values() for row in claims))
    write_text(folder / "comparison.md", markdown(results, comparison))


def write_paired(results: Results) -> None:
    """Write paired.csv."""
    rows: list[list[Any]] = []
    for point, pairs in results.pairs:
        rows += [[*point.values(), *pair.cells] for pair in pairs]
    write_csv(results.target / "paired.csv", [*results.grid, *COLUMNS], rows)


def number_rows(comparison: Verdicts) -> list[dict[str, object]]:
    """Return rows of comparison.csv: every reading of every number, the best ones marked."""
    rows: list[dict[str, object]] = []
    # A number counts by its best reading; every reading is a row.
    best = {id(number.best) for number in comparison.numbers}
    for compared in comparison.rows:
        p, m, verdict = compared.published, compared.measured, compared.verdict
        cells = [
            *[p.table, p.filter, p.metric, p.value, m.value, m.stderr, verdict.z],
            *[verdict.word, compared.note, p.paper, p.row, compared.label],
            *[str(p.expression or ""), m.runs, "" if p.runs is None else p.runs],
            *[_parts(verdict), _yes(verdict.fragile), _yes(id(compared) in best)],
        ]
        rows.append(dict(zip(NUMBER_HEADER, cells, strict=True)))
    return rows


def claim_rows(comparison: Verdicts) -> list[dict[str, object]]:
    """Return rows of claims.csv."""
    rows = []
    for judged in comparison.claims:
        verdict, claim = judged.verdict, judged.claim
        cells = [claim.claim, verdict.word, verdict.z, _yes(judged.paired), judged.note]
        cells += [claim.paper, claim.source, _parts(verdict), _yes(verdict.fragile)]
        rows.append(dict(zip(CLAIM_HEADER, cells, strict=True)))
    return rows


def _yes(flag: bool) -> str:
    return "yes" if flag else "no"


def summary_lines(comparison: Verdicts) -> list[str]:
    """Return a line each on numbers, counted once, words on a bias, claims, and numbers left out."""
    lines = [bar.words for bar in bars(comparison)]
    tried = [number for number in comparison.numbers if number.readings > 1]
    if tried:
        agree = sum(number.best.verdict.word == "agrees" for number in tried)
        what = f"{len(tried)} were tried under several readings, of which {agree} agree in one"
        lines[0] += f"; {what}"
    if comparison.left_out:
        lines.append(f"{counted(len(comparison.left_out), 'printed number')} left out")
    return lines


def markdown(results: Results, comparison: Verdicts) -> str:
    """Return counts, published numbers per table, rank agreement, claims."""
    counts = "\n".join(f"- {line}" for line in summary_lines(comparison))
    parts = [f"# Published and measured: {results.title}", counts]
    parts += [table.markdown().rstrip() for table in verdict_tables(comparison)]
    times = f"Verdicts on CPU times stand in {TIME_VERDICTS}: they depend on the machine."
    return "\n\n".join([*parts, *([times] if time_verdicts(results) else [])]) + "\n"


def _explained(table: TextTable, verdicts: Sequence[Verdict]) -> TextTable:
    """Add a line of meaning for each word that occurs in a table of verdicts."""
    words = {verdict.word for verdict in verdicts}
    lines = {word: meaning for word, meaning in MEANINGS.items() if word in words}
    if words & {"differs", "holds", "fails"}:
        lines["significant"] = HOW_DECIDED
    if any(verdict.fragile for verdict in verdicts):
        what = "another seed, one run fewer or three far ones more could change the verdict"
        lines["fragile"] = what
    table.notes += [f"{word}: {meaning}." for word, meaning in lines.items()]
    return table


def verdict_tables(comparison: Verdicts) -> list[TextTable]:
    """Return numbers per published table, agreement of orders, claims, numbers left out."""
    left_out = TextTable("Left out", ["Table", "Filter", "Metric", "Published", "Why"])
    for p in comparison.left_out:
        cells = f"{p.paper}, {p.table}", p.filter, _place(p), printed(p), p.note
        left_out.rows.append([*map(Text, cells)])
    others = [_rank_table(comparison.ranks), _claim_table(comparison.claims), left_out]
    return [*_number_tables(comparison), *(table for table in others if table.rows)]


def _number_tables(comparison: Verdicts) -> list[TextTable]:
    """Tabulate verdicts per published table, and of those with several readings all of them."""
    places: dict[str, list[Reproduced]] = {}
    for number in comparison.numbers:
        published = number.best.published
        places.setdefault(f"{published.paper}, {published.table}", []).append(number)
    tables = []
    for place, numbers in places.items():
        best = [_row(number.best, number.readings) for number in numbers]
        table = TextTable(f"{place}: published and measured", _HEADS, best)
        tables.append(_explained(table, [number.best.verdict for number in numbers]))
        # A search's row stands for many readings: only the rows themselves are listed.
        several = (number.rows for number in numbers if len(number.rows) > 1)
        readings = list(chain.from_iterable(several))
        if readings:
            table = TextTable(
                f"{place}: every reading", _HEADS, [_row(row, row.tried) for row in readings]
            )
            tables.append(_explained(table, [row.verdict for row in readings]))
    return tables


_HEADS = ["Filter", "Metric", "Verdict", "Published", "Measured", "z", "z without a batch", "Note"]


def _row(row: Compared, readings: int = 1) -> list[Text]:
    p, verdict = row.published, row.verdict
    name = row.label if row.label.startswith(p.filter) else f"{p.filter}: {row.label}"
    tried = f" (best of {readings})" if readings > 1 else ""
    return [
        Text((name if row.label else p.filter) + tried),
        Text(_place(p)),
        Text(verdict.word),
        Text(printed(p), None if isinstance(p.value, str) else p.value),
        Text(_measured(row), row.measured.value),
        Text(_z(verdict.z), verdict.z),
        Text(_parts(verdict)),
        Text(_note(row)),
    ]


def _note(row: Compared | ClaimVerdict) -> str:
    return noted("fragile" if row.verdict.fragile else "", row.note)


def _parts(verdict: Verdict) -> str:
    return "; ".join(_z(z) for z in verdict.parts)


def _claim_table(claims: list[ClaimVerdict]) -> TextTable:
    title = "Claims (z: standard errors in the claim's favor, weakest comparison)"
    heads = ["Claim", "Verdict", "z", "z without a batch", "Paired", "Weakest comparison; note"]
    table = TextTable(title, [*heads, "Source"])
    for row in claims:
        source, z = f"{row.claim.paper}, {row.claim.source}".rstrip(", "), row.verdict.z
        cells = [row.claim.claim, row.verdict.word, _z(z), _parts(row.verdict), _yes(row.paired)]
        cells += [_note(row), source]
        table.rows.append([Text(c, z if i == 2 else None) for i, c in enumerate(cells)])
    return _explained(table, [row.verdict for row in claims])


def _rank_table(ranks: list[Ranked]) -> TextTable:
    heads = ["Table", "Column", "Filters", "Kendall's tau"]
    table = TextTable("Order of the filters, published against measured (1: the same)", heads)
    for r in ranks:
        cells = [Text(f"{r.paper}, {r.table}"), Text(r.metric), Text(str(r.filters), r.filters)]
        table.rows.append([*cells, Text(f"{r.tau:+.2f}", r.tau)])
    return table


def _place(number: PublishedNumber) -> str:
    return f"{number.metric}, {number.row}" if number.row else number.metric


def printed(number: PublishedNumber) -> str:
    """Return the number with the decimals it is printed with."""
    if isinstance(number.value, str):
        return number.value
    return f"{number.value:.{number.digits}f}"


def _measured(row: Compared) -> str:
    value, stderr = row.measured.estimate
    if isnan(value):
        return "all runs lost" if row.measured.lost else "–"
    if not isfinite(value):
        return "infinite"
    if row.verdict.word == "equal":
        digits = max(DIGITS["per_run.csv"], row.published.significant_digits)
        return f"{value:.{digits}g}"
    return rounded(value, stderr, 4) if stderr else f"{value:.6g}"


def _z(z: float) -> str:
    if isnan(z):
        return "–"
    return f"{z:+.1f}" if abs(z) < 100 else f"{z:+.0f}"


_MOST_REASONS = 5
"""Longer lists are cut; comparison.md has all verdicts."""


def reasons(comparison: Verdicts, runs: int) -> list[str]:
    """Explain why numbers and claims are inconclusive, a line each; ``runs`` of each filter."""
    lines = []
    rows: list[Compared | ClaimVerdict] = [number.best for number in comparison.numbers]
    for row in [*rows, *comparison.claims]:
        if row.verdict.word == UNDECIDED:
            name = row.claim.claim if isinstance(row, ClaimVerdict) else ""
            if isinstance(row, Compared):
                of = row.published
                name = ", ".join(filter(None, (of.filter, of.metric, of.row)))
            lines.append(f"inconclusive: {name}: {_reason(row, runs)}")
    more = len(lines) - _MOST_REASONS
    if more < 2:
        return lines
    return [*lines[:_MOST_REASONS], f"inconclusive: {more} more: comparison.md"]


def _reason(row: Compared | ClaimVerdict, runs: int) -> str:
    verdict, z = row.verdict, abs(row.verdict.z)
    if not isfinite(z) or (isinstance(row, Compared) and row.published.chosen):
        return row.note or "no standard error"
    if isnan(verdict.needed):
        return f"neither within its margin nor beyond it by {DECIDED:g} standard errors"
    if verdict.is_short:
        text = f"{z:.2f} standard errors, and {verdict.needed:g} decide"
        if not verdict.has_sign:
            return f"{text}; no sign of a difference"
        more = run_count(runs_that_decide(runs, z, verdict.needed))
        what = f"{more} runs" if runs > 1 else f"a recording {more} times as long"
        return f"{text}; a difference as large as measured needs about {what}"
    part = verdict.weak_part
    if part is None:
        return row.note
    return f"{z:.1f} standard errors over all runs, but {abs(part):.1f} without one batch of them"
