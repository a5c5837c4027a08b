"""Filters of a suite that fit a problem: the others are left out of it, with the reason."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

from trackbench.config import load as configurations
from trackbench.config.chosen_filters import remove_filter
from trackbench.config.idle_keys_in_suite import idle_set_keys
from trackbench.config.key_and_value_mistakes import is_unknown_kind
from trackbench.config.suite_keys import SuiteSettings
from trackbench.config.suite_problem_configs import AssembledProblem, FittedProblem
from trackbench.config.tuning import tuned_label
from trackbench.errors import Mark, Problem, UserError
from trackbench.filters.external_process import NO_FIRST_ANSWER
from trackbench.yaml_source import Keys, Source, dotted

_WAY_TO_PLUGIN = (
    " (a kind of your own needs its Python file: the key `plugins: [FILE.py]` of the suite, or the "
    "option `--filter FILE.py`)"
)
"""How a roster gets a filter of the user's own."""


class SilentProgramError(UserError):
    """A program does not answer the first line of the protocol: it runs on no problem of a suite."""


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
                remove_filter(source, label)
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
            idle_keys = idle_set_keys(assembled, error)
            if idle_keys:
                for keys in idle_keys:
                    _remove_key(source, keys)
                idle += map(dotted, idle_keys)
                continue
            misfits = _misfits(source, error)
            if misfits.mistakes:
                raise UserError(*misfits.mistakes) from None
            left_out |= misfits.reasons
            for label in misfits.reasons:
                remove_filter(source, label)
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


def _remove_key(source: Source, keys: Keys) -> None:
    """Remove a key that exists from the config."""
    owner = source.value_at(keys[:-1])
    assert isinstance(owner, dict)
    del owner[keys[-1]]


class _Misfits(NamedTuple):
    """Filters that do not fit a problem, and mistakes that would stay without these filters."""

    reasons: dict[str, str]
    """why a filter does not fit, by label; several mistakes of a filter are one reason"""
    mistakes: list[Problem | str]


def _misfits(source: Source, error: UserError) -> _Misfits:
    """Find the filters that do not fit a problem, from the mistakes in its config.

    Leaving out filters does not help if a mistake lies outside their entries, or in that of the
    reference filter, as no problem is run without its reference. ``source`` is the problem's config.
    """
    reference = source.data.get("reference")
    labels = [*source.data["filters"]]
    labels += [f"{label}, smoothed" for label in source.data.get("smoothed", ())]
    # Step 1: the mistakes of each filter, and other ones.
    messages: dict[str, list[str]] = {}
    others: list[Problem | str] = []
    for problem in error.problems:
        if not isinstance(problem, Problem):  # a text that names no place in the config
            others.append(problem)
            continue
        label = _label_of(problem.path, {f"filters.{label}": label for label in labels})
        if is_unknown_kind(problem):
            # No scenario lacks a kind: its plugin is missing, or a letter is wrong.
            others.append(replace(problem, message=f"{problem.message}{_WAY_TO_PLUGIN}"))
        elif label is None or label == reference:
            others.append(problem)
        else:
            # A key of the user's own filter has the option that sets it, as the label stands alone.
            is_set = problem.mark.file.startswith("--set ")
            message = f"{problem.mark}: {problem.message}" if is_set else problem.message
            messages.setdefault(label, []).append(message)
    # Step 2: a filter that does not fit has its mistakes in its tuned copy, and at the values that are
    # tried first, too. Those are left out with the filter.
    tuned_places: dict[str, str] = {}
    for label in messages:
        tuned_places[f"filters.{tuned_label(label)}"] = label
        tuned_places[f"tune.{label}"] = label
    mistakes = []
    for other in others:
        path = other.path if isinstance(other, Problem) else ""
        if _label_of(path, tuned_places) is None:
            mistakes.append(other)
    reasons = {label: "; and ".join(dict.fromkeys(lines)) for label, lines in messages.items()}
    return _Misfits(reasons=reasons, mistakes=mistakes)


def _label_of(path: str, places: Mapping[str, str]) -> str | None:
    """Return the label of the filter whose place in the config ``path`` is or lies in; None if none is.

    ``places`` has the labels by their places, such as ``filters.EKF``.
    """
    owners = [place for place in places if f"{path}.".startswith(f"{place}.")]
    # A label may have dots: of the labels `a` and `a.b` the longer one is meant.
    return places[max(owners, key=len)] if owners else None


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
