"""Command `gate`: fail in continuous integration if a filter is worse than before."""

from pathlib import Path
from typing import Annotated

import typer

from trackbench.cli.json_objects import echo_line
from trackbench.cli.options import (
    AllowPlugins,
    Config,
    Json,
    Only,
    Runs,
    Seed,
    Set,
    Workers,
    api_options,
)

_AGAINST = "stored results, or the folder that holds those of several experiments"
_WORSE = "3sigma, or 3sigma,1%: normal tail of the gate's false alarms, least change"
_COST = "also fail if times on one machine, or evaluations, grow beyond this"
Against = Annotated[Path | None, typer.Option(metavar="DIR", help=_AGAINST)]
Ref = Annotated[str, typer.Option(metavar="REF", help="git revision, which is run, too")]
FilterFile = Annotated[
    Path | None, typer.Option("--filter", metavar="FILE", help="filters; runs its code")
]
Worse = Annotated[str, typer.Option(metavar="LIMIT", help=_WORSE)]
Cost = Annotated[float, typer.Option(min=0, metavar="RATIO", help=_COST)]
AllowRemoved = Annotated[
    bool, typer.Option("--allow-removed", help="pass without a filter or number that was compared")
]
Md = Annotated[Path | None, typer.Option(metavar="FILE", help="comment for a pull request")]


def gate(
    config: Config,
    against: Against = None,
    against_ref: Ref = "",
    filter_file: FilterFile = None,
    worse: Worse = "3sigma",
    cost: Cost = 0.0,
    allow_removed: AllowRemoved = False,
    md: Md = None,
    set_: Set = None,
    only: Only = None,
    runs: Runs = None,
    seed: Seed = None,
    workers: Workers = None,
    allow_plugins: AllowPlugins = False,
    json: Json = False,
) -> None:
    """Fail with exit code 1 if a filter is worse than in stored results or at a git revision."""
    from trackbench.atomic_files import write_text
    from trackbench.commands.compare_new_with_stored import FAILED
    from trackbench.commands.gate import gate as run_gate
    from trackbench.commands.gate import limit_of
    from trackbench.commands.gate_headline import gate_table
    from trackbench.report.folder_comparison.numbers_of_one_folder import REMOVED

    if (against is None) == (not against_ref):  # neither is given, or both are
        raise typer.BadParameter("name either --against DIR or --against-ref REF")
    if md is not None and not md.absolute().parent.is_dir():
        raise typer.BadParameter(f"--md {md}: there is no such folder")
    limit = limit_of(worse)
    # The parameters have the names of options; `api_options` leaves out other names, such as `limit`.
    options = api_options(locals())
    verdict = run_gate(
        config,
        options,
        limit,
        against=against,
        ref=against_ref,
        file=filter_file,  # its filters run beside those of the config
        cost=cost,
        allow_removed=allow_removed,
    )
    table = gate_table(verdict, against_ref or str(against), worse)
    if md is not None:
        text = table.markdown()
        if not table.rows:  # no number of a common filter has changed
            text = "\n\n".join([f"**{table.title}**", *table.notes]) + "\n"
        write_text(md, text)
    if json:
        for row in verdict.rows:
            echo_line(row.fields)
        for removed in verdict.removed:
            echo_line({**removed._asdict(), "verdict": REMOVED, "reason": ""})
        for failure in verdict.failed:
            failed_filter = {"point": None, "filter": failure.filter, "metric": None}
            echo_line({**failed_filter, "verdict": FAILED, "reason": failure.reason})
    else:
        typer.echo(table.aligned())
    raise typer.Exit(int(verdict.is_worse))
