"""Commands `show` and `copy`: shipped experiments."""

from pathlib import Path

import typer

from trackbench.cli.options import Name


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
