"""The verdicts as files: comparison.csv, comparison.md and claims.csv; paired.csv has the pairs."""

from collections import Counter
from collections.abc import Iterable, Sequence
from math import isfinite, isnan
from typing import Any, NamedTuple

from trackbench.atomic_files import remove, write_text
from trackbench.config.published_csv import PublishedNumber
from trackbench.csv_writer import write_csv
from trackbench.errors import counted
from trackbench.report.pairs_of_filters import COLUMNS
from trackbench.report.table import Text, TextTable, markdown_text, rounded
from trackbench.report.tables_and_figures import Results
from trackbench.report.verdicts.claims import ClaimVerdict, noted
from trackbench.report.verdicts.cpu_times import time_verdicts, write_time_verdicts
from trackbench.report.verdicts.published_numbers import Compared, Ranked, Reproduced, Verdicts
from trackbench.results.file_names import TIME_VERDICTS
from trackbench.results.significant_digits import DIGITS
from trackbench.statistics.verdict_rules import (
    HOW_DECIDED,
    MEANINGS,
    NOT_MEASURED,
    TOO_FEW_RUNS,
    UNDECIDED,
    Verdict,
)

_VERBS = ("agrees", "differs", "holds", "fails")
"""Words of verdicts that are verbs, and have no "s" if several agree, differ, ..."""


class Tally(NamedTuple):
    """Number of verdicts of one word."""

    number: int
    word: str
    verb: str
    """the word in a sentence, such as "differ" of several"""
    fragile: int
    """number of these verdicts that are fragile"""


class Bar(NamedTuple):
    """The verdicts on numbers, or on claims."""

    title: str
    """what is counted, such as ``11 claims``"""
    parts: list[Tally]
    """one for each word that occurs"""

    @property
    def words(self) -> str:
        """Bar as a line: ``11 claims: 10 agree (2 fragile), 1 differs``."""
        texts = []
        for tally in self.parts:
            text = f"{tally.number} {tally.verb}"
            if tally.fragile:
                text += f" ({tally.fragile} fragile)"
            texts.append(text)
        return f"{self.title}: {', '.join(texts)}"


_WORDS = (
    *("equal", "agrees", "compatible", "differs", "holds", "fails"),
    *(UNDECIDED, TOO_FEW_RUNS, NOT_MEASURED),
)
"""Words of verdicts, in the order in which they are counted."""


def tallies(verdicts: Iterable[Compared | ClaimVerdict]) -> list[Tally]:
    """Count the verdicts of each word, in the order of `_WORDS`; leave out words without a verdict."""
    rows = list(verdicts)
    numbers = Counter(row.verdict.word for row in rows)
    fragile = Counter(row.verdict.word for row in rows if row.verdict.fragile)
    counts = []
    for word in _WORDS:
        number = numbers[word]
        if number:
            verb = word  # 1 agrees, 2 agree
            if word == TOO_FEW_RUNS:
                verb = f"with {word}"
            elif number > 1 and word in _VERBS:
                verb = word.removesuffix("s")
            counts.append(Tally(number=number, word=word, verb=verb, fragile=fragile[word]))
    return counts


def bars(comparison: Verdicts) -> list[Bar]:
    """Return counts of the verdicts on numbers, on words on a bias and on claims, to be drawn as bars.

    A bar without any verdict is left out. The list is empty if the results have fewer runs than the
    experiment: see `needed_runs`.
    """
    if comparison.experiment_runs is not None:
        return []
    return _all_bars(comparison)


def needed_runs(comparison: Verdicts) -> str:
    """Return the sentence on verdicts that need more runs; empty if the results have all runs."""
    titles = " and ".join(bar.title for bar in _all_bars(comparison))
    if comparison.experiment_runs is None or not titles:
        return ""
    return f"Verdicts on {titles} need all {comparison.experiment_runs} runs"


def _all_bars(comparison: Verdicts) -> list[Bar]:
    """Return the bars of numbers, words on a bias and claims; leave out those without a verdict."""
    # A published value that is a text is a word on a bias, and is counted apart from numbers.
    words = []
    numbers = []
    for reproduced in comparison.numbers:
        row = reproduced.best
        if isinstance(row.published.value, str):
            words.append(row)
        else:
            numbers.append(row)
    claims = comparison.claims
    margin = " on a bias, by a margin chosen here"
    all_bars = [
        Bar(counted(len(numbers), "published number"), tallies(numbers)),
        Bar(counted(len(words), "published word") + margin, tallies(words)),
        Bar(counted(len(claims), "claim"), tallies(claims)),
    ]
    return [bar for bar in all_bars if bar.parts]


