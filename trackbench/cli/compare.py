"""Commands on several results: two folders, a gate for continuous integration, a history."""

from collections.abc import Sequence
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

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
from trackbench.cli.output import echo_line, table_rows

if TYPE_CHECKING:
    from trackbench.commands.gate import Verdict
    from trackbench.report.compare_folders import Row
    from trackbench.report.table import TextTable

_AGAINST = "stored results, or the folder that holds those of several experiments"
_WORSE = "3sigma, or 3sigma,1%: normal tail of the gate's false alarms, least change"
_COST = "also fail if times on one machine, or evaluations, grow beyond this"
Figure = Annotated[Path | None, typer.Option("--out", metavar="FILE", help="png, svg or pdf")]
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
Metric = Annotated[str, typer.Option(help="row of summary.csv, as rms(rmse_position)")]
Folders = Annotated[list[Path], typer.Argument(metavar="DIR...", help="results folders")]


def compare_two(
    first: Path, second: Path, out: Path | None, json: bool, markdown: bool = False
) -> None:
    """Print how the numbers of two folders differ, and draw a figure."""
    from trackbench.errors import UserError, counted
    from trackbench.report import compare_folders as comparison
    from trackbench.report.compare_folders import compare_folders
    from trackbench.report.open import open_with_notes
    from trackbench.statistics.rules import EQUAL

    a, b = open_with_notes(first), open_with_notes(second)
    rows, why = compare_folders(a, b)
    if not rows:
        raise UserError(f"{first} and {second} have no filter, metric and grid point in common")
    names = (first.name, second.name) if first.name != second.name else (str(first), str(second))
    if out is not None:
        comparison.save(comparison.draw(rows, names), out)
    if json:
        _echo_rows(rows)
        return
    paired = f"paired on {counted(max(row.difference.runs for row in rows), 'common run')}"
    title = f"{names[1]} against {names[0]}, {f'independent: {why}' if why else paired}"
    changed = [row for row in rows if row.how != EQUAL]
    main = [row for row in changed if row.is_primary] or changed
    table = comparison.table_of(
        title, [row for row in rows if row in main or row.how == EQUAL], names
    )
    if len(changed) > len(main):
        more = f"{len(changed) - len(main)} more of windows, components and diagnostics: --json"
        table.notes.append(more)
    typer.echo(table.markdown() if markdown else table.aligned())
    typer.echo(comparison.conclusion(rows, names))


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
    from trackbench.commands.gate import gate as judged
    from trackbench.commands.gate import limit_of

    if (against is None) == (not against_ref):
        raise typer.BadParameter("name either --against DIR or --against-ref REF")
    if md is not None and not md.absolute().parent.is_dir():
        raise typer.BadParameter(f"--md {md}: there is no such folder")
    limit, options = limit_of(worse), api_options(locals())
    verdict = judged(config, options, limit, against, against_ref, filter_, cost, allow_removed)
    table = _gate_table(verdict, against_ref or str(against), worse)
    if md is not None:
        lines = "\n\n".join([f"**{table.title}**", *table.notes]) + "\n"
        write_text(md, table.markdown() if table.rows else lines)
    if json:
        _echo_rows(verdict.rows)
        for what in verdict.removed:
            echo_line({"removed": what})
    else:
        typer.echo(table.aligned())
    raise typer.Exit(int(verdict.is_worse))


def _gate_table(verdict: "Verdict", name: str, worse: str) -> "TextTable":
    """Tabulate the numbers of the changed filters, with a headline and notes."""
    from trackbench.errors import counted
    from trackbench.report import compare_folders as comparison
    from trackbench.report.findings import phrases
    from trackbench.statistics.rules import EQUAL, WORSE

    bad = comparison.changes(verdict.rows, WORSE) + verdict.failed
    tests = [row.difference.runs for row in verdict.rows if not isnan(row.change.p)]
    same = all(row.how == EQUAL for row in verdict.rows)
    # The headline names what is worse or gone, else the filters that were compared.
    parts = [f"worse: {phrases.listed(bad)}"] if bad else []
    if verdict.removed:
        parts.append(f"incomplete: removed {phrases.listed(verdict.removed)}")
    if not parts:
        compared = phrases.listed([*map(phrases.named, verdict.compared)])
        parts.append(f"{'unchanged' if same else 'not worse'}: {compared}")
    title = f"{verdict.name} is {'; '.join(parts)}"
    table = comparison.table_of(title, verdict.rows, (name, "now"))
    if tests:
        on = f"{counted(len(tests), 'number')} tested on {counted(max(tests), 'run')}"
        table.notes.append(f"{on}; limit {worse} for all together (Holm's correction).")
    table.notes += verdict.notes
    return table


def _echo_rows(rows: "Sequence[Row]") -> None:
    for row in rows:
        echo_line(row.fields)


def history(folders: Folders, metric: Metric = "", out: Figure = None, json: Json = False) -> None:
    """Show a metric of each filter over results folders, in the order of their dates."""
    from trackbench.errors import UserError
    from trackbench.report import history as of_folders
    from trackbench.report.compare_folders import save
    from trackbench.report.open import explain_content_errors, open_results

    good = [folder for folder in folders if (folder / "config.yaml").is_file()]
    for folder in folders:
        if folder not in good and (folder.is_dir() or not folder.exists()):
            typer.echo(f"note: {folder}: is not a results folder, it has no config.yaml", err=True)
    if not good:
        raise UserError("name at least one results folder: trackbench history results/*")
    every = [open_results(folder) for folder in good]
    with explain_content_errors(good[0] if len(good) == 1 else "one of these folders"):
        tables = of_folders.history(every, metric)
    if out is not None:
        save(of_folders.draw(tables), out)
    for table in tables:
        if json:
            echo_line({"experiment": table.title, **table_rows(table)})
        else:
            typer.echo(table.texts().aligned())
