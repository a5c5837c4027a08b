"""The command line: options in, messages out, no logic. Heavy modules are imported when needed."""

import shlex
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

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
EngineName = Annotated[str, typer.Option(help="serial, processes or dask")]
Scheduler = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="of a dask cluster: tcp://host:port")
]
Fresh = Annotated[bool, typer.Option("--fresh", help="compute again what is kept from before")]
DryRun = Annotated[bool, typer.Option("--dry-run", help="say what would run")]
Quick = Annotated[bool, typer.Option("--quick", help="20 runs")]
SaveTracks = Annotated[
    bool, typer.Option("--save-tracks", help="write every run's track to tracks.npz")
]
Format = Annotated[
    str, typer.Option("--format", help="png, svg, pdf (figures), tex (tables), with commas")
]
AllowPlugins = Annotated[
    bool, typer.Option("--allow-plugins", help="run the code of the config's plugins")
]
Grid = Annotated[
    list[str],
    typer.Option(
        "--grid", metavar="PATH=VALUES", help="values V1,V2,..., a..b:n (linear) or log:a..b:n"
    ),
]


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
    scheduler: Scheduler = None,
    fresh: Fresh = False,
    dry_run: DryRun = False,
    quick: Quick = False,
    save_tracks: SaveTracks = False,
    format_: Format = "png,svg",
    allow_plugins: AllowPlugins = False,
) -> None:
    """Run an experiment and write tables, figures and CSV files."""
    _execute("run", config, dry_run, _options(locals()))


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
    _execute("sweep", config, dry_run, _options(locals()))


@app.command()
def cache(
    clear: Annotated[bool, typer.Option("--clear", help="remove every block")] = False,
    prune: Annotated[
        bool, typer.Option("--prune", help="remove blocks that other versions of the code made")
    ] = False,
) -> None:
    """Show or clear the finished blocks that are kept for the next run."""
    from trackbench.experiment.cache import cache_folder, cache_size, clear_cache

    root = cache_folder()
    if clear or prune:
        clear_cache(root, old_only=not clear)
    size = cache_size(root)
    typer.echo(f"{root}/: {size.blocks} blocks, {size.bytes / 1e6:.1f} MB")
    if size.old_blocks:
        old = f"{size.old_blocks} blocks, {size.old_bytes / 1e6:.1f} MB"
        typer.echo(f"of other versions of the code: {old}; remove them with --prune")


@app.command()
def check(
    config: Annotated[Path | None, typer.Argument(help="experiment file (YAML)")] = None,
    set_: Set = None,
    only: Only = None,
    allow_plugins: AllowPlugins = False,
    contract: Annotated[
        Path | None, typer.Option(metavar="FILE", help="hold the filters of a Python file to it")
    ] = None,
) -> None:
    """Validate a config and run nothing, or hold a filter of one's own against the contract."""
    if config is None and contract is None:
        raise typer.BadParameter("name a config, or a Python file with --contract")
    if config is not None:
        _check_config(config, _options(locals()))
    if contract is not None:
        _check_contract(contract)


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


@app.command()
def new(
    what: Annotated[str, typer.Argument(help="filter, scenario or experiment")],
    name: Annotated[str, typer.Argument(help="its name, such as my-filter")],
) -> None:
    """Write a commented starting file that runs as it is, and its test."""
    from trackbench.scaffold import WHAT, write_new

    paths = write_new(_one_of("new", what, WHAT), name, Path())
    for path in paths:
        typer.echo(f"wrote {path}")
    config = next(path for path in paths if path.suffix == ".yaml")
    plugins = "" if what == "experiment" else " --allow-plugins"
    typer.echo(f"run it: trackbench run {config}{plugins}")


@app.command()
def schema() -> None:
    """Print the JSON Schema of an experiment file, for editors."""
    import json

    from trackbench.schema import schema

    typer.echo(json.dumps(schema(), indent=1))


def main() -> None:
    """Run the command line; exit codes: 0 done, 1 a filter failed, 2 bad input, 130 interrupted."""
    from trackbench.experiment.problems import RunError, UserError

    try:
        app()
    except UserError as error:
        typer.echo(str(error), err=True)
        sys.exit(2)
    except RunError as error:
        typer.echo(f"error: {error}", err=True)
        typer.echo(f"finished blocks are kept; to go on: {_this_command()}", err=True)
        sys.exit(1)


def _check_config(config: Path, options: "Options") -> None:
    from trackbench import api
    from trackbench.experiment.plan import check_memory

    experiment = api.prepare(config, options)
    check_memory(experiment, workers=1)
    points = len(experiment.points)
    grid = f" at {points} points" if points > 1 else ""
    typer.echo(f"{config}: good, {len(experiment.points[0].filters)} filters{grid}")


def _check_contract(path: Path) -> None:
    from trackbench.contract import check_file, report

    found = check_file(path)
    for line in report(found):
        typer.echo(line)
    if any(finding.verdict == "bad" for findings in found.values() for finding in findings):
        raise typer.Exit(1)


def _options(given: dict[str, Any]) -> "Options":
    """The API's options from a command's own."""
    from trackbench import api

    engines = ("serial", "processes", "dask")
    quick_runs = 20 if given.get("quick") else None
    return api.Options(
        set=tuple(given["set_"] or ()),
        only=tuple(given["only"] or ()),
        runs=given.get("runs") or quick_runs,
        seed=given.get("seed"),
        grid=tuple(given.get("grid") or ()),
        out=given.get("out"),
        engine=_one_of("--engine", given.get("engine", "serial"), engines),  # type: ignore[arg-type]
        workers=given.get("workers"),
        scheduler=given.get("scheduler"),
        fresh=given.get("fresh", False),
        save_tracks=given.get("save_tracks", False),
        formats=_formats(given.get("format_", "png")),
        allow_plugins=given["allow_plugins"],
    )


def _execute(command: str, config: Path, dry_run: bool, options: "Options") -> None:
    from trackbench import api

    if dry_run:
        typer.echo(api.preview(config, options))
        return
    signal.signal(signal.SIGTERM, _interrupt)
    try:
        report = getattr(api, command)(config, options)
    except KeyboardInterrupt:
        typer.echo(
            f"\ninterrupted; finished blocks are kept, to go on: {_this_command()}", err=True
        )
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


def _this_command() -> str:
    return shlex.join(["trackbench", *sys.argv[1:]])


def _formats(text: str) -> list[str]:
    return [_one_of("--format", f, ("png", "svg", "pdf", "tex")) for f in text.split(",")]


def _one_of(option: str, value: str, known: tuple[str, ...]) -> str:
    from trackbench.experiment.problems import Mark, Problem, UserError

    if value not in known:
        raise UserError(Problem(Mark(option), "", f"{value!r} is not one of {', '.join(known)}"))
    return value