NUMBER_HEADER = [
    *["table", "filter", "metric", "published", "measured", "stderr", "z", "verdict", "note"],
    *["paper", "row", "label", "expression", "runs", "published_runs"],
    *["z_without_batch", "fragile", "best"],
]
"""Columns of comparison.csv, in the order of the values in a row of `number_rows`."""
CLAIM_HEADER = [
    *["claim", "verdict", "z", "paired", "note"],
    *["paper", "source", "z_without_batch", "fragile"],
]
"""Columns of claims.csv, in the order of the values in a row of `claim_rows`."""
FILES = ("comparison.csv", "comparison.md", "claims.csv")


def write_comparison(results: Results, comparison: Verdicts) -> None:
    """Write comparison.csv, comparison.md, claims.csv and the verdicts on CPU times.

    If nothing is published about the experiment, earlier files are removed.
    """
    folder = results.target
    write_time_verdicts(results)
    if not (comparison.rows or comparison.claims or comparison.left_out):
        for name in FILES:
            remove(folder / name)
        return
    numbers = number_rows(comparison)
    claims = claim_rows(comparison)
    write_csv(folder / "comparison.csv", NUMBER_HEADER, map(_csv_cells, numbers))
    write_csv(folder / "claims.csv", CLAIM_HEADER, map(_csv_cells, claims))
    write_text(folder / "comparison.md", markdown(results, comparison))


def write_paired(results: Results) -> None:
    """Write paired.csv: the differences of every two filters on common runs, at each grid point."""
    rows: list[list[Any]] = []
    for point, pairs in results.pairs:
        rows += [[*point.values(), *pair.cells] for pair in pairs]
    write_csv(results.target / "paired.csv", [*results.grid, *COLUMNS], rows)


def number_rows(comparison: Verdicts) -> list[dict[str, object]]:
    """Return the rows of comparison.csv as data, one for each reading of each number.

    A reading is an interpretation of the paper. A number counts by its best reading, whose row has True
    under ``counts``, the column ``best``.
    """
    # The rows contain arrays and cannot be hashed, so they are identified by their `id`.
    best = {id(number.best) for number in comparison.numbers}
    rows: list[dict[str, object]] = []
    for compared in comparison.rows:
        published = compared.published
        measured = compared.measured
        verdict = compared.verdict
        rows.append(
            {
                "table": published.table,
                "filter": published.filter,
                "metric": published.metric,
                "published": published.value,
                "measured": measured.value,
                "stderr": measured.stderr,
                "z": verdict.z,
                "verdict": verdict.word,
                "note": compared.note,
                "paper": published.paper,
                "row": published.row,
                "label": compared.label,
                "expression": str(published.expression or ""),
                "runs": measured.runs,
                "published_runs": published.runs,
                "z_without_batch": verdict.parts,
                "fragile": verdict.fragile,
                "counts": id(compared) in best,
            }
        )
    return rows


def claim_rows(comparison: Verdicts) -> list[dict[str, object]]:
    """Return the rows of claims.csv as data."""
    rows: list[dict[str, object]] = []
    for judged in comparison.claims:
        claim = judged.claim
        verdict = judged.verdict
        rows.append(
            {
                "claim": claim.claim,
                "verdict": verdict.word,
                "z": verdict.z,
                "paired": judged.paired,
                "note": judged.note,
                "paper": claim.paper,
                "source": claim.source,
                "z_without_batch": verdict.parts,
                "fragile": verdict.fragile,
            }
        )
    return rows


def _csv_cells(row: dict[str, object]) -> list[object]:
    """Return the values of a row of data as cells of a CSV file.

    A truth value is written as yes or no, None as an empty cell. A tuple has the z without each batch of
    runs.
    """
    cells: list[object] = []
    for value in row.values():
        if isinstance(value, bool):
            cells.append(_yes_or_no(value))
        elif isinstance(value, tuple):
            cells.append(_zs_text(value))
        elif value is None:
            cells.append("")
        else:
            cells.append(value)
    return cells


