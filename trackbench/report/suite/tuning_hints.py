"""Hints on tuning in a suite: where it is unfair, in vain, or makes the user's filter worse."""

from collections.abc import Sequence

from trackbench.report.findings.phrases import joined
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
    roster = [other for other in group.labels(FILTER) if other not in group.added]
    if not roster:  # all filters are the user's own
        return []
    unfair_to_own = []
    unfair_to_roster = []
    for problem in problems:
        tuned = group.tuned.get(problem, ())
        is_roster_tuned = any(other in tuned for other in roster)
        if is_roster_tuned and label not in tuned:
            unfair_to_own.append(problem)
        if label in tuned and not is_roster_tuned:
            unfair_to_roster.append(problem)
    lines = []
    if unfair_to_own:
        place = _on_problems(unfair_to_own, problems)
        lines.append(
            f"The filters of the roster are tuned {place}, and yours is not: --set "
            f"'groups.{group.group}.tune.{label}={{KEY: log:LOW..HIGH}}' tunes a key of it."
        )
    if unfair_to_roster:
        place = _on_problems(unfair_to_roster, problems)
        lines.append(f"Your filter is tuned {place}, and those of the roster are not.")
    return lines


def _on_problems(chosen: Sequence[str], problems: Sequence[str]) -> str:
    """Return ``on each problem`` if all ``problems`` are chosen, or the names of the chosen ones."""
    if len(chosen) == len(problems):
        return "on each problem"
    return f"on {joined(chosen)}"
