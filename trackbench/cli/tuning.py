"""The command that tunes the filters of an experiment."""

from typing import Annotated

import typer

from trackbench.cli.options import (
    AllowPlugins,
    Config,
    DryRun,
    EngineName,
    Format,
    Json,
    Only,
    Out,
    Runs,
    Scheduler,
    Seed,
    Set,
    Workers,
    api_options,
)
from trackbench.cli.running import execute


def tune(
    config: Config,
    set_: Set = None,
    only: Only = None,
    metric: Annotated[
        str | None,
        typer.Option(help="what is made small: rms(rmse_position), anees, {log_score: 1, ...}"),
    ] = None,
    evaluations: Annotated[int | None, typer.Option(min=2, help="trials of each filter")] = None,
    runs: Runs = None,
    seed: Seed = None,
    out: Out = None,
    engine: EngineName = "processes",
    workers: Workers = None,
    scheduler: Scheduler = None,
    fresh: Annotated[
        bool,
        typer.Option("--fresh/--resume", help="compute again what is kept, or go on with it"),
    ] = False,
    dry_run: DryRun = False,
    format_: Format = "png,svg",
    allow_plugins: AllowPlugins = False,
    json: Json = False,
) -> None:
    """Tune the filters that the config's `tune` names, and run what is found beside them."""
    given = locals()
    also = {"tuning.metric": metric, "tuning.evaluations": evaluations}
    given["set_"] = [*(set_ or ()), *(f"{k}={v}" for k, v in also.items() if v is not None)]
    execute("tune", [config], dry_run, api_options(given), json)
