"""Run experiments and report them, or compute one shard of their blocks."""

import hashlib
import json
import os
import platform
import re
import sys
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, suppress
from dataclasses import replace
from importlib import import_module
from itertools import chain
from threading import Thread
from typing import Any, NamedTuple

from trackbench.atomic_files import record_writes, write_text
from trackbench.commands import with_known_keywords
from trackbench.commands.prepare import (
    OPTION_NAMES,
    Job,
    Options,
    expected_time,
    jobs_of,
    most_drawers,
    most_workers,
    plan_of,
    say,
    with_tuned,
)
from trackbench.commands.stored_results import Report
from trackbench.config.experiment import Experiment
from trackbench.config.python_tables import without_folders
from trackbench.config.requested_metrics import takes_times
from trackbench.config.tuned_entries import held_out, training_cautions
from trackbench.core.random_streams import RunStreams
from trackbench.errors import Mark, Problem, UserError, WriteError, counted, in_line
from trackbench.evaluation.timing import REPEATS, Measured, measure
from trackbench.execution.cache import BlockStore, block_key, cache_folder, times_folder
from trackbench.execution.engines import OpenEngine, begin, engine
from trackbench.execution.plan import Key, Plan, cautions
from trackbench.execution.queue import progress_bar
from trackbench.execution.runner import Outcome, execute, next_batch, stop_reason
from trackbench.field_types import require_regular_file
from trackbench.filters.external import PRINT_ALL_DIGITS, External
from trackbench.plugins.errors import guarded
from trackbench.report import DRAWER
from trackbench.report.html.report_page import write_report
from trackbench.report.render import render
from trackbench.report.results import Results
from trackbench.report.sweep import write_sweep
from trackbench.results.folder_contents import locked, write_manifest
from trackbench.results.write import Losses, write_results
from trackbench.tuning.search import write_tuning
from trackbench.yaml_source import Config


@with_known_keywords(*OPTION_NAMES)
def run_all(
    configs: Sequence[Config], options: Options | None = None, **changes: Any
) -> Generator[Report]:
    """Run experiments one after the other on the same workers; yield each written report.

    With several experiments, ``out`` is the folder of their folders. Raises UserError, before anything
    runs, with the mistakes of all configs.
    """
    yield from run_each(configs, (options or Options()).changed(changes))


def run_each(configs: Sequence[Config], options: Options, sweep: bool = False) -> Generator[Report]:
    """Run experiments as `run_all` does; ``sweep`` adds the files and notes of a sweep."""
    begin(options.engine, options.workers, DRAWER)
    jobs = jobs_of(configs, options)
    workers = min(most_workers(options), sum(len(job.plan.unique) for job in jobs))
    open_engine = engine(options.engine, workers, options.scheduler)
    said: set[str] = set()
    for job in jobs:
        say(job.line, options)
        read = chain.from_iterable(plugin.notes for plugin in job.experiment.plugins)
        of_points = cautions(job.experiment.points)
        for caution in [*of_points, *training_cautions(job.experiment), *read]:
            line = f"note: {without_folders(caution)}"
            if line not in said:  # several problems of a suite may have the same
                said.add(line)
                say(line, options)

    if options.shard:
        run_shard(jobs, options, open_engine, workers)
        return

    def more(i: int, outcome: Outcome) -> Plan | None:
        batch = next_batch(jobs[i].experiment, jobs[i].most, outcome)
        if batch is None:
            return None
        outcome.least_precise = batch.least_precise
        plan = plan_of(batch.experiment, jobs[i].most, options)
        jobs[i] = jobs[i]._replace(experiment=batch.experiment, plan=plan)
        return plan

    if most_drawers(options) > 1:
        Thread(target=_import_ahead, daemon=True).start()
    with ExitStack() as stack:
        locks = {}
        for folder in sorted(job.folder for job in jobs):  # in one order: nobody waits in a circle
            locks[folder] = stack.enter_context(ExitStack())
            locks[folder].enter_context(locked(folder, lambda line: say(line, options)))
        jobs = [with_tuned(job, options) if job.experiment.tuned else job for job in jobs]
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
            report = _reported(jobs[i], outcome, options, sweep)
            locks[report.folder].close()  # who gets the report may plot it
            yield report


