"""What the command line does, for notebooks and scripts: one code path for both.

``trackbench.run("config.yaml", runs=50).per_run`` is a data frame; ``trackbench.load(folder)`` reads the
results of an earlier run.
"""

import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trackbench.experiment import config as configs
from trackbench.experiment.cache import BlockStore, cache_folder
from trackbench.experiment.definition import Experiment
from trackbench.experiment.engines import Engine, cpu_count, engine
from trackbench.experiment.lock import locked
from trackbench.experiment.plan import Key, Plan, cautions, check_memory, describe, make_plan
from trackbench.experiment.problems import Mark, Problem, UserError
from trackbench.experiment.runner import Outcome, execute
from trackbench.experiment.store import Losses, write_results
from trackbench.report.comparison import summary_lines, write_comparison, write_paired
from trackbench.report.ledger import write_overview
from trackbench.report.page import write_report
from trackbench.report.render import render, write_figures
from trackbench.report.results import Results, open_results
from trackbench.report.table import Table
from trackbench.report.verdicts import Comparison
from trackbench.report.verdicts import compare as hold_against_published

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, kw_only=True)
class Options:
    """How to run an experiment; only set, only, runs, seed and grid change a number in a CSV."""

    set: Sequence[str] = ()
    only: Sequence[str] = ()
    runs: int | None = None
    seed: int | None = None
    grid: Sequence[str] = ()
    out: Path | None = None
    engine: Engine = "processes"
    workers: int | None = None
    scheduler: str | None = None
    fresh: bool = False
    save_tracks: bool = False
    formats: Sequence[str] = ("png", "svg")
    allow_plugins: bool = False
    quiet: bool = False


@dataclass
class Report:
    """Where the results are, the tables, and what went wrong."""

    folder: Path
    tables: dict[str, Table]
    comparison: Comparison
    notes: list[str] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)
    best: list[str] = field(default_factory=list)
    """of a sweep: each filter's best point"""

    @property
    def results(self) -> Results:
        """The folder's files as data frames."""
        return Results(self.folder)

    @property
    def per_run(self) -> "pd.DataFrame":
        """``filter,run,metric,value``."""
        return self.results.per_run

    @property
    def per_step(self) -> "pd.DataFrame":
        """``filter,step,time,metric,value,stderr,runs``."""
        return self.results.per_step

    @property
    def summary(self) -> "pd.DataFrame":
        """``filter,metric,value,stderr,runs,lost``."""
        return self.results.summary


def prepare(config: Path, options: Options) -> Experiment:
    """Read and validate a config with the options' overrides."""
    return configs.load(
        config,
        list(options.set),
        list(options.only),
        options.runs,
        options.seed,
        list(options.grid),
        options.allow_plugins,
    )


def run(config: Path | str, options: Options | None = None, **changes: Any) -> Report:
    """Run an experiment and write its results folder; raises UserError for bad input.

    ``changes`` are fields of Options, as in ``run("config.yaml", runs=50, workers=2)``.
    """
    options = replace(options or Options(), **changes)
    experiment = prepare(Path(config), options)
    if options.grid:  # a sweep has figures of its own; a panel per point would be no figure
        experiment = replace(experiment, figures={})
    folder = options.out or Path("results") / experiment.settings.name
    _check_out(folder)
    plan, workers, text = _planned(experiment, options)
    open_engine = engine(options.engine, workers, options.scheduler)
    _say(text, options)
    for caution in dict.fromkeys(c for point in experiment.points for c in cautions(point)):
        _say(f"note: {caution}", options)
    with locked(folder, lambda line: _say(line, options)):
        outcome = execute(
            plan,
            BlockStore(cache_folder()),
            open_engine,
            workers,
            experiment.plugins,
            fresh=options.fresh,
            progress=not options.quiet,
        )
        for line in _what_happened(outcome):
            _say(line, options)
        losses = write_results(folder, experiment, outcome, options.save_tracks)
        results = Results(folder)
        tables, comparison = render(results, options.formats)
        write_report(results, comparison)
    notes = [*_notes(experiment, losses), *summary_lines(comparison)]
    return Report(folder, tables, comparison, notes, list(_failed(experiment, outcome, losses)))


