"""Commands on results folders: `plot`, `report`, `codecheck`, `verify`; only `verify` computes runs."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from trackbench.cli.options import AllowPlugins, Folder, formats, one_of


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
    from trackbench.verify.verify_folder import verify as verify_folder

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