def _import_ahead() -> None:
    """Import what tables and verdicts need while workers compute blocks."""
    with suppress(Exception):  # the program may be ending; whoever needs them imports them himself
        import_module("scipy.special")
        import_module("pandas")


def preview(configs: Sequence[Config], options: Options) -> list[str]:
    """Describe each experiment that `run_all` would run in a line, with the time that it takes."""
    return [f"{job.line}; {expected_time(job, options)}" for job in jobs_of(configs, options)]


def _reported(job: Job, outcome: Outcome, options: Options, sweep: bool) -> Report:
    """Write the data of an experiment with all blocks and its manifest, then what follows from them.

    What fails among tables, figures and sentences becomes a line. The manifest is written once more at
    the end, with the files that were made.
    """
    for line in [*_what_happened(outcome), *stop_reason(job.experiment, job.most, outcome)]:
        say(line, options)
    progress, times = not options.quiet, Times({}, {})
    if options.times:
        times = times_of(job.experiment, outcome, options.fresh, progress)
    for label, why in times.failed.items():
        say(f"note: {label} has no measured CPU time: {why}", options)
    with record_writes() as data:
        losses, facts = write_results(
            job.folder, job.experiment, outcome, options.save_tracks, times.measured
        )
        if job.tuning:
            write_tuning(job.folder / "tuning.csv", job.tuning)
            facts["training_holds_out"] = held_out(job.experiment)
            trained_s = sum(record.cpu_s for record in job.tuning.values())
            facts["cpu_s"] = round(facts["cpu_s"] + trained_s, 3)
    write_manifest(job.folder, facts, data)
    results = Results(job.folder, facts)
    with record_writes() as derived:
        drawers = most_drawers(options)
        comparison = render(results, options.formats, drawers, options.fresh, progress)[1]
        if sweep:
            with results.without("sweep.csv"):
                write_sweep(results)
        with results.without("report.html"):
            write_report(results, comparison)
    write_manifest(job.folder, facts, [*data, *derived])
    failed = list(_failed(job.experiment, outcome, losses))
    notes = [*_notes(job.experiment, losses), *_digit_notes(job.experiment, outcome)]
    return Report(results, failed, notes, comparison)


def _what_happened(outcome: Outcome) -> Iterator[str]:
    if outcome.reused:
        finished = outcome.reused + outcome.computed
        yield f"reused {outcome.reused} of {counted(finished, 'block')} from {outcome.store.root}/"
    if outcome.damaged:
        yield f"{_were(outcome.damaged, 'damaged block')} computed again"
    if outcome.deaths:
        yield f"note: a worker died; {_were(outcome.deaths, 'block')} started again"
    if outcome.crowding:
        yield f"note: {outcome.crowding}"


def _were(number: int, word: str) -> str:
    return f"{counted(number, word)} {'was' if number == 1 else 'were'}"


def _notes(experiment: Experiment, losses: dict[Key, Losses]) -> Iterator[str]:
    for key, loss in losses.items():
        if loss.lost and not loss.is_total:
            yield f"{experiment.title_of(key)}: {loss}"
    bound = experiment.settings.bound
    if bound:
        cautions_of_bound = (point.scenario.bound_caution for point in experiment.points)
        for caution in dict.fromkeys(filter(None, cautions_of_bound)):
            yield f"{bound}: {caution}"


def _digit_notes(experiment: Experiment, outcome: Outcome) -> Iterator[str]:
    """Yield a note for each program whose answers have few digits, by a run of the first point."""
    point = experiment.points[0]
    failed = {label for _, label in outcome.failures}
    for label, tracker in point.filters.items():
        if not isinstance(tracker, External) or label in failed:
            continue
        scenario = point.assumed_scenario(label)
        data = scenario.simulate(RunStreams(experiment.settings.seed, range(1)), 1)
        prior = scenario.assumed_prior(1) or data.prior
        first = int(scenario.steps[1])
        digits = tracker.few_digits(scenario.model, prior, data.measurements, first)
        if digits:
            yield f"{label}: answers have {digits}: {PRINT_ALL_DIGITS}"


