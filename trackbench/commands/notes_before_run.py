"""Lines that a run prints before it begins: the line of each job, and its cautions."""

from collections.abc import Sequence

from trackbench.commands.expected_time import expected_time_of_tuning
from trackbench.commands.prepare_jobs import Job
from trackbench.commands.run_options import Options, say
from trackbench.config.experiment import cautions
from trackbench.config.python_tables import without_folders
from trackbench.config.tune_key_and_tuning_checks import training_cautions


def announce(jobs: Sequence[Job], options: Options) -> None:
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
