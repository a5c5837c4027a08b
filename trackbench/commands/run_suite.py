"""Run a suite: its problems as experiments in one queue, then the scores over all of them."""

from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

from trackbench.atomic_files import ensure_folder
from trackbench.commands.expected_time import ExpectedTimesOfSuite
from trackbench.commands.keyword_arguments import with_known_keywords
from trackbench.commands.options import DRAWER, OPTION_NAMES, Options, say
from trackbench.commands.prepare import FIT, dry_run_line, jobs_of
from trackbench.commands.run_experiment import run_each
from trackbench.commands.stored_results import Report
from trackbench.commands.suite_contract import ContractOutcome, check_own_filters
from trackbench.config.shipped_experiments import suite_names, suite_times
from trackbench.config.suite import Suite, load_suite
from trackbench.errors import Mark, Problem, UserError, counted
from trackbench.execution.engines import begin
from trackbench.models.motions.linear import Linear
from trackbench.report.findings.phrases import joined
from trackbench.report.html.suite_page import write_suite_page
from trackbench.report.plotting import file_formats
from trackbench.report.suite.figures import draw_figures
from trackbench.report.suite.filter_sentences import filter_sentences
from trackbench.report.suite.first_filter import leader_sentence
from trackbench.report.suite.runs_on_few_problems import ProblemModel, reach_sentence
from trackbench.report.suite.scores import (
    FILTER,
    ProblemRuns,
    Score,
    SuiteScores,
    left_out_scores,
    score_problem,
    write_scores,
)
from trackbench.report.suite.tables import filter_table, roster_table, smoother_table
from trackbench.report.text_table import TextTable
from trackbench.results.folder_contents import MANIFEST

_UNUSED = ("measurements", "truth", "grid", "product")
"""Options of experiments that a suite does not have."""


@dataclass(frozen=True, kw_only=True)
class SuiteReport:
    """Outcome of a suite: its folder, the scores by group, and what failed."""

    suite: Suite
    folder: Path
    groups: list[SuiteScores]
    failed: list[str]
    """filters, tables and figures that failed, a line each, with the problem"""
    contract: list[ContractOutcome]
    """outcomes of the contract for the user's own filters"""

    def tables(self) -> list[TextTable]:
        """Return the tables of the first screen.

        These are one for each filter of the user, and one for each group of problems on which several
        filters ran.
        """
        shown = [filter_table(self.groups, label) for label in self.suite.own]
        for group in self.groups:
            # Smoothers, references and bounds have other roles and are no filters here.
            if len(group.labels(FILTER)) > 1:
                shown.append(roster_table(group))
        return shown

    def sentences(self) -> list[str]:
        """Return what follows from the scores, a paragraph each.

        First those on the user's filters and the best filter of each group of problems, then how the
        user's filters may run on more problems, and last which checks of the contract they fail.
        """
        lines = []
        for group in self.groups:
            for label in group.added:
                lines.append(" ".join(filter_sentences(group, label)))
            lines.append(leader_sentence(group))
        models = _problem_models(self.suite)
        lines += [
            reach_sentence(self.groups, label, label in self.suite.programs, models)
            for label in self.suite.own
        ]
        lines += [outcome.sentence() for outcome in self.contract]
        # Several of these texts are empty if there is nothing to say.
        return [line for line in lines if line]

    def smoothers(self) -> list[TextTable]:
        """Return the tables of smoothers, of the groups that have any."""
        tables = [smoother_table(group) for group in self.groups]
        return [table for table in tables if table is not None]


def _problem_models(suite: Suite) -> dict[str, ProblemModel]:
    """Return the names of state and measurement components of each problem, by the problem's name.

    Problems that are not run, because no filter of the user fits them, are included.
    """
    models = {}
    for problem in [*suite.problems, *suite.without_added]:
        motion, sensor = problem.experiment.points[0].scenario.model
        models[problem.name] = ProblemModel(
            state=tuple(motion.components),
            measurement=tuple(sensor.components),
            # A linear sensor has a measurement matrix H.
            is_linear=isinstance(motion, Linear) and getattr(sensor, "H", None) is not None,
        )
    return models


def prepare_suite(file: Path, options: Options, problems: Sequence[str] = ()) -> Suite:
    """Read and validate a suite with the options' overrides; ``problems`` names those to run."""
    for name in _UNUSED:  # options of experiments that a suite does not have
        if getattr(options, name):
            message = "`trackbench suite` has no such option; use `trackbench run`"
            raise UserError(Problem(Mark(f"--{name}"), "", message))
    return load_suite(
        file,
        overrides=[text for text in options.set if text != FIT],  # --quick sets it in each problem
        only=options.only,
        chosen_problems=problems,
        runs=options.runs,
        seed=options.seed,
        quick=options.quick,
        filter_files=[Path(path) for path in options.filters],
        allow_plugins=options.allow_plugins,
    )


