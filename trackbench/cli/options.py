"""Options that several commands share: their types for typer, and their conversion for the API."""

import inspect
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trackbench.cli.completion import assignments, configs, experiments, labels

if TYPE_CHECKING:
    from trackbench.api import Options


_CONFIG = "experiment: a YAML file, a name of `trackbench list experiments`, or - for stdin"
Config = Annotated[Path, typer.Argument(metavar="CONFIG", help=_CONFIG, autocompletion=configs)]
Configs = Annotated[
    list[Path], typer.Argument(metavar="CONFIG", help=_CONFIG, autocompletion=configs)
]
Name = Annotated[
    str, typer.Argument(help="a shipped experiment's name", autocompletion=experiments)
]
Folder = Annotated[Path, typer.Argument(metavar="DIR", help="results folder")]
Set = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="PATH=VALUE", help="override a key", autocompletion=assignments),
]
Only = Annotated[
    list[str] | None,
    typer.Option(metavar="LABEL", help="run these filters only", autocompletion=labels),
]
Json = Annotated[bool, typer.Option("--json", help="JSON, an object a line (docs/running.md)")]
Runs = Annotated[int | None, typer.Option(min=1, help="Monte Carlo runs")]
Seed = Annotated[int | None, typer.Option(min=0, help="seed of every random number")]
Out = Annotated[
    Path | None,
    typer.Option(
        help="results folder [results/NAME]; of several configs the folder that holds theirs"
    ),
]
Workers = Annotated[int | None, typer.Option(min=1, help="worker processes [all processors]")]
EngineName = Annotated[str, typer.Option(help="serial, processes or dask")]
Scheduler = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="of a dask cluster: tcp://host:port")
]
Fresh = Annotated[bool, typer.Option("--fresh", help="compute again what is kept from before")]
DryRun = Annotated[bool, typer.Option("--dry-run", help="say what would run")]
Quick = Annotated[bool, typer.Option("--quick", help="20 runs at most, in blocks that fit them")]
Force = Annotated[bool, typer.Option("--force", help="let --quick replace results of more runs")]
SaveTracks = Annotated[
    bool, typer.Option("--save-tracks", help="write every run's track to tracks.npz")
]
Format = Annotated[
    str,
    typer.Option(
        "--format",
        help="png, svg, pdf, tex (tables, and figures as pdf), with commas; markdown prints tables as "
        "into a pipe",
    ),
]
AllowPlugins = Annotated[
    bool, typer.Option("--allow-plugins", help="run the code of the config's plugins")
]
Filters = Annotated[
    list[Path] | None,
    typer.Option(
        "--filter",
        metavar="FILE",
        help="run the filters of this Python file, too, into results/NAME-with-FILE",
    ),
]
Grid = Annotated[
    list[str],
    typer.Option(
        "--grid", metavar="PATH=VALUES", help="values V1,V2,..., a..b:n (linear) or log:a..b:n"
    ),
]
Product = Annotated[
    bool,
    typer.Option(
        "--product",
        help="every combination of keys of different filters, not one filter after the other",
    ),
]


def _shared(
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
    format_: Format = "png,svg",
    allow_plugins: AllowPlugins = False,
    json: Json = False,
) -> None:
    """Declare the options of all commands that run experiments, with types and defaults."""


def runs_experiments(command: Callable[..., None]) -> Callable[..., None]:
    """Add the shared options to a command, in its ``**given``; its own options come first."""
    own = dict(inspect.signature(command).parameters)
    given = own.popitem()[1]
    assert given.kind is inspect.Parameter.VAR_KEYWORD
    shared = {k: p for k, p in inspect.signature(_shared).parameters.items() if k not in own}
    parameters = [*own.values(), *shared.values()]
    by_name = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in parameters]
    command.__signature__ = inspect.Signature(by_name, return_annotation=None)  # type: ignore[attr-defined]
    command.__annotations__ = {p.name: p.annotation for p in parameters}
    return command


def api_options(given: dict[str, Any]) -> "Options":
    """Convert a command's options to the API's."""
    from trackbench import api

    known = {field.name for field in fields(api.Options)}
    options = {key: value for key, value in given.items() if key in known and value is not None}
    if "engine" in given:
        one_of("--engine", given["engine"], ("serial", "processes", "dask"))
    if "format_" in given:
        files = [f for f in formats(given["format_"], (MARKDOWN,)) if f != MARKDOWN]
        options["formats"] = files or ["png", "svg"]
    fit = []
    if given.get("quick"):
        fit = ["block=fit"]
        options |= {"quick": True, "times": False}
        options["spare"] = not given.get("force")
    return api.Options(**options, set=(*fit, *(given["set_"] or ())))


MARKDOWN = "markdown"


def formats(text: str, printed: tuple[str, ...] = ()) -> list[str]:
    """Return the formats of files, or of what is printed, in a list with commas; raises UserError."""
    return [one_of("--format", f, ("png", "svg", "pdf", "tex", *printed)) for f in text.split(",")]


def one_of(option: str, value: str, known: tuple[str, ...]) -> str:
    """Return the value if it is allowed; raises UserError."""
    from trackbench.errors import Mark, Problem, UserError

    if value not in known:
        raise UserError(Problem(Mark(option), "", f"{value!r} is not one of {', '.join(known)}"))
    return value
