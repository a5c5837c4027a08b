"""Command `tune`: tune filters, and run them beside the originals."""

from pathlib import Path
from typing import Annotated, Any, TypeAlias

import typer

from trackbench.cli.options import Config, runs_experiments
from trackbench.cli.run import execute

Evaluations: TypeAlias = Annotated[int | None, typer.Option(min=2, help="trials of each filter")]


@runs_experiments
def tune(
    config: Config,
    metric: Annotated[
        str | None,
        typer.Option(help="what is made small: rms(rmse_position), anees, {log_score: 1, ...}"),
    ] = None,
    evaluations: Evaluations = None,
    **given: Any,
) -> None:
    """Tune the filters that the config's `tune` names, and run them beside the originals."""
    # ``given`` has the options of `_shared` (options.py) by name, which the decorator declares. Without
    # ``metric`` or ``evaluations`` (None), those of the config's `tuning` stay.
    run_with_tuning(config, metric, evaluations, given)


def run_with_tuning(
    config: Path, metric: str | None, evaluations: int | None, given: dict[str, Any]
) -> None:
    """Run a config with tuning; ``metric`` and ``evaluations`` override its keys unless None.

    ``evaluations`` is the number of trials of each filter. ``given`` are the command's options by name.
    """
    overrides = list(given["set_"] or ())
    if metric is not None:
        overrides.append(f"tuning.metric={metric}")
    if evaluations is not None:
        overrides.append(f"tuning.evaluations={evaluations}")
    execute("tune", [config], given | {"set_": overrides})