def suite_folder(suite: Suite, options: Options) -> Path:
    """Return the folder of the suite's scores, in which each problem has a results folder.

    Without the option ``out`` its name is that of the suite, and of all by which the run differs from
    the whole suite.
    """
    if options.out is not None:
        return Path(options.out)
    parts = [suite.settings.name]
    # Names differ, so that scores of the whole suite and those of another problem are not replaced.
    is_single = suite.is_part and len(suite.problems) == 1
    if is_single:
        parts.append(suite.problems[0].name)
    if options.only or (suite.is_part and not is_single):
        parts.append("part")
    if options.quick:
        parts.append("quick")
    if options.filters:
        parts += ["with", *(Path(path).stem for path in options.filters)]
    return Path("results") / "-".join(parts)


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
    return [*_left_out_lines(suite), *contract_lines, *lines]


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
    # The process that forks workers imports its modules while this process reads the configs.
    begin(options.engine, options.workers, DRAWER)
    suite = prepare_suite(Path(file), options, problems)
    folder = suite_folder(suite, options)
    if suite.too_long:
        names = ", ".join(suite.too_long)
        reason = "which takes long; --problem NAME runs it"
        if len(suite.too_long) > 1:
            reason = "which take long; --problem NAME runs one of them"
        say(f"note: --quick leaves out {names}, {reason}", options)
    for line in _left_out_notes(suite):
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
    not_computed: dict[str, list[Score]] = {name: [] for name in suite.settings.groups}
    for problem in suite.without_added:
        not_computed[problem.group] += left_out_scores(problem, suite.added)
    groups = [
        SuiteScores(
            group=name,
            title=group.title,
            scores=scores[name],
            runs=runs[name],
            tuned={p.name: p.tuned for p in suite.problems if p.group == name},
            added=_own_in_group(suite, name),
            not_computed=tuple(not_computed[name]),
        )
        for name, group in suite.settings.groups.items()
        if scores[name] or not_computed[name]
    ]
    result = SuiteReport(
        suite=suite, folder=folder, groups=groups, failed=failed, contract=contract
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
        left_out=_left_out_lines(suite),
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

    Options that change a config are reset: the suite has put them into the experiments' configs.
    """
    folder = suite_folder(suite, options)
    # `prepare` adds each experiment's name to the folder of several, but not to that of a single one.
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


class _LeftOut(NamedTuple):
    """A filter that is left out of a problem, with the reason ``why``."""

    label: str
    problem: str
    why: str


def _misfits(suite: Suite) -> list[_LeftOut]:
    """List each filter that is left out of a problem, with the reason; added filters come first.

    The scenario of the problem does not fit the filter, or the filter is a program that refuses it.
    Filters are added by `--filter`, the others are those of the suite's roster. Problems that are not
    computed, because no added filter fits them, are listed for added filters only.
    """
    misfits_of_added = []
    misfits_of_roster = []
    not_computed = {problem.name for problem in suite.without_added}
    for problem in [*suite.problems, *suite.without_added]:
        for label, why in problem.left_out.items():
            left = _LeftOut(label, problem.name, why)
            if label in suite.added:
                misfits_of_added.append(left)
            elif problem.name not in not_computed:
                misfits_of_roster.append(left)
    return misfits_of_added + misfits_of_roster


def _left_out_lines(suite: Suite) -> list[str]:
    """Return lines on filters that are left out of problems, one for each filter and reason.

    Lines come first on how many problems added filters run on, and how many problems are not computed.
    """
    return [*_own_filter_lines(suite), *_reason_lines(_misfits(suite))]


def _own_filter_lines(suite: Suite) -> Iterator[str]:
    """Yield a line for each filter of `--filter` that runs on some problems only, with their number.

    A last line has the number of problems that are not computed, if any.
    """
    problems = [*suite.problems, *suite.without_added]
    for label in suite.added:
        number = sum(label not in problem.left_out for problem in problems)
        if number < len(problems):
            yield f"{label} runs on {number} of {len(problems)} problems"
    if suite.without_added:
        yield (
            f"{counted(len(suite.without_added), 'problem')} on which no filter of yours runs are not "
            "computed; `--problem NAME` computes one"
        )


def _reason_lines(misfits: Sequence[_LeftOut]) -> Iterator[str]:
    """Yield a line for each filter and reason why it is left out of problems."""
    problems: dict[tuple[str, str], list[str]] = {}
    for left in misfits:
        problems.setdefault((left.label, left.why), []).append(left.problem)
    for (label, why), names in problems.items():
        yield f"{label} is left out of {', '.join(names)}: {why}"


_MOST_REASONS = 3
"""Number of reasons that are printed for one filter; if it has more, an example is printed."""


def _left_out_notes(suite: Suite) -> Iterator[str]:
    """Yield `_left_out_lines` for the screen.

    A filter with many reasons to be left out has one line, with one of the reasons.
    """
    yield from _own_filter_lines(suite)
    misfits = _misfits(suite)
    for label in dict.fromkeys(left.label for left in misfits):
        filter_misfits = [left for left in misfits if left.label == label]
        lines = [*_reason_lines(filter_misfits)]
        if len(lines) <= _MOST_REASONS:
            yield from lines
        else:
            example = filter_misfits[0]
            yield (
                f"{label} is left out of {len(filter_misfits)} problems, such as {example.problem}: "
                f"{example.why}; --dry-run and scores.csv have all reasons"
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
