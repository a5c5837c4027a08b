"""Suites: a roster of filters on many problems, each problem an experiment with these filters.

A suite file names groups of problems. Each group has its own roster. A problem is the scenario of an
experiment, by its name or path, and a filter of the roster is left out of it only if the scenario does
not fit the filter; the reason is kept.
"""

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from trackbench.config import load as configurations
from trackbench.config.build import build
from trackbench.config.experiment import Experiment, Label, Name
from trackbench.config.includes import assignment, deep_merge, inline_parts, override, split_path
from trackbench.config.mistakes import unknown
from trackbench.config.plugin_checks import add_filters
from trackbench.config.shipped_experiments import located, suite_file
from trackbench.config.tuning import tuned_label
from trackbench.errors import Mark, Problem, UserError
from trackbench.evaluation.metric_expression import measured
from trackbench.field_types import Count, Natural
from trackbench.yaml_source import Assembled, MarkedMapping, Source, dotted, marked, put, read

QUICK_RUNS = 4
"""Runs of each problem with `--quick`."""
_QUICK_TUNING = {"evaluations": 6, "runs": 10}
"""Trials and training runs of each filter with `--quick`."""
_COPIED = ("title", "paper", "seed", "scenario", "hold_out")
"""Keys of a problem's experiment that the suite uses."""


@dataclass(frozen=True, kw_only=True)
class SuiteProblem:
    """A problem of a suite: the scenario of an experiment, with changes."""

    class_: str
    """class of the problem in tables and figures: linear, bearings, chaotic"""
    use: str | None = None
    """name of a shipped experiment, or path of an experiment file; default: the problem's name"""
    title: str = ""
    """one line for people; default: the title of the experiment"""
    runs: Count | None = None
    """Monte Carlo runs; default: those of the suite"""
    set: dict[str, object] = field(default_factory=dict)
    """changes of the experiment, by path: {scenario.last: 100}"""
    score: str | None = None
    """what filters are ranked by, such as rms(rmse_state); default: the rms of the first error"""
    reference: Label | None = None
    """filter of the experiment, or its bound, that errors are compared with beside the best"""
    filters: dict[Label, object] = field(default_factory=dict)
    """filters that only this problem has, or other keys for filters of the roster"""
    tune: dict[Label, dict[str, object]] = field(default_factory=dict)
    """keys that are tuned on this problem, by filter, as in an experiment"""


@dataclass(frozen=True, kw_only=True)
class SuiteGroup:
    """Problems with one roster of filters: one matrix of problems and filters."""

    title: str
    """one line for people"""
    filters: dict[Label, object]
    """the roster, as the filters of an experiment"""
    smoothed: list[Label] = field(default_factory=list)
    """filters whose smoothers run beside them; smoothers are ranked apart"""
    tune: dict[Label, dict[str, object]] = field(default_factory=dict)
    """keys that are tuned on each problem, by filter; the tuned filter takes the original's place"""
    tuning: dict[str, object] = field(default_factory=dict)
    """number of trials and of training runs, as in an experiment"""
    problems: dict[Name, SuiteProblem]
    """problems by name"""


@dataclass(frozen=True, kw_only=True)
class SuiteSettings:
    """The top level of a suite file."""

    name: Name
    """name of the suite, and of its folder under results/"""
    title: str = ""
    """one line for people"""
    version: Count = 1
    """version, raised with every change that moves a number"""
    seed: Natural | None = None
    """seed of every problem; default: that of its experiment"""
    runs: Count = 50
    """Monte Carlo runs of each problem; a recording has its own number"""
    groups: dict[Name, SuiteGroup]
    """groups of problems by name"""


@dataclass(frozen=True)
class FittedProblem:
    """A problem with the filters that it can be run with."""

    name: str
    group: str
    settings: SuiteProblem
    config: Assembled
    experiment: Experiment
    left_out: dict[str, str]
    """filters that the scenario does not fit, with the reasons"""
    tuned: tuple[str, ...]
    """filters of the roster that are shown by their tuned copies"""
    citation: str
    """name and version of the standard problem whose scenario it is; empty for another scenario"""


