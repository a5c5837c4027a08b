"""Options that several commands share: types for typer, and their conversion for the API."""

import inspect
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args

import typer
from typer.core import TyperCommand, TyperOption

from trackbench.cli.shell_completion import assignments, configs, experiments, labels

if TYPE_CHECKING:
    from typer._click import Context

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
All = Annotated[bool, typer.Option("--all", help="also print the config's tables and all notes")]
Json = Annotated[bool, typer.Option("--json", help="JSON, an object a line (docs/json-lines.md)")]
Runs = Annotated[int | None, typer.Option(min=1, help="Monte Carlo runs")]
Seed = Annotated[int | None, typer.Option(min=0, help="seed of every random number")]


def _folder(text: str) -> Path:
    """Return the path of a folder; an empty one, as of a variable that is not set, is a mistake."""
    if not text:
        raise typer.BadParameter("is empty; for this folder write .")
    return Path(text)


Out = Annotated[
    Path | None,
    typer.Option(
        parser=_folder,
        metavar="<path>",
        help="results folder [results/NAME]; of several configs the folder that holds theirs",
    ),
]
Workers = Annotated[int | None, typer.Option(min=1, help="worker processes [all processors]")]
EngineName = Annotated[str, typer.Option(help="serial, processes or dask")]
Scheduler = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="of a dask cluster: tcp://host:port")
]
Fresh = Annotated[bool, typer.Option("--fresh", help="compute again what is kept from before")]
NoTimes = Annotated[
    bool,
    typer.Option(
        "--no-times",
        help="do not time the filters in turns; tables show the CPU time of the blocks",
    ),
]
DryRun = Annotated[bool, typer.Option("--dry-run", help="print what would run")]
Quick = Annotated[bool, typer.Option("--quick", help="20 runs at most, in blocks that fit them")]
Force = Annotated[bool, typer.Option("--force", help="let --quick replace results of more runs")]
SaveTracks = Annotated[
    bool, typer.Option("--save-tracks", help="write every run's track to tracks.npz")
]
Format = Annotated[
    str,
    typer.Option(
        "--format",
        help="png, svg, pdf, tex (tables, and figures as pdf), with commas; markdown prints Markdown",
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
        help="run the filters of this Python file, or this program, into results/NAME-with-FILE",
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
    no_times: NoTimes = False,
    dry_run: DryRun = False,
    format_: Format = "png,svg",
    allow_plugins: AllowPlugins = False,
    all_: All = False,
    json: Json = False,
) -> None:
    """Declare the options of all commands that run experiments, with types and defaults.

    Nobody calls this function: `runs_experiments` copies the parameters of its signature into that of
    each command.
    """


def runs_experiments(command: Callable[..., None]) -> Callable[..., None]:
    """Add the options that `_shared` declares to a command, which gets them in its ``**given``.

    typer reads the options from the signature and the annotations of a function, so those of the command
    are changed. Its own options come first, and replace shared ones of the same name.
    """
    specific = dict(inspect.signature(command).parameters)
    _, given = specific.popitem()  # the last parameter
    assert given.kind is inspect.Parameter.VAR_KEYWORD
    shared = {k: p for k, p in inspect.signature(_shared).parameters.items() if k not in specific}
    parameters = [*specific.values(), *shared.values()]
    # Keyword-only parameters may have any order of those with and without defaults.
    by_name = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in parameters]
    command.__signature__ = inspect.Signature(by_name, return_annotation=None)  # type: ignore[attr-defined]
    command.__annotations__ = {p.name: p.annotation for p in parameters}
    return command


def api_options(given: dict[str, Any]) -> "Options":
    """Convert the options of a command, ``given`` by name, to those of the Python API.

    Options that are not given (None) are left at their defaults. Names that are no fields of `Options`,
    such as ``json`` or a command's local variable, are left out. Raises UserError for a wrong word.
    """
    from trackbench.commands.run_options import Options
    from trackbench.execution.engines import Engine

    known = {field.name for field in fields(Options)}
    options = {key: value for key, value in given.items() if key in known and value is not None}
    if "engine" in given:
        one_of("--engine", given["engine"], get_args(Engine))
    if "format_" in given:
        # Markdown is printed, and is no format of files: alone it leaves the files at their defaults.
        files = [f for f in formats(given["format_"], (MARKDOWN,)) if f != MARKDOWN]
        options["formats"] = files or ["png", "svg"]
    if given.get("no_times"):
        options["times"] = False
    overrides = []
    if given.get("quick"):
        # Few runs need no blocks as wide as those of many, and the filters are not timed in turns.
        overrides.append("block=fit")
        options |= {"quick": True, "times": False}
        options["spare"] = not given.get("force")  # keep results of more runs
    overrides += given["set_"] or ()
    return Options(**options, set=tuple(overrides))


MARKDOWN = "markdown"


def formats(text: str, printed: tuple[str, ...] = ()) -> list[str]:
    """Split the option `--format` at commas; raises UserError for an unknown format.

    ``printed`` are allowed formats beside those of files.
    """
    from trackbench.commands.run_options import FORMATS

    return [one_of("--format", word, (*FORMATS, *printed)) for word in text.split(",")]


def one_of(option: str, value: str, known: tuple[str, ...]) -> str:
    """Return the ``value`` of an option if it is one of the ``known`` words; raise UserError if not."""
    from trackbench.errors import Mark, Problem, UserError

    if value not in known:
        raise UserError(Problem(Mark(option), "", f"{value!r} is not one of {', '.join(known)}"))
    return value


class CommandWithSingleOptions(TyperCommand):
    """Command that rejects a repeated option of one value, as only its last value would count."""

    def parse_args(self, ctx: "Context", args: list[str]) -> list[str]:
        """Parse the words of the command line; raises UsageError for an option that is there twice."""
        if ctx.resilient_parsing:  # of a line that is being completed
            return super().parse_args(ctx, args)
        # The parser lists the options as they appear, one that is there twice two times.
        _, _, options = self.make_parser(ctx).parse_args(args=list(args))
        earlier_options: list[object] = []
        for option in options:
            if not isinstance(option, TyperOption) or option.multiple or option.is_flag:
                continue
            if option in earlier_options:
                ctx.fail(f"{option.opts[0]} is there twice, and takes one value: leave one out")
            earlier_options.append(option)
        return super().parse_args(ctx, args)
