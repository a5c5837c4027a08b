"""The commands on the experiments that come with the package."""

from pathlib import Path
from typing import Annotated

import typer

from trackbench.cli.options import Name


def show(name: Name) -> None:
    """Print a shipped experiment's config."""
    from trackbench.experiment.reading.shipped import named

    typer.echo(named(name).read_text(encoding="utf-8"), nl=False)


def copy(
    name: Name,
    to: Annotated[Path, typer.Option(metavar="DIR", help="folder that they go to")] = Path(),
) -> None:
    """Copy a shipped experiment and its parts to be edited; nothing is written over."""
    from trackbench.experiment.reading.shipped import copied

    written = copied(name, to)
    for path in written:
        typer.echo(f"wrote {path}")
    typer.echo(f"run it: trackbench run {to / name}.yaml")
