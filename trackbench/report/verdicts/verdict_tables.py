"""Tables of the verdicts: numbers per published table, orders of the filters, claims, CPU times."""

from collections.abc import Iterable
from math import isfinite, isnan

from trackbench.config.published_numbers_and_claims import PublishedNumber
from trackbench.report.markdown_table import Text, TextTable
from trackbench.report.rounded_numbers import number_or_dash, range_in_words, rounded
from trackbench.report.verdicts.all_verdicts import Verdicts
from trackbench.report.verdicts.claim_verdicts import ClaimVerdict
from trackbench.report.verdicts.cpu_time_verdicts import SCATTER, TimeVerdict
from trackbench.report.verdicts.number_verdicts import Compared, Reproduced
from trackbench.report.verdicts.rank_agreement import Ranked
from trackbench.results.significant_digits import DIGITS
from trackbench.statistics.verdict_meanings import meanings_of
from trackbench.statistics.verdict_rules import noted

TIME_LEGEND = (
    "CPU times are of the machine that ran the experiment. A ratio is decided only beyond a factor "
    f"of {SCATTER:g} either way. Operations are per run and step: evaluations of a likelihood, updates "
    "of a covariance; - where a filter does not note them."
)


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

    A reading is an interpretation of what the paper leaves open, and has a row of the number. A search,
    by a table of kind `readings`, tries many readings: it has a single row, that of the best, which has
    the number of readings in ``tried``. A second table lists every row of the numbers that have several.
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
        table.notes += meanings_of([number.best.verdict for number in numbers])
        tables.append(table)
        # The second table, of numbers with several rows.
        readings: list[Compared] = []
        for number in numbers:
            if len(number.rows) > 1:
                readings += number.rows
        if readings:
            rows = [_number_row(row, row.tried) for row in readings]
            table = TextTable(f"{name}: every reading", _HEADS, rows)
            table.notes += meanings_of([row.verdict for row in readings])
            tables.append(table)
    return tables


_HEADS = ["Filter", "Metric", "Verdict", "Published", "Measured", "z", "z without a batch", "Note"]


def _number_row(row: Compared, readings: int = 1) -> list[Text]:
    """Write the cells of a published number under `_HEADS`.

    ``readings`` is the number of interpretations of the paper of which ``row`` is the best. The cell "z
    without a batch" has the z without each batch of the runs in turn, ``verdict.parts``. A note calls a
    verdict fragile if other runs could well change its word.
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
        Text(zs_text(row.verdict.parts)),
        Text(_note_with_fragile(row)),
    ]


def _note_with_fragile(row: Compared | ClaimVerdict) -> str:
    return noted("fragile" if row.verdict.fragile else "", row.note)


def zs_text(zs: Iterable[float]) -> str:
    """Write the z without each batch of runs in turn: ``+5.1; +4.8; +6.0; +5.3``."""
    return "; ".join(map(_z_text, zs))


def _claim_table(claims: list[ClaimVerdict]) -> TextTable:
    """Tabulate the verdicts on claims.

    The column "z without a batch" has the z without each batch of the runs in turn, ``verdict.parts``.
    """
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
                Text(zs_text(row.verdict.parts)),
                Text(yes_or_no(row.paired)),
                Text(_note_with_fragile(row)),
                Text(f"{row.claim.paper}, {row.claim.source}".rstrip(", ")),
            ]
        )
    table.notes += meanings_of([row.verdict for row in claims])
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
    return rounded(value, stderr, digits=4)  # four digits if the standard error is NaN


def _z_text(z: float) -> str:
    """Write z with its sign and one decimal, a large one without decimals."""
    if isnan(z):
        return "–"
    if abs(z) < 100:
        return f"{z:+.1f}"
    return f"{z:+.0f}"


def yes_or_no(flag: bool) -> str:
    """Write a truth value as a word."""
    return "yes" if flag else "no"


def time_tables(verdicts: Iterable[TimeVerdict]) -> list[TextTable]:
    """Return a table of the verdicts on times; none if there is no verdict."""
    heads = ["Statement", "Verdict", "Filters", "Time, ratio", "95 %", "Published", "Operations"]
    table = TextTable("CPU times, on this machine", [*heads, "Source"], notes=[TIME_LEGEND])
    for verdict in verdicts:
        table.rows.append(
            [
                Text(verdict.statement),
                Text(verdict.word),
                Text(verdict.filters),
                Text(number_or_dash(verdict.measured), number=verdict.measured),
                Text(range_in_words(verdict.low, verdict.high)),
                Text(range_in_words(*verdict.wanted)),
                Text(verdict.operations),
                Text(f"{verdict.row.paper}, {verdict.row.source}".rstrip(", ")),
            ]
        )
    if not table.rows:
        return []
    return [table]
