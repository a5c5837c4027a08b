"""Run experiments and report them, or compute one shard of their blocks."""

from collections.abc import Generator, Iterator, Sequence
from contextlib import ExitStack, closing, suppress
from importlib import import_module
from threading import Thread
from typing import Any

from trackbench.atomic_files import record_writes
from trackbench.commands.cpu_times import Times, measure_times
from trackbench.commands.expected_time import expected_time, expected_time_of_tuning
from trackbench.commands.keyword_arguments import with_known_keywords
from trackbench.commands.prepare import Job, dry_run_line, jobs_of, plan_of, with_tuned
from trackbench.commands.run_options import (
    DRAWER,
    OPTION_NAMES,
    Options,
    most_drawers,
    most_workers,
    say,
)
from trackbench.commands.shard import run_shard
from trackbench.commands.stored_results import Report
from trackbench.config.experiment import Experiment
from trackbench.config.python_tables import without_folders
from trackbench.config.training_data import held_out_data, training_cautions
from trackbench.core.random_streams import RunStreams
from trackbench.errors import counted
from trackbench.execution.cache import BlockStore, cache_folder
from trackbench.execution.engines import begin, engine
from trackbench.execution.plan import Key, Plan, cautions
from trackbench.execution.runner import Outcome, execute
from trackbench.execution.stop_when_precise import next_batch, stop_reason
from trackbench.filters.external import External
from trackbench.filters.printed_digits import PRINT_ALL_DIGITS
from trackbench.report.html.report_page import write_report
from trackbench.report.render import render
from trackbench.report.sweep_files import write_sweep
from trackbench.report.tables_and_figures import Results
from trackbench.results.lock import locked
from trackbench.results.manifest import write_manifest
from trackbench.results.number_arrays import array_notes
from trackbench.results.write import Losses, write_results
from trackbench.tuning.record_of_trials import write_tuning
from trackbench.yaml_source import Config


@with_known_keywords(*OPTION_NAMES)
def run_all(
    configs: Sequence[Config], options: Options | None = None, **changes: Any
) -> Generator[Report]:
    """Run experiments one after the other on the same workers; yield each written report.

    With several experiments, ``out`` is the folder of their folders.

    Parameters
    ----------
    configs : paths, names of shipped experiments, or mappings like config files
    options : options of every run; default: those of `Options`
    changes : fields of Options, as in ``run_all(configs, runs=50)``

    Raises
    ------
    UserError : bad input, before anything runs, with the mistakes of all configs
    """
    yield from run_each(configs, (options or Options()).changed(changes))


def run_each(
    configs: Sequence[Config],
    options: Options,
    sweep: bool = False,
    validated: Sequence[Experiment] = (),
) -> Generator[Report]:
    """Run experiments as `run_all` does: yield a report of each once its results are written.

    ``sweep`` adds the files of a sweep. ``validated`` are the experiments of the configs with these
    options, where a suite has them already. With the option ``shard`` only blocks are computed, and
    nothing is yielded.
    """
    # Step 1: validate all configs, and announce them.
    begin(options.engine, options.workers, DRAWER)
    jobs = jobs_of(configs, options, validated)
    workers = min(most_workers(options), sum(len(job.plan.unique) for job in jobs))
    open_engine = engine(options.engine, workers, options.scheduler)
    _announce(jobs, options)
    if options.shard:
        run_shard(jobs, options, open_engine, workers)
        return

    def plan_more(i: int, outcome: Outcome) -> Plan | None:
        """Plan the next batch of runs of the i-th job, and update the job; None if it has enough.

        Only with the config's key `until` there are several batches.
        """
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
        # Step 2: lock the results folders, always in one order, so that no two commands wait for each
        # other.
        locks = {}
        for folder in sorted(job.folder for job in jobs):
            locks[folder] = stack.enter_context(ExitStack())
            locks[folder].enter_context(locked(folder, lambda line: say(line, options)))
        # Step 3: tune, run, and report each experiment once it is complete.
        jobs = [with_tuned(job, options) if job.experiment.tuned else job for job in jobs]
        outcomes = execute(
            [job.plan for job in jobs],
            BlockStore(cache_folder()),
            open_engine,
            workers,
            fresh=options.fresh,
            progress=not options.quiet,
            more=plan_more,
        )
        for i, outcome in enumerate(stack.enter_context(closing(outcomes))):
            report = _write_results_and_report(jobs[i], outcome, options, sweep)
            # The caller may plot the report's figures again, which locks the folder.
            locks[report.folder].close()
            yield report


