"""Outcome of a command as it is printed: ranking, conclusions, verdicts, notes, written files."""

from collections.abc import Callable
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
        from trackbench.config.added_tables_and_figures import exhibits_without_tuning
        from trackbench.report.verdicts.verdict_counts import verdict_lines

        # Over a grid the ranking has further tables: the numbers of each scenario, or each filter's
        # settings. They are printed for a sweep, too, and for a config without tables of its own.
        names_table = bool(exhibits_without_tuning(report.config.get("tables")))
        with_further_tables = everything or is_sweep or not names_table
        tables = report.ranking(with_further_tables)
        # There is no ranking if no filter has a number to rank, or if it failed.
        if everything or not tables:
            tables += [table.texts() for table in report.tables.values()]
        print_tables(tables, markdown)
        print_lines([*report.answer, *verdict_lines(report.comparison, report.folder, config)])
    notes = report.notes if everything else report.run_notes
    for note in notes:
        typer.echo(f"note: {note}", err=True)
    for failure in report.failed:
        typer.echo(f"error: {failure}", err=True)
    line = f"results in {report.folder}/"
    if not everything:
        line += ": report.html has tables and figures of these runs; --all prints the tables"
    typer.echo(line, err=True)


def print_written_files(write: Callable[[], list[Path]]) -> None:
    """Call ``write`` and print the files that it wrote; if some outputs failed, exit with 1.

    Each failed table, figure or sentence is printed with its reason.
    """
    from trackbench.report.output_errors import PartialReportError

    failures: list[str] = []
    try:
        paths = write()
    except PartialReportError as error:
        paths = error.written
        failures = error.lines
    for path in paths:
        typer.echo(path)
    for failure in failures:
        typer.echo(f"error: {failure}", err=True)
    if failures:
        raise typer.Exit(1)