def sweep(config: Path | str, options: Options | None = None, **changes: Any) -> Report:
    """Run every combination of ``grid``; also writes ``sweep.csv`` and a figure per metric.

    The results go to ``results/<name>-sweep/``, so that the experiment's own stay as they are.
    """
    from trackbench.report.sweep import render_sweep

    options = replace(options or Options(), **changes)
    if options.out is None:
        name = prepare(Path(config), options).settings.name
        options = replace(options, out=Path("results") / f"{name}-sweep")
    report = run(config, options)
    report.best = render_sweep(report.folder, options.formats)
    return report


def load(folder: Path | str) -> Results:
    """The results of an earlier run, as data frames."""
    return open_results(Path(folder))


def compare(folder: Path | str) -> Comparison:
    """Hold a results folder against what is published again; writes comparison and paired.csv."""
    results = open_results(Path(folder))
    comparison = hold_against_published(results)
    write_comparison(results, comparison)
    write_paired(results)
    return comparison


def plot(
    folder: Path | str, formats: Sequence[str] = ("png", "svg"), only: Sequence[str] = ()
) -> list[Path]:
    """Draw the figures of a results folder again; returns the files written."""
    return write_figures(open_results(Path(folder)), formats, only)


def report(folder: Path | str) -> list[Path]:
    """Write report.html of a results folder, or index.html and the ledger over a folder of them."""
    folder = Path(folder)
    if (folder / "config.yaml").is_file():
        return [write_report(open_results(folder))]
    return write_overview(folder)


def preview(config: Path | str, options: Options) -> str:
    """What `run` would do, in one line."""
    return _planned(prepare(Path(config), options), options)[2]


def _planned(experiment: Experiment, options: Options) -> tuple[Plan, int, str]:
    """The plan, the number of workers and a line that says what is going to happen."""
    check_memory(experiment, 1, options.save_tracks)
    plan = make_plan(experiment, options.save_tracks)
    workers = min(options.workers or cpu_count(), len(plan.unique))
    needed = check_memory(experiment, workers, options.save_tracks)
    return plan, workers, describe(experiment, plan, workers, needed)


def _check_out(folder: Path) -> None:
    """Raise UserError if a file stands where the folder is to be."""
    for path in (folder, *folder.parents):
        if os.path.isfile(path):  # unlike Path.is_file, quiet about a name that is too long
            raise UserError(Problem(Mark(f"--out {folder}"), "", f"{path} is a file, not a folder"))


def _say(text: str, options: Options) -> None:
    if not options.quiet:
        print(text, file=sys.stderr)


def _what_happened(outcome: Outcome) -> Iterator[str]:
    if outcome.reused:
        kept = outcome.reused + outcome.computed
        yield f"reused {outcome.reused} of {kept} blocks from {outcome.store.root}/"
    if outcome.damaged:
        yield f"{outcome.damaged} damaged blocks were computed again"
    if outcome.deaths:
        yield f"note: a worker died; {outcome.deaths} blocks were started again"


def _notes(experiment: Experiment, losses: dict[Key, Losses]) -> Iterator[str]:
    for key, loss in losses.items():
        if loss.lost and not loss.is_total:
            yield f"{experiment.title_of(key)}: {loss}"


def _failed(experiment: Experiment, outcome: Outcome, losses: dict[Key, Losses]) -> Iterator[str]:
    for key, why in outcome.failures.items():
        yield f"{experiment.title_of(key)} failed: {why}"
    for key, loss in losses.items():
        if loss.is_total:
            yield f"{experiment.title_of(key)} failed: {loss}"