@dataclass(frozen=True)
class Suite:
    """A validated suite."""

    settings: SuiteSettings
    problems: list[FittedProblem]
    added: tuple[str, ...]
    """labels of the user's own filters"""
    file: str
    """path as the user gave it"""
    is_part: bool = False
    """True if problems are left out by the user"""


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

    Parameters
    ----------
    file : path of a suite file, or name of a shipped suite
    overrides : assignments ``PATH=VALUE`` of keys of the suite
    only : labels of the filters to run; default: all
    chosen_problems : names of the problems to run; default: all
    filter_files : files or programs with the user's own filters, which join every roster

    Raises
    ------
    UserError : mistakes of the suite or of an experiment that it uses, one line each; also for a filter
        that fits no problem
    """
    path = suite_file(file)
    source = read(path)
    if not isinstance(source.data, dict):
        raise UserError(source.problem((), "a suite is a mapping of keys to values"))
    for text in overrides:
        keys, value, mark = assignment(source, text)
        override(source, keys, value, mark)
    if runs is not None:
        override(source, ("runs",), runs, Mark("--runs"))
    if seed is not None:
        override(source, ("seed",), seed, Mark("--seed"))
    settings = build(SuiteSettings, source, ())
    source.check()
    assert settings is not None
    _check_chosen(settings, chosen_problems)
    _check_scores(source, settings)
    fitted: list[FittedProblem] = []
    problems: list[Problem | str] = []
    added: dict[str, Mark] = {}
    reasons: dict[str, str] = {}
    for group_name, group in settings.groups.items():
        for name in group.problems:
            if chosen_problems and name not in chosen_problems:
                continue
            try:
                draft = _draft(
                    source, path.parent, settings, group_name, name, filter_files, quick, runs
                )
                added |= draft.added
                problem, left_out = _fitted(draft, group_name, name, group, only, allow_plugins)
                reasons |= left_out
                if problem is not None:
                    fitted.append(problem)
            except UserError as error:
                problems += error.problems
    problems += _unknown_labels(settings, only, added)
    if not problems:
        problems += _filters_without_problem(
            source, settings, fitted, added, is_whole=not (only or chosen_problems)
        )
    if not problems and not fitted:
        why = [f"{label} fits no problem: {reason}" for label, reason in reasons.items()]
        problems += why or [f"{file}: no problem has these filters; leave out --only or --problem"]
    if problems:
        raise UserError(*dict.fromkeys(problems))
    return Suite(
        settings=settings,
        problems=fitted,
        added=tuple(added),
        file=str(file),
        is_part=bool(chosen_problems),
    )


def _check_chosen(settings: SuiteSettings, chosen_problems: Sequence[str]) -> None:
    """Reject names of problems that the suite lacks."""
    names: dict[str, None] = {}
    for group in settings.groups.values():
        names |= dict.fromkeys(group.problems)
    problems = []
    for name in chosen_problems:
        if name not in names:
            what = f"is no problem of this suite; {unknown(name, list(names))}"
            problems.append(Problem(Mark(f"--problem {name}"), "", what))
    if problems:
        raise UserError(*problems)


def _unknown_labels(
    settings: SuiteSettings, only: Sequence[str], added: Mapping[str, Mark]
) -> list[Problem]:
    """Return a mistake for each label to run that neither the suite nor the user's files have."""
    labels: dict[str, None] = dict.fromkeys(added)
    for group in settings.groups.values():
        labels |= dict.fromkeys(group.filters)
        for problem in group.problems.values():
            labels |= dict.fromkeys(problem.filters)
    problems = []
    for label in only:
        if label not in labels:
            what = f"is no filter of this suite; {unknown(label, list(labels))}"
            problems.append(Problem(Mark(f"--only {label}"), "", what))
    return problems


def _check_scores(source: Source, settings: SuiteSettings) -> None:
    """Reject scores that filters cannot be ranked by."""
    for group_name, group in settings.groups.items():
        for name, problem in group.problems.items():
            if problem.score is None:
                continue
            keys = ("groups", group_name, "problems", name, "score")
            try:
                score = measured(problem.score)
            except ValueError as error:
                source.add_problem(keys, str(error))
                continue
            is_whole = not (score.window or score.steps or score.relation)
            if score.statistic not in ("mean", "rms") or not is_whole:
                what = "write mean(METRIC) or rms(METRIC) over the whole run, as rms(rmse_position)"
                source.add_problem(keys, f"filters are not ranked by {problem.score}: {what}")
    source.check()


@dataclass(frozen=True)
class _Draft:
    """Experiment of a problem with the whole roster, before it is fitted."""

    config: Assembled
    added: dict[str, Mark]
    """labels of the user's filters"""
    citation: str


