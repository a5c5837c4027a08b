"""Commands on a results folder; only `verify` computes runs."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from trackbench.cli.options import MARKDOWN, AllowPlugins, Folder, Json, formats, one_of
from trackbench.cli.output import echo_line


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
    from trackbench.cli.compare import compare_two

    if format_:
        one_of("--format", format_, (MARKDOWN,))
    if other is not None:
        compare_two(folder, other, figure_file, json, format_ == MARKDOWN)
        return
    if figure_file is not None:
        raise typer.BadParameter("--out draws two folders: trackbench compare DIR DIR2 --out FILE")
    from trackbench.commands import stored_results
    from trackbench.report.results import Results
    from trackbench.report.verdicts.comparison_files import (
        claim_rows,
        markdown,
        number_rows,
        summary_lines,
        verdict_tables,
    )
    from trackbench.report.verdicts.cpu_times import time_tables, time_verdicts

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
    from trackbench.cli.screen import print_lines, print_tables
    from trackbench.report.verdicts.inconclusive import reasons

    print_lines([*summary_lines(verdicts), ""])
    print_tables([*verdict_tables(verdicts), *times])
    print_lines(reasons(verdicts, results.config["runs"]))


def plot(
    folder: Folder,
    only: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="this figure or kind of figure only")
    ] = None,
    format_: Annotated[
        str | None,
        typer.Option(
            "--format", help="png, svg, pdf, tex (as pdf), with commas [png,svg; for a paper pdf]"
        ),
    ] = None,
    style: Annotated[
        str,
        typer.Option(
            help="screen, or paper: NAME-column and NAME-page, 3.5 and 7.2 in wide, letters of 8 pt"
        ),
    ] = "screen",
    allow_plugins: AllowPlugins = False,
) -> None:
    """Draw the figures of stored results again, without computing runs."""
    from trackbench.commands import stored_results

    chosen_style: Any = one_of("--style", style, ("screen", "paper"))
    if not format_:
        format_ = "pdf" if chosen_style == "paper" else "png,svg"
    figure_formats = formats(format_)

    def draw() -> list[Path]:
        return stored_results.plot(
            folder,
            formats=figure_formats,
            only=tuple(only or ()),
            allow_plugins=allow_plugins,
            style=chosen_style,
        )

    _print_written_files(draw)


def report(folder: Folder, allow_plugins: AllowPlugins = False) -> None:
    """Write report.html of stored results, or index.html and README.md over a folder of several."""
    from trackbench.commands import stored_results

    _print_written_files(lambda: stored_results.report(folder, allow_plugins))


def _print_written_files(write: Callable[[], list[Path]]) -> None:
    """Call ``write`` and print the files that it wrote; report failures and exit with 1."""
    from trackbench.report.results import PartialReportError

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


def codecheck(
    folders: Annotated[list[Path], typer.Argument(metavar="DIR...", help="results folders")],
    path: Annotated[Path, typer.Option("--out", metavar="FILE", help="file to write")] = Path(
        "codecheck.yml"
    ),
) -> None:
    """Write a codecheck.yml of the tables and figures of stored results."""
    from trackbench.atomic_files import write_text
    from trackbench.commands.codecheck import codecheck_text
    from trackbench.errors import Mark, Problem, UserError

    if path.exists():
        mistake = "is there already; name another file by --out"
        raise UserError(Problem(Mark(str(path)), "", mistake))
    write_text(path, codecheck_text(folders, path.absolute().parent))
    typer.echo(f"wrote {path}")


def verify(
    folders: Annotated[list[Path], typer.Argument(metavar="DIR...", help="results folders")],
    runs: Annotated[int, typer.Option(min=1, help="runs that are computed again")] = 20,
    allow_plugins: AllowPlugins = False,
) -> None:
    """Compute the first runs of stored results again, rebuild the other files, and compare bytes."""
    from trackbench.errors import Problem, UserError
    from trackbench.verify import verify as verify_folder

    is_changed = False
    problems: list[Problem | str] = []
    for folder in folders:
        try:
            differences = verify_folder(folder, runs, allow_plugins)
        except UserError as error:
            problems += error.problems
            continue
        typer.echo(f"{folder}: {'changed' if differences else 'the same bytes'}")
        for line in differences:
            typer.echo(f"  {line}")
        is_changed |= bool(differences)
    if problems:
        raise UserError(*problems)
    if is_changed:
        raise typer.Exit(1)
