"""Command `compare`: stored results against published numbers, or against another folder."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trackbench.cli.json_objects import echo_line
from trackbench.cli.options import (
    Json,
)

if TYPE_CHECKING:
    pass


from trackbench.cli.options import MARKDOWN, Folder, one_of


def compare(
    folder: Folder,
    other: Annotated[
        Path | None, typer.Argument(metavar="DIR2", help="results folder to compare the first with")
    ] = None,
    figure_file: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help="figure of two folders: .png, .svg or .pdf"),
    ] = None,
    format_: Annotated[
        str, typer.Option("--format", metavar=MARKDOWN, help="print tables as Markdown")
    ] = "",
    json: Json = False,
) -> None:
    """Compare stored results with the published numbers and claims, or with another folder."""
    if format_:
        one_of("--format", format_, (MARKDOWN,))
    if other is not None:
        compare_two(folder, other, figure_file, json, format_ == MARKDOWN)
        return
    if figure_file is not None:
        raise typer.BadParameter("--out draws two folders: trackbench compare DIR DIR2 --out FILE")
    from trackbench.commands import stored_results
    from trackbench.report.tables_and_figures import Results
    from trackbench.report.verdicts.cpu_time_verdicts import time_tables, time_verdicts
    from trackbench.report.verdicts.verdict_counts import summary_lines
    from trackbench.report.verdicts.verdict_files import claim_rows, markdown, number_rows
    from trackbench.report.verdicts.verdict_tables import verdict_tables

    verdicts = stored_results.compare(folder)
    results = Results(folder)
    times = time_tables(time_verdicts(results))
    if json:
        for row in (*number_rows(verdicts), *claim_rows(verdicts)):
            echo_line(row)
        return
    if not verdicts.rows and not verdicts.claims and not times:
        text = "this experiment names no published numbers; compare two folders: trackbench compare"
        typer.echo(f"{folder}: {text} {folder} DIR2", err=True)
        return
    if format_:
        typer.echo("\n".join([markdown(results, verdicts), *(table.markdown() for table in times)]))
        return
    from trackbench.cli.terminal_tables import print_lines, print_tables
    from trackbench.report.verdicts.inconclusive_reasons import reasons

    print_lines([*summary_lines(verdicts), ""])
    print_tables([*verdict_tables(verdicts), *times])
    print_lines(reasons(verdicts, results.config["runs"]))


def compare_two(
    first: Path, second: Path, figure_file: Path | None, json: bool, markdown: bool = False
) -> None:
    """Print how the numbers of the second folder differ from those of the first.

    Also draw the differences to ``figure_file`` unless it is None.
    """
    from trackbench.errors import UserError, counted
    from trackbench.report import compare_folders as comparison
    from trackbench.report.compare_folders import compare_folders
    from trackbench.report.folder_check import open_with_notes
    from trackbench.statistics.significance_rules import EQUAL

    # Step 1: compare.
    rows, why_not_paired = compare_folders(open_with_notes(first), open_with_notes(second))
    if not rows:
        raise UserError(f"{first} and {second} have no filter, metric and grid point in common")
    names = (first.name, second.name)
    if first.name == second.name:
        names = (str(first), str(second))
    if figure_file is not None:
        comparison.save(comparison.draw(rows, names), figure_file)
    if json:
        for row in rows:
            echo_line(row.fields)
        return
    # Step 2: a table of the primary numbers that changed, or, if there are none, of all that changed.
    # Primary are errors, scores, shares of runs and the ANEES of whole runs.
    if why_not_paired:
        pairing = f"independent: {why_not_paired}"
    else:
        common_runs = max(row.difference.runs for row in rows)
        pairing = f"paired on {counted(common_runs, 'common run')}"
    title = f"{names[1]} against {names[0]}, {pairing}"
    changed = [row for row in rows if row.how != EQUAL]
    shown = [row for row in changed if row.is_primary] or changed
    # Rows of equal numbers let a note name the filters that did not change.
    table = comparison.table_of(
        title, [row for row in rows if row in shown or row.how == EQUAL], names
    )
    if len(changed) > len(shown):
        number = len(changed) - len(shown)
        table.notes.append(f"{number} more of windows, components and diagnostics: --json")
    typer.echo(table.markdown() if markdown else table.aligned())
    typer.echo(comparison.conclusion(rows, names))
