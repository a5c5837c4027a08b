"""Option `--dry-run`: a line on each experiment, or problem of a suite, that would run."""

from collections.abc import Sequence
from pathlib import Path

from trackbench.commands.expected_time import expected_time_with_tuning
from trackbench.commands.expected_time_of_suite import ExpectedTimesOfSuite
from trackbench.commands.prepare_jobs import Job, jobs_of
from trackbench.commands.prepare_suite import options_of_jobs, prepare_suite
from trackbench.commands.printed_left_out_filters import left_out_lines
from trackbench.commands.run_options import Options
from trackbench.config.shipped_suites import suite_names, suite_times
from trackbench.models.component_names import few_names
from trackbench.models.sensor_places import sensor_places
from trackbench.yaml_source import Config


def dry_run_line(job: Job, time: str) -> str:
    """Return what a dry run prints of a job: its size, state and measurement, and the expected time.

    A filter with components of its own may run on the problem only if it has these names. Places of
    sensors are printed unless all are the origin. ``time`` is the expected time in words.
    """
    model = job.experiment.points[0].scenario.model
    motion, sensor = model
    names = f"state {few_names(motion.components)}, measurement {few_names(sensor.components)}"
    places = sensor_places(model)
    is_elsewhere = any(any(place) for place in places)
    if is_elsewhere:
        texts = []
        for place in places:
            numbers = ", ".join(f"{number:g}" for number in place)
            texts.append(f"[{numbers}]")
        noun = "sensor" if len(places) == 1 else "sensors"
        names += f", {noun} at {few_names(texts)}"
    return f"{job.line} ({names}); {time}"


def preview(configs: Sequence[Config], options: Options) -> list[str]:
    """Describe each experiment that `run_all` would run in a line, with the time that it takes."""
    jobs = jobs_of(configs, options)
    lines = []
    for job in jobs:
        lines.append(dry_run_line(job, expected_time_with_tuning(job, options)))
    return lines


def preview_suite(file: Path, options: Options, problems: Sequence[str] = ()) -> list[str]:
    """Describe each problem that `run_suite` would run in a line, with the time that it takes.

    The time follows from stored results, or else from the recorded times of a shipped suite. To these
    the times of the user's own filters are added, by a trial of their first steps. The first lines are
    on problems that filters do not fit, and on checks of the contract that the user's filters fail.
    """
    # Imported here, as results are read without the code of scenarios.
    from trackbench.commands.suite_contract import check_own_filters

    suite = prepare_suite(file, options, problems)
    job_options = options_of_jobs(suite, options)
    # Times are recorded for the shipped suites with all of their filters.
    is_shipped = file.name in suite_names() and not file.is_file()
    recorded = suite_times(file.name) if is_shipped and not options.only else {}
    configs = [problem.config for problem in suite.problems]
    experiments = [problem.experiment for problem in suite.problems]
    jobs = jobs_of(configs, job_options, experiments)
    expected_times = ExpectedTimesOfSuite(
        recorded, suite.added, job_options, is_quick=options.quick
    )
    lines = []
    for problem, job in zip(suite.problems, jobs, strict=True):
        lines.append(dry_run_line(job, expected_times.of_problem(problem, job)))
    time_of_all = expected_times.of_all_problems()
    if time_of_all:
        lines.append(time_of_all)
    contract_lines = [note for outcome in check_own_filters(suite) for note in outcome.notes()]
    return [*left_out_lines(suite), *contract_lines, *lines]
