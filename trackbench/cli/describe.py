"""Command `describe`: the keys and defaults of a kind, or the hooks of a group."""

from typing import Annotated

import typer

from trackbench.cli.json_objects import echo_line
from trackbench.cli.options import Json
from trackbench.cli.shell_completion import all_kinds


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