def _yes_or_no(flag: bool) -> str:
    return "yes" if flag else "no"


def summary_lines(comparison: Verdicts) -> list[str]:
    """Count the verdicts: a line on numbers, one on words on a bias, one on claims.

    A number with several readings counts once. A last line counts the numbers left out. If the results
    have fewer runs than the experiment, the only line is how many runs the verdicts need.
    """
    needed = needed_runs(comparison)
    if needed:
        return [f"{needed}."]
    lines = [bar.words for bar in bars(comparison)]
    with_readings = [number for number in comparison.numbers if number.readings > 1]
    if with_readings:
        agree = sum(number.best.verdict.word == "agrees" for number in with_readings)
        remark = (
            f"{len(with_readings)} were tried under several readings, of which {agree} agree in one"
        )
        lines[0] += f"; {remark}"  # the first line is that of the numbers
    if comparison.left_out:
        lines.append(f"{counted(len(comparison.left_out), 'printed number')} left out")
    return lines


def markdown(results: Results, comparison: Verdicts) -> str:
    """Return comparison.md: counts, published numbers per table, rank agreement, claims."""
    counts = "\n".join(f"- {line}" for line in summary_lines(comparison))
    paragraphs = [f"# Published and measured: {markdown_text(results.title)}", counts]
    paragraphs += [table.markdown().rstrip() for table in verdict_tables(comparison)]
    if time_verdicts(results):
        times = f"Verdicts on CPU times stand in {TIME_VERDICTS}: they depend on the machine."
        paragraphs.append(times)
    return "\n\n".join(paragraphs) + "\n"


def _add_meanings(table: TextTable, verdicts: Sequence[Verdict]) -> None:
    """Add a note with the meaning of each word that occurs in a table of ``verdicts``."""
    words = {verdict.word for verdict in verdicts}
    meanings = {word: meaning for word, meaning in MEANINGS.items() if word in words}
    if words & {"differs", "holds", "fails"}:  # their meanings have the word "significant"
        meanings["significant"] = HOW_DECIDED
    if any(verdict.fragile for verdict in verdicts):
        meaning = "another seed, one run fewer or three far ones more could change the verdict"
        meanings["fragile"] = meaning
    table.notes += [f"{word}: {meaning}." for word, meaning in meanings.items()]


def verdict_tables(comparison: Verdicts) -> list[TextTable]:
    """Return tables of the verdicts: numbers per published table, orders of the filters, claims.

    A last table has the numbers that are left out, as no filter of the experiment measures them.
    """
    left_out = TextTable("Left out", ["Table", "Filter", "Metric", "Published", "Why"])
    for number in comparison.left_out:
        table = f"{number.paper}, {number.table}"
        cells = [table, number.filter, _metric_and_row(number), printed(number), number.note]
        left_out.rows.append([Text(cell) for cell in cells])
    others = [_rank_table(comparison.ranks), _claim_table(comparison.claims), left_out]
    return [*_number_tables(comparison), *(table for table in others if table.rows)]


def _number_tables(comparison: Verdicts) -> list[TextTable]:
    """Tabulate the verdicts of each published table by each number's best reading.

    A second table lists every reading of the numbers that have several.
    """
    numbers_by_table: dict[str, list[Reproduced]] = {}
    for number in comparison.numbers:
        published = number.best.published
        name = f"{published.paper}, {published.table}"
        numbers_by_table.setdefault(name, []).append(number)
    tables = []
    for name, numbers in numbers_by_table.items():
        best = [_number_row(number.best, number.readings) for number in numbers]
        table = TextTable(f"{name}: published and measured", _HEADS, best)
        _add_meanings(table, [number.best.verdict for number in numbers])
        tables.append(table)
        # Numbers with several rows. A search has one row, although it stands for many readings.
        readings: list[Compared] = []
        for number in numbers:
            if len(number.rows) > 1:
                readings += number.rows
        if readings:
            rows = [_number_row(row, row.tried) for row in readings]
            table = TextTable(f"{name}: every reading", _HEADS, rows)
            _add_meanings(table, [row.verdict for row in readings])
            tables.append(table)
    return tables


