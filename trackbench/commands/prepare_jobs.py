"""Jobs of a run, one for each config: validated before anything runs, with folder and plan of blocks."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

from trackbench.commands.job_line import announced
from trackbench.commands.output_folder import check_out, choose_folder, may_write
from trackbench.commands.read_experiment import prepare
from trackbench.commands.run_options import Options, most_workers, say
from trackbench.config.experiment import Experiment
from trackbench.config.resolved_config import data_from_python
from trackbench.errors import Mark, Problem, UserError
from trackbench.execution.cache import BlockStore, cache_folder
from trackbench.execution.memory import check_memory
from trackbench.execution.plan import Plan
from trackbench.execution.stop_when_precise import first_batch, plan_of
from trackbench.report.sweep_tables_and_figures import as_sweep
from trackbench.tuning.record_of_trials import Record
from trackbench.yaml_source import Config


class Job(NamedTuple):
    """An experiment to run, its results folder, and the line that announces it.

    ``experiment`` and ``plan`` have the first batch of runs, which is all runs without the key `until`.
    """

    config: Config
    experiment: Experiment
    folder: Path
    plan: Plan
    line: str
    most_runs: int
    """largest number of runs: with the key `until` a run may end earlier"""
    tuning: Mapping[str, Record] = MappingProxyType({})
    """trials of tuning, by label"""


def jobs_of(
    configs: Sequence[Config], options: Options, validated: Sequence[Experiment] = ()
) -> list[Job]:
    """Prepare a job for each config; raises UserError with the mistakes of all of them.

    A job is a validated experiment with its results folder and its plan of blocks. ``validated`` are the
    experiments of the configs with these options, where a suite has them already.
    """
    jobs: list[Job] = []
    # A dict in place of a set: the mistakes keep their order, and each is printed once.
    problems: dict[Problem | str, None] = {}
    for i, config in enumerate(configs):
        try:
            experiment = validated[i] if validated else prepare(config, options)
            job = _prepare_job(config, experiment, options, is_only_config=len(configs) == 1)
        except UserError as error:
            problems |= dict.fromkeys(error.problems)
            continue
        if job.folder in [other.folder for other in jobs]:
            mark = job.experiment.source.mark(("name",))
            message = f"another config of this command writes into {job.folder}/, too"
            problems[Problem(mark, "name", message)] = None
        jobs.append(job)
    store = BlockStore(cache_folder())
    if not may_write(store.root) and store.is_to_be_written(
        (task for job in jobs for task in job.plan.unique), options.fresh
    ):
        message = "may not be written in; finished blocks are kept where TRACKBENCH_CACHE says"
        problems[Problem(Mark(f"{cache_folder()}/"), "", message)] = None
    if problems:
        raise UserError(*problems)
    return jobs


def _prepare_job(
    config: Config, experiment: Experiment, options: Options, is_only_config: bool
) -> Job:
    """Choose the results folder of an experiment, and plan its first batch of runs.

    Raises UserError if the folder may not be written, or the memory is too small.
    """
    # A sweep is an experiment over the values of the option ``grid``.
    if options.grid:
        omitted_figures = list(experiment.settings.figures)
        experiment = as_sweep(experiment)
        if omitted_figures:
            names = ", ".join(omitted_figures)
            say(f"note: a sweep draws figures over its keys, not the config's ({names})", options)
    # Step 1: its folder.
    folder = choose_folder(experiment, options, is_only_config)
    # A folder that may not be written, or has foreign files under the names of those to be written, is a
    # mistake. Data files from Python are written into it, too.
    check_out(folder, data_from_python(experiment, folder))
    # Step 2: the plan of all runs, for the line that announces the job, and of the first batch of runs.
    check_memory(experiment, options.save_tracks)
    most_runs = experiment.settings.runs
    plan = plan_of(experiment, most_runs, options.save_tracks)
    workers = min(most_workers(options), len(plan.unique))
    stored_blocks = 0
    # The values of a tuned filter, and so the names of its blocks in the cache, are not known yet.
    if not options.fresh and not experiment.tuned:
        store = BlockStore(cache_folder())
        stored_blocks = sum(store.has_file(task) for task in plan.unique)
    first = first_batch(experiment)
    return Job(
        config=config,
        experiment=first,
        folder=folder,
        plan=plan_of(first, most_runs, options.save_tracks),
        line=announced(experiment, plan, workers, stored_blocks),
        most_runs=most_runs,
    )
