"""Run experiments and report them, or compute one shard of their blocks."""

from collections.abc import Generator, Sequence
from contextlib import ExitStack, closing, suppress
from importlib import import_module
from threading import Thread
from typing import Any

from trackbench.atomic_files import record_writes
from trackbench.commands.jobs_with_tuned_values import with_tuned
from trackbench.commands.measured_or_cached_cpu_times import Times, measure_times
from trackbench.commands.notebook_report import Report
from trackbench.commands.notes_after_run import (
    bound_notes,
    digit_notes,
    failure_lines,
    idle_figure_notes,
    loss_notes,
    run_lines,
    tuning_notes,
)
from trackbench.commands.notes_before_run import announce
from trackbench.commands.prepare_jobs import Job, jobs_of
from trackbench.commands.run_options import OPTION_NAMES, Options, most_workers, say
from trackbench.commands.shard import run_shard
from trackbench.commands.unknown_keywords import with_known_keywords
from trackbench.config.experiment import Experiment
from trackbench.config.training_data import held_out_data
from trackbench.execution.cache import BlockStore, cache_folder
from trackbench.execution.engines import begin, engine
from trackbench.execution.plan import Plan
from trackbench.execution.run_plans import Outcome, execute
from trackbench.execution.stop_when_precise import next_batch, plan_of, stop_reason
from trackbench.report.html.report_page import write_report
from trackbench.report.number_of_drawers import DRAWER, most_drawers
from trackbench.report.render import render
from trackbench.report.sweep_csv import write_sweep
from trackbench.report.tables_and_figures import Results
from trackbench.results.lock import locked
from trackbench.results.manifest import write_manifest
from trackbench.results.write_folder import write_results
from trackbench.results.write_npz import array_notes
from trackbench.tuning.record_of_trials import write_tuning
from trackbench.yaml_source import Config


@with_known_keywords(*OPTION_NAMES)
def run_all(
    configs: Sequence[Config], options: Options | None = None, **changes: Any
) -> Generator[Report]:
    """Run experiments one after the other on the same workers; yield each written report.

    With several experiments, ``out`` is the folder of their folders. With the option ``shard`` only
    blocks are computed, and no report is yielded.

    Parameters
    ----------
    configs
        paths, names of shipped experiments, or mappings like config files
    options
        options of every run; default: those of `Options`
    changes
        fields of Options, as in ``run_all(configs, runs=50)``

    Raises
    ------
    UserError
        bad input, before anything runs, with the mistakes of all configs
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
    # Step 1: validate all configs, and announce them. The process that forks workers meanwhile imports
    # what they need, with the module that draws figures (`DRAWER`).
    begin(options.engine, options.workers, DRAWER)
    jobs = jobs_of(configs, options, validated)
    workers = min(most_workers(options), sum(len(job.plan.unique) for job in jobs))
    open_engine = engine(options.engine, workers, options.scheduler)
    announce(jobs, options)
    if options.shard:
        run_shard(jobs, options, open_engine, workers)
        return

    def plan_more(i: int, outcome: Outcome) -> Plan | None:
        """Plan the next batch of runs of the i-th job, and update the job; None if it has enough.

        Only with the config's key `until` there are several batches, of at most ``most_runs`` runs
        together. ``outcome`` has the results so far, and gets the number that is least precise.
        """
        batch = next_batch(jobs[i].experiment, jobs[i].most_runs, outcome)
        if batch is None:
            return None
        outcome.least_precise = batch.least_precise
        plan = plan_of(batch.experiment, jobs[i].most_runs, options.save_tracks)
        jobs[i] = jobs[i]._replace(experiment=batch.experiment, plan=plan)
        return plan

    # Several processes draw figures if several compute blocks: this one then is idle for now.
    if most_drawers(options.engine, most_workers(options)) > 1:
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


def _import_ahead() -> None:
    """Import scipy.special, which tables and verdicts need, while workers compute blocks."""
    # The program may be ending; the modules that need the library import it anyway.
    with suppress(Exception):
        import_module("scipy.special")


def _write_results_and_report(job: Job, outcome: Outcome, options: Options, sweep: bool) -> Report:
    """Write the data and the manifest of an experiment, then its tables, figures and report.

    ``outcome`` has the results of all runs. A failing table, figure or sentence becomes a line of the
    report. If filters were tuned, their trials are written, too, and the manifest has in what the judged
    data differ from the training data. The manifest is written once more at the end, with all files.
    ``sweep`` adds the files of a sweep.
    """
    progress = not options.quiet
    # Step 1: notes on the run, and CPU times.
    for line in run_lines(outcome):
        say(line, options)
    for line in stop_reason(job.experiment, job.most_runs, outcome):
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
            failures = {
                label: record.first_failure
                for label, record in job.tuning.items()
                if record.first_failure
            }
            if failures:
                facts["training_failures"] = failures
            training_s = sum(record.cpu_s for record in job.tuning.values())
            facts["cpu_s"] = round(facts["cpu_s"] + training_s, 3)
    digests = write_manifest(job.folder, facts, data_files)
    # Step 3: the outputs that are computed from the data.
    results = Results(job.folder, facts, run_values=written.run_values)
    with record_writes() as derived_files:
        drawers = most_drawers(options.engine, most_workers(options))
        # Tables, figures and verdicts; `render` also returns the tables.
        _, comparison = render(results, options.formats, drawers, options.fresh, progress)
        if sweep:
            with results.continued_after_failure("sweep.csv"):
                write_sweep(results)
        with results.continued_after_failure("report.html"):
            write_report(results, comparison)
    write_manifest(job.folder, {**facts, "files": digests}, derived_files)
    # Step 4: notes on lost runs, lower bounds, answers of programs, files of arrays and missing figures.
    notes = list(loss_notes(job.experiment, written.losses))
    notes += tuning_notes(job.tuning)
    notes += bound_notes(job.experiment)
    notes += digit_notes(job.experiment, outcome)
    notes += array_notes(job.experiment)
    notes += idle_figure_notes(results)
    return Report(
        results=results,
        failed_filters=list(failure_lines(job.experiment, outcome, written.losses)),
        run_notes=notes,
        _compared=comparison,
    )
