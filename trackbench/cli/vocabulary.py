"""The commands about what a config may say: the kinds, their keys, a file to start from."""

import re
from pathlib import Path
from typing import Annotated

import typer

from trackbench.cli.options import AllowPlugins, one_of


def list_(
    group: Annotated[
        str | None,
        typer.Argument(help="filters, ..., metrics, statistics; default: all groups of kinds"),
    ] = None,
    config: Annotated[
        Path | None, typer.Argument(help="an experiment whose metrics and windows are listed")
    ] = None,
    allow_plugins: AllowPlugins = False,
) -> None:
    """List what a config may name; `list metrics CONFIG`: what can be measured in an experiment."""
    from trackbench import glossary
    from trackbench.catalogue import listing
    from trackbench.registry import GROUPS

    word = None if group is None else one_of("list", group, (*GROUPS, "metrics", "statistics"))
    if word == "statistics":
        typer.echo(glossary.statistics())
    elif word == "metrics":
        typer.echo(
            glossary.metrics_of_config(config, allow_plugins) if config else glossary.metrics()
        )
    else:
        typer.echo(listing(GROUPS if word is None else (word,)))


def describe(
    kind: Annotated[
        str, typer.Argument(help="a kind, metric or statistic of `trackbench list`, or a group")
    ],
) -> None:
    """Print a kind's parameters, defaults and source; of a group, what its classes may offer."""
    from trackbench.catalogue import description

    typer.echo(description(kind))


def new(
    what: Annotated[str, typer.Argument(help="filter, sensor, motion, scenario or experiment")],
    name: Annotated[
        str | None, typer.Argument(help="its name, such as my-sensor; of data by default theirs")
    ] = None,
    data: Annotated[
        Path | None, typer.Option("--from", help="of an experiment: the table of data it is to use")
    ] = None,
) -> None:
    """Write a commented starting file that runs as it is, and its test.

    With --from an experiment on recorded data: what their columns, units and errors are is guessed.
    """
    from trackbench.scaffold import WHAT, write_config_for, write_new

    one_of("new", what, WHAT)
    if data is not None and what != "experiment":
        raise typer.BadParameter(f"a {what} is not made from data", param_hint="--from")
    if data is not None:
        paths = write_config_for(data, name or _plain(data.stem), Path())
    elif name is None:
        raise typer.BadParameter("is required without --from", param_hint="NAME")
    else:
        paths = write_new(what, name, Path())
    for path in paths:
        typer.echo(f"wrote {path}")
    config = next(path for path in paths if path.suffix == ".yaml")
    plugins = "" if what == "experiment" else " --allow-plugins"
    typer.echo(f"run it: trackbench run {config}{plugins}")


def _plain(stem: str) -> str:
    """A file's name as one of an experiment."""
    return re.sub("[^A-Za-z0-9]+", "-", stem).strip("-")


def schema() -> None:
    """Print the JSON Schema of an experiment file, for editors."""
    import json

    from trackbench.schema import schema

    typer.echo(json.dumps(schema(), indent=1))
