"""Suites: a roster of filters on many problems, each problem an experiment with these filters.

A suite file names groups of problems. Each group has its own roster. A problem is the scenario of an
experiment, by its name or path, and a filter of the roster is left out of it only if the scenario does
not fit the filter; the reason is kept.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from trackbench.component_parts import foreign_parts
from trackbench.config.added_filters import runs_as_program
from trackbench.config.build_components import build
from trackbench.config.did_you_mean import unknown
from trackbench.config.filters_that_fit import (
    SilentProgramError,
    filters_without_problem,
    fit_roster,
)
from trackbench.config.idle_keys_in_suite import idle_overrides
from trackbench.config.overrides import override, override_all
from trackbench.config.requested_truth import is_measured_in
from trackbench.config.shipped_suites import suite_file
from trackbench.config.suite_keys import SuiteSettings
from trackbench.config.suite_problem_configs import Assembler, FittedProblem
from trackbench.errors import Mark, Problem, UserError, joined
from trackbench.evaluation.metric_expression import measure
from trackbench.yaml_source import Source, read


@dataclass(frozen=True)
class Suite:
    """A validated suite."""

    settings: SuiteSettings
    problems: list[FittedProblem]
    added: tuple[str, ...]
    """labels of the filters of --filter, which join every roster"""
    own: tuple[str, ...]
    """labels of all of the user's own filters: those added, and programs and plugins of the rosters"""
    programs: tuple[str, ...]
    """labels of those that are programs"""
    file: str
    """path as the user gave it"""
    is_part: bool = False
    """True if problems are left out by the user"""
    too_long: tuple[str, ...] = ()
    """problems that `--quick` leaves out"""
    without_added: tuple[FittedProblem, ...] = ()
    """problems that none of the user's own filters fits; they are not run, as nobody chose them"""


def load_suite(
    file: Path,
    overrides: Sequence[str] = (),
    only: Sequence[str] = (),
    chosen_problems: Sequence[str] = (),
    runs: int | None = None,
    seed: int | None = None,
    quick: bool = False,
    filter_files: Sequence[Path] = (),
    allow_plugins: bool = False,
) -> Suite:
    """Read and validate a suite, and fit its rosters to its problems.

    A filter is the user's own if `--filter` adds it, or if it is a program or plugin in a roster.

    Parameters
    ----------
    file
        path of a suite file, or name of a shipped suite
    overrides
        assignments ``PATH=VALUE`` of keys of the suite; ``filters.LABEL.KEY=VALUE`` is a key of one of
        the user's own filters
    only
        labels of the filters to run; default: all
    chosen_problems
        names of the problems to run; default: all
    runs, seed
        number of runs of each problem, and seed; default: those of the suite and its problems
    quick
        take few runs, and leave out problems that take long unless they are chosen
    filter_files
        files or programs with the user's own filters, which join every roster
    allow_plugins
        run the code of all plugins and programs that the experiments name

    Raises
    ------
    UserError
        mistakes of the suite or of an experiment that it uses, one line each; also for a filter that
        fits no problem, and at once for a program that does not answer its first line
    """
    # Step 1: the suite's file, with the options of the command line.
    path = suite_file(file)
    source = read(path)
    if not isinstance(source.data, dict):
        raise UserError(source.problem((), "a suite is a mapping of keys to values"))
    # The user's own filters join each problem below, with their keys.
    filter_overrides = [text for text in overrides if text.startswith("filters.")]
    suite_overrides = [text for text in overrides if not text.startswith("filters.")]
    override_all(source, suite_overrides)
    if runs is not None:
        override(source, ("runs",), runs, Mark("--runs"))
    if seed is not None:
        override(source, ("seed",), seed, Mark("--seed"))
    settings = build(SuiteSettings, source, ())
    source.check()
    assert settings is not None
    names = [name for group in settings.groups.values() for name in group.problems]
    if unknown_problems := _unknown_words("--problem", "problem", chosen_problems, names):
        raise UserError(*unknown_problems)
    _check_scores(source, settings)
    # Step 2: the experiment of each problem, with the filters that its scenario fits.
    fitted: list[FittedProblem] = []
    # Mistakes of the problems' configs, with the names of the problems that have them.
    names_by_mistake: dict[Problem | str, list[str]] = {}
    added: dict[str, Mark] = {}  # filters of --filter by label
    override_paths: dict[str, str] = {}  # of keys of these filters, by the assignment PATH=VALUE
    reasons: dict[str, str] = {}  # why filters were left out, by label
    too_long: list[str] = []
    assembler = Assembler(
        suite=source,
        home=path.parent,
        settings=settings,
        filter_files=tuple(filter_files),
        filter_overrides=tuple(filter_overrides),
        quick=quick,
        runs=runs,
    )
    for group_name, group in settings.groups.items():
        for name in group.problems:
            if chosen_problems and name not in chosen_problems:
                continue
            if quick and not chosen_problems and not group.problems[name].quick:
                too_long.append(name)
                continue
            try:
                assembled = assembler.assemble(group_name, name)
                added |= assembled.added
                override_paths |= assembled.override_paths
                problem, left_out = fit_roster(assembled, only, allow_plugins)
                reasons |= left_out
                if problem is not None:  # None: no filter fits it
                    fitted.append(problem)
                    _check_truth(source, problem)
            except SilentProgramError:
                raise
            except UserError as error:
                for mistake in error.problems:
                    names_by_mistake.setdefault(mistake, []).append(name)
    problems = [
        _with_problems(mistake, names_of_mistake, settings, source.mark(()).file)
        for mistake, names_of_mistake in names_by_mistake.items()
    ]
    # Step 3: mistakes that show only now.
    labels = [*added, *_labels_of(settings)]
    problems += _unknown_words("--only", "filter", only, labels)
    if not problems:
        problems += filters_without_problem(
            source, settings, fitted, added, is_whole=not (only or chosen_problems)
        )
    if not problems and not fitted:
        why = [f"{label} fits no problem: {reason}" for label, reason in reasons.items()]
        problems += why or [f"{file}: no problem has these filters; leave out --only or --problem"]
    problems += idle_overrides(override_paths, fitted)
    if problems:
        raise UserError(*dict.fromkeys(problems))
    # Step 4: the user's own filters: those of the rosters, with whether each is a program, and the added
    # ones. Problems that none of the added ones fits are not run.
    own_of_rosters = _own_of_rosters(fitted, _labels_of(settings))
    programs = [file.stem for file in filter_files if runs_as_program(file)]
    programs += [label for label, is_program in own_of_rosters.items() if is_program]
    computed = fitted
    without_added = []
    if added and not chosen_problems:
        computed = [problem for problem in fitted if added.keys() - problem.left_out.keys()]
        without_added = [problem for problem in fitted if added.keys() <= problem.left_out.keys()]
    return Suite(
        settings=settings,
        problems=computed,
        added=tuple(added),
        own=tuple(dict.fromkeys([*added, *own_of_rosters])),
        programs=tuple(programs),
        file=str(file),
        is_part=bool(chosen_problems),
        too_long=tuple(too_long),
        without_added=tuple(without_added),
    )


