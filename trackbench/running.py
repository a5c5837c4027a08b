"""From configs to results folders: what is run, on which workers, and what is said of it."""

import os
import stat
import sys
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from trackbench.evaluation.precision import looks
from trackbench.experiment.computing.cache import BlockStore, cache_folder
from trackbench.experiment.computing.engines import Engine, cpu_count, engine
from trackbench.experiment.computing.growing import begun, grown, said
from trackbench.experiment.computing.runner import Outcome, execute
from trackbench.experiment.files import touched
from trackbench.experiment.planning.plan import (
    Key,
    Plan,
    cautions,
    check_memory,
    describe,
    make_plan,
)
from trackbench.experiment.problems import Mark, Problem, UserError, counted, reason
from trackbench.experiment.reading import config as configurations
from trackbench.experiment.reading.definition import Experiment
from trackbench.experiment.reading.shipped import located
from trackbench.experiment.storing.lock import locked
from trackbench.experiment.storing.outputs import seal
from trackbench.experiment.storing.store import Losses, write_results
from trackbench.report.comparison import summary_lines
from trackbench.report.page import write_report
from trackbench.report.render import render
from trackbench.report.results import Results
from trackbench.report.table import Table
from trackbench.report.verdicts import Comparison
from trackbench.tuning.entries import Values
from trackbench.tuning.record import write_tuning
from trackbench.tuning.tuned import Tuned
from trackbench.tuning.tuner import tune

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
    out: Path | str | None = None
    engine: Engine = "processes"
    workers: int | None = None
    scheduler: str | None = None
    fresh: bool = False
    save_tracks: bool = False
    formats: Sequence[str] = ("png", "svg")
    allow_plugins: bool = False
    quiet: bool = False


Also: TypeAlias = Callable[[Results, Sequence[str]], list[str]]
"""Writes more files of results, with figures in these formats; returns the best points in words."""


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


def file_of(config: Path | str, options: Options) -> Path:
    """The file of a config, or of the shipped experiment of this name."""
    return located(Path(config), lambda line: _say(line, options))


def prepare(
    config: Path, options: Options, found: Mapping[str, Values] | None = None
) -> Experiment:
    """Read and validate a config, a file or a shipped experiment's name, with the options' overrides.

    ``found`` is what tuning found.
    """
    return configurations.load(
        file_of(config, options),
        list(options.set),
        list(options.only),
        options.runs,
        options.seed,
        list(options.grid),
        options.allow_plugins,
        found,
    )


def run_all(
    configs: Sequence[Path | str], options: Options | None = None, **changes: Any
) -> Generator[Report]:
    """Run experiments one after the other on the same workers, which do not wait for reports.

    Yields each one's report when it is written. Of several experiments ``out`` is the folder that
    holds their folders. Raises UserError, before anything runs, with the mistakes of all configs.
    """
    yield from run_each(configs, replace(options or Options(), **changes))


def run_each(
    configs: Sequence[Path | str], options: Options, also: Also | None = None
) -> Generator[Report]:
    """The same, with more files that ``also`` makes of each one's results."""
    jobs = _jobs([Path(config) for config in configs], options)
    workers = min(_most_workers(options), sum(len(job.plan.unique) for job in jobs))
    open_engine = engine(options.engine, workers, options.scheduler)
    for job in jobs:
        _say(job.line, options)
        points = job.experiment.points
        for caution in dict.fromkeys(c for point in points for c in cautions(point)):
            _say(f"note: {caution}", options)

    def more(i: int, outcome: Outcome) -> Plan | None:
        bigger = grown(jobs[i].experiment, jobs[i].most, outcome)
        if bigger is None:
            return None
        plan = _plan(bigger, jobs[i].most, options)
        jobs[i] = jobs[i]._replace(experiment=bigger, plan=plan)
        return plan

    with ExitStack() as stack:
        for folder in sorted(job.folder for job in jobs):  # in one order: nobody waits in a circle
            stack.enter_context(locked(folder, lambda line: _say(line, options)))
        jobs = [_tuned(job, options) if job.experiment.tuned else job for job in jobs]
        outcomes = execute(
            [job.plan for job in jobs],
            BlockStore(cache_folder()),
            open_engine,
            workers,
            fresh=options.fresh,
            progress=not options.quiet,
            more=more,
        )
        for i, outcome in enumerate(stack.enter_context(closing(outcomes))):
            yield _reported(jobs[i], outcome, options, also)


def preview(configs: Sequence[Path | str], options: Options) -> list[str]:
    """What `run_all` would do, in a line for each."""
    return [job.line for job in _jobs([Path(config) for config in configs], options)]


class _Job(NamedTuple):
    """An experiment that is going to be run, where, and a line that says so."""

    config: Path
    experiment: Experiment
    folder: Path
    plan: Plan
    line: str
    most: int
    """runs at most"""
    tuning: Mapping[str, Tuned] = MappingProxyType({})
    """what tuning tried, by label"""


