"""Command `suite`: run many filters on many problems."""

import signal
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from trackbench.cli.errors_and_exit_codes import way_to_go_on
from trackbench.cli.json_objects import echo_line
from trackbench.cli.options import MARKDOWN, Filters, SaveTracks, api_options, runs_experiments
from trackbench.cli.run import Shard, start_fork_server


@runs_experiments
def suite(
    file: Annotated[
        Path,
        typer.Argument(metavar="[SUITE]", help="a suite file, or the name of a shipped suite"),
    ] = Path("standard"),
    filters: Filters = None,
    problems: Annotated[
        list[str] | None,
        typer.Option("--problem", metavar="NAME", help="run these problems only"),
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="a few runs of each problem")] = False,
    save_tracks: SaveTracks = False,
    shard: Shard = "",
    **given: Any,
) -> None:
    """Run many filters, and yours, on many problems: which filter is good where."""
    # ``given`` has the options of `_shared` (options.py) by name, which the decorator declares.
    start_fork_server(given)  # which needs no other option
    given |= {"filters": filters, "quick": quick, "save_tracks": save_tracks, "shard": shard}
    execute_suite(file, problems or [], given)


def execute_suite(file: Path, problems: list[str], given: dict[str, Any]) -> None:
    """Run the suite of a file on its problems, and print the outcome; exit with 1 if anything failed.

    ``problems`` are the names of the problems to run, all if empty. ``given`` are the command's options
    by name.
    """
    from trackbench.commands.dry_run import preview_suite
    from trackbench.commands.run_suite import run_suite
    from trackbench.plugins.stop_signals import interrupt

    options = api_options(given)
    if given["dry_run"]:
        for line in preview_suite(file, options, problems):
            if given["json"]:
                echo_line({"would": line})
            else:
                typer.echo(line)
        return
    # A request to terminate is handled like Ctrl-C.
    signal.signal(signal.SIGTERM, interrupt)
    try:
        report = run_suite(file, options, problems)
    except KeyboardInterrupt:
        typer.echo(f"\ninterrupted; {way_to_go_on()}", err=True)
        raise typer.Exit(130) from None  # 128 and SIGINT's number 2, as of a shell
    if report is None:  # a shard computes blocks only
        return
    if given["json"]:
        for group in report.groups:
            for score in [*group.scores, *group.not_computed]:
                echo_line(asdict(score))
    else:
        from trackbench.cli.terminal_tables import print_lines, print_tables

        tables = report.tables()
        if given["all_"]:
            tables += report.smoothers()
        print_tables(tables, MARKDOWN in given["format_"].split(","))
        print_lines(report.sentences())
    for failure in report.failed:
        typer.echo(f"error: {failure}", err=True)
    typer.echo(
        f"results in {report.folder}/: suite.html has the figures, scores.csv every number",
        err=True,
    )
    if report.failed:
        raise typer.Exit(1)
