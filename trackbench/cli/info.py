"""Commands that list and describe kinds and metrics, and write starting files."""

import re
from itertools import compress
from pathlib import Path
from typing import Annotated

import typer

from trackbench.cli.options import AllowPlugins, Json, Name, all_kinds, configs, groups, one_of
from trackbench.cli.output import echo_line


def list_(
    group: Annotated[
        str | None,
        typer.Argument(
            help="filters, ..., metrics, statistics, experiments, problems; default: the groups",
            autocompletion=groups,
        ),
    ] = None,
    config: Annotated[
        Path | None,
        typer.Argument(
            help="an experiment whose metrics and windows are listed", autocompletion=configs
        ),
    ] = None,
    allow_plugins: AllowPlugins = False,
    json: Json = False,
) -> None:
    """List what a config may name; `list metrics CONFIG` lists what an experiment can measure."""
    from trackbench.help import metrics
    from trackbench.help.kinds import rows
    from trackbench.registry import GROUPS

    known = (*GROUPS, "experiments", "problems", "metrics", "statistics")
    word = None if group is None else one_of("list", group, known)
    experiment = config if word == "metrics" else None
    if not json:
        typer.echo(_listing(word, experiment, allow_plugins))
        return
    every = (*GROUPS, "experiments") if word is None else (word,)
    for row in metrics.rows_of_config(experiment, allow_plugins) if experiment else rows(every):
        echo_line(row)


def _listing(word: str | None, config: Path | None, allow_plugins: bool) -> str:
    """List one word; without a word, the groups with their sizes."""
    from trackbench.help import metrics
    from trackbench.help.kinds import experiments, groups_with_counts, listing, problems

    if config:
        return metrics.metrics_of_config(config, allow_plugins)
    if word is None:
        return groups_with_counts()
    others = {"statistics": metrics.statistics, "metrics": metrics.metrics}
    others |= {"experiments": experiments, "problems": problems}
    return others[word]() if word in others else listing(word)


def describe(
    kind: Annotated[
        str,
        typer.Argument(
            help="a kind, metric or statistic of `trackbench list`, or a group",
            autocompletion=all_kinds,
        ),
    ],
    json: Json = False,
) -> None:
    """Print the keys, defaults and source of a kind, or the hooks of a group."""
    from trackbench.help.kinds import description, entries

    if json:
        for entry in entries(kind):
            echo_line(entry)
        return
    typer.echo(description(kind))


def show(name: Name) -> None:
    """Print the config of a shipped experiment."""
    from trackbench.config.shipped_experiments import find_shipped

    typer.echo(find_shipped(name).read_text(encoding="utf-8"), nl=False)


def copy(
    name: Name,
    to: Annotated[Path, typer.Option(metavar="DIR", help="folder that they go to")] = Path(),
) -> None:
    """Copy a shipped experiment and its parts for editing; existing files stay."""
    from trackbench.config.shipped_experiments import copy_experiment

    for path in copy_experiment(name, to):
        typer.echo(f"wrote {path}")
    typer.echo(f"run it: trackbench run {to / name}.yaml")


def new(
    what: Annotated[
        str, typer.Argument(help="filter, sensor, motion, start, scenario or experiment")
    ],
    name: Annotated[
        str | None, typer.Argument(help="its name, such as my-sensor; of data by default theirs")
    ] = None,
    data: Annotated[
        Path | None,
        typer.Option("--from", help="an experiment's table of data, or a shipped filter's kind"),
    ] = None,
    per_run: Annotated[
        bool, typer.Option("--per-run", help="a filter that is written for one run, without arrays")
    ] = False,
    nonlinear: Annotated[
        bool, typer.Option("--nonlinear", help="a motion of any state, by its equations in Python")
    ] = False,
    language: Annotated[
        str,
        typer.Option(help="a filter as a program: c, c++, rust, julia, octave, javascript, python"),
    ] = "",
    sets: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="how --from reads: columns.time=Zeit"),
    ] = None,
) -> None:
    """Write a commented starting file that runs as it is, and its test.

    With --from, an experiment is on recorded data, whose columns, units and errors are guessed; a filter
    is a subclass of a shipped one, with a copy of its step.
    With --language, a filter is a program that reads and writes lines, and a config runs it.
    """
    from trackbench.errors import UserError
    from trackbench.scaffold import LANGUAGES, WHAT, write_config_for, write_new

    one_of("new", what, WHAT)
    if language:
        one_of("--language", language, tuple(LANGUAGES))
    names, values = ("--per-run", "--nonlinear", "--language"), (per_run, nonlinear, language)
    chosen = [*compress(names, values), *(["--from"] if data else [])]
    if len(chosen) > 1:
        raise UserError(f"new {what} {name}: {' and '.join(chosen)} exclude each other")
    if data is not None and what not in ("experiment", "filter"):
        raise typer.BadParameter(f"a {what} is not made from data", param_hint="--from")
    if sets and data is None:
        raise typer.BadParameter("is of --from", param_hint="--set")
    unknown = list[str]()
    unused = list[str]()
    quantities = list[str]()
    if data is not None and what == "experiment":
        name = name or re.sub("[^A-Za-z0-9]+", "-", data.stem).strip("-")
        paths, unknown, unused, quantities = write_config_for(data, name, Path(), sets or ())
    elif name is None:
        raise typer.BadParameter("is required without --from", param_hint="NAME")
    else:
        form = language or ("per_run" if per_run else "nonlinear" if nonlinear else "")
        paths = write_new(what, name, Path(), "copy" if data else form, str(data))
    build = LANGUAGES[language].build if language else ""
    for path in paths:
        typer.echo(f"wrote {path}")
    _echo_unused(unused, quantities)
    plugins = "" if what == "experiment" else " --allow-plugins"
    _echo_next(paths, build, unknown, plugins)


def _echo_unused(unused: list[str], quantities: list[str]) -> None:
    """Print the columns that a config does not read, and how to use one."""
    if not unused:
        return
    more = f" and {len(unused) - 9} more" if unused[9:] else ""
    way = f"to use one as {', '.join(quantities[:-1])} or {quantities[-1]}"
    option = f"--set 'columns.{quantities[0]}=ITS NAME'"
    typer.echo(f"columns not used: {', '.join(unused[:9])}{more} ({way}: {option})")


def _echo_next(paths: list[Path], build: str, unknown: list[str], plugins: str) -> None:
    """Print what to do with the files that were written."""
    config = next(path for path in paths if path.suffix == ".yaml")
    if build:
        typer.echo(f"build it: {build.replace('@MODULE@', config.stem)}")
    if unknown:
        typer.echo(f"write into it where these are: {', '.join(unknown)}")
    typer.echo(f"run it: trackbench run {config}{plugins}")


def schema() -> None:
    """Print the JSON Schema of an experiment file, for editors."""
    import json

    from trackbench.help.json_schema import schema

    typer.echo(json.dumps(schema(), indent=1))
