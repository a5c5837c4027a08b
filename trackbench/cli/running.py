"""The commands that run an experiment, once or over a grid."""

import shlex
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trackbench.cli.options import (
    AllowPlugins,
    Config,
    DryRun,
    EngineName,
    Format,
    Fresh,
    Grid,
    Only,
    Out,
    Quick,
    Runs,
    SaveTracks,
    Scheduler,
    Seed,
    Set,
    Workers,
    api_options,
)

if TYPE_CHECKING:
    from trackbench.api import Options


def run(
    config: Config,
    set_: Set = None,
    only: Only = None,
    runs: Runs = None,
    seed: Seed = None,
    out: Out = None,
    engine: EngineName = "processes",
    workers: Workers = None,
    scheduler: Scheduler = None,
    fresh: Fresh = False,
    dry_run: DryRun = False,
    quick: Quick = False,
    save_tracks: SaveTracks = False,
    format_: Format = "png,svg",
    allow_plugins: AllowPlugins = False,
) -> None:
    """Run an experiment and write tables, figures and CSV files."""
    _execute("run", config, dry_run, api_options(locals()))


def sweep(
    config: Config,
    grid: Grid,
    set_: Set = None,
    only: Only = None,
    runs: Runs = None,
    seed: Seed = None,
    out: Annotated[Path | None, typer.Option(help="results folder [results/NAME-sweep]")] = None,
    engine: EngineName = "processes",
    workers: Workers = None,
    scheduler: Scheduler = None,
    fresh: Fresh = False,
    dry_run: DryRun = False,
    quick: Quick = False,
    save_tracks: SaveTracks = False,
    format_: Format = "png,svg",
    allow_plugins: AllowPlugins = False,
) -> None:
    """Run every combination of the grids' values; also writes sweep.csv and a figure per metric."""
    _execute("sweep", config, dry_run, api_options(locals()))


def _execute(command: str, config: Path, dry_run: bool, options: "Options") -> None:
    from trackbench import api

    if dry_run:
        typer.echo(api.preview(config, options))
        return
    signal.signal(signal.SIGTERM, _interrupt)
    try:
        report = getattr(api, command)(config, options)
    except KeyboardInterrupt:
        typer.echo(f"\ninterrupted; finished blocks are kept, to go on: {this_command()}", err=True)
        raise typer.Exit(130) from None
    for table in report.tables.values():
        typer.echo(table.markdown())
    for best in report.best:
        typer.echo(f"best: {best}")
    for note in report.notes:
        typer.echo(f"note: {note}", err=True)
    for failure in report.failed:
        typer.echo(f"error: {failure}", err=True)
    typer.echo(f"results in {report.folder}/", err=True)
    if report.failed:
        raise typer.Exit(1)


def _interrupt(signal_number: int, frame: object) -> None:
    raise KeyboardInterrupt


def this_command() -> str:
    """The command line as it may be typed again."""
    return shlex.join(["trackbench", *sys.argv[1:]])
