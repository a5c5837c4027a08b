"""Command `sweep`: run an experiment over a grid of values."""

from pathlib import Path
from typing import Annotated, Any

import typer

from trackbench.cli.options import Config, Force, Grid, Product, Quick, SaveTracks, runs_experiments
from trackbench.cli.run import execute, start_fork_server


@runs_experiments
def sweep(
    config: Config,
    grid: Grid,
    product: Product = False,
    out: Annotated[Path | None, typer.Option(help="results folder [results/NAME-sweep]")] = None,
    quick: Quick = False,
    force: Force = False,
    save_tracks: SaveTracks = False,
    **given: Any,
) -> None:
    """Run all values of a grid; also write sweep.csv, figures and each filter's best values."""
    # ``given`` has the options of `_shared` (options.py) by name, which the decorator declares.
    start_fork_server(given)  # which needs no other option
    given |= {
        "grid": grid,
        "product": product,
        "out": out,
        "quick": quick,
        "force": force,
        "save_tracks": save_tracks,
    }
    execute("sweep", [config], given)