def _announce(jobs: Sequence[Job], options: Options) -> None:
    """Print each job's line and its cautions, a caution of several jobs once.

    The line has the size of the job and, with tuning, the expected time of tuning. A caution warns of
    what may mislead in the results.
    """
    printed: set[str] = set()
    for job in jobs:
        line = job.line
        # The time of tuning is estimated by a trial, which is not made if nothing is printed. A shard
        # tunes nothing: `run_shard` rejects it.
        if not options.quiet and not options.shard:
            line = ", ".join(filter(None, [line, expected_time_of_tuning(job, options)]))
        say(line, options)
        job_cautions = [*cautions(job.experiment.points), *training_cautions(job.experiment)]
        for plugin in job.experiment.plugins:
            job_cautions += plugin.notes
        for caution in job_cautions:
            # Files of tables from Python are named without their temporary folder.
            line = f"note: {without_folders(caution)}"
            if line not in printed:
                printed.add(line)
                say(line, options)


def _import_ahead() -> None:
    """Import scipy.special, which tables and verdicts need, while workers compute blocks."""
    # The program may be ending; the modules that need the library import it anyway.
    with suppress(Exception):
        import_module("scipy.special")


def preview(configs: Sequence[Config], options: Options) -> list[str]:
    """Describe each experiment that `run_all` would run in a line, with the time that it takes."""
    jobs = jobs_of(configs, options)
    lines = []
    for job in jobs:
        times = [expected_time(job, options), expected_time_of_tuning(job, options)]
        lines.append(dry_run_line(job, ", ".join(filter(None, times))))
    return lines


def _write_results_and_report(job: Job, outcome: Outcome, options: Options, sweep: bool) -> Report:
    """Write the data and the manifest of an experiment, then its tables, figures and report.

    ``outcome`` has the results of all runs. A failing table, figure or sentence becomes a line of the
    report. The manifest is written once more at the end, with all files. ``sweep`` adds the files of a
    sweep.
    """
    progress = not options.quiet
    # Step 1: notes on the run, and CPU times.
    for line in _run_lines(outcome):
        say(line, options)
    for line in stop_reason(job.experiment, job.most, outcome):
        say(line, options)
    times = Times({}, {})
    if options.times:
        times = measure_times(job.experiment, outcome, options.fresh, progress)
    for label, why in times.failed.items():
        say(f"note: {label} has no measured CPU time: {why}", options)
    # Step 2: the data.
    with record_writes() as data_files:
        written = write_results(
            job.folder, job.experiment, outcome, options.save_tracks, times.measured
        )
        facts = written.facts
        if job.tuning:
            write_tuning(job.folder / "tuning.csv", job.tuning)
            facts["training_holds_out"] = held_out_data(job.experiment)
            training_s = sum(record.cpu_s for record in job.tuning.values())
            facts["cpu_s"] = round(facts["cpu_s"] + training_s, 3)
    digests = write_manifest(job.folder, facts, data_files)
    # Step 3: the outputs that are computed from the data.
    results = Results(job.folder, facts, run_values=written.run_values)
    with record_writes() as derived_files:
        drawers = most_drawers(options)
        _, comparison = render(results, options.formats, drawers, options.fresh, progress)
        if sweep:
            with results.continued_after_failure("sweep.csv"):
                write_sweep(results)
        with results.continued_after_failure("report.html"):
            write_report(results, comparison)
    write_manifest(job.folder, {**facts, "files": digests}, derived_files)
    notes = list(_loss_notes(job.experiment, written.losses))
    notes += _bound_notes(job.experiment)
    notes += _digit_notes(job.experiment, outcome)
    notes += array_notes(job.experiment)
    if results.idle_figures:
        names = ", ".join(results.idle_figures)
        notes.append(f"figures that are not drawn, because none of their filters ran: {names}")
    return Report(
        results=results,
        failed_filters=list(_failure_lines(job.experiment, outcome, written.losses)),
        run_notes=notes,
        _compared=comparison,
    )


