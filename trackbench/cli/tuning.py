"""The command that tunes the filters of an experiment."""

from typing import Annotated, Any

import typer

from trackbench.cli.options import Config
from trackbench.cli.running import execute
from trackbench.cli.shared import runs_experiments


@runs_experiments
def tune(
    config: Config,
    metric: Annotated[
        str | None,
        typer.Option(help="what is made small: rms(rmse_position), anees, {log_score: 1, ...}"),
    ] = None,
    evaluations: Annotated[int | None, typer.Option(min=2, help="trials of each filter")] = None,
    fresh: Annotated[
        bool,
        typer.Option("--fresh/--resume", help="compute again what is kept, or go on with it"),
    ] = False,
    **given: Any,
) -> None:
    """Tune the filters that the config's `tune` names, and run what is found beside them."""
    also = {"tuning.metric": metric, "tuning.evaluations": evaluations}
    words = [f"{key}={value}" for key, value in also.items() if value is not None]
    execute("tune", [config], given | {"fresh": fresh, "set_": [*(given["set_"] or ()), *words]})
