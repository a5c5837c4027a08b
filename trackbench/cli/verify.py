"""Command `verify`: compute the first runs of stored results again, and compare bytes."""

from pathlib import Path
from typing import Annotated

import typer

from trackbench.cli.options import AllowPlugins


def verify(
    folders: Annotated[list[Path], typer.Argument(metavar="DIR...", help="results folders")],
    runs: Annotated[int, typer.Option(min=1, help="runs that are computed again")] = 20,
    allow_plugins: AllowPlugins = False,
) -> None:
    """Compute the first runs of stored results again, rebuild the other files, and compare bytes."""
    from trackbench.errors import Problem, UserError
    from trackbench.verify.verify_folder import verify as verify_folder

    is_changed = False
    problems: list[Problem | str] = []
    for folder in folders:
        try:
            differences = verify_folder(folder, runs, allow_plugins)
        except UserError as error:
            problems += error.problems
            continue
        typer.echo(f"{folder}: {'changed' if differences else 'the same bytes'}")
        for line in differences:
            typer.echo(f"  {line}")
        is_changed |= bool(differences)
    if problems:
        raise UserError(*problems)
    if is_changed:
        raise typer.Exit(1)
