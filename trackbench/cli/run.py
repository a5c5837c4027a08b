"""Command `run`: run experiments and print their outcome, also for `sweep` and `tune`."""

import signal
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from trackbench.cli.errors_and_exit_codes import way_to_go_on
from trackbench.cli.json_objects import echo_line
from trackbench.cli.options import (
    MARKDOWN,
    Configs,
    Filters,
    Force,
    Quick,
    SaveTracks,
    api_options,
    runs_experiments,
)
from trackbench.cli.printed_outcome import print_outcome
from trackbench.cli.watch import watch_config

if TYPE_CHECKING:
    from trackbench.api import Options


_PrintReport: TypeAlias = "partial[None]"
"""Function that prints a report, as objects, Markdown or tables of a terminal."""


Shard: TypeAlias = Annotated[
    str, typer.Option(metavar="I/N", help="compute this part of the blocks into the cache only")
]


@runs_experiments
def run(
    configs: Configs,
    quick: Quick = False,
    force: Force = False,
    save_tracks: SaveTracks = False,
    filters: Filters = None,
    watch: Annotated[
        bool, typer.Option("--watch", help="run again when the config or a file it names is saved")
    ] = False,
    shard: Shard = "",
    **given: Any,
) -> None:
    """Run experiments and write tables, figures and CSV files."""
    # ``given`` has the options of `_shared` (options.py) by name, which the decorator declares.
    start_fork_server(given)  # which needs no other option
    given |= {
        "quick": quick,
        "force": force,
        "save_tracks": save_tracks,
        "filters": filters,
        "shard": shard,
    }
    execute("run", configs, given, watch)


def start_fork_server(given: dict[str, Any]) -> None:
    """Start the process that forks workers early: it imports while this process reads the configs.

    ``given`` has the options of `_shared` (options.py) by name. `DRAWER` names the module that draws
    figures, which the workers import, too. A dry run needs no workers.
    """
    from trackbench.execution.engines import begin
    from trackbench.report.number_of_drawers import DRAWER

    if not given["dry_run"]:
        begin(given["engine"], given["workers"], DRAWER)


def execute(
    command: str, configs: list[Path], given: dict[str, Any], watched: bool = False
) -> None:
    """Run the experiments of the ``command`` `run`, `sweep` or `tune`, and print the outcome.

    ``given`` are all of the command's options by name. With ``watched``, run again after each change of
    a file. Exit with code 1 if anything failed.
    """
    from trackbench import api
    from trackbench.plugins.stop_signals import interrupt

    options = api_options(given)
    json = given["json"]
    print_report = partial(
        print_outcome,
        json=json,
        markdown=MARKDOWN in given["format_"].split(","),
        everything=given["all_"],
    )
    if command == "tune":
        api.check_tuned(configs, options)  # raises for a config that tunes no filter
    if given["dry_run"]:
        for line in api.preview(configs, options):
            if json:
                echo_line({"would": line})
            else:
                typer.echo(line)
        return
    # A request to terminate is handled like Ctrl-C.
    signal.signal(signal.SIGTERM, interrupt)
    if watched:
        watch_config(
            configs, options, lambda config: _run(command, [config], options, print_report)
        )
    elif not _run(command, configs, options, print_report):
        raise typer.Exit(1)


def _run(command: str, configs: list[Path], options: "Options", print_report: _PrintReport) -> bool:
    """Run experiments and print each report; return False if a filter or an output failed.

    After Ctrl-C, print how to go on and exit with code 130.
    """
    from trackbench import api

    is_sweep = command == "sweep"
    if is_sweep:
        reports = (api.sweep(config, options) for config in configs)
    else:
        reports = api.run_all(configs, options)
    is_good = True
    try:
        with closing(reports):
            # The option `--shard` writes no results, and so gives no reports.
            for config, report in zip(configs, reports, strict=False):
                print_report(report, config, is_sweep=is_sweep)
                if report.failed:
                    is_good = False
    except KeyboardInterrupt:
        typer.echo(f"\ninterrupted; {way_to_go_on()}", err=True)
        raise typer.Exit(130) from None  # 128 and SIGINT's number 2, as of a shell
    return is_good