def _with_problems(
    mistake: Problem | str, names: Sequence[str], settings: SuiteSettings, suite_file: str
) -> Problem | str:
    """Add the ``names`` of the problems whose config has a mistake in a key of their group.

    Such a key, as `tune` of the group, may not fit these problems alone. A mistake of the whole group,
    of a problem's own keys or of an experiment's file stays as it is.
    """
    if isinstance(mistake, str) or mistake.path.startswith("groups."):
        return mistake
    is_option = not mistake.mark.line
    if mistake.mark.file != suite_file and not is_option:
        return mistake
    for group in settings.groups.values():
        if names[0] in group.problems and len(group.problems) == len(names):
            return mistake
    words = "problem" if len(names) == 1 else "problems"
    where = f" (on the {words} {joined(names)})"
    return replace(mistake, message=mistake.message + where)


def _unknown_words(
    option: str, noun: str, words: Sequence[str], known: Sequence[str]
) -> list[Problem]:
    """Return a mistake for each word of a command-line option that is not ``known``.

    ``noun`` is what the words name: filters or problems.
    """
    problems = []
    for word in words:
        if word not in known:
            message = f"is no {noun} of this suite; {unknown(word, list(dict.fromkeys(known)))}"
            problems.append(Problem(Mark(f"{option} {word}"), "", message))
    return problems


def _labels_of(settings: SuiteSettings) -> list[str]:
    """List the labels of all rosters, and of filters that only one problem has."""
    labels: list[str] = []
    for group in settings.groups.values():
        labels += group.filters
        for problem in group.problems.values():
            labels += problem.filters
    return labels


def _own_of_rosters(
    fitted: Sequence[FittedProblem], roster_labels: Sequence[str]
) -> dict[str, bool]:
    """Find the filters of the rosters that are programs or plugins, which are the user's own.

    Return by label whether such a filter is a program. ``roster_labels`` are the labels of all rosters.
    """
    is_program: dict[str, bool] = {}
    for problem in fitted:
        for label, tracker in problem.experiment.points[0].filters.items():
            is_own = tracker.runs_program or bool(foreign_parts(tracker))
            if is_own and label in roster_labels:
                is_program[label] = tracker.runs_program
    return is_program


def _check_truth(source: Source, problem: FittedProblem) -> None:
    """Raise UserError if a problem has no error, as it has no truth.

    The ranking would be by the log score, of which no ratio is taken.
    """
    if is_measured_in(problem.experiment.points[0].scenario):
        return
    message = (
        "has no truth at a scored step, so that filters have no error to be ranked by; add a `truth` to "
        "its target, or leave the problem out (`trackbench run` ranks filters by the log score)"
    )
    raise UserError(source.problem(("groups", problem.group, "problems", problem.name), message))


def _check_scores(source: Source, settings: SuiteSettings) -> None:
    """Raise UserError if a problem has a ``score`` by which filters cannot be ranked."""
    for group_name, group in settings.groups.items():
        for name, problem in group.problems.items():
            if problem.score is None:
                continue
            keys = ("groups", group_name, "problems", name, "score")
            try:
                score = measure(problem.score)
            except ValueError as error:
                source.add_problem(keys, str(error))
                continue
            is_whole = not (score.window or score.steps or score.relation)
            if score.statistic not in ("mean", "rms") or not is_whole:
                message = (
                    "write mean(METRIC) or rms(METRIC) over the whole run, as rms(rmse_position)"
                )
                source.add_problem(keys, f"filters are not ranked by {problem.score}: {message}")
            elif score.definition.better not in ("lower", ""):
                if score.definition.more_is_better:
                    better = "more"
                else:
                    better = f"nearer {score.definition.better}"  # zero or one
                message = f"{better} is better, and a suite divides by the smallest error"
                source.add_problem(keys, f"filters are not ranked by {problem.score}: {message}")
    source.check()


def own_in_group(suite: Suite, name: str) -> tuple[str, ...]:
    """Return the labels of the user's own filters that run on problems of the group ``name``.

    These are added filters, which join all problems, and those in the rosters of the group's problems.
    """
    group = suite.settings.groups[name]
    labels = {*suite.added, *group.filters}
    for problem in group.problems.values():
        labels |= problem.filters.keys()
    return tuple(label for label in suite.own if label in labels)
