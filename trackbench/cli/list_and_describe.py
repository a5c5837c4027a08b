"""Commands that list, describe, show and copy what ships, and the schema of configs."""

from pathlib import Path
from typing import Annotated

import typer

from trackbench.cli.json_objects import echo_line
from trackbench.cli.options import (
    FURTHER_LISTS,
    AllowPlugins,
    Json,
    Name,
    all_kinds,
    configs,
    groups,
    one_of,
)


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
    from trackbench.help.lists import rows
    from trackbench.registry import GROUPS

    known_words = (*GROUPS, *FURTHER_LISTS)
    word = None
    if group is not None:
        word = one_of("list", group, known_words)
    metrics_config = config if word == "metrics" else None
    if not json:
        typer.echo(_list_as_text(word, metrics_config, allow_plugins))
        return
    if metrics_config:
        json_rows = metrics.rows_of_config(metrics_config, allow_plugins)
    elif word is None:
        json_rows = rows((*GROUPS, "experiments"))
    else:
        json_rows = rows((word,))
    for row in json_rows:
        echo_line(row)


def _list_as_text(word: str | None, config: Path | None, allow_plugins: bool) -> str:
    """List one word, or the metrics of a config; without a word, the groups with their sizes."""
    from trackbench.help import metrics
    from trackbench.help.lists import experiments, groups_with_counts, listing, problems

    if config:
        return metrics.metrics_of_config(config, allow_plugins)
    if word is None:
        return groups_with_counts()
    if word == "statistics":
        return metrics.statistics()
    if word == "metrics":
        return metrics.metrics()
    if word == "experiments":
        return experiments()
    if word == "problems":
        return problems()
    return listing(word)


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
    from trackbench.help.descriptions import description, entries

    if json:
        for entry in entries(kind):
            echo_line(entry)
        return
    typer.echo(description(kind))


def show(name: Name) -> None:
    """Print the config of a shipped experiment."""
    from trackbench.config.shipped_experiments import find_shipped

    typer.echo(find_shipped(name).read_text(encoding="utf-8"), nl=False)


def copy(name: Name) -> None:
    """Copy a shipped experiment and its parts here for editing; existing files stay."""
    from trackbench.config.copy_experiment import copy_experiment

    copied = copy_experiment(name, Path())
    for path in copied.written:
        typer.echo(f"wrote {path}")
    typer.echo(f"run it: trackbench run {copied.config}")


def schema() -> None:
    """Print the JSON Schema of an experiment file, for editors."""
    import json

    from trackbench.help.json_schema import schema

    typer.echo(json.dumps(schema(), indent=1))
