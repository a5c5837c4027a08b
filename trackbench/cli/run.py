"""Commands that run an experiment: once, over a grid, with tuned filters."""

import signal
from collections.abc import Iterator
from contextlib import closing, suppress
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from trackbench.cli.errors_and_exit_codes import as_reportable, print_error, way_to_go_on
from trackbench.cli.json_objects import echo_line, report_as_data
from trackbench.cli.options import (
    MARKDOWN,
    Config,
    Configs,
    Filters,
    Force,
    Grid,
    Product,
    Quick,
    SaveTracks,
    api_options,
    runs_experiments,
)
from trackbench.cli.watch import run_after_changes

if TYPE_CHECKING:
    from trackbench.api import Options, Report


_PrintReport: TypeAlias = "partial[None]"
"""Function that prints a report, as objects, Markdown or tables of a terminal."""


Evaluations: TypeAlias = Annotated[int | None, typer.Option(min=2, help="trials of each filter")]
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
    _begin(given)
    given |= {
        "quick": quick,
        "force": force,
        "save_tracks": save_tracks,
        "filters": filters,
        "shard": shard,
    }
    execute("run", configs, given, watch)


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
    _begin(given)
    given |= {
        "grid": grid,
        "product": product,
        "out": out,
        "quick": quick,
        "force": force,
        "save_tracks": save_tracks,
    }
    execute("sweep", [config], given)


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
    _tune(config, metric, evaluations, given)


@runs_experiments
def fit(config: Config, evaluations: Evaluations = None, **given: Any) -> None:
    """Estimate what `tune` names, such as Q and R, from data: the maximum of the likelihood.

    It is `tune --metric log_score`: of the predictions of each measurement by those before it.
    """
    # ``given`` has the options of `_shared` (options.py) by name, which the decorator declares. Without
    # ``evaluations``, the number of trials of each filter, that of the config's `tuning` stays.
    _tune(config, "log_score", evaluations, given)


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
    _begin(given)
    given |= {"filters": filters, "quick": quick, "save_tracks": save_tracks, "shard": shard}
    execute_suite(file, problems or [], given)


def execute_suite(file: Path, problems: list[str], given: dict[str, Any]) -> None:
    """Run the suite of a file on its problems, and print the outcome; exit with 1 if anything failed.

    ``problems`` are the names of the problems to run, all if empty. ``given`` are the command's options
    by name.
    """
    from trackbench.commands.run_suite import preview_suite, run_suite
    from trackbench.plugins.interrupts import interrupt

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


def _tune(config: Path, metric: str | None, evaluations: int | None, given: dict[str, Any]) -> None:
    """Run a config with tuning; ``metric`` and ``evaluations`` override its keys unless None.

    ``evaluations`` is the number of trials of each filter. ``given`` are the command's options by name.
    """
    overrides = list(given["set_"] or ())
    if metric is not None:
        overrides.append(f"tuning.metric={metric}")
    if evaluations is not None:
        overrides.append(f"tuning.evaluations={evaluations}")
    execute("tune", [config], given | {"set_": overrides})


def _begin(given: dict[str, Any]) -> None:
    """Start the process that forks workers early: it imports while this process reads the configs.

    ``given`` are the command's options by name. `DRAWER` names the module that draws figures, which the
    workers import, too.
    """
    from trackbench.commands.options import DRAWER
    from trackbench.execution.engines import begin

    if not given["dry_run"]:
        begin(given["engine"], given["workers"], DRAWER)


def execute(
    command: str, configs: list[Path], given: dict[str, Any], watched: bool = False
) -> None:
    """Run the experiments of the ``command`` `run`, `sweep` or `tune`, and print the outcome.

    ``given`` are the command's options by name. With ``watched``, run again after each change of a file.
    Exit with code 1 if anything failed.
    """
    from trackbench import api
    from trackbench.plugins.interrupts import interrupt

    options = api_options(given)
    json = given["json"]
    print_report = partial(
        _print_report,
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
        _watch(configs, options, print_report)
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
            # A shard has no reports.
            for config, report in zip(configs, reports, strict=False):
                print_report(report, config, is_sweep=is_sweep)
                if report.failed:
                    is_good = False
    except KeyboardInterrupt:
        typer.echo(f"\ninterrupted; {way_to_go_on()}", err=True)
        raise typer.Exit(130) from None  # 128 and SIGINT's number 2, as of a shell
    return is_good


def _watch(configs: list[Path], options: "Options", print_report: _PrintReport) -> None:
    """Run one config now and after each change of a file; Ctrl-C between runs exits with 0.

    An error is printed, and the next change is waited for.
    """
    from trackbench.commands.options import say
    from trackbench.config.shipped_experiments import located
    from trackbench.errors import Mark, Problem, UserError

    if len(configs) > 1 or str(configs[0]) == "-":
        raise UserError(Problem(Mark("--watch"), "", "watches one config, and that a file"))
    config = located(configs[0], lambda line: say(line, options))

    def run_config() -> None:
        try:
            _run("run", [config], options, print_report)
        except Exception as error:
            print_error(as_reportable(error))

    with suppress(KeyboardInterrupt):
        run_after_changes(config, run_config, [Path(file) for file in options.filters])


def _print_report(
    report: "Report", config: Path, json: bool, markdown: bool, everything: bool, is_sweep: bool
) -> None:
    """Print the ranking, further conclusions, counts of verdicts, and the place of the results.

    Tables are aligned, or in Markdown if ``markdown``. With ``json`` stdout gets one JSON object
    instead. ``everything`` prints all tables and notes.
    """
    if json:
        echo_line(report_as_data(report))
    else:
        from trackbench.cli.terminal_tables import print_lines, print_tables

        # A config without tables of its own, and a sweep, get all tables of the ranking.
        with_numbers = everything or is_sweep or not report.config.get("tables")
        tables = report.ranking(with_numbers)
        if everything or not tables:
            tables += [table.texts() for table in report.tables.values()]
        print_tables(tables, markdown)
        print_lines([*report.answer, *_verdict_lines(report, config)])
    notes = report.notes if everything else report.run_notes
    for note in notes:
        typer.echo(f"note: {note}", err=True)
    for failure in report.failed:
        typer.echo(f"error: {failure}", err=True)
    line = f"results in {report.folder}/"
    if not everything:
        line += ": report.html has tables and figures of these runs; --all prints the tables"
    typer.echo(line, err=True)


def _verdict_lines(report: "Report", config: Path) -> Iterator[str]:
    """Yield lines on the verdicts that compare the results with a paper's numbers and claims.

    These are the numbers of verdicts by word, and the first claim. With fewer runs than the experiment
    has, a line names the number of runs that verdicts need. ``config`` is that of the report.
    """
    from trackbench.report.verdicts.verdict_counts import bars, needed_runs

    need_of_runs = needed_runs(report.comparison)  # a sentence, or empty
    if need_of_runs:
        yield f"{need_of_runs}: trackbench run {config}"
    # A bar has the verdicts on all numbers, or on all claims: a tally for each word.
    verdict_bars = bars(report.comparison)
    if not verdict_bars:
        return
    texts = []
    for bar in verdict_bars:
        numbers = ", ".join(f"{tally.number} {tally.verb}" for tally in bar.parts)
        texts.append(f"{bar.title}: {numbers}")
    yield f"Verdicts on {'; on '.join(texts)}. Reasons: trackbench compare {report.folder}"
    if report.comparison.claims:
        first = report.comparison.claims[0]
        yield f"The first claim: {first.claim.claim}: {first.verdict.word}."
