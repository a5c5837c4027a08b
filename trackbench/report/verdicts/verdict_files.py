"""The verdicts as files: comparison.csv, comparison.md, claims.csv, time_verdicts.csv, paired.csv."""

from typing import Any

from trackbench.atomic_files import ensure_folder, remove, write_text
from trackbench.csv_writer import write_csv
from trackbench.report.markdown_table import markdown_text
from trackbench.report.pairs_of_filters import COLUMNS
from trackbench.report.tables_and_figures import Results
from trackbench.report.verdicts.all_verdicts import Verdicts
from trackbench.report.verdicts.cpu_time_verdicts import time_verdicts
from trackbench.report.verdicts.verdict_counts import summary_lines
from trackbench.report.verdicts.verdict_tables import verdict_tables, yes_or_no, zs_text
from trackbench.results.file_names import TIME_VERDICTS
from trackbench.results.links import within

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
TIME_HEADER = [
    *["statement", "verdict", "measured", "low", "high", "wanted_low", "wanted_high"],
    *["filters", "operations", "paper", "source", "note"],
]


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
    under ``counts``; the file calls this column ``best``. Under ``z_without_batch`` is a tuple of the z
    without each batch of the runs in turn (``verdict.parts``), which show if one batch decides.
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
    """Return the rows of claims.csv as data.

    Under ``z_without_batch`` is a tuple of z in favor of the claim without each batch of the runs in
    turn (``verdict.parts``), each that of the weakest comparison.
    """
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

    A truth value is written as yes or no, None as an empty cell. A tuple has the z of a verdict without
    each batch of the runs in turn, and is written as one text.
    """
    cells: list[object] = []
    for value in row.values():
        if isinstance(value, bool):
            cells.append(yes_or_no(value))
        elif isinstance(value, tuple):
            cells.append(zs_text(value))
        elif value is None:
            cells.append("")
        else:
            cells.append(value)
    return cells


def markdown(results: Results, comparison: Verdicts) -> str:
    """Return comparison.md: counts, published numbers per table, rank agreement, claims."""
    counts = "\n".join(f"- {line}" for line in summary_lines(comparison))
    paragraphs = [f"# Published and measured: {markdown_text(results.title)}", counts]
    paragraphs += [table.markdown().rstrip() for table in verdict_tables(comparison)]
    if time_verdicts(results):
        times = f"Verdicts on CPU times stand in {TIME_VERDICTS}: they depend on the machine."
        paragraphs.append(times)
    return "\n\n".join(paragraphs) + "\n"


def write_time_verdicts(results: Results) -> None:
    """Write the verdicts on times, or remove an old file if nothing is published about times."""
    verdicts = time_verdicts(results)
    path = results.target / TIME_VERDICTS
    if not verdicts:
        remove(path)
        return
    ensure_folder(within(results.target, "run"))
    rows = []
    for verdict in verdicts:
        published = verdict.row
        wanted_low, wanted_high = verdict.wanted  # the values that agree with the row
        rows.append(
            [
                *[verdict.statement, verdict.word, verdict.measured, verdict.low, verdict.high],
                *[wanted_low, wanted_high],
                *[verdict.filters, verdict.operations],
                *[published.paper, published.source, published.note],
            ]
        )
    write_csv(path, TIME_HEADER, rows)