def _draft(
    suite: Source,
    home: Path,
    settings: SuiteSettings,
    group_name: str,
    name: str,
    filter_files: Sequence[Path],
    quick: bool,
    runs: int | None,
) -> _Draft:
    """Put the experiment of a problem together."""
    group = settings.groups[group_name]
    problem = group.problems[name]
    keys = ("groups", group_name, "problems", name)
    # Step 1: the experiment whose scenario is used, with its parts and the changes.
    file = _experiment_file(suite, home, problem, name, (*keys, "use"))
    source = read(file)
    unread = inline_parts(source, file.parent)
    if unread:
        raise UserError(*(line for lines in unread.values() for line in lines))
    standard = source.data.get("problem")
    for path_text, value in problem.set.items():
        mark = suite.mark((*keys, "set", path_text))
        target = split_path(source, path_text)
        override(source, target, value, mark)
        if target[0] == "scenario":
            standard = None
    citation = ""
    if isinstance(standard, Mapping):
        citation = f"{source.data.get('name')} v{standard.get('version')}"
    # Step 2: what of it the suite uses, under the problem's name.
    original = source.data
    data = MarkedMapping()
    mark = suite.mark(keys)
    put(data, "name", name, mark)
    for key in _COPIED:
        if key in original:
            put(data, key, original[key], source.mark((key,)))
    if problem.title:
        put(data, "title", problem.title, mark)
    if settings.seed is not None:
        put(data, "seed", settings.seed, suite.mark(("seed",)))
    put(data, "runs", problem.runs if problem.runs and runs is None else settings.runs, mark)
    if quick:
        put(data, "runs", runs or QUICK_RUNS, Mark("--quick"))
        put(data, "block", "fit", Mark("--quick"))
    put(data, "per_step", [], mark)
    if problem.score is not None:
        columns = {"Error": problem.score, "ANEES": "anees"}
        table = {"errors": {"kind": "metrics", "title": "Error", "columns": columns}}
        put(data, "tables", marked(table, suite.mark((*keys, "score"))), mark)
    for key in ("plugins", "files"):
        paths = original.get(key)
        if isinstance(paths, list):
            absolute = [str((file.parent / str(path)).absolute()) for path in paths]
            put(data, key, marked(absolute, mark), source.mark((key,)))
    # Step 3: the roster, the problem's own filters, and the user's.
    filters = _roster(suite, home, group_name, name)
    reference = problem.reference
    if reference is not None and reference != original.get("bound"):
        known = original.get("filters") or {}
        if reference not in known:
            labels = ", ".join(map(str, known))
            what = f"{reference!r} is neither a filter of {file.name} ({labels}) nor its bound"
            raise UserError(Problem(suite.mark((*keys, "reference")), dotted(keys), what))
        if reference in filters:
            what = f"{reference!r} is already a filter of the roster"
            raise UserError(Problem(suite.mark((*keys, "reference")), dotted(keys), what))
        put(
            filters, reference, copy.deepcopy(known[reference]), source.mark(("filters", reference))
        )
        put(data, "reference", reference, suite.mark((*keys, "reference")))
    elif reference is not None:
        put(data, "bound", reference, suite.mark((*keys, "reference")))
    put(data, "filters", filters, mark)
    if group.smoothed:
        put(data, "smoothed", [*group.smoothed], mark)
    tune = {**group.tune, **problem.tune}
    if tune:
        put(data, "tune", marked(tune, mark), mark)
        tuning = {**group.tuning, **_QUICK_TUNING} if quick else {**group.tuning}
        put(data, "tuning", marked(tuning, mark), mark)
    assembled = Source(data, mark)
    assembled.programs = set()
    added = add_filters(assembled, filter_files)
    config = Assembled(source=assembled, allowed=tuple(filter_files))
    return _Draft(config=config, added=added, citation=citation)


def _experiment_file(
    suite: Source, home: Path, problem: SuiteProblem, name: str, keys: tuple[str, ...]
) -> Path:
    """Find the experiment file of a problem: beside the suite, or shipped."""
    word = problem.use or name
    if word.endswith((".yaml", ".yml")):
        return home / word
    try:
        return located(Path(word), lambda line: None)
    except UserError as error:
        what = "; ".join(p.what if isinstance(p, Problem) else str(p) for p in error.problems)
        raise UserError(Problem(suite.mark(keys), dotted(keys), f"{word!r} {what}")) from None


