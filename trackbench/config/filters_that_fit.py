"""Filters of a suite that fit a problem: the others are left out of it, with the reason."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from trackbench.config import load as configurations
from trackbench.config.experiment import Experiment
from trackbench.config.overrides import split_path
from trackbench.config.suite_keys import SuiteProblem, SuiteSettings
from trackbench.config.suite_problem_configs import AssembledProblem
from trackbench.config.tuning import tuned_label
from trackbench.errors import Mark, Problem, UserError
from trackbench.filters.external_process import NO_FIRST_ANSWER
from trackbench.yaml_source import Assembled, Keys, Source, dotted


class SilentProgramError(UserError):
    """A program does not answer the first line of the protocol: it runs on no problem of a suite."""


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


def fit_roster(
    assembled: AssembledProblem, only: Sequence[str], allow_plugins: bool
) -> tuple[FittedProblem | None, dict[str, str]]:
    """Validate a problem's experiment without the filters that its scenario does not fit.

    If there are labels in ``only``, other filters of the roster are removed first. Return two results:
    the problem, None if no filter is left, and the reasons why filters were left out, by label. Raises
    SilentProgramError for a program that does not answer its first line, and UserError for other
    mistakes.
    """
    source = assembled.config.source
    reference = source.data.get("reference")
    if only:
        for label in list(source.data["filters"]):
            if label not in (*only, reference, *assembled.added):
                _remove_filter(source, label)
    # Each round removes what validation rejects, until all filters fit or only the reference is left.
    # These are filters, or first the keys that `--set` gives the user's own filters and that have no
    # effect on this problem. `idle_overrides` reports a key without effect on any problem.
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


def _idle_keys(assembled: AssembledProblem, error: UserError) -> list[Keys]:
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


def idle_overrides(paths: Mapping[str, str], fitted: Sequence[FittedProblem]) -> list[Problem]:
    """Return a mistake for each key of the user's own filters that has no effect on any problem.

    ``paths`` has the path ``filters.LABEL.KEY`` of each assignment ``PATH=VALUE`` of these keys, and
    ``fitted`` are the problems.
    """
    problems = []
    for text, path in paths.items():
        problems_of_filter = [problem for problem in fitted if not _why_left_out(problem, path)]
        if problems_of_filter and all(path in problem.idle for problem in problems_of_filter):
            message = f"has no effect {_where_idle(fitted, path)}; leave it out"
            problems.append(Problem(Mark(f"--set {text}"), path, message))
    return problems


def _where_idle(fitted: Sequence[FittedProblem], path: str) -> str:
    """Name the problems on which a key of the user's own filter has no effect.

    The key, at ``path``, may have an effect on problems that its filter is left out of. Then name these
    problems, too, with the reason on the first of them.
    """
    others = [
        problem for problem in fitted if path not in problem.idle and _why_left_out(problem, path)
    ]
    if not others:
        return "on any problem of the suite"
    names = ", ".join(problem.name for problem in others)
    return (
        f"where the filter runs, and the filter is left out of {names}: "
        f"{_why_left_out(others[0], path)}"
    )


def _why_left_out(problem: FittedProblem, path: str) -> str:
    """Return why the filter that the key at ``path`` belongs to is left out of a problem.

    The text is empty if the problem has this filter.
    """
    for label, reason in problem.left_out.items():
        if path.startswith(f"filters.{label}."):
            return reason
    return ""


def _misfits(source: Source, error: UserError) -> dict[str, str]:
    """Return by label why filters do not fit a problem, from the mistakes in its config.

    Several mistakes of a filter are one reason. The mapping is empty if a mistake lies outside the
    filters' entries, or in that of the reference filter: leaving out filters would not help, as no
    problem is run without its reference. ``source`` is the problem's config.
    """
    reference = source.data.get("reference")
    labels = [*source.data["filters"]]
    labels += [f"{label}, smoothed" for label in source.data.get("smoothed", ())]
    # Step 1: the mistakes of each filter, and other ones.
    messages: dict[str, list[str]] = {}
    other_paths = []
    for problem in error.problems:
        if not isinstance(problem, Problem):  # a text that names no place in the config
            return {}
        label = _label_of(problem.path, {f"filters.{label}": label for label in labels})
        if label is None:
            other_paths.append(problem.path)
        elif label == reference:
            return {}
        else:
            messages.setdefault(label, []).append(problem.message)
    # Step 2: a filter that does not fit has its mistakes in its tuned copy, and at the values that are
    # tried first, too. Those are left out with the filter.
    tuned_places: dict[str, str] = {}
    for label in messages:
        tuned_places[f"filters.{tuned_label(label)}"] = label
        tuned_places[f"tune.{label}"] = label
    for path in other_paths:
        if _label_of(path, tuned_places) is None:
            return {}
    return {label: "; and ".join(dict.fromkeys(lines)) for label, lines in messages.items()}


def _label_of(path: str, places: Mapping[str, str]) -> str | None:
    """Return the label of the filter whose place in the config ``path`` is or lies in; None if none is.

    ``places`` has the labels by their places, such as ``filters.EKF``.
    """
    owners = [place for place in places if f"{path}.".startswith(f"{place}.")]
    # A label may have dots: of the labels `a` and `a.b` the longer one is meant.
    return places[max(owners, key=len)] if owners else None


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


def filters_without_problem(
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
