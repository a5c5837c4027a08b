"""Run a suite: its problems as experiments in one queue, then the scores over all of them."""

from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

from trackbench.atomic_files import ensure_folder
from trackbench.commands.output_folder import suite_folder
from trackbench.commands.prepare_suite import options_of_jobs, prepare_suite
from trackbench.commands.printed_left_out_filters import left_out_lines, left_out_notes
from trackbench.commands.run_experiment import run_each
from trackbench.commands.run_options import OPTION_NAMES, Options, say
from trackbench.commands.suite_contract import check_own_filters
from trackbench.commands.suite_report import SuiteReport, failure_lines, problem_models
from trackbench.commands.unknown_keywords import with_known_keywords
from trackbench.config.suite import own_in_group
from trackbench.execution.engines import begin
from trackbench.report.findings.phrases import joined
from trackbench.report.html.suite_page import write_suite_page
from trackbench.report.number_of_drawers import DRAWER
from trackbench.report.plotting import file_formats
from trackbench.report.suite.figure_files import draw_figures
from trackbench.report.suite.problem_scores import left_out_scores, score_problem
from trackbench.report.suite.scores import ProblemRuns, Score, SuiteScores, write_scores
from trackbench.results.file_names import MANIFEST


def earlier_problems(folder: Path, groups: Sequence[SuiteScores]) -> list[str]:
    """List the results folders in a suite's folder that are of problems without scores in ``groups``.

    An earlier command has run these problems.
    """
    names = {problem for group in groups for problem in group.problems}
    manifests = sorted(folder.glob(f"*/{MANIFEST}"))
    return [path.parent.name for path in manifests if path.parent.name not in names]


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
    file
        path of a suite file, or name of a shipped suite
    options
        options of every run; default: those of `Options`
    problems
        names of the problems to run; default: all
    changes
        fields of Options

    Returns
    -------
    SuiteReport | None
        the scores; None for a shard, whose blocks are computed into the cache only.

    Raises
    ------
    UserError
        bad input, with one line per mistake
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
    reports = run_each(configs, options_of_jobs(suite, options), validated=experiments)
    with closing(reports):
        # A shard has no reports.
        for problem, report in zip(suite.problems, reports, strict=False):
            failed += failure_lines(suite, problem.name, report)
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
            added=own_in_group(suite, name),
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
        runs_and_seeds=result.runs_and_seeds(),
        groups=groups,
        sentences=result.sentences(),
        tables=result.tables(),
        smoothers=result.smoothers(),
        figures=figures,
        left_out=left_out_lines(suite),
    )
    return result
