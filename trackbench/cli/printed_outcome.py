"""Outcome of `run`, `sweep` and `tune` as it is printed: ranking, conclusions, verdicts, notes."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from trackbench.cli.json_objects import echo_line, report_as_data

if TYPE_CHECKING:
    from trackbench.api import Report


def print_outcome(
    report: "Report", config: Path, json: bool, markdown: bool, everything: bool, is_sweep: bool
) -> None:
    """Print the ranking, further conclusions, counts of verdicts, and the place of the results.

    Tables are aligned, or in Markdown if ``markdown``. With ``json`` stdout gets one JSON object
    instead. ``everything`` prints all tables and notes. ``config`` is the config as the user named it,
    and ``is_sweep`` is true for the command `sweep`.
    """
    if json:
        echo_line(report_as_data(report))
    else:
        from trackbench.cli.terminal_tables import print_lines, print_tables

        # Over a grid the ranking has further tables: the numbers of each scenario, or each filter's
        # settings. They are printed for a sweep, too, and for a config without tables of its own.
        with_further_tables = everything or is_sweep or not report.config.get("tables")
        tables = report.ranking(with_further_tables)
        # There is no ranking if no filter has a number to rank, or if it failed.
        if everything or not tables:
            tables += [table.texts() for table in report.tables.values()]
        print_tables(tables, markdown)
        print_lines([*report.answer, *_verdict_lines(report, config)])
    notes = report.notes if everything else report.run_notes
    for note in notes:
        typer.echo(f"note: {note}", err=True)
    for failure in report.failed:
        typer.echo(f"error: {failure}", err=True)
    line = f"results in {report.folder}/"
    if not everything:
        line += ": report.html has tables and figures of these runs; --all prints the tables"
    typer.echo(line, err=True)


def _verdict_lines(report: "Report", config: Path) -> Iterator[str]:
    """Yield lines on the verdicts that compare the results with a paper's numbers and claims.

    These are the numbers of verdicts by word, and the first claim. With fewer runs than the experiment
    has, a line names the number of runs that verdicts need. ``config`` is that of the report.
    """
    from trackbench.report.verdicts.verdict_counts import bars, needed_runs

    need_of_runs = needed_runs(report.comparison)  # a sentence, or empty
    if need_of_runs:
        yield f"{need_of_runs}: trackbench run {config}"
    # A bar has the verdicts on all numbers, or on all claims: a tally for each word.
    verdict_bars = bars(report.comparison)
    if not verdict_bars:
        return
    texts = []
    for bar in verdict_bars:
        numbers = ", ".join(f"{tally.number} {tally.verb}" for tally in bar.parts)
        texts.append(f"{bar.title}: {numbers}")
    yield f"Verdicts on {'; on '.join(texts)}. Reasons: trackbench compare {report.folder}"
    if report.comparison.claims:
        first = report.comparison.claims[0]
        yield f"The first claim: {first.claim.claim}: {first.verdict.word}."