_HEADS = ["Filter", "Metric", "Verdict", "Published", "Measured", "z", "z without a batch", "Note"]


def _number_row(row: Compared, readings: int = 1) -> list[Text]:
    """Write the cells of a published number under `_HEADS`.

    ``readings`` is the number of interpretations of the paper of which ``row`` is the best.
    """
    published = row.published
    # The paper's name of the filter and its label in the experiment; the label alone if it begins with
    # that name.
    name = published.filter
    if row.label.startswith(published.filter):
        name = row.label
    elif row.label:
        name = f"{published.filter}: {row.label}"
    if readings > 1:
        name += f" (best of {readings})"
    printed_number = None if isinstance(published.value, str) else published.value
    return [
        Text(name),
        Text(_metric_and_row(published)),
        Text(row.verdict.word),
        Text(printed(published), number=printed_number),
        Text(_measured_text(row), number=row.measured.value),
        Text(_z_text(row.verdict.z), number=row.verdict.z),
        Text(_zs_text(row.verdict.parts)),
        Text(_note_with_fragile(row)),
    ]


def _note_with_fragile(row: Compared | ClaimVerdict) -> str:
    return noted("fragile" if row.verdict.fragile else "", row.note)


def _zs_text(zs: Iterable[float]) -> str:
    """Write the z without each batch of runs in turn: ``+5.1; +4.8; +6.0; +5.3``."""
    return "; ".join(map(_z_text, zs))


def _claim_table(claims: list[ClaimVerdict]) -> TextTable:
    """Tabulate the verdicts on claims."""
    title = "Claims (z: standard errors in the claim's favor, weakest comparison)"
    heads = ["Claim", "Verdict", "z", "z without a batch", "Paired", "Weakest comparison; note"]
    table = TextTable(title, [*heads, "Source"])
    for row in claims:
        z = row.verdict.z
        table.rows.append(
            [
                Text(row.claim.claim),
                Text(row.verdict.word),
                Text(_z_text(z), number=z),
                Text(_zs_text(row.verdict.parts)),
                Text(_yes_or_no(row.paired)),
                Text(_note_with_fragile(row)),
                Text(f"{row.claim.paper}, {row.claim.source}".rstrip(", ")),
            ]
        )
    _add_meanings(table, [row.verdict for row in claims])
    return table


def _rank_table(ranks: list[Ranked]) -> TextTable:
    """Tabulate how well the measured order of the filters agrees with the published one."""
    heads = ["Table", "Column", "Filters", "Kendall's tau"]
    table = TextTable("Order of the filters, published against measured (1: the same)", heads)
    for rank in ranks:
        table.rows.append(
            [
                Text(f"{rank.paper}, {rank.table}"),
                Text(rank.metric),
                Text(str(rank.filters), number=rank.filters),
                Text(f"{rank.tau:+.2f}", number=rank.tau),
            ]
        )
    return table


def _metric_and_row(number: PublishedNumber) -> str:
    """Name the metric of a published number, and the row of its table if it has one."""
    if not number.row:
        return number.metric
    return f"{number.metric}, {number.row}"


def printed(number: PublishedNumber) -> str:
    """Return the number with the decimals it is printed with."""
    if isinstance(number.value, str):
        return number.value
    return f"{number.value:.{number.digits}f}"


def _measured_text(row: Compared) -> str:
    """Write what is measured for a number: with its standard error, or in words if it is not finite.

    A number that equals the printed one is written with all digits that per_run.csv stores, or with as
    many as the paper prints if these are more.
    """
    value, stderr = row.measured.estimate
    if isnan(value):
        return "all runs lost" if row.measured.lost else "–"
    if not isfinite(value):
        return "infinite"
    if row.verdict.word == "equal":
        digits = max(DIGITS["per_run.csv"], row.published.significant_digits)
        return f"{value:.{digits}g}"
    if not stderr:  # zero: the exact number of a linear filter, or the same value in all runs
        return f"{value:.6g}"
    return rounded(value, stderr, 4)


def _z_text(z: float) -> str:
    """Write z with its sign and one decimal, a large one without decimals."""
    if isnan(z):
        return "–"
    if abs(z) < 100:
        return f"{z:+.1f}"
    return f"{z:+.0f}"
