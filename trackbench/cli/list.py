"""Command `list`: what a config may name, and what an experiment can measure."""

from pathlib import Path
from typing import Annotated

import typer

from trackbench.cli.json_objects import echo_line
from trackbench.cli.options import AllowPlugins, Json, one_of
from trackbench.cli.shell_completion import FURTHER_LISTS, configs, groups


def list_(
    group: Annotated[
        str | None,
        typer.Argument(
            help="filters, ..., metrics, statistics, experiments, problems, suites; default: the groups",
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
    metrics_config = config if word == "metrics" else None  # other lists use no config
    if not json:
        typer.echo(_list_as_text(word, metrics_config, allow_plugins))
        return
    if metrics_config:
        json_rows = metrics.rows_of_config(metrics_config, allow_plugins)
    elif word is None:  # programs get every member of the groups, people the sizes of the groups
        json_rows = rows((*GROUPS, "experiments"))
    else:
        json_rows = rows((word,))
    for row in json_rows:
        echo_line(row)


def _list_as_text(word: str | None, config: Path | None, allow_plugins: bool) -> str:
    """Write the list of one word, such as filters; without a word, the groups with their sizes.

    ``config`` is None unless the word is `metrics`: its metrics are then listed.
    """
    from trackbench.help import metrics
    from trackbench.help.lists import experiments, groups_with_counts, listing, problems, suites

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
    if word == "suites":
        return suites()
    return listing(word)
