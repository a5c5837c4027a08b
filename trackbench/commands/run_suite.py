"""Run a suite: its problems as experiments in one queue, then the scores over all of them."""

from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path

from trackbench.atomic_files import ensure_folder
from trackbench.commands.dry_run import dry_run_line
from trackbench.commands.expected_time_of_suite import ExpectedTimesOfSuite
from trackbench.commands.keyword_arguments import with_known_keywords
from trackbench.commands.left_out_filters import left_out_lines, left_out_notes
from trackbench.commands.notebook_report import Report
from trackbench.commands.output_folder import suite_folder
from trackbench.commands.prepare_jobs import jobs_of
from trackbench.commands.run_experiment import run_each
from trackbench.commands.run_options import OPTION_NAMES, Options, say
from trackbench.commands.suite_contract import check_own_filters
from trackbench.commands.suite_report import SuiteReport, problem_models
from trackbench.config.quick_run import FIT
from trackbench.config.shipped_suites import suite_names, suite_times
from trackbench.config.suite import Suite, load_suite
from trackbench.errors import Mark, Problem, UserError
from trackbench.execution.engines import begin
from trackbench.report.drawing_workers import DRAWER
from trackbench.report.findings.phrases import joined
from trackbench.report.html.suite_page import write_suite_page
from trackbench.report.plotting import file_formats
from trackbench.report.suite.figures import draw_figures
from trackbench.report.suite.scores import (
    ProblemRuns,
    Score,
    SuiteScores,
    left_out_scores,
    score_problem,
    write_scores,
)
from trackbench.results.file_names import MANIFEST

_UNUSED = ("measurements", "truth", "grid", "product")
"""Options of experiments that a suite does not have."""


def prepare_suite(file: Path, options: Options, problems: Sequence[str] = ()) -> Suite:
    """Read and validate a suite with the options' overrides; ``problems`` names those to run.

    Raises UserError for mistakes in the suite, and for options that only experiments have.
    """
    for name in _UNUSED:  # options of experiments that a suite does not have
        if getattr(options, name):
            message = "`trackbench suite` has no such option; use `trackbench run`"
            raise UserError(Problem(Mark(f"--{name}"), "", message))
    # On the command line --quick adds the override FIT, block=fit. A suite has no such key, and each of
    # its problems has this value anyway.
    overrides = [text for text in options.set if text != FIT]
    return load_suite(
        file,
        overrides=overrides,
        only=options.only,
        chosen_problems=problems,
        runs=options.runs,
        seed=options.seed,
        quick=options.quick,
        filter_files=[Path(path) for path in options.filters],
        allow_plugins=options.allow_plugins,
    )


def earlier_problems(folder: Path, groups: Sequence[SuiteScores]) -> list[str]:
    """List the results folders in a suite's folder that are of problems without scores in ``groups``.

    An earlier command has run these problems.
    """
    names = {problem for group in groups for problem in group.problems}
    manifests = sorted(folder.glob(f"*/{MANIFEST}"))
    return [path.parent.name for path in manifests if path.parent.name not in names]


def preview_suite(file: Path, options: Options, problems: Sequence[str] = ()) -> list[str]:
    """Describe each problem that `run_suite` would run in a line, with the time that it takes.

    The time follows from stored results, or else from the recorded times of a shipped suite. To these
    the times of the user's own filters are added, by a trial of their first steps. The first lines are
    on problems that filters do not fit, and on checks of the contract that the user's filters fail.
    """
    suite = prepare_suite(file, options, problems)
    job_options = _options_of_jobs(suite, options)
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


