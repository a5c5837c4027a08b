"""The command line: options in, messages out, no logic. Heavy modules are imported when needed."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from trackbench.api import Options

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="Monte Carlo experiments with target-tracking filters, from YAML to tables and figures.",
)

Config = Annotated[Path, typer.Argument(metavar="CONFIG", help="experiment file (YAML)")]
Set = Annotated[
    list[str] | None, typer.Option("--set", metavar="PATH=VALUE", help="override a key")
]
Only = Annotated[list[str] | None, typer.Option(metavar="LABEL", help="run these filters only")]
Runs = Annotated[int | None, typer.Option(min=1, help="Monte Carlo runs")]
Seed = Annotated[int | None, typer.Option(min=0, help="seed of every random number")]
Out = Annotated[Path | None, typer.Option(help="results folder [results/NAME]")]
Workers = Annotated[int | None, typer.Option(min=1, help="worker processes [all processors]")]
EngineName = Annotated[str, typer.Option(help="serial or processes")]


@app.command()
def run(
    config: Config,
    set_: Set = None,
    only: Only = None,
    runs: Runs = None,
    seed: Seed = None,
    out: Out = None,
    engine: EngineName = "processes",
    workers: Workers = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="say what would run")] = False,
    quick: Annotated[bool, typer.Option("--quick", help="20 runs")] = False,
    save_tracks: Annotated[
        bool, typer.Option("--save-tracks", help="write every run's track to tracks.npz")
    ] = False,
    format_: Annotated[
        str, typer.Option("--format", help="png, svg, pdf (figures), tex (tables), with commas")
    ] = "png,svg",
) -> None:
    """Run an experiment and write tables, figures and CSV files."""
    from trackbench import api

    options = api.Options(
        set=tuple(set_ or ()),
        only=tuple(only or ()),
        runs=20 if quick and runs is None else runs,
        seed=seed,
        out=out,
        engine=_one_of("--engine", engine, ("serial", "processes")),  # type: ignore[arg-type]
        workers=workers,
        save_tracks=save_tracks,
        formats=_formats(format_),
    )
    if dry_run:
        typer.echo(api.preview(config, options))
        return
    _run(config, options)


Folder = Annotated[Path, typer.Argument(metavar="DIR", help="results folder")]


@app.command()
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


@app.command()
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

    for path in api.plot(folder, _formats(format_), tuple(only or ())):
        typer.echo(path)


@app.command()
def report(folder: Folder) -> None:
    """Write report.html of stored results; over a folder of several, index.html and a ledger."""
    from trackbench import api

    for path in api.report(folder):
        typer.echo(path)


@app.command()
def verify(
    folders: Annotated[list[Path], typer.Argument(metavar="DIR...", help="results folders")],
    runs: Annotated[int, typer.Option(min=1, help="runs that are computed again")] = 20,
) -> None:
    """Compute the first runs of stored results again and compare them, and every verdict."""
    from trackbench.verification import verify as changes

    differing = 0
    for folder in folders:
        found = changes(folder, runs)
        differing += len(found)
        for line in found or [f"{folder}: the first {runs} runs and all verdicts come out again"]:
            typer.echo(line)
    if differing:
        raise typer.Exit(1)


@app.command()
def check(config: Config, set_: Set = None, only: Only = None) -> None:
    """Validate a config and run nothing."""
    from trackbench.experiment.config import load

    experiment = load(config, set_ or [], only or [])
    points = len(experiment.points)
    grid = f" at {points} points" if points > 1 else ""
    typer.echo(f"{config}: good, {len(experiment.points[0].filters)} filters{grid}")


@app.command("list")
def list_(
    group: Annotated[
        str | None, typer.Argument(help="filters, scenarios, tables or figures")
    ] = None,
) -> None:
    """List what a config may name."""
    from trackbench.catalogue import listing

    groups = ("filters", "scenarios", "tables", "figures")
    chosen = groups if group is None else (_one_of("list", group, groups),)
    typer.echo(listing(chosen))


@app.command()
def describe(kind: Annotated[str, typer.Argument(help="a kind from `trackbench list`")]) -> None:
    """Print a kind's parameters, defaults and source."""
    from trackbench.catalogue import description

    typer.echo(description(kind))


def main() -> None:
    """Run the command line; exit codes: 0 done, 1 a filter failed, 2 bad input, 130 interrupted."""
    from trackbench.experiment.problems import UserError

    try:
        app()
    except UserError as error:
        typer.echo(str(error), err=True)
        sys.exit(2)


def _run(config: Path, options: "Options") -> None:
    from trackbench import api

    try:
        report = api.run(config, options)
    except KeyboardInterrupt:
        typer.echo("\ninterrupted; nothing was written, the same command starts again", err=True)
        raise typer.Exit(130) from None
    for table in report.tables.values():
        typer.echo(table.markdown())
    for note in report.notes:
        typer.echo(f"note: {note}", err=True)
    for failure in report.failed:
        typer.echo(f"error: {failure}", err=True)
    typer.echo(f"results in {report.folder}/", err=True)
    if report.failed:
        raise typer.Exit(1)


def _formats(text: str) -> list[str]:
    return [_one_of("--format", f, ("png", "svg", "pdf", "tex")) for f in text.split(",")]


def _one_of(option: str, value: str, known: tuple[str, ...]) -> str:
    from trackbench.experiment.problems import Mark, Problem, UserError

    if value not in known:
        raise UserError(Problem(Mark(option), "", f"{value!r} is not one of {', '.join(known)}"))
    return value
