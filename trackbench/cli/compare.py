"""Command `compare`: stored results against published numbers, or against another folder."""

from pathlib import Path
from typing import Annotated

import typer

from trackbench.cli.json_objects import echo_line
from trackbench.cli.options import MARKDOWN, Folder, Json, one_of


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
    from trackbench.commands import read_and_rewrite_stored_results
    from trackbench.report.tables_and_figures import Results
    from trackbench.report.verdicts.cpu_time_verdicts import time_verdicts
    from trackbench.report.verdicts.verdict_counts import summary_lines
    from trackbench.report.verdicts.verdict_files import claim_rows, markdown, number_rows
    from trackbench.report.verdicts.verdict_tables import time_tables, verdict_tables

    verdicts = read_and_rewrite_stored_results.compare(folder)
    results = Results(folder)
    # Verdicts on CPU times, as tables for people; the JSON rows have only the verdicts that every
    # machine computes again.
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
    """Print how the numbers of the second results folder differ from those of the first.

    Print a JSON object for each number with ``json``, else a table of the numbers that changed, in
    Markdown if ``markdown``. Print also what only one of the folders has, such as a filter that failed
    in the other one. Draw the differences to ``figure_file`` unless it is None. Raises UserError for
    folders without a common number.
    """
    from trackbench.errors import UserError
    from trackbench.report.folder_check import open_with_notes
    from trackbench.report.folder_comparison import table_figure_and_sentences
    from trackbench.report.folder_comparison.numbers_and_pairing import compare_folders
    from trackbench.report.folder_comparison.numbers_of_one_folder import numbers_of_one_folder

    # Step 1: compare.
    first_results = open_with_notes(first)
    second_results = open_with_notes(second)
    rows, why_not_paired = compare_folders(first_results, second_results)
    names = (first.name, second.name)
    if first.name == second.name:
        names = (str(first), str(second))
    one_sided = numbers_of_one_folder(first_results, second_results)
    sentences = [item.sentence(names) for item in one_sided]
    if not rows:
        message = f"{first} and {second} have no filter, metric and grid point in common"
        raise UserError(message + "".join(f"; {sentence}" for sentence in sentences))
    if figure_file is not None:
        table_figure_and_sentences.save(table_figure_and_sentences.draw(rows, names), figure_file)
    if json:
        for row in rows:
            echo_line(row.fields)
        for item in one_sided:
            for line in item.lines:
                echo_line(line)
        return
    # Step 2: print the numbers that changed.
    table = table_figure_and_sentences.table_of_changes(rows, names, why_not_paired)
    typer.echo(table.markdown() if markdown else table.aligned())
    typer.echo(table_figure_and_sentences.conclusion(rows, names))
    # In Markdown a line of text goes on in the paragraph of the line before.
    for sentence in sentences:
        typer.echo(f"\n{sentence}" if markdown else sentence)
