"""Command `check`: validate a config, or check a filter against the contract."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trackbench.cli.json_objects import echo_line
from trackbench.cli.options import AllowPlugins, Json, Only, Set, api_options
from trackbench.cli.shell_completion import configs

if TYPE_CHECKING:
    from trackbench.commands.run_options import Options

_PICTURES = (".png", ".svg", ".pdf")


def check(
    config: Annotated[
        Path | None, typer.Argument(help="as of `run`", autocompletion=configs)
    ] = None,
    set_: Set = None,
    only: Only = None,
    allow_plugins: AllowPlugins = False,
    contract: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="check a Python file's filters, or a program"),
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="draw the scene: path, sensors and one run's measurements"
        ),
    ] = None,
    on: Annotated[
        Path | None,
        typer.Option(
            "--on",
            metavar="CONFIG",
            help="with --contract: experiment (as of `run`) whose model the filters assume",
            autocompletion=configs,
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Validate a config without running it, or check your own filter against the contract."""
    if picture is not None and (config is None or picture.suffix not in _PICTURES):
        forms = ", ".join(_PICTURES)
        raise typer.BadParameter(f"--picture draws the scene of a config to a file in {forms}")
    if config is None and contract is None:
        raise typer.BadParameter("name a config, or a Python file or program with --contract")
    if on is not None and contract is None:
        raise typer.BadParameter("--on needs --contract FILE")
    if contract is not None and contract.suffix in (".yaml", ".yml"):
        raise typer.BadParameter(
            f"--contract {contract}: is a config; name the Python file or program"
        )
    if config is not None:
        # The parameters of this function have the names of options. `api_options` leaves out the others,
        # such as `contract` and `picture`.
        _check_config(config, api_options(locals()), json, picture)
    if contract is not None:
        _check_contract(contract, on, allow_plugins, json)


def _check_config(config: Path, options: "Options", json: bool, picture: Path | None) -> None:
    """Validate a config, print a summary, and draw its scene to the file ``picture``."""
    from trackbench.atomic_files import atomic_write
    from trackbench.commands.read_experiment import prepare
    from trackbench.config.experiment import cautions
    from trackbench.config.tune_key_and_tuning_checks import training_cautions
    from trackbench.errors import counted
    from trackbench.execution.memory import check_memory

    experiment = prepare(config, options)
    check_memory(experiment)
    # The notes are those of `run`.
    for caution in [*cautions(experiment.points), *training_cautions(experiment)]:
        typer.echo(f"note: {caution}", err=True)
    if picture is not None:
        from trackbench.report.figures.scenario_picture import draw_scene

        figure = draw_scene(experiment)
        with atomic_write(picture) as file:
            figure.savefig(file, format=picture.suffix.removeprefix("."), dpi=150)
        typer.echo(f"drew {picture}")
    number_of_points = len(experiment.points)
    labels = list(experiment.points[0].filters)
    if json:
        summary = {
            "good": True,
            "config": str(config),
            "experiment": experiment.settings.name,
            "runs": experiment.settings.runs,
            "points": number_of_points,
            "filters": labels,
        }
        echo_line(summary)
        return
    line = f"{config}: good, {counted(len(labels), 'filter')}"
    if number_of_points > 1:
        line += f" at {number_of_points} points"
    typer.echo(line)


def _check_contract(path: Path, on: Path | None, allow_plugins: bool, json: bool) -> None:
    """Check the filters of a file against the contract; exit with 1 if one fails a check.

    With ``on`` the filters run with the model of this config, otherwise on the contract's own problems.
    """
    from trackbench.config.shipped_experiments import located
    from trackbench.contract import check_file
    from trackbench.contract.findings import report

    if on is not None:
        on = located(on, lambda line: typer.echo(line, err=True))
    findings_by_kind = check_file(path, on, allow_plugins)
    if json:
        for kind, findings in findings_by_kind.items():
            rows = [finding._asdict() for finding in findings]
            echo_line({"file": str(path), "kind": kind, "contract": rows})
    else:
        for line in report(findings_by_kind):
            typer.echo(line)
    for findings in findings_by_kind.values():
        if any(finding.verdict == "bad" for finding in findings):
            raise typer.Exit(1)