def _jobs(configs: list[Path], options: Options) -> list[_Job]:
    """What the configs ask for; raises UserError with the mistakes of all of them."""
    jobs: list[_Job] = []
    problems: dict[Problem | str, None] = {}
    for config in configs:
        try:
            job = _job(config, options, alone=len(configs) == 1)
        except UserError as error:
            problems |= dict.fromkeys(error.problems)
            continue
        if job.folder in [other.folder for other in jobs]:
            mark = job.experiment.source.mark(("name",))
            what = f"another config of this command writes into {job.folder}/, too"
            problems[Problem(mark, "name", what)] = None
        jobs.append(job)
    if not _may_write(cache_folder()):
        what = "may not be written in; finished blocks are kept where TRACKBENCH_CACHE says"
        problems[Problem(Mark(f"{cache_folder()}/"), "", what)] = None
    if problems:
        raise UserError(*problems)
    return jobs


def _job(config: Path, options: Options, alone: bool) -> _Job:
    experiment = prepare(config, options)
    if options.grid:  # a sweep has figures of its own; a panel per point would be no figure
        experiment = replace(experiment, figures={})
    folder = Path("results" if options.out is None else options.out)
    if options.out is None or not alone:
        folder /= experiment.settings.name
    _check_out(folder)
    check_memory(experiment, 1, options.save_tracks)
    most = experiment.settings.runs
    plan = _plan(experiment, most, options)
    workers = min(_most_workers(options), len(plan.unique))
    needed = check_memory(experiment, workers, options.save_tracks)
    line = describe(experiment, plan, workers, needed)
    first = begun(experiment)
    return _Job(config, first, folder, _plan(first, most, options), line, most)


def _plan(experiment: Experiment, most: int, options: Options) -> Plan:
    settings = experiment.settings
    stops = list(looks(settings.min_runs, most)) if settings.until else []
    return make_plan(experiment, options.save_tracks, stops)


def _tuned(job: _Job, options: Options) -> _Job:
    """The experiment with the values that tuning finds on runs of its own."""
    workers, store = _most_workers(options), BlockStore(cache_folder())
    open_engine = engine(options.engine, workers, options.scheduler)
    tuning = tune(job.experiment, store, open_engine, workers, options.fresh, not options.quiet)
    found = {label: tried.found for label, tried in tuning.items()}
    experiment = begun(prepare(job.config, options, found))
    plan = _plan(experiment, job.most, options)
    return job._replace(experiment=experiment, plan=plan, tuning=tuning)


def _most_workers(options: Options) -> int:
    return options.workers or cpu_count()


def _reported(job: _Job, outcome: Outcome, options: Options, also: Also | None) -> Report:
    """Tables, figures and the report of an experiment whose blocks are there; at last the manifest."""
    for line in [*_what_happened(outcome), *said(job.experiment, job.most, outcome)]:
        _say(line, options)
    with touched() as paths:
        losses, facts = write_results(job.folder, job.experiment, outcome, options.save_tracks)
        if job.tuning:
            write_tuning(job.folder / "tuning.csv", job.tuning)
        results = Results(job.folder, facts)
        tables, comparison = render(results, options.formats)
        write_report(results, comparison)
        best = also(results, options.formats) if also else []
    seal(job.folder, facts, paths)
    notes = [*_notes(job.experiment, losses), *summary_lines(comparison)]
    failed = list(_failed(job.experiment, outcome, losses))
    return Report(job.folder, tables, comparison, notes, failed, best)


def _check_out(folder: Path) -> None:
    """Raise UserError if something else stands where the folder is to be."""
    for path in (folder, *folder.parents):
        try:
            bad = "" if stat.S_ISDIR(path.stat().st_mode) else f"{path} is a file, not a folder"
        except (FileNotFoundError, NotADirectoryError):
            bad = f"{path} is a link to nothing" if path.is_symlink() else ""
        except OSError as error:
            bad = f"{path}: {reason(error)}"
        if bad:
            raise UserError(Problem(Mark(f"--out {folder}"), "", bad))
    if not _may_write(folder):
        what = "may not be written in; another folder: --out DIR"
        raise UserError(Problem(Mark(f"{folder}/"), "", what))


def _may_write(folder: Path) -> bool:
    """Whether the folder, or the first above it that is there, may be written in."""
    there = next((f for f in (folder, *folder.absolute().parents) if f.exists()), folder)
    return os.access(there, os.W_OK | os.X_OK)


def _say(text: str, options: Options) -> None:
    if not options.quiet:
        print(text, file=sys.stderr)


def _what_happened(outcome: Outcome) -> Iterator[str]:
    if outcome.reused:
        kept = outcome.reused + outcome.computed
        yield f"reused {outcome.reused} of {counted(kept, 'block')} from {outcome.store.root}/"
    if outcome.damaged:
        were = "was" if outcome.damaged == 1 else "were"
        yield f"{counted(outcome.damaged, 'damaged block')} {were} computed again"
    if outcome.deaths:
        were = "was" if outcome.deaths == 1 else "were"
        yield f"note: a worker died; {counted(outcome.deaths, 'block')} {were} started again"


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