def _roster(suite: Source, home: Path, group_name: str, name: str) -> MarkedMapping:
    """Return the filters of a problem with their files included."""
    group = suite.data["groups"][group_name]
    own = group["problems"][name].get("filters") or {}
    merged = deep_merge(copy.deepcopy(group["filters"]), copy.deepcopy(own), by_kind=True)
    part = Source(MarkedMapping({"filters": merged}), suite.start)
    unread = inline_parts(part, home)
    if unread:
        raise UserError(*(line for lines in unread.values() for line in lines))
    filters = part.data["filters"]
    assert isinstance(filters, MarkedMapping)
    return filters


def _fitted(
    draft: _Draft,
    group_name: str,
    name: str,
    group: SuiteGroup,
    only: Sequence[str],
    allow_plugins: bool,
) -> tuple[FittedProblem | None, dict[str, str]]:
    """Leave out the filters that the scenario does not fit.

    Returns the problem, None if no filter is left, and the reasons by label. Raises UserError for
    other mistakes.
    """
    source = draft.config.source
    reference = source.data.get("reference")
    if only:
        for label in list(source.data["filters"]):
            if label not in (*only, reference, *draft.added):
                _remove_filter(source, label)
    left_out: dict[str, str] = {}
    while source.data["filters"].keys() - {reference}:
        try:
            experiment = configurations.load(draft.config, allow_plugins=allow_plugins)
            break
        except UserError as error:
            reasons = _misfits(source, error)
            if not reasons:
                raise
            left_out |= reasons
            for label in reasons:
                _remove_filter(source, label)
    else:
        return None, left_out
    problem = group.problems[name]
    fitted = FittedProblem(
        name=name,
        group=group_name,
        settings=problem,
        config=draft.config,
        experiment=experiment,
        left_out=left_out,
        tuned=tuple(source.data.get("tune") or ()),
        citation=draft.citation,
    )
    return fitted, left_out


def _misfits(source: Source, error: UserError) -> dict[str, str]:
    """Return the filters that all these mistakes are about, with the reasons; none if another is."""
    reference = source.data.get("reference")
    reasons: dict[str, str] = {}
    for problem in error.problems:
        if not isinstance(problem, Problem):
            return {}
        label = _label_of(source, problem.path)
        if label is None or label == reference:
            return {}
        reasons.setdefault(label, problem.what)
    return reasons


def _label_of(source: Source, path: str) -> str | None:
    """Return the label of the filter whose entry this path is, or lies in."""
    labels = [*source.data["filters"]]
    labels += [f"{label}, smoothed" for label in source.data.get("smoothed", ())]
    labels = [label for label in labels if f"{path}.".startswith(f"filters.{label}.")]
    return max(labels, key=len, default=None)


def _remove_filter(source: Source, label: str) -> None:
    """Remove a filter, its smoother and its tuned keys; or a smoother alone."""
    data = source.data
    if label not in data["filters"]:
        data["smoothed"].remove(label.removesuffix(", smoothed"))
        return
    del data["filters"][label]
    if label in data.get("smoothed", ()):
        data["smoothed"].remove(label)
    if label in data.get("tune", {}):
        del data["tune"][label]
        if not data["tune"]:
            del data["tune"]
            del data["tuning"]


def _filters_without_problem(
    suite: Source,
    settings: SuiteSettings,
    fitted: Sequence[FittedProblem],
    added: Mapping[str, Mark],
    is_whole: bool,
) -> list[Problem]:
    """Return a mistake for each filter that fits no problem of its group.

    A part of the suite (``is_whole`` is false) may be one that some filters of the roster do not fit.
    """
    problems = []
    for group_name, group in settings.groups.items() if is_whole else ():
        mine = [problem for problem in fitted if problem.group == group_name]
        if not mine:
            continue
        for label in group.filters:
            reasons = [problem.left_out.get(label) for problem in mine]
            if None in reasons:
                continue
            keys = ("groups", group_name, "filters", label)
            what = f"fits no problem: {reasons[0]}"
            problems.append(Problem(suite.mark(keys), dotted(keys), what))
    for label, mark in added.items():
        reasons = [problem.left_out.get(label) for problem in fitted]
        if fitted and None not in reasons:
            problems.append(Problem(mark, label, f"fits no problem: {reasons[0]}"))
    return problems


def shown_label(problem: FittedProblem, label: str) -> str:
    """Return the label under which a filter of the roster stands in the problem's results."""
    return tuned_label(label) if label in problem.tuned else label