def _failed(experiment: Experiment, outcome: Outcome, losses: dict[Key, Losses]) -> Iterator[str]:
    for key, why in outcome.failures.items():
        yield f"{experiment.title_of(key)} failed: {why}"
    for key, loss in losses.items():
        if loss.is_total:
            yield f"{experiment.title_of(key)} failed: {loss}"
        if not loss.has_distance:
            reference = experiment.settings.reference
            yield f"{experiment.title_of(key)} has no distance: the reference {reference} failed"


class Times(NamedTuple):
    """Measured times by grid point and filter, and by filter the reason why others have none."""

    measured: Mapping[Key, Measured]
    failed: Mapping[str, str]


def times_of(
    experiment: Experiment, outcome: Outcome, fresh: bool, progress: bool = False
) -> Times:
    """Measure the filters' CPU times if the config or a published row uses them.

    They are measured in this process. Cached times are reused unless code, machine or a filter
    changed, or ``fresh``.
    """
    if not takes_times(experiment):
        return Times({}, {})
    # One run is timed as one; more runs are timed in blocks, as they are computed.
    widest = 1 if experiment.settings.runs == 1 else sys.maxsize
    tasks = {
        key: replace(
            blocks[0].filtering_key,
            width=min(blocks[0].width, widest),
            predictive_metrics=(),
            hold_out=None,
        )
        for key, blocks in outcome.plan.tasks.items()
        if key not in outcome.failures
    }
    unique = list(dict.fromkeys(tasks.values()))
    digests = [block_key(task, 0) for task in unique]
    # The properties of this machine that CPU times depend on.
    machine = [platform.node(), platform.platform(), platform.processor(), str(os.cpu_count())]
    name = hashlib.sha256(json.dumps([machine, digests]).encode()).hexdigest()
    file = times_folder() / f"{name}.json"
    if not fresh:
        with suppress(OSError, ValueError, TypeError):
            stored = [Measured(*row) for row in json.loads(require_regular_file(file).read_bytes())]
            return Times({key: stored[unique.index(task)] for key, task in tasks.items()}, {})
    what = f"{experiment.settings.name}: CPU times"
    with progress_bar(len(unique) + REPEATS, "turn", progress, desc=what) as bar:
        measured = dict(zip(unique, measure(unique, guarded, bar.update), strict=True))
    good = {key: m for key, task in tasks.items() if isinstance(m := measured[task], Measured)}
    failed = {
        key[1]: in_line(str(measured[task])) for key, task in tasks.items() if key not in good
    }
    if not failed:
        with (
            record_writes(),
            suppress(OSError, WriteError),
        ):  # it is none of the results folder's files
            file.parent.mkdir(parents=True, exist_ok=True)
            write_text(file, json.dumps([*measured.values()]) + "\n")
    return Times(good, failed)


def run_shard(jobs: Sequence[Job], options: Options, open_engine: OpenEngine, workers: int) -> None:
    """Compute the missing blocks of one shard of every plan, and store them."""
    shard, shards = _parse_shard(options.shard)
    for job in jobs:
        if job.experiment.tuned:
            what = "the blocks of tuned filters follow from tuning; run this config without --shard"
            raise UserError(job.experiment.source.problem(("tune",), what))
    plans = [job.plan.of_shard(shard, shards) for job in jobs]
    store = BlockStore(cache_folder())
    outcomes = execute(
        plans, store, open_engine, workers, fresh=options.fresh, progress=not options.quiet
    )
    with closing(outcomes):
        for job, outcome in zip(jobs, outcomes, strict=True):
            number = f"{len(outcome.plan.unique)} of {len(job.plan.unique)} blocks"
            say(f"{outcome.plan.name}, shard {options.shard}: {number} in {store.root}/", options)
            for key, why in outcome.failures.items():
                say(f"note: {job.experiment.title_of(key)} failed: {why}", options)


def _parse_shard(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d{1,6})/(\d{1,6})", text)
    if match is None or not 1 <= int(match[1]) <= int(match[2]):
        what = f"{text!r} is no shard; allowed: 1/8 to 8/8 of eight shards"
        raise UserError(Problem(Mark("--shard"), "", what))
    return int(match[1]), int(match[2])