def _run_lines(outcome: Outcome) -> Iterator[str]:
    """Yield lines on reused and damaged blocks, on workers that died, and on too little memory."""
    if outcome.reused:
        finished = outcome.reused + outcome.computed
        yield f"reused {outcome.reused} of {counted(finished, 'block')} from {outcome.store.root}/"
    if outcome.damaged:
        yield f"{_counted_with_verb(outcome.damaged, 'damaged block')} computed again"
    if outcome.deaths:
        yield f"note: a worker died; {_counted_with_verb(outcome.deaths, 'block')} started again"
    if outcome.crowding:
        yield f"note: {outcome.crowding}"


def _counted_with_verb(number: int, noun: str) -> str:
    """Write ``1 block was`` or ``2 blocks were``."""
    verb = "was" if number == 1 else "were"
    return f"{counted(number, noun)} {verb}"


def _loss_notes(experiment: Experiment, losses: dict[Key, Losses]) -> Iterator[str]:
    """Yield a note for each filter that lost some of its runs.

    A filter that lost all of them counts as failed, in `_failure_lines`.
    """
    for key, loss in losses.items():
        if loss.lost and not loss.is_total:
            yield f"{experiment.title_of(key)}: {loss}"


def _bound_notes(experiment: Experiment) -> Iterator[str]:
    """Yield the cautions of the scenarios' lower error bounds, each once; none without a bound.

    A caution is a reason to doubt a bound, such as that few simulated paths carry its information.
    """
    bound = experiment.settings.bound
    if not bound:
        return
    bound_cautions = [point.scenario.bound_caution for point in experiment.points]
    for caution in dict.fromkeys(bound_cautions):
        if caution:
            yield f"{bound}: {caution}"


def _digit_notes(experiment: Experiment, outcome: Outcome) -> Iterator[str]:
    """Yield a note for each filter that is a program and prints its estimates with too few digits.

    Those of float32 are too few at large coordinates. The program is run once more, on the first run of
    the first point of the grid.
    """
    point = experiment.points[0]
    failed = {label for _, label in outcome.failures}  # by number of the point, and label
    for label, tracker in point.filters.items():
        if not isinstance(tracker, External) or label in failed:
            continue
        scenario = point.assumed_scenario(label)
        data = scenario.simulate(RunStreams(experiment.settings.seed, range(1)), 1)
        prior = scenario.assumed_prior(1) or data.prior  # None: filters assume the simulated prior
        first_step = int(scenario.steps[1])  # of the first measurement; steps[0] is the prior's
        digits = tracker.digits(scenario.model, prior, data.measurements, first_step)
        if digits.too_few:
            yield f"{label}: answers have {digits.too_few}: {PRINT_ALL_DIGITS}"
        elif digits.advice:
            yield f"{label}: {digits.advice}"


def _failure_lines(
    experiment: Experiment, outcome: Outcome, losses: dict[Key, Losses]
) -> Iterator[str]:
    """Yield a line for each filter that failed, lost all runs, or has no distance to the reference.

    ``losses`` are the lost runs of the filters that did not fail. The distance is the RMS difference
    from the estimates of the reference filter, which may itself have failed.
    """
    for key, why in outcome.failures.items():
        yield f"{experiment.title_of(key)} failed: {why}"
    for key, loss in losses.items():
        if loss.is_total:
            yield f"{experiment.title_of(key)} failed: {loss}"
        if not loss.has_distance:
            reference = experiment.settings.reference
            yield f"{experiment.title_of(key)} has no distance: the reference {reference} failed"
