"""Command `gate`: fail in continuous integration if a filter is worse than before."""

from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

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

if TYPE_CHECKING:
    from trackbench.commands.gate import Verdict
    from trackbench.report.text_table import TextTable

_AGAINST = "stored results, or the folder that holds those of several experiments"
_WORSE = "3sigma, or 3sigma,1%: normal tail of the gate's false alarms, least change"
_COST = "also fail if times on one machine, or evaluations, grow beyond this"
Against = Annotated[Path | None, typer.Option(metavar="DIR", help=_AGAINST)]
Ref = Annotated[str, typer.Option(metavar="REF", help="git revision, which is run, too")]
File = Annotated[
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
    filter_: File = None,
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
    from trackbench.commands.gate import FAILED, REMOVED, limit_of
    from trackbench.commands.gate import gate as run_gate

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
        file=filter_,
        cost=cost,
        allow_removed=allow_removed,
    )
    table = _gate_table(verdict, against_ref or str(against), worse)
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


def _gate_table(verdict: "Verdict", name: str, worse: str) -> "TextTable":
    """Tabulate the numbers of the changed filters in both results, with a headline and notes.

    ``name`` is that of the stored results or revision, ``worse`` the limit as typed.
    """
    from trackbench.errors import counted
    from trackbench.report import compare_folders as comparison
    from trackbench.report.findings import phrases
    from trackbench.statistics.significance_rules import EQUAL, WORSE

    # The headline names the numbers that are worse or gone, else the filters that were compared.
    parts = []
    worse_numbers = comparison.changes(verdict.rows, WORSE)
    worse_numbers += [str(failure) for failure in verdict.failed]
    if worse_numbers:
        parts.append(f"worse: {phrases.listed(worse_numbers)}")
    if verdict.removed:
        removed = phrases.listed([str(item) for item in verdict.removed])
        parts.append(f"incomplete: removed {removed}")
    if not parts:
        is_unchanged = all(row.how == EQUAL for row in verdict.rows)
        compared = phrases.listed([phrases.named(label) for label in verdict.compared])
        parts.append(f"{'unchanged' if is_unchanged else 'not worse'}: {compared}")
    title = f"{verdict.name} is {'; '.join(parts)}"
    table = comparison.table_of(title, verdict.rows, (name, "now"), has_tests=True)
    # A number that was tested has a p-value.
    runs_of_tests = [row.difference.runs for row in verdict.rows if not isnan(row.change.p)]
    if runs_of_tests:
        numbers = counted(len(runs_of_tests), "number")
        runs = counted(max(runs_of_tests), "run")
        limit = f"limit {worse} for all together (Holm's correction)"
        table.notes.append(f"{numbers} tested on {runs}; {limit}.")
    table.notes += verdict.notes
    return table
