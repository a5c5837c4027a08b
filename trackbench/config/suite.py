"""Suites: a roster of filters on many problems, each problem an experiment with these filters.

A suite file names groups of problems. Each group has its own roster. A problem is the scenario of an
experiment, by its name or path, and a filter of the roster is left out of it only if the scenario does
not fit the filter; the reason is kept.
"""

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from trackbench.component_parts import foreign_parts
from trackbench.config import load as configurations
from trackbench.config.added_filters import add_filters
from trackbench.config.build_components import build
from trackbench.config.experiment import Experiment
from trackbench.config.experiment_keys import Label, Name
from trackbench.config.includes import deep_merge, inline_parts
from trackbench.config.key_mistakes import unknown
from trackbench.config.overrides import (
    assignment,
    check_single_value,
    override,
    override_all,
    split_path,
)
from trackbench.config.quick_run import QUICK_RUNS_OF_PROBLEM, QUICK_TUNING
from trackbench.config.shipped_experiments import located, suite_file
from trackbench.config.tuning import tuned_label
from trackbench.errors import Mark, Problem, UserError
from trackbench.evaluation.metric_expression import measured
from trackbench.field_types import Count, Natural
from trackbench.filters.external_process import NO_FIRST_ANSWER
from trackbench.yaml_source import Assembled, Keys, MarkedMapping, Source, dotted, marked, put, read

_COPIED = ("title", "paper", "seed", "scenario", "hold_out")
"""Keys of a problem's experiment that the suite uses."""


