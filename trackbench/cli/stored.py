"""The commands on a results folder: no run is computed, but by `verify`."""

from pathlib import Path
from typing import Annotated

import typer

from trackbench.cli.options import AllowPlugins, Folder, formats


def compare(folder: Folder) -> None:
    """Hold stored results against the published numbers and claims; computes no run."""
    from trackbench import api
    from trackbench.report.comparison import markdown
    from trackbench.report.results import Results

    found = api.compare(folder)
    if not found.numbers and not found.claims:
        typer.echo(f"{folder}: nothing is published about this experiment", err=True)
        return
    typer.echo(markdown(Results(folder), found))


def plot(
    folder: Folder,
    only: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="this figure or kind of figure only")
    ] = None,
    format_: Annotated[
        str, typer.Option("--format", help="png, svg, pdf, separated by commas")
    ] = "png,svg",
) -> None:
    """Draw the figures of stored results again; computes no run."""
    from trackbench import api

    for path in api.plot(folder, formats(format_), tuple(only or ())):
        typer.echo(path)


def report(folder: Folder) -> None:
    """Write report.html of stored results; over a folder of several, index.html and a ledger."""
    from trackbench import api

    for path in api.report(folder):
        typer.echo(path)


def verify(
    folders: Annotated[list[Path], typer.Argument(metavar="DIR...", help="results folders")],
    runs: Annotated[int, typer.Option(min=1, help="runs that are computed again")] = 20,
    allow_plugins: AllowPlugins = False,
) -> None:
    """Compute the first runs of stored results again and compare them, and every verdict."""
    from trackbench.verification import verify as changes

    differing = 0
    for folder in folders:
        found = changes(folder, runs, allow_plugins)
        differing += len(found)
        for line in found or [f"{folder}: the first {runs} runs and all verdicts come out again"]:
            typer.echo(line)
    if differing:
        raise typer.Exit(1)
