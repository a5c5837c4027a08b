"""Tune the filters of an experiment before its runs, and take the tuned values."""

from trackbench.commands.prepare_jobs import Job
from trackbench.commands.read_experiment import prepare
from trackbench.commands.run_options import Options, most_workers
from trackbench.execution.cache import BlockStore, cache_folder
from trackbench.execution.engines import engine
from trackbench.execution.stop_when_precise import first_batch, plan_of
from trackbench.tuning.record_of_trials import Record
from trackbench.tuning.tuner import tune


def with_tuned(job: Job, options: Options) -> Job:
    """Tune the job's filters on training runs; return the job whose experiment has the tuned values."""
    workers = most_workers(options)
    store = BlockStore(cache_folder())
    open_engine = engine(options.engine, workers, options.scheduler)
    tuning = tune(
        job.experiment,
        store,
        open_engine,
        workers,
        fresh=options.fresh,
        progress=not options.quiet,
    )
    return with_tuned_values(job, options, tuning)


def with_tuned_values(job: Job, options: Options, tuning: dict[str, Record]) -> Job:
    """Return the job whose experiment has the values of the best trials, and that has the record of all.

    ``tuning`` has the trials of each tuned filter by its label.
    """
    tuned_values = {label: record.best.values for label, record in tuning.items()}
    # Plan the first batch of runs. With the config's key `until` further ones may follow, up to the
    # largest number of runs.
    experiment = first_batch(prepare(job.config, options, tuned_values))
    plan = plan_of(experiment, job.most_runs, options.save_tracks)
    return job._replace(experiment=experiment, plan=plan, tuning=tuning)