class SilentProgramError(UserError):
    """A program does not answer the first line of the protocol: it runs on no problem of a suite."""


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
    quick: bool = True
    """whether `--quick` runs it, too; a problem that takes long may be left out"""
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
    """filters that the scenario does not fit, or that refuse it, with the reasons"""
    tuned: tuple[str, ...]
    """filters of the roster that are shown by their tuned copies"""
    idle: tuple[str, ...] = ()
    """keys of the user's own filters, as `filters.LABEL.KEY`, that have no effect on this problem"""


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

    Parameters
    ----------
    file : path of a suite file, or name of a shipped suite
    overrides : assignments ``PATH=VALUE`` of keys of the suite; ``filters.LABEL.KEY=VALUE`` is a key of
        one of the user's own filters
    only : labels of the filters to run; default: all
    chosen_problems : names of the problems to run; default: all
    runs, seed : number of runs of each problem, and seed; default: those of the suite and its problems
    quick : take few runs, and leave out problems that take long unless they are chosen
    filter_files : files or programs with the user's own filters, which join every roster
    allow_plugins : run the code of all plugins and programs that the experiments name

    Raises
    ------
    UserError : mistakes of the suite or of an experiment that it uses, one line each; also for a filter
        that fits no problem, and at once for a program that does not answer its first line
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
    problems: list[Problem | str] = []  # mistakes
    added: dict[str, Mark] = {}  # filters of --filter by label
    override_paths: dict[str, str] = {}  # of keys of these filters, by the assignment PATH=VALUE
    reasons: dict[str, str] = {}  # why filters were left out, by label
    too_long: list[str] = []
    assembler = _Assembler(
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
                problem, left_out = _fit_roster(assembled, only, allow_plugins)
                reasons |= left_out
                if problem is not None:
                    fitted.append(problem)
            except SilentProgramError:
                raise
            except UserError as error:
                problems += error.problems
    # Step 3: mistakes that show only now.
    labels = [*added, *_labels_of(settings)]
    problems += _unknown_words("--only", "filter", only, labels)
    if not problems:
        problems += _filters_without_problem(
            source, settings, fitted, added, is_whole=not (only or chosen_problems)
        )
    if not problems and not fitted:
        why = [f"{label} fits no problem: {reason}" for label, reason in reasons.items()]
        problems += why or [f"{file}: no problem has these filters; leave out --only or --problem"]
    problems += _idle_overrides(override_paths, fitted)
    if problems:
        raise UserError(*dict.fromkeys(problems))
    # Step 4: the user's own filters. Problems that none of the added ones fits are not run.
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


def _check_scores(source: Source, settings: SuiteSettings) -> None:
    """Raise UserError if a problem has a ``score`` by which filters cannot be ranked."""
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
                message = (
                    "write mean(METRIC) or rms(METRIC) over the whole run, as rms(rmse_position)"
                )
                source.add_problem(keys, f"filters are not ranked by {problem.score}: {message}")
    source.check()


@dataclass(frozen=True)
class _AssembledProblem:
    """Experiment of a problem with the whole roster, before the roster is fitted."""

    name: str
    group: str
    settings: SuiteProblem
    config: Assembled
    added: dict[str, Mark]
    """labels of the user's filters"""
    override_paths: dict[str, str]
    """path of the key of a user's filter that an assignment ``PATH=VALUE`` sets, by the assignment"""


@dataclass(frozen=True, kw_only=True)
class _Assembler:
    """Put the experiments of a suite's problems together."""

    suite: Source
    home: Path
    """folder of the suite's file"""
    settings: SuiteSettings
    filter_files: tuple[Path, ...]
    filter_overrides: tuple[str, ...]
    """assignments of keys of the user's own filters"""
    quick: bool
    runs: int | None
    """number of runs that the user asks for"""

    def assemble(self, group_name: str, name: str) -> _AssembledProblem:
        """Put a problem's experiment together: its scenario, and the roster in place of its filters."""
        keys = ("groups", group_name, "problems", name)
        group = self.settings.groups[group_name]
        problem = group.problems[name]
        # Step 1: the experiment, with the problem's changes.
        file = self._experiment_file(problem, name, (*keys, "use"))
        experiment = read(file)
        _include_parts(experiment, file.parent)
        for path_text, value in problem.set.items():
            mark = self.suite.mark((*keys, "set", path_text))
            override(experiment, split_path(experiment, path_text), value, mark)
        # Step 2: a config with its scenario, the roster, and the user's own filters with their keys.
        mark = self.suite.mark(keys)
        data = self._scenario_and_runs(experiment, file, problem, name, keys)
        self._put_roster(data, experiment, file, group_name, name, keys)
        self._put_tuning(data, group, problem, mark)
        source = Source(data, mark)
        added = add_filters(source, self.filter_files)
        texts_by_keys: dict[Keys, str] = {}
        for text in self.filter_overrides:
            filter_keys, value, mark_of_option = assignment(source, text)
            check_single_value(texts_by_keys, filter_keys, text, mark_of_option)
            label = filter_keys[1]  # of filters.LABEL.KEY
            if label not in added:
                message = (
                    f"no filter of --filter is called {label!r}; the rosters are "
                    "`groups.GROUP.filters`"
                )
                raise UserError(Problem(mark_of_option, dotted(filter_keys), message))
            override(source, filter_keys, value, mark_of_option)
        config = Assembled(source=source, allowed=self.filter_files)
        return _AssembledProblem(
            name=name,
            group=group_name,
            settings=problem,
            config=config,
            added=added,
            override_paths={text: dotted(path) for path, text in texts_by_keys.items()},
        )

    def _experiment_file(self, problem: SuiteProblem, name: str, keys: Keys) -> Path:
        """Find the experiment file of a problem: beside the suite, or shipped."""
        word = problem.use or name
        if word.endswith((".yaml", ".yml")):
            return self.home / word
        try:
            return located(Path(word), lambda line: None)  # nothing is printed
        except UserError as error:
            message = "; ".join(
                p.message if isinstance(p, Problem) else str(p) for p in error.problems
            )
            mark = self.suite.mark(keys)
            raise UserError(Problem(mark, dotted(keys), f"{word!r} {message}")) from None

    def _scenario_and_runs(
        self, experiment: Source, file: Path, problem: SuiteProblem, name: str, keys: Keys
    ) -> MarkedMapping:
        """Return a config with the keys that a suite takes from an experiment, and the suite's own.

        The suite's own are the problem's ``name``, title and score, and the seed and number of runs.
        ``file`` is the experiment's; ``keys`` lead to the problem in the suite.
        """
        mark = self.suite.mark(keys)
        data = MarkedMapping()
        put(data, "name", name, mark)
        for key in _COPIED:
            if key in experiment.data:
                put(data, key, experiment.data[key], experiment.mark((key,)))
        if problem.title:
            put(data, "title", problem.title, mark)
        if self.settings.seed is not None:
            put(data, "seed", self.settings.seed, self.suite.mark(("seed",)))
        if self.quick:
            put(data, "runs", self.runs or QUICK_RUNS_OF_PROBLEM, Mark("--quick"))
        elif problem.runs and self.runs is None:
            put(data, "runs", problem.runs, mark)
        else:
            put(data, "runs", self.settings.runs, mark)  # that of --runs, if it is given
        # Blocks as wide as the runs need: a suite has few runs, and no more are added later.
        put(data, "block", "fit", mark)
        put(data, "per_step", [], mark)  # no series over time is stored
        if problem.score is not None:
            # Filters are ranked by the first error of the first table.
            columns = {"Error": problem.score, "ANEES": "anees"}
            table = {"errors": {"kind": "metrics", "title": "Error", "columns": columns}}
            put(data, "tables", marked(table, self.suite.mark((*keys, "score"))), mark)
        for key in ("plugins", "files"):
            paths = experiment.data.get(key)
            if isinstance(paths, list):
                absolute = [str((file.parent / str(path)).absolute()) for path in paths]
                put(data, key, marked(absolute, mark), experiment.mark((key,)))
        return data

    def _put_roster(
        self,
        data: MarkedMapping,
        experiment: Source,
        file: Path,
        group_name: str,
        name: str,
        keys: Keys,
    ) -> None:
        """Put the roster, the problem's own filters and its reference into the config ``data``.

        ``experiment`` is the config of the problem's ``file``, which has the reference. ``keys`` lead to
        the problem in the suite.
        """
        # Step 1: the roster with the problem's own filters, whose files are included.
        group = self.suite.data["groups"][group_name]
        changes = group["problems"][name].get("filters") or {}
        filters = deep_merge(copy.deepcopy(group["filters"]), copy.deepcopy(changes), by_kind=True)
        part = Source(MarkedMapping({"filters": filters}), self.suite.start)
        _include_parts(part, self.home)
        mark = self.suite.mark(keys)
        put(data, "filters", filters, mark)
        smoothed = self.settings.groups[group_name].smoothed
        if smoothed:
            put(data, "smoothed", [*smoothed], mark)
        # Step 2: the reference, a filter of the experiment or its bound.
        reference = self.settings.groups[group_name].problems[name].reference
        if reference is None:
            return
        mark = self.suite.mark((*keys, "reference"))
        if reference == experiment.data.get("bound"):
            put(data, "bound", reference, mark)
            return
        known = experiment.data.get("filters") or {}
        if reference not in known:
            labels = ", ".join(map(str, known))
            message = f"{reference!r} is neither a filter of {file.name} ({labels}) nor its bound"
            raise UserError(Problem(mark, dotted(keys), message))
        if reference in filters:
            message = f"{reference!r} is already a filter of the roster"
            raise UserError(Problem(mark, dotted(keys), message))
        entry = copy.deepcopy(known[reference])
        put(filters, reference, entry, experiment.mark(("filters", reference)))
        put(data, "reference", reference, mark)

    def _put_tuning(
        self, data: MarkedMapping, group: SuiteGroup, problem: SuiteProblem, mark: Mark
    ) -> None:
        """Put the keys that are tuned, and the number of trials, into the config ``data``."""
        tune = {**group.tune, **problem.tune}
        if not tune:
            return
        tuning = {**group.tuning}
        if self.quick:
            tuning |= QUICK_TUNING
        put(data, "tune", marked(tune, mark), mark)
        put(data, "tuning", marked(tuning, mark), mark)


def _include_parts(source: Source, folder: Path) -> None:
    """Include the files that a config names; raises UserError for those that cannot be read."""
    unread = inline_parts(source, folder)
    problems = [problem for mistakes in unread.values() for problem in mistakes]
    if problems:
        raise UserError(*problems)


def _fit_roster(
    assembled: _AssembledProblem, only: Sequence[str], allow_plugins: bool
) -> tuple[FittedProblem | None, dict[str, str]]:
    """Validate a problem's experiment without the filters that its scenario does not fit.

    If there are labels in ``only``, other filters of the roster are removed first. Return the problem,
    None if no filter is left, and by label why filters were left out. Raises SilentProgramError for a
    program that does not answer its first line, and UserError for other mistakes.
    """
    source = assembled.config.source
    reference = source.data.get("reference")
    if only:
        for label in list(source.data["filters"]):
            if label not in (*only, reference, *assembled.added):
                _remove_filter(source, label)
    # Each round removes the filters, or idle keys of the user, of which validation complains, until all
    # filters fit or only the reference is left.
    left_out: dict[str, str] = {}
    idle: list[str] = []
    while source.data["filters"].keys() - {reference}:
        try:
            experiment = configurations.load(assembled.config, allow_plugins=allow_plugins)
        except UserError as error:
            silent = [problem for problem in error.problems if _is_silent_program(problem)]
            if silent:
                raise SilentProgramError(*silent) from None
            idle_keys = _idle_keys(assembled, error)
            if idle_keys:
                for keys in idle_keys:
                    _remove_key(source, keys)
                idle += map(dotted, idle_keys)
                continue
            reasons = _misfits(source, error)
            if not reasons:
                raise
            left_out |= reasons
            for label in reasons:
                _remove_filter(source, label)
            continue
        fitted = FittedProblem(
            name=assembled.name,
            group=assembled.group,
            settings=assembled.settings,
            config=assembled.config,
            experiment=experiment,
            left_out=left_out,
            tuned=tuple(source.data.get("tune") or ()),
            idle=tuple(idle),
        )
        return fitted, left_out
    return None, left_out


def _is_silent_program(problem: Problem | str) -> bool:
    """Test whether a mistake is that a program does not answer the first line of the protocol."""
    return isinstance(problem, Problem) and problem.message.startswith(NO_FIRST_ANSWER)


def _idle_keys(assembled: _AssembledProblem, error: UserError) -> list[Keys]:
    """Return the keys that `--set` gives the user's own filters, and that have no effect here.

    ``error`` has the mistakes of the problem. The key `late`, for example, has no effect where all
    measurements arrive on time.
    """
    idle_keys = []
    for problem in error.problems:
        if isinstance(problem, Problem) and problem.message.startswith("has no effect"):
            keys = split_path(assembled.config.source, problem.path)
            is_added = len(keys) > 2 and keys[:1] == ("filters",) and keys[1] in assembled.added
            if is_added and problem.mark.file.startswith("--set "):
                idle_keys.append(keys)
    return idle_keys


def _remove_key(source: Source, keys: Keys) -> None:
    """Remove a key that exists from the config."""
    owner = source.value_at(keys[:-1])
    assert isinstance(owner, dict)
    del owner[keys[-1]]


def _idle_overrides(paths: Mapping[str, str], fitted: Sequence[FittedProblem]) -> list[Problem]:
    """Return a mistake for each key of the user's own filters that has no effect on any problem.

    ``paths`` has the path ``filters.LABEL.KEY`` of each assignment ``PATH=VALUE`` of these keys, and
    ``fitted`` are the problems.
    """
    problems = []
    for text, path in paths.items():
        problems_of_filter = [problem for problem in fitted if not _leaves_out_owner(problem, path)]
        if problems_of_filter and all(path in problem.idle for problem in problems_of_filter):
            message = "has no effect on any problem of the suite; leave it out"
            problems.append(Problem(Mark(f"--set {text}"), path, message))
    return problems


def _leaves_out_owner(problem: FittedProblem, path: str) -> bool:
    """Test whether the filter that the key at ``path`` belongs to is left out of a problem."""
    return any(path.startswith(f"filters.{label}.") for label in problem.left_out)


def _misfits(source: Source, error: UserError) -> dict[str, str]:
    """Return by label why filters do not fit a problem, from the mistakes in its config.

    The mapping is empty if a mistake lies outside the filters' entries, or in that of the reference
    filter: leaving out filters would not help, as no problem is run without its reference. ``source`` is
    the problem's config.
    """
    reference = source.data.get("reference")
    reasons: dict[str, str] = {}
    for problem in error.problems:
        if not isinstance(problem, Problem):
            return {}
        label = _label_of(source, problem.path)
        if label is None or label == reference:
            return {}
        reasons.setdefault(label, problem.message)
    return reasons


def _label_of(source: Source, path: str) -> str | None:
    """Return the label of the filter whose entry ``path`` is or lies in; None if there is none."""
    labels = [*source.data["filters"]]
    labels += [f"{label}, smoothed" for label in source.data.get("smoothed", ())]
    owners = [label for label in labels if f"{path}.".startswith(f"filters.{label}.")]
    # A label may have dots: of the labels `a` and `a.b` the longer one is meant.
    return max(owners, key=len, default=None)


def _remove_filter(source: Source, label: str) -> None:
    """Remove a filter with its smoother and its tuned keys, or only the smoother of this label."""
    data = source.data
    # A smoother has no entry of its own: its filter is listed under `smoothed`.
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

    Filters of the roster are checked only if ``is_whole``: the user may choose problems that some do not
    fit. ``added`` are the user's own filters, each of which must fit a problem of any group.
    """
    problems = []
    checked_groups = settings.groups if is_whole else {}
    for group_name, group in checked_groups.items():
        group_problems = [problem for problem in fitted if problem.group == group_name]
        if not group_problems:
            continue
        for label in group.filters:
            # A filter that fits a problem has no reason there.
            reasons = [problem.left_out.get(label) for problem in group_problems]
            if None in reasons:
                continue
            keys = ("groups", group_name, "filters", label)
            message = f"fits no problem: {reasons[0]}"
            problems.append(Problem(suite.mark(keys), dotted(keys), message))
    for label, mark in added.items():
        reasons = [problem.left_out.get(label) for problem in fitted]
        if fitted and None not in reasons:
            problems.append(Problem(mark, label, f"fits no problem: {reasons[0]}"))
    return problems


def shown_label(problem: FittedProblem, label: str) -> str:
    """Return the label under which a filter of the roster stands in the problem's results."""
    return tuned_label(label) if label in problem.tuned else label
