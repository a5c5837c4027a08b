"""Hints on tuning in a suite: where it is unfair, in vain, or makes the user's filter worse."""

from collections.abc import Sequence

from trackbench.report.findings.phrases import joined, named, verb
from trackbench.report.suite.scores import FILTER, SuiteScores
from trackbench.statistics.holm_correction import as_family
from trackbench.tuning.remarks_on_keys import remark_on_failures


def tuning_hints(group: SuiteScores, label: str, problems: Sequence[str]) -> list[str]:
    """Return sentences on the problems where tuning is unfair or in vain, or makes the filter worse.

    It is unfair if only the roster is tuned, or only the user's own filter. It is in vain if trials fail
    or a key has no effect. ``problems`` are those that this filter ran on.
    """
    return [
        *_unfair_hints(group, label, problems),
        *_vain_hints(group, label, problems),
        *_worse_hints(group, label),
    ]


def _vain_hints(group: SuiteScores, label: str, problems: Sequence[str]) -> list[str]:
    """Return sentences on keys that have no effect, and on trials of the tuned filter that failed.

    Of several problems with failed trials the first one has numbers and the reason.
    """
    idle: dict[str, list[str]] = {}  # problems by key
    failing: dict[str, str] = {}  # remark on the failed trials by problem
    for problem, runs in group.runs.items():
        record = runs.tuning.get(label)
        if record is None:
            continue
        if record.failed_trials:
            failing[problem] = remark_on_failures(record)
        for key in record.keys_without_effect:
            idle.setdefault(key, []).append(problem)
    lines = []
    for key, of_key in idle.items():
        lines.append(
            f"Tuning of {key} has no effect {_on_problems(of_key, problems)}: trials with different "
            "values of it have an equal metric. Check that the filter reads this key."
        )
    if failing:
        first, *others = failing
        also = f" Trials fail on {joined(others)}, too." if others else ""
        lines.append(f"In the tuning on {first} {failing[first]}.{also}")
    return lines


def _worse_hints(group: SuiteScores, label: str) -> list[str]:
    """Return a sentence on the problems where the tuned filter is significantly worse than untuned.

    The list is empty if there are none.
    """
    gains = {
        problem: runs.gains[label] for problem, runs in group.runs.items() if label in runs.gains
    }
    # The comparisons of all problems are tested together.
    worse = [problem for problem, gain in as_family(gains).items() if gain.sign > 0]
    if not worse:
        return []
    errors = [
        f"{problem} ({gains[problem].a.value:.4g} in place of {gains[problem].b.value:.4g})"
        for problem in worse
    ]
    return [
        f"Tuning makes it significantly worse on {joined(errors)}. More trials or a narrower range may "
        f"help. The search begins at the value of --set filters.{label}.KEY=VALUE, or without it in the "
        "middle of the range."
    ]


def _unfair_hints(group: SuiteScores, label: str, problems: Sequence[str]) -> list[str]:
    """Return sentences on the problems where only the roster is tuned, or only the user's own filter.

    ``problems`` are those that the user's own filter ran on.
    """
    if all(other in group.added for other in group.labels(FILTER)):
        return []
    # Problems by the labels of the roster that are tuned there, and of those that are not.
    unfair_to_own: dict[str, list[str]] = {}
    unfair_to_roster: dict[str, list[str]] = {}
    for problem in problems:
        tuned, untuned = _tuned_and_untuned(group, problem)
        if tuned and label not in group.tuned.get(problem, ()):
            words = "The filters of the roster are"
            if untuned:
                words = f"{joined([*map(named, tuned)])} {verb(tuned)}"
            unfair_to_own.setdefault(words, []).append(problem)
        if untuned and label in group.tuned.get(problem, ()):
            words = "those of the roster are"
            if tuned:
                words = f"{joined([*map(named, untuned)])} {verb(untuned)}"
            unfair_to_roster.setdefault(words, []).append(problem)
    lines = []
    for words, chosen in unfair_to_own.items():
        lines.append(
            f"{words} tuned {_on_problems(chosen, problems)}, and yours is not: --set "
            f"'groups.{group.group}.tune.{label}={{KEY: log:LOW..HIGH}}' tunes a key of it."
        )
    for words, chosen in unfair_to_roster.items():
        place = _on_problems(chosen, problems)
        lines.append(f"Your filter is tuned {place}, and {words} not.")
    return lines


def _tuned_and_untuned(group: SuiteScores, problem: str) -> tuple[list[str], list[str]]:
    """Return the labels of the roster that are tuned on a problem, and those that are not.

    The user's own filters, and filters that the problem leaves out, are in neither list.
    """
    tuned: list[str] = []
    untuned: list[str] = []
    for score in group.of_role(FILTER):
        if score.problem != problem or score.is_left_out or score.label in group.added:
            continue
        labels = tuned if score.label in group.tuned.get(problem, ()) else untuned
        labels.append(score.label)
    return tuned, untuned


def tuning_note(group: SuiteScores) -> list[str]:
    """Return a sentence that names the tuned filters of a group, and where; none without any."""
    filters_by_place: dict[str, list[str]] = {}
    is_any_untuned = False
    for label in group.labels(FILTER):
        of_filter = [score for score in group.of_role(FILTER) if score.label == label]
        problems = [score.problem for score in of_filter if not score.is_left_out]
        tuned = [problem for problem in problems if label in group.tuned.get(problem, ())]
        if tuned:
            filters_by_place.setdefault(_on_problems(tuned, problems), []).append(named(label))
        if len(tuned) < len(problems):
            is_any_untuned = True
    if not filters_by_place:
        return []
    if not is_any_untuned:
        return ["All filters are tuned on each problem."]
    parts = [f"{joined(labels)} {place}" for place, labels in filters_by_place.items()]
    return [f"Tuned: {'; '.join(parts)}. All other values are those of the suite."]


def _on_problems(chosen: Sequence[str], problems: Sequence[str]) -> str:
    """Return ``on each problem`` if all ``problems`` are chosen, or the names of the chosen ones."""
    if len(chosen) == len(problems):
        return "on each problem"
    return f"on {joined(chosen)}"