@with_known_keywords(*OPTION_NAMES)
def run_suite(
    file: Path | str,
    options: Options | None = None,
    problems: Sequence[str] = (),
    **changes: object,
) -> SuiteReport | None:
    """Run a suite and write the scores of its filters.

    Parameters
    ----------
    file : path of a suite file, or name of a shipped suite
    options : options of every run; default: those of `Options`
    problems : names of the problems to run; default: all
    changes : fields of Options

    Returns
    -------
    The scores; None for a shard, whose blocks are computed into the cache only.

    Raises
    ------
    UserError : bad input, with one line per mistake
    """
    options = (options or Options()).changed(changes)
    # The process that forks workers imports its modules, and the one that draws figures (`DRAWER`),
    # while this process reads the configs.
    begin(options.engine, options.workers, DRAWER)
    suite = prepare_suite(Path(file), options, problems)
    folder = suite_folder(suite, options)
    if suite.too_long:
        names = ", ".join(suite.too_long)
        reason = "which takes long; --problem NAME runs it"
        if len(suite.too_long) > 1:
            reason = "which take long; --problem NAME runs one of them"
        say(f"note: --quick leaves out {names}, {reason}", options)
    for line in left_out_notes(suite):
        say(f"note: {line}", options)
    # A shard writes no scores, and its other shards would repeat the checks.
    contract = [] if options.shard else check_own_filters(suite)
    for outcome in contract:
        for line in outcome.notes():
            say(f"note: {line}", options)
    scores: dict[str, list[Score]] = {name: [] for name in suite.settings.groups}
    runs: dict[str, dict[str, ProblemRuns]] = {name: {} for name in suite.settings.groups}
    failed: list[str] = []
    configs = [problem.config for problem in suite.problems]
    experiments = [problem.experiment for problem in suite.problems]
    reports = run_each(configs, _options_of_jobs(suite, options), validated=experiments)
    with closing(reports):
        # A shard has no reports.
        for problem, report in zip(suite.problems, reports, strict=False):
            failed += _failures(suite, problem.name, report)
            problem_scores, problem_runs = score_problem(problem, report.results)
            scores[problem.group] += problem_scores
            runs[problem.group][problem.name] = problem_runs
    if options.shard:
        return None
    # Problems that none of the added filters fits are not run: these filters get scores that say so.
    not_computed: dict[str, list[Score]] = {name: [] for name in suite.settings.groups}
    for problem in suite.without_added:
        not_computed[problem.group] += left_out_scores(problem, suite.added)
    models = problem_models(suite)
    groups = [
        SuiteScores(
            group=name,
            title=group.title,
            scores=scores[name],
            runs=runs[name],
            tuned={p.name: p.tuned for p in suite.problems if p.group == name},
            added=_own_in_group(suite, name),
            linear=frozenset(label for label, model in models.items() if model.is_linear),
            not_computed=tuple(not_computed[name]),
        )
        for name, group in suite.settings.groups.items()
        if scores[name] or not_computed[name]
    ]
    result = SuiteReport(
        suite=suite,
        models=models,
        folder=folder,
        groups=groups,
        failed=failed,
        contract=contract,
    )
    ensure_folder(folder)
    write_scores(folder, groups)
    earlier = earlier_problems(folder, groups)
    if earlier:
        say(
            f"note: {folder} also has {joined(earlier)} of earlier commands; scores.csv and suite.html "
            "have the problems of this one only: name all of them, or write with --out elsewhere",
            options,
        )
    figures = draw_figures(folder, groups, file_formats.forms(options.formats))
    write_suite_page(
        folder / "suite.html",
        title=suite.settings.title or suite.settings.name,
        version=suite.settings.version,
        groups=groups,
        sentences=result.sentences(),
        tables=result.tables(),
        smoothers=result.smoothers(),
        figures=figures,
        left_out=left_out_lines(suite),
    )
    return result


def _own_in_group(suite: Suite, name: str) -> tuple[str, ...]:
    """Return the labels of the user's own filters that run on problems of the group ``name``.

    These are added filters, which join all problems, and those in the rosters of the group's problems.
    """
    group = suite.settings.groups[name]
    labels = {*suite.added, *group.filters}
    for problem in group.problems.values():
        labels |= problem.filters.keys()
    return tuple(label for label in suite.own if label in labels)


def _options_of_jobs(suite: Suite, options: Options) -> Options:
    """Return the options with which the suite's experiments are run.

    Options that change a config, such as ``filters``, are reset: the suite has put them into the
    experiments' configs. So is ``spare``, which would keep results of more runs and write to another
    folder.
    """
    folder = suite_folder(suite, options)
    # `choose_folder` adds each experiment's name to the folder of several, but not to that of a single
    # one.
    if len(suite.problems) == 1:
        folder = folder / suite.problems[0].name
    return replace(
        options,
        set=(),
        only=(),
        runs=None,
        seed=None,
        quick=False,
        spare=False,
        filters=(),
        out=folder,
    )


def _failures(suite: Suite, name: str, report: Report) -> list[str]:
    """Return a line for each of the user's filters, tables and figures that failed on a problem.

    The problem's ``name`` comes first in the line. Failed filters of the roster are not listed: their
    cells of the matrix have the reasons.
    """
    lines = list(report.results.unmade_lines)
    for line in report.failed_filters:  # "LABEL failed: ...", or "LABEL at ..." for a grid
        is_of_user = any(line.startswith(f"{label} ") for label in suite.own)
        if is_of_user:
            lines.append(line)
    return [f"{name}: {line}" for line in lines]
