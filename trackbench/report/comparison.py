"""The verdicts as files: comparison.csv, comparison.md and claims.csv; the pairs as paired.csv."""

from collections import Counter
from collections.abc import Iterable
from math import isfinite, isnan

from trackbench.experiment.files import remove, write_csv, write_text
from trackbench.experiment.published import PublishedNumber
from trackbench.report.paired import Pair
from trackbench.report.results import Results
from trackbench.report.table import rounded
from trackbench.report.text import Text, TextTable
from trackbench.report.verdicts import Compared, Comparison, Judged, Ranked

NUMBER_HEADER = [
    *["table", "filter", "metric", "published", "measured", "stderr", "z", "verdict", "note"],
    *["paper", "row", "label", "expression", "runs", "published_runs"],
]
CLAIM_HEADER = ["claim", "verdict", "z", "paired", "note", "paper", "source"]
FILES = ("comparison.csv", "comparison.md", "claims.csv")


def write_comparison(results: Results, comparison: Comparison) -> None:
    """Write the verdicts, or take away old ones if nothing is published about the experiment."""
    folder = results.target
    if not comparison.numbers and not comparison.claims:
        for name in FILES:
            remove(folder / name)
        return
    for name, header, rows in (
        ("comparison.csv", NUMBER_HEADER, number_rows(comparison)),
        ("claims.csv", CLAIM_HEADER, claim_rows(comparison)),
    ):
        write_csv(folder / name, header, (row.values() for row in rows))
    write_text(folder / "comparison.md", markdown(results, comparison))


def write_paired(results: Results) -> None:
    """Write paired.csv."""
    rows = [[*point.values(), *pair] for point, pairs in results.pairs for pair in pairs]
    write_csv(results.target / "paired.csv", [*results.grid, *Pair._fields], rows)


def number_rows(comparison: Comparison) -> list[dict[str, object]]:
    """Rows of comparison.csv."""
    rows = []
    for compared in comparison.numbers:
        p, m = compared.published, compared.measured
        cells = [
            *[p.table, p.filter, p.metric, p.value, m.value, m.stderr, compared.z],
            *[compared.verdict, compared.note, p.paper, p.row, compared.label],
            *[p.expression, m.runs, "" if p.runs is None else p.runs],
        ]
        rows.append(dict(zip(NUMBER_HEADER, cells, strict=True)))
    return rows


def claim_rows(comparison: Comparison) -> list[dict[str, object]]:
    """Rows of claims.csv."""
    rows = []
    for judged in comparison.claims:
        paired = "yes" if judged.paired else "no"
        cells = [judged.claim.claim, judged.verdict, judged.z, paired, judged.note]
        cells += [judged.claim.paper, judged.claim.source]
        rows.append(dict(zip(CLAIM_HEADER, cells, strict=True)))
    return rows


def verdict_counts(verdicts: Iterable[str]) -> str:
    """``10 agrees, 2 near, 3 differs``, in a fixed order."""
    order = ("agrees", "near", "differs", "holds", "fails", "not decided", "not measured")
    found = Counter(verdicts)
    return ", ".join(f"{found[word]} {word}" for word in order if found[word])


def summary_lines(comparison: Comparison) -> list[str]:
    """One line on the numbers, one on the claims."""
    lines = []
    for what, rows in (("published numbers", comparison.numbers), ("claims", comparison.claims)):
        if rows:
            lines.append(f"{len(rows)} {what}: {verdict_counts(r.verdict for r in rows)}")
    return lines


def markdown(results: Results, comparison: Comparison) -> str:
    """Counts, published numbers per table, rank agreement, claims."""
    title = results.config["title"] or results.config["name"]
    parts = [
        f"# Published and measured: {title}",
        "\n".join(f"- {line}" for line in summary_lines(comparison)),
    ]
    parts += [table.markdown().rstrip() for table in number_tables(comparison)]
    if comparison.ranks:
        parts.append(rank_table(comparison.ranks).markdown().rstrip())
    if comparison.claims:
        parts.append(claim_table(comparison.claims).markdown().rstrip())
    return "\n\n".join([*parts, LEGEND]) + "\n"


LEGEND = (
    "`agrees`: within three combined standard errors (the paper's from the spread over our runs and "
    "its own number of runs), or equal in the printed digits. `near`: within 10 %. A claim `holds` or "
    "`fails` beyond three standard errors of the difference, on common runs where it is marked paired."
)


def number_tables(comparison: Comparison) -> list[TextTable]:
    """A table of verdicts per published table."""
    heads = ["Filter", "Metric", "Verdict", "Published", "Measured", "z", "Note"]
    tables: dict[tuple[str, str], TextTable] = {}
    for row in comparison.numbers:
        p = row.published
        title = f"{p.paper}, {p.table}: published and measured"
        table = tables.setdefault((p.paper, p.table), TextTable(title, heads))
        name = row.label if row.label.startswith(p.filter) else f"{p.filter}: {row.label}"
        name = name if row.label else p.filter
        metric = f"{p.metric}, {p.row}" if p.row else p.metric
        table.rows.append(
            [
                Text(name),
                Text(metric),
                Text(row.verdict),
                Text(printed(p), None if isinstance(p.value, str) else p.value),
                Text(_measured(row), row.measured.value),
                Text(_z(row.z), row.z),
                Text(row.note),
            ]
        )
    return list(tables.values())


def claim_table(claims: list[Judged]) -> TextTable:
    """Claims with verdict and z."""
    table = TextTable(
        "Claims (z: standard errors in the claim's favour, weakest comparison)",
        ["Claim", "Verdict", "z", "Paired", "Weakest comparison; note", "Source"],
    )
    for row in claims:
        paired = "yes" if row.paired else "no"
        source = f"{row.claim.paper}, {row.claim.source}".rstrip(", ")
        cells = [row.claim.claim, row.verdict, _z(row.z), paired, row.note, source]
        table.rows.append([Text(c, row.z if i == 2 else None) for i, c in enumerate(cells)])
    return table


def rank_table(ranks: list[Ranked]) -> TextTable:
    """Agreement of orders per column."""
    heads = ["Table", "Column", "Filters", "Kendall's tau"]
    table = TextTable("Order of the filters, published against measured (1: the same)", heads)
    for r in ranks:
        cells = [Text(f"{r.paper}, {r.table}"), Text(r.metric), Text(str(r.filters), r.filters)]
        table.rows.append([*cells, Text(f"{r.tau:+.2f}", r.tau)])
    return table


def printed(number: PublishedNumber) -> str:
    """The number with the decimals it is printed with."""
    if isinstance(number.value, str):
        return number.value
    return f"{number.value:.{number.digits}f}"


def _measured(row: Compared) -> str:
    value, stderr = row.measured.estimate
    if isnan(value):
        return "all runs lost" if row.measured.lost else "–"
    if not isfinite(value):
        return "infinite"
    return rounded(value, stderr, 4) if stderr else f"{value:.6g}"


def _z(z: float) -> str:
    if isnan(z):
        return "–"
    return f"{z:+.1f}" if abs(z) < 100 else f"{z:+.0f}"
